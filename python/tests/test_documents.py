"""Examples print what is committed beside them, and the blocks of the READMEs run."""

from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from pathlib import Path

import deltatwin as dt
import pytest
from conftest import ROOT

EXAMPLES = ROOT / "python" / "examples"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def blocks(file: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", file.read_text(), re.DOTALL)


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda p: p.stem)
def test_examples_print_what_is_committed(script):
    """Words are the same; numbers agree within what another machine's rounding can do to an iteration."""
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=600, cwd=ROOT, check=False)
    assert run.returncode == 0, run.stderr
    output = script.with_suffix(".out")
    if os.environ.get("ACCEPT_SNAPSHOTS"):
        output.write_text(run.stdout)
    expected = output.read_text()
    assert NUMBER.sub("#", run.stdout).split() == NUMBER.sub("#", expected).split()
    for own, other in zip(NUMBER.findall(run.stdout), NUMBER.findall(expected), strict=True):
        assert float(own) == pytest.approx(float(other), rel=0.05, abs=0.02)


def test_blocks_of_the_package(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    own: dict[str, object] = {}
    found = blocks(ROOT / "python" / "README.md")
    assert len(found) == 3
    for block in found:
        exec(compile(block, "python/README.md", "exec"), own)  # noqa: S102


def test_block_of_the_main_page(tmp_path, monkeypatch, runs):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(ROOT / "models")
    for name, recording in zip(("run1.csv", "run2.csv"), runs, strict=True):
        recording.write(tmp_path / name)
    (block,) = blocks(ROOT / "README.md")
    exec(compile(block, "README.md", "exec"), {})  # noqa: S102
    assert dt.Model.load(tmp_path / "better.toml").history == ["ball_socket_coulomb"]


def test_examples_of_docstrings():
    runner = doctest.DocTestRunner()
    texts = {"deltatwin": dt.__doc__, "with_effect": dt.Model.with_effect.__doc__}
    for name, text in texts.items():
        case = doctest.DocTestParser().get_doctest(text or "", {"dt": dt}, name, None, 0)
        assert case.examples, name
        runner.run(case)
    assert runner.summarize().failed == 0


def test_docstrings_say_what_is_needed():
    for name in ("inverse_dynamics", "mass_matrix", "forward_dynamics", "jacobian", "regressor", "constraint_forces"):
        text = getattr(dt.Model, name).__doc__ or ""
        assert "(n," in text or "``(n" in text, name
        assert "Counterpart" in text and ("pinocchio" in text or "mujoco" in text), name
    for name in dt.__all__:
        own = getattr(dt, name)
        assert isinstance(own, str) or own.__doc__, name
