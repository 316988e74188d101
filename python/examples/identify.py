"""Identify a robot: design a motion, record it, estimate the parameters, and compare them with the truth.

The robot is a twin whose friction and masses differ from the model's by some percent; of a real robot, read the
recordings with ``dt.Recording.read``.
"""

from pathlib import Path

import deltatwin as dt
import numpy as np

MODELS = Path(__file__).resolve().parents[2] / "models"
model = dt.Model.load(MODELS / "irb360-6-1600.toml")

# The machine: ten of its numbers are off.
rng = np.random.default_rng(7)
names = [n for n in model.parameters["name"] if n.startswith("drive_friction")]
values = dict(zip(model.parameters["name"], model.parameters["value"], strict=True))
truth = {name: values[name] * rng.uniform(0.8, 1.3) for name in names}
robot = model.with_parameters(truth)

# A motion with much information, within all limits and half a ball in which the telescope stays clear of its stops.
ball = ([0.0, 0.0, -0.9], 0.35)
excitation = dt.excite(model, frequency=0.25, periods=1, hemisphere=ball, starts=2, iterations=20, time_limit=60)
random = np.median(excitation.random_condition)
print(f"condition number {excitation.condition:.0f}, of random motions {random:.0f} (median)")

# Two runs of it, with other noise.
scenario = excitation.scenario(MODELS / "irb360-6-1600.toml")
runs = [dt.simulate(scenario, model=robot, controller=model, seed=seed, folder="/").recording for seed in (1, 2)]

fitted = dt.identify(model, runs[0], held_out=runs[1])
print(f"{fitted.rank} base parameters, condition number {fitted.condition:.0f}")
print(f"\n{'channel':10}{'before':>10}{'fitted':>10}{'held out':>10}{'noise':>10}")
before = dt.compare(model, runs[1]).rms
rows = zip(fitted.channels, before, fitted.rms, fitted.held_out_rms or [], fitted.noise_floor, strict=True)
for channel, *numbers in rows:
    print(f"{channel:10}" + "".join(f"{x:10.4f}" for x in numbers))

print(f"\n{'parameter':34}{'truth':>10}{'estimate':>10}{'std':>10}")
worst = 0.0
for estimate in fitted.estimates:
    if estimate.name in truth:
        print(f"{estimate.name:34}{truth[estimate.name]:10.4f}{estimate.value:10.4f}{estimate.std:10.4f}")
        worst = max(worst, abs(estimate.value - truth[estimate.name]) / estimate.std)
print(f"\nlargest error: {worst:.1f} standard errors")
assert worst < 5
