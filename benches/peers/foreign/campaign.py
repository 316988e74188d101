"""Draws of robots, effects, motions, controllers and loggers; a recording to fit to and one held out, from one seed."""

import json
import pathlib

import numpy as np

from cell import Drives, Logger, record, run
from machine import nominal
from motions import KINDS, motion

# Control rate in Hz, cycles per written sample.
RATES = [(2500, 1), (5000, 2), (2000, 1), (2500, 2), (4000, 4), (2000, 2), (3000, 4), (2000, 4), (2500, 5)]


def spread(rng, value, part):
    """A number or array times independent factors within ± part."""
    return value * rng.uniform(1 - part, 1 + part, np.shape(value))


def measured(base, rng):
    """A machine of the type: bodies ± 10 %, friction ± 40 % and other for every drive; all limbs alike."""
    one = lambda value: value * rng.uniform(0.9, 1.1)
    bodies = "arm_x arm_z arm_i pair_m pair_mc pair_i plate_m upper_mc upper_i lower_m lower_mc lower_i rotor".split()
    plant = base._replace(**{name: one(getattr(base, name)) for name in bodies})
    rub = {name: spread(rng, getattr(base, name), 0.4) for name in ("coulomb", "viscous")}
    plant = plant._replace(**rub, a_c=one(base.a_c), a_v=one(base.a_v), bar_coulomb=one(base.bar_coulomb),
                           bar_viscous=one(base.bar_viscous))
    if rng.uniform() < 0.3:
        x, y = rng.uniform(-0.04, 0.04, 2)
        plant = plant._replace(load_m=rng.uniform(0.5, 2.5), load_x=x, load_y=y, load_zz=rng.uniform(0.001, 0.01))
    return plant


def some(rng, low, high, all_arms):
    """A size for all arms, each its own, or for a single one."""
    size = rng.uniform(low, high, 3)
    return size if all_arms else size * np.eye(3)[rng.integers(3)]


def hide(name, plant, rng):
    """The machine with an effect of the given name, what it changes on the sensors, and the numbers for the record."""
    sensors = {}
    phase = rng.uniform(0, 2 * np.pi, 3)
    sign = rng.choice([-1, 1], 3)
    everywhere = rng.uniform() < 0.5
    change = {}
    match name:
        case "none":
            pass
        case "viscous_curve":
            change = {"power": some(rng, 3, 8, True), "exponent": rng.choice([rng.uniform(0.3, 0.5), rng.uniform(1.7, 2.2)])}
        case "drive_stribeck":
            change = {"stribeck": some(rng, 1.5, 4, everywhere), "stribeck_speed": rng.uniform(0.05, 0.3),
                      "stribeck_shape": rng.choice([1.0, 2.0])}
        case "drive_coulomb_asymmetry":
            change = {"asymmetry": some(rng, 0.6, 2, everywhere) * sign}
        case "cogging":
            change = {"cogging": some(rng, 0.5, 1.5, everywhere), "cogging_phase": phase,
                      "cogging_order": 33.0 * rng.choice([4, 6, 12])}
        case "ball_socket_coulomb":
            change = {"socket": rng.uniform(0.08, 0.3)}
        case "hose_spring":
            change = {"hose": rng.uniform(15, 50), "hose_preload": rng.uniform(2, 10),
                      "hose_at": np.array([rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.2)])}
        case "payload_com_offset":
            mass = plant.load_m or rng.uniform(0.8, 2.5)
            change = {"load_m": mass, "load_zz": plant.load_zz or 0.004}
            sensors["stated"] = {"mass": mass, "com": [plant.load_x, plant.load_y], "inertia_zz": change["load_zz"]}
            change |= {"load_x": plant.load_x + rng.uniform(0.02, 0.06) * sign[0],
                       "load_y": plant.load_y + rng.uniform(0.02, 0.06) * sign[1]}
        case "limb_asymmetry":
            mass = rng.uniform(0.08, 0.4) * np.eye(3)[rng.integers(3)]
            part = 1 + mass / plant.pair_m
            change = {"pair_m": plant.pair_m * part, "pair_mc": plant.pair_mc * part, "pair_i": plant.pair_i * part}
        case "base_tilt":
            x, y = rng.uniform(0.01, 0.04, 2) * sign[:2]
            g = -plant.gravity[2]
            change = {"gravity": g * np.array([np.sin(y), -np.sin(x), -np.sqrt(1 - np.sin(x) ** 2 - np.sin(y) ** 2)])}
        case "drive_elasticity":
            change = {"gear": np.full(3, rng.uniform(1.2e4, 4e4)), "motor": plant.arm_i * rng.uniform(0.65, 0.75)}
            change["gear_damping"] = change["gear"] * rng.uniform(5e-4, 1.5e-3)
        case "backlash_hysteresis":
            torque = some(rng, 1.0, 3.0, True)
            change = {"bristle_torque": torque, "bristle": torque / rng.uniform(0.005, 0.03)}
        case "torque_gain_error":
            sensors["gain"] = 1 + rng.uniform(0.04, 0.12) * sign[0] * np.eye(4)[rng.integers(3)]
        case "joint_zero_offset":
            sensors["offset"] = rng.uniform(0.015, 0.06) * sign[0] * np.eye(4)[rng.integers(3)]
        case "torque_filter":
            sensors["low_pass"] = rng.uniform(12, 50)
        case "signal_delay":
            sensors["delay"] = rng.uniform(2e-3, 6e-3)
        case "unknown_bumps":
            n = 6
            bumps = np.column_stack([rng.uniform(-0.4, 1.2, n), rng.uniform(0.1, 0.3, n), rng.uniform(-2.5, 2.5, n)])
            change = {"bumps": bumps, "bumps_on": int(rng.integers(3))}
        case "unknown_crosstalk":
            change = {"cross": some(rng, 0.5, 1.5, False)}
        case _:
            raise ValueError(f"no effect {name}")
    truth = {k: np.asarray(v).tolist() for k, v in (change | sensors).items() if k != "stated"}
    return plant._replace(**change), sensors, truth


