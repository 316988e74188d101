"""Which boxes fail at which speed: a study, its table in polars, and the payload diagram as text.

``dt.study(study, folder, ray="auto")`` computes the same table on a cluster.
"""

import tempfile
from pathlib import Path

import deltatwin as dt

ROOT = Path(__file__).resolve().parents[2]
STUDY = """
title = "Largest mass over the speed"
scenario = "{scenario}"

[design]
kind = "boundary"
along = ["mass"]
tolerance = 0.01

[[factors]]
name = "mass"
key = "payload.mass"
unit = "kg"
from = 0.1
to = 12.0

[[factors]]
name = "speed"
key = "speed_scale"
levels = [0.7, 0.8, 0.9, 1.0]
"""

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "diagram.toml"
    file.write_text(STUDY.format(scenario=ROOT / "scenarios/failures/bulky-torque-limits.toml"))
    table = dt.study(file, Path(folder) / "study")

print(f"{len(table)} rows, columns {', '.join(table.names[:6])} …\n")
print("speed  largest mass / kg        fails by")
for speed, mass, cause in zip(table["speed"], table["mass"], table["cause"], strict=True):
    print(f"{float(speed or 0):5.1f}  {float(mass or 0):5.2f} {'█' * round(2 * float(mass or 0)):20} {cause}")
