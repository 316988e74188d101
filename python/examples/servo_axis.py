"""A real servo axis: from a raw log to a better model.

The log is a measurement of a free brushless motor by LAAS-CNRS and H. Andrade (see ``data/README.md``): time, position,
velocity and current, no torque, a clock with jitter and gaps.
"""

from pathlib import Path

import deltatwin as dt

DATA = Path(__file__).resolve().parent / "data"
run1, run2 = (dt.Recording.read(DATA / f"speed-test-{k}.csv") for k in (1, 2))
print(run1)
print("\n".join(f"  {warning.split(': ', 1)[1]}" for warning in run1.warnings))

model = dt.Model.from_axis([run1, run2], name="rotor")
values = dict(zip(model.parameters["name"], model.parameters["value"], strict=True))
print(f"\nfirst model: {', '.join(f'{name} = {value:.4g}' for name, value in values.items() if value)}")

diagnosis = dt.diagnose(model, run1, held_out=run2, time_limit=60)
print(f"\nVerdict: {diagnosis.verdict}")
for effect in diagnosis.effects:
    largest = max(effect.parameters, key=lambda p: abs(p.value) if "sine" in p.name else 0.0)
    print(f"  {effect.name}: {largest.name} = {largest.value:.3f} ± {largest.std:.3f} {largest.unit}")
    print(f"  explains {effect.explained:.1%} of the error above the noise")
rms = f"{diagnosis.rms_before[0]:.4f} -> {diagnosis.rms_after[0]:.4f}"
print(f"RMS error, held out: {rms} A, noise {diagnosis.noise_floor[0]:.4f} A")
assert "cogging" in [effect.name for effect in diagnosis.effects]
