"""Inverse dynamics of 50 000 states by the Rust library and by the Python package: time, ratio, and the same bits.

One thread, the same states, both built with the same profile; the two take turns, and the best time of each counts.

    pip install ./python
    python benches/peers/side_by_side.py          # --profile dev for a package built with that
"""

import argparse
import os
import subprocess
import tempfile
import time
from pathlib import Path

os.environ["RAYON_NUM_THREADS"] = "1"

import deltatwin as dt
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "models" / "irb360-6-1600.toml"
STATES, TURNS, REPETITIONS = 50_000, 10, 3
ALLOWED = 1.3


def states() -> np.ndarray:
    """q, q̇, q̈ of all axes per state, within the joint limits."""
    rng = np.random.default_rng(1)
    q = rng.uniform([-0.1, -0.1, -0.1, -2.0], [0.8, 0.8, 0.8, 2.0], (STATES, 4))
    return np.hstack([q, rng.uniform(-3, 3, (STATES, 4)), rng.uniform(-50, 50, (STATES, 4))])


def main() -> None:
    """Print both times and their ratio; fail if they differ in a bit or the ratio is above what is allowed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--profile", default="python", help="profile of cargo, that of the installed package")
    profile = parser.parse_args().profile
    build = ["cargo", "build", "--locked", "--profile", profile, "--example", "side_by_side"]
    subprocess.run(build, cwd=ROOT, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    program = target / ("debug" if profile == "dev" else profile) / "examples" / "side_by_side"
    all_states = states()
    q, qd, qdd = (np.ascontiguousarray(all_states[:, k : k + 4]) for k in (0, 4, 8))
    model = dt.Model.load(MODEL)
    rust = python = np.inf
    with tempfile.TemporaryDirectory() as folder:
        given, got = Path(folder) / "states", Path(folder) / "torques"
        all_states.tofile(given)
        for _ in range(TURNS):
            run = subprocess.run(
                [program, MODEL, given, got, str(REPETITIONS)], check=True, capture_output=True, text=True
            )
            rust = min(rust, float(run.stdout))
            for _ in range(REPETITIONS):
                start = time.perf_counter()
                torques = model.inverse_dynamics(q, qd, qdd)
                python = min(python, time.perf_counter() - start)
        same = np.array_equal(np.fromfile(got).reshape(-1, 4), torques)
    print(f"{STATES} states, one thread: Rust {1e3 * rust:.1f} ms, Python {1e3 * python:.1f} ms")
    print(f"ratio {python / rust:.2f}, {'the same bits' if same else 'DIFFERENT RESULTS'}")
    if not same or python > ALLOWED * rust:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
