"""Find the physical effect that a model lacks, and add it.

The robot is a twin with friction hidden in its ball sockets; of a real robot, read the recordings with
``dt.Recording.read("run1.csv", model=model)``.
"""

from pathlib import Path

import deltatwin as dt

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
model = dt.Model.builtin("irb360-6-1600")
robot = model.with_effect("ball_socket_coulomb", moment=0.15)
run1, run2 = (
    dt.simulate(SCENARIOS / f"{name}.toml", model=robot, controller=model, duration=8.0).recording
    for name in ("excitation", "excitation-held-out")
)

fitted = dt.identify(model, run1, held_out=run2)
comparison = dt.compare(fitted.model, run1, held_out=run2)
print("Where the model fails:")
for finding in comparison.findings[:3]:
    print(f"  {finding.sentence}")

diagnosis = dt.diagnose(fitted.model, run1, held_out=run2)
print(f"\nVerdict: {diagnosis.verdict}")
for effect in diagnosis.effects:
    print(f"  {effect.name}, probability {effect.probability:.2f}, explains {effect.explained:.1%}")
print("Ranking: " + ", ".join(diagnosis.ranking["name"][:4]))

better = dt.add(fitted.model, diagnosis.effects[0].name, run1, held_out=run2)
for parameter in better.parameters:
    print(f"\n{parameter.name} = {parameter.value:.4f} ± {parameter.std:.4f} {parameter.unit}, hidden was 0.15")
print(f"\n{'channel':10}{'before':>10}{'after':>10}{'noise':>10}")
for row in zip(better.channels, better.rms_before, better.rms_after, better.noise_floor, strict=True):
    print(f"{row[0]:10}" + "".join(f"{x:10.4f}" for x in row[1:]))
assert [effect.name for effect in diagnosis.effects] == ["ball_socket_coulomb"]
