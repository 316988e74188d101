"""Sobol' indices of SALib beside those of deltatwin: on the Ishigami function, and on the runs of one study.

    pip install SALib==1.6.0 pyarrow
    deltatwin study scenarios/studies/sensitivity.toml -o study
    deltatwin study scenarios/studies/sensitivity.toml -o study --json > study.json
    python benches/peers/salib_study.py study study.json

The rows of a sensitivity study are one nominal run, two per factor, and d + 2 per base point in SALib's order (A, A with
each factor of B, B), so SALib takes the column as it is.
"""

import json
import pathlib
import sys

import numpy as np
import pyarrow.parquet as pq
from SALib.analyze import sobol as analyze
from SALib.sample import sobol as sample


def indices(names, outputs):
    problem = {"num_vars": len(names), "names": names, "bounds": [[0, 1]] * len(names)}
    found = analyze.analyze(problem, outputs, calc_second_order=False, num_resamples=2000, seed=1)
    return found["S1"], found["S1_conf"], found["ST"], found["ST_conf"]


def ishigami():
    """a = 7, b = 0.1; exact: S1 0.3139, 0.4424, 0; ST 0.5576, 0.4424, 0.2437."""
    names = ["x1", "x2", "x3"]
    problem = {"num_vars": 3, "names": names, "bounds": [[-np.pi, np.pi]] * 3}
    x = sample.sample(problem, 8192, calc_second_order=False, seed=1)
    y = np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    first, _, total, _ = indices(names, y)
    print("Ishigami, SALib at 8192 base points, beside the exact indices")
    for name, s, t, exact in zip(names, first, total, [(0.3139, 0.5576), (0.4424, 0.4424), (0.0, 0.2437)]):
        print(f"  {name}  S1 {s:7.4f} ({exact[0]:.4f})  ST {t:7.4f} ({exact[1]:.4f})")


def study(folder, answer):
    table = pq.read_table(pathlib.Path(folder) / "runs.parquet")
    told = json.loads(pathlib.Path(answer).read_text())["sobol"]
    names = [index["factor"] for index in told["indices"]]
    output = table[told["output"]].to_numpy()[1 + 2 * len(names):]
    first, first_conf, total, total_conf = indices(names, output)
    print(f"{folder}: {len(output) // (len(names) + 2)} base points, output {told['output']}")
    print("  factor      S1 deltatwin       SALib   ± 95 %   ST deltatwin       SALib   ± 95 %")
    worst = 0.0
    for k, index in enumerate(told["indices"]):
        ours = index["first"], index["total"]
        worst = max(worst, abs(ours[0] - first[k]), abs(ours[1] - total[k]))
        print(f"  {index['factor']:10} {ours[0]:13.6f} {first[k]:11.6f} {first_conf[k]:8.3f}"
              f" {ours[1]:14.6f} {total[k]:11.6f} {total_conf[k]:8.3f}")
    print(f"  largest difference {worst:.1e}")


if __name__ == "__main__":
    ishigami()
    if len(sys.argv) == 3:
        study(*sys.argv[1:])