def controller(rng, rate, step, load):
    """A cascade with a rough feed-forward; drives that close on coarse encoders have slower filters."""
    inside = np.minimum(step, 1e-4) if rng.uniform() < 0.5 else np.minimum(step, 1e-5)
    coarse = inside.max() > 3e-5
    inertia = np.array([0.45, 0.45, 0.45, 0.0033]) + load * np.array([0.1, 0.1, 0.1, 0.003])
    bandwidth = rng.uniform(50, 70) if coarse else rng.uniform(70, 130)  # rad/s
    four = lambda low, high, last: np.append(np.full(3, rng.uniform(low, high)), rng.uniform(*last))
    guess = rng.choice([0.0, 1.0, 1.0])
    return Drives(rate=float(rate), kp=np.full(4, bandwidth / rng.uniform(3.5, 5)), kv=bandwidth * inertia,
                  ki=np.full(4, bandwidth / rng.uniform(6, 15)), cut=rng.uniform(60, 100) if coarse else rng.uniform(100, 300),
                  inertia=guess * inertia * rng.uniform(0.5, 1.2, 4), weight=four(8, 20, (0, 1e-12)),
                  rub=guess * four(2, 6, (0.2, 0.6)), step=inside, limit=np.array([132, 132, 132, 45.0]),
                  late=int(rng.integers(2)))


def follow(plant, rng, drives, kind, offset):
    """Runs a random motion; slower ones are drawn until the controller keeps to it."""
    quick, seconds = rng.uniform(0.6, 1.2), rng.uniform(6, 20)
    for _ in range(6):
        ref = motion(plant, rng, kind, drives.rate, seconds, quick)
        try:
            return run(plant, drives, ref, offset)
        except RuntimeError as error:
            last, quick = error, 0.75 * quick
    raise last


def logger(rng, every, noise, step):
    """Noise of one kind, other on every axis."""
    jitter = 10 ** rng.uniform(-6, -4.7) if rng.uniform() < 0.3 else 0.0
    arms = np.append(np.ones(3), 0.1)
    if noise == "quantised":
        sigma, quantum = rng.uniform(0.02, 0.1) * arms, 10 ** rng.uniform(-2, -1) * arms
    else:
        sigma, quantum = 10 ** rng.uniform(-1, -0.2) * arms, np.zeros(4)
    return Logger(every=every, encoder=step, jitter=jitter, noise=noise, sigma=sigma * rng.uniform(0.5, 1.6, 4),
                  tau=10 ** rng.uniform(-2.7, -1.3), correlation=rng.choice([0.0, rng.uniform(0, 0.6)]), quantum=quantum)


def make(model, effect, seed, folder):
    """Writes fit.csv, val.csv, their setups and truth.json; everything follows from effect and seed. Several effects are
    joined by "+"."""
    rng = np.random.default_rng([seed, sum(map(ord, effect))])
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    plant = measured(nominal(model), rng)
    sensors, sizes = {"offset": np.zeros(4), "gain": np.ones(4), "low_pass": 0.0, "delay": 0.0}, {}
    for name in effect.split("+"):
        plant, changed, numbers = hide(name, plant, rng)
        sensors, sizes = sensors | changed, sizes | numbers
    rate, every = RATES[rng.integers(len(RATES))]
    step = 10 ** rng.uniform(-5, -3) * rng.uniform(0.5, 2, 4)
    noise = ["white", "coloured", "quantised"][seed % 3]
    log, drives = logger(rng, every, noise, np.clip(step, 1e-5, 1e-3)), controller(rng, rate, step, plant.load_m)
    stated = sensors.pop("stated", None)
    if stated is None and plant.load_m:
        stated = {"mass": plant.load_m, "com": [plant.load_x, plant.load_y], "inertia_zz": plant.load_zz}
    truth = {"effect": effect, "seed": seed, "sizes": sizes, "rate": rate / every, "control": rate, "noise": noise,
             "sigma": log.sigma.tolist(), "quantum": log.quantum.tolist(), "tau": log.tau, "encoder": log.encoder.tolist(),
             "loop_encoder": drives.step.tolist(), "jitter": log.jitter, "late": drives.late, "payload": stated, "motions": []}
    kind = list(KINDS)[rng.integers(3)]
    for name in ("fit", "val"):
        kind = kind if rng.uniform() < 0.6 else list(KINDS)[rng.integers(3)]
        states, torques = follow(plant, rng, drives, kind, sensors["offset"])
        record(folder / f"{name}.csv", rng, drives, states, torques, log, **sensors)
        truth["motions"].append({"kind": kind, "seconds": round(len(states) / rate, 2), "peak": np.abs(torques).max(axis=0).tolist()})
        setup = 'configuration = "assembled"\n'
        if stated:
            x, y = stated["com"]
            setup += f"[payload]\nmass = {stated['mass']:.6f}\ncom = [{x:.6f}, {y:.6f}, 0.0]\ninertia_zz = {stated['inertia_zz']:.6f}\n"
        (folder / f"{name}.setup.toml").write_text(setup)
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return truth
