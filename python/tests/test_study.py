"""Studies: chunks are pure, engines give the same bytes."""

from __future__ import annotations

import contextlib
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import deltatwin as dt
import pytest
from conftest import ROOT
from deltatwin._study import keep

SMOKE = ROOT / "scenarios" / "studies" / "smoke.toml"


def digest(folder: Path) -> str:
    return hashlib.sha256((folder / "runs.parquet").read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> str:
    """Digest of the table that one process makes."""
    folder = tmp_path_factory.mktemp("alone")
    table = dt.study(SMOKE, folder)
    assert len(table) == 12 and {"mass", "offset", "survived", "margin"} <= set(table.names)
    assert dt.study(SMOKE, folder)["margin"].tolist() == table["margin"].tolist()
    return digest(folder)


def test_chunks_of_any_number_give_the_same_table(alone, tmp_path):
    plan = dt.StudyPlan(SMOKE, tmp_path)
    for number in (3, 1, 5, 2, 4):
        files = dt.compute_chunk(str(SMOKE), plan.digest, number, 5)
        assert files == dt.compute_chunk(str(SMOKE), plan.digest, number, 5, threads=2)
        keep(tmp_path, files)
        keep(tmp_path, files)
    plan.merge()
    assert digest(tmp_path) == alone


def test_what_is_missing_is_told(tmp_path):
    plan = dt.StudyPlan(SMOKE, tmp_path)
    plan.chunk(1, 4)
    with pytest.raises(ValueError, match="9 of 12 runs are missing"):
        plan.merge()
    with pytest.raises(ValueError, match="chunk 5 of 4"):
        plan.chunk(5, 4)
    with pytest.raises(ValueError, match="expected the same files"):
        dt.compute_chunk(str(SMOKE), "0" * 64, 1, 4)
    with pytest.raises(ValueError, match="the same deltatwin on every node"):
        dt.compute_chunk(str(SMOKE), plan.digest, 1, 4, build="0" * 64)
    with pytest.raises(FileNotFoundError):
        dt.StudyPlan(tmp_path / "missing.toml", tmp_path)


EXAM = {"effects": ["torque_bias"], "seeds": 1, "null": 1, "fast_null": 1, "duration": 3.0, "noise": ["white", "drift"]}


@pytest.fixture(scope="module")
def examined(tmp_path_factory) -> str:
    """Digest of the table of an exam that one process makes."""
    folder = tmp_path_factory.mktemp("examined")
    table = dt.exam(ROOT / "models" / "irb360-6-1600.toml", folder, **EXAM)
    assert len(table) == 3 and table["hidden"][1] == "torque_bias"
    assert set(table["campaign"]) == {p.parent.name for p in folder.rglob("truth.json")}
    # A finished exam is only read.
    assert dt.exam(dt.Model.builtin("irb360-6-1600"), folder, **EXAM)["grade"] == table["grade"]
    with pytest.raises(ValueError, match="another study"):
        dt.exam(dt.Model.builtin("irb360-6-1600"), folder, **{**EXAM, "seed": 2})
    return digest(folder)


def test_an_exam_in_chunks_is_the_same(examined, tmp_path):
    plan = dt.StudyPlan.of_exam(dt.Model.builtin("irb360-6-1600"), tmp_path, **EXAM)
    assert plan.runs == 3 and plan.study is None and not plan.is_search
    for number in (2, 1):
        plan.chunk(number, 2, threads=1, progress=False)
    plan.merge()
    assert digest(tmp_path) == examined


def test_what_cannot_be_examined_is_refused(tmp_path):
    model = dt.Model.builtin("irb360-6-1600")
    with pytest.raises(dt.ModelError, match="cannot hide `gremlins`"):
        dt.exam(model, tmp_path, effects=["gremlins"])
    with pytest.raises(dt.ModelError, match="assembled delta"):
        dt.exam(dt.Model.builtin("servo-axis"), tmp_path, effects=[])
    with pytest.raises(ValueError, match='sizes is "huge"; expected one of small, medium, large'):
        dt.exam(model, tmp_path, sizes=["huge"])
    with pytest.raises(dt.ModelError, match="duration is 0.1"):
        dt.exam(model, tmp_path, duration=0.1)


@pytest.mark.skipif(shutil.which("parallel") is None, reason="GNU parallel is not installed")
def test_gnu_parallel(alone, tmp_path):
    line = (
        f"{sys.executable} -c \"import deltatwin as dt, sys; "
        f"dt.StudyPlan('{SMOKE}', '{tmp_path}').chunk(int(sys.argv[1]), 4, threads=1, progress=False)\" {{}}"
    )
    subprocess.run(["parallel", "-j2", line, ":::", "1", "2", "3", "4"], check=True, timeout=300)
    dt.StudyPlan(SMOKE, tmp_path).merge()
    assert digest(tmp_path) == alone


# Ray: three nodes on this machine, of which one is killed hard again and again.

os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
# Workers as prompt as the rest of a busy machine.
os.environ["RAY_worker_niceness"] = "0"
ray = pytest.importorskip("ray", reason="Ray is not installed")
KILLS = int(os.environ.get("DELTATWIN_KILLS", "3"))


class Cluster:
    """A head and workers, each with one processor, reachable from this machine only."""

    def __init__(self) -> None:
        from ray.cluster_utils import Cluster as Own

        self.own = Own(
            initialize_head=True,
            head_node_args={"num_cpus": 1, "node_ip_address": "127.0.0.1", "include_dashboard": False},
        )
        self.workers = [self.own.add_node(num_cpus=1, node_ip_address="127.0.0.1") for _ in range(2)]
        self.own.wait_for_nodes()

    def kill(self) -> None:
        """Kill the raylet of one worker with SIGKILL, and start another node in its place."""
        if self.workers:
            node = self.workers.pop(random.randrange(len(self.workers)))
            for own in node.all_processes.get("raylet", []):
                os.kill(own.process.pid, signal.SIGKILL)
            with contextlib.suppress(Exception):  # it is dead already
                self.own.remove_node(node, allow_graceful=False)
        with contextlib.suppress(Exception):  # a busy machine may not start a node in time; the head goes on alone
            self.workers.append(self.own.add_node(num_cpus=1, node_ip_address="127.0.0.1"))


def test_an_exam_on_ray_is_the_same(examined, tmp_path):
    """Nodes are sent the model; its recordings stay with them."""
    try:
        ray.init(address="local", _node_ip_address="127.0.0.1", num_cpus=2, include_dashboard=False, log_to_driver=False)
        assert {node["NodeManagerAddress"] for node in ray.nodes()} == {"127.0.0.1"}
        dt.exam(dt.Model.builtin("irb360-6-1600"), tmp_path, **EXAM, ray="auto", chunks=3)
    finally:
        ray.shutdown()
    assert digest(tmp_path) == examined
    assert len(list(tmp_path.rglob("answer.json"))) == 3 and not list(tmp_path.rglob("*.csv"))


def test_nodes_may_die(alone, tmp_path):
    """Studies run one after another while workers are killed; every table is that of one process."""
    cluster = Cluster()
    digests: list[str] = []
    stop = threading.Event()

    def studies() -> None:
        while not stop.is_set():
            folder = tmp_path / str(len(digests))
            dt.study(SMOKE, folder, ray="auto", chunks=12)
            digests.append(digest(folder))

    thread = threading.Thread(target=studies)
    try:
        ray.init(address=cluster.own.address, log_to_driver=False)
        assert {node["NodeManagerAddress"] for node in ray.nodes()} == {"127.0.0.1"}
        thread.start()
        for _ in range(KILLS):
            time.sleep(random.uniform(0.3, 2.0))
            cluster.kill()
        stop.set()
        thread.join(timeout=300)
        assert not thread.is_alive()
    finally:
        stop.set()
        ray.shutdown()
        cluster.own.shutdown()
    print(f"{KILLS} kills during {len(digests)} studies")
    assert digests and set(digests) == {alone}
