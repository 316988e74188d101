"""Machines and short runs that several tests use."""

from __future__ import annotations

from pathlib import Path

import deltatwin as dt
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]

MOTION = """
[motion]
kind = "fourier"
frequency = 0.5
centre = [0.0, 0.0, -1.05, 0.0]
sine = [[0.15, 0.05, 0.03, 1.0], [0.02, 0.06, 0.01, 0.2]]
cosine = [[0.05, 0.12, 0.0, 0.3], [0.01, -0.03, 0.02, 0.1]]
"""


def scenario(seed: int, duration: float = 4.0, motion: str = MOTION) -> str:
    """A scenario as text, on the shipped robot."""
    return f'model = "models/irb360-6-1600.toml"\nduration = {duration}\nseed = {seed}\n{motion}'


@pytest.fixture(scope="session")
def model() -> dt.Model:
    return dt.Model.builtin("irb360-6-1600")


@pytest.fixture(scope="session")
def states() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two hundred states within the joint limits."""
    rng = np.random.default_rng(1)
    q = rng.uniform([-0.1, -0.1, -0.1, -2.0], [0.8, 0.8, 0.8, 2.0], (200, 4))
    return q, rng.uniform(-3, 3, (200, 4)), rng.uniform(-50, 50, (200, 4))


@pytest.fixture(scope="session")
def hidden() -> dt.Model:
    """A robot with friction in its ball sockets."""
    return dt.Model.builtin("irb360-6-1600").with_effect("ball_socket_coulomb", moment=0.15)


@pytest.fixture(scope="session")
def runs(model: dt.Model, hidden: dt.Model) -> tuple[dt.Recording, dt.Recording]:
    """A measurement of that robot, and one to judge by."""

    def run(seed: int, motion: str = MOTION) -> dt.Recording:
        run = dt.simulate(scenario(seed, 6.0, motion), model=hidden, controller=model, folder=ROOT)
        assert run.status == "completed"
        return run.recording

    other = MOTION.replace("0.15, 0.05, 0.03, 1.0", "0.05, -0.14, 0.04, 0.8")
    return run(1), run(2, other)
