"""The simulator next to reference torques, and next to `deltatwin compare` without noise.

    python verify.py MODEL tests/reference --program deltatwin
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import warnings

import numpy as np
from cell import Drives, Logger, record, run
from machine import nominal
from motions import KINDS, motion
from plant import inverse

warnings.filterwarnings("ignore")


def references(base, folder):
    """Largest differences to tables of states and torques."""
    none = base._replace(coulomb=np.zeros(3), viscous=np.zeros(3), a_c=0.0, a_v=0.0, bar_coulomb=0.0, bar_viscous=0.0)
    cases = {
        "rigid_no_payload": none,
        "rigid_payload": none._replace(load_m=2.5, load_x=0.03, load_y=-0.02, load_zz=0.012),
        "friction_no_payload": base,
    }
    for name, plant in cases.items():
        table = np.genfromtxt(pathlib.Path(folder) / f"{name}.csv", delimiter=",", names=True)
        q, qd, qdd, tau = (np.stack([table[f"{stem}{i}"] for i in (1, 2, 3, 4)], axis=1) for stem in ("q", "qd", "qdd", "tau"))
        ours = np.array([inverse(plant, *row) for row in zip(q, qd, qdd)])
        print(f"{name}: largest difference {np.abs(ours - tau).max():.1e} of {np.abs(tau).max():.0f} N·m")


def compared(base, model, program):
    """RMS residuals of deltatwin on closed-loop recordings without noise and with exact angles."""
    fine = np.full(4, 1e-12)
    drives = Drives(rate=5000.0, kp=np.full(4, 30.0), kv=np.array([30, 30, 30, 0.3]), ki=np.full(4, 5.0), cut=200.0,
                    inertia=np.array([0.5, 0.5, 0.5, 0.003]), weight=np.array([12, 12, 12, 0.0]),
                    rub=np.array([4, 4, 4, 0.4]), step=fine, limit=np.array([132, 132, 132, 45.0]), late=0)
    log = Logger(every=1, encoder=fine, jitter=0.0, noise="none", sigma=np.zeros(4), tau=0.01, correlation=0.0, quantum=np.zeros(4))
    rng = np.random.default_rng(3)
    for kind in KINDS:
        states, torques = run(base, drives, motion(base, rng, kind, drives.rate, 8, 1.0), np.zeros(4))
        # Torques are held: at the instant of a sample they step, and their mean acts.
        torques[1:] = (torques[1:] + torques[:-1]) / 2
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "run.csv"
            record(file, rng, drives, states, torques, log, np.zeros(4), np.ones(4), 0.0, 0.0)
            said = json.loads(subprocess.run([program, "compare", model, file, "--json"], capture_output=True, text=True, check=True).stdout)
        print(f"{kind}: residual of deltatwin, RMS in N·m", " ".join(f"{r:.1e}" for r in said["rms"]),
              "of", " ".join(f"{r:.1f}" for r in torques.std(axis=0)))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model")
    parser.add_argument("references")
    parser.add_argument("--program", default="deltatwin")
    options = parser.parse_args()
    base = nominal(options.model)
    references(base, options.references)
    compared(base, options.model, options.program)


if __name__ == "__main__":
    main()
