"""Reliability of `deltatwin diagnose` on recordings of another simulator. See README.md here.

    python reliability.py run --program deltatwin --model irb360-6-1600.toml --data FOLDER --nulls 200 --each 7
    python reliability.py table --data FOLDER

`run` appends one line per diagnosis to FOLDER/answers.jsonl and goes on where it was interrupted.

How an answer is judged, written down before the first diagnosis:

- Nothing hidden: right if the verdict is `none`. Every other final verdict (`effect`, `several`, `ambiguous`, `unknown`)
  is a false alarm. A lag of the recording that is reported next to `none` is not an alarm.
- One effect of the catalogue hidden: `named` if the hidden effect is the only one named and the verdict is not
  `ambiguous`; `set` if the verdict is `ambiguous`, one effect is in question and the set of it and its indistinguishable
  ones contains the hidden one; `among` if it is named (or in a set) together with effects that are not there. `named` and
  `set` are right. `unknown` and `none` name nothing and are misses, everything else is `wrong`. The same holds
  if the program adds "and something else" to a name.
- A law outside the catalogue hidden: right if the verdict is `unknown`, with or without a name next to it; `none` is a miss, a
  name alone is `wrong`.
- Two effects of the catalogue hidden: `named` if exactly these two are named and the verdict is not `ambiguous`; `set` if two
  are in question and the sets of them and their indistinguishable ones contain one hidden effect each; `one` if all that is
  named, or in question, is one of the two; `wrong` if something is named that is not there. "And something else", the verdict
  `unknown` with names, does not change the grade. Without a name `unknown` and `none` are misses.
- An effect of the catalogue and a law outside it hidden: `right` if the effect alone is named (or in a set) and the program says
  that something else is missing, `one` if only one of both is said.
- A claim is a verdict that names (`effect`, `several`, `ambiguous`), with the smallest probability of the named effects. It
  is true if the answer is right in the sense above; for `ambiguous` the probability of the set is the sum over its members.
- `undecided` (the time was up), `refused` (the check of the recording stops the command) and `failed` (exit status, no
  JSON) are counted on their own. They are no answers and enter no rate.
"""

import argparse
import collections
import hashlib
import json
import os
import pathlib
import subprocess
import time
import warnings

import numpy as np

warnings.filterwarnings("ignore")

EFFECTS = """viscous_curve drive_stribeck drive_coulomb_asymmetry cogging torque_gain_error joint_zero_offset
ball_socket_coulomb hose_spring payload_com_offset limb_asymmetry base_tilt drive_elasticity backlash_hysteresis
torque_filter signal_delay unknown_bumps unknown_crosstalk""".split()
KEPT = "verdict sentence indistinguishable left unknown_beside sampling_lag not_tried noise_floor rms_before rms_after too_few".split()


def pair(seed, mixed):
    """Two effects of the catalogue, or one and a law outside it, drawn by the seed."""
    known = [name for name in EFFECTS if not name.startswith("unknown")]
    unknown = [name for name in EFFECTS if name.startswith("unknown")]
    rng = np.random.default_rng([seed, mixed])
    one, other = rng.choice(known, 2, replace=False)
    return f"{one}+{rng.choice(unknown) if mixed else other}"


def plan(options):
    """Names and seeds, the kinds by turns, so that an interrupted run has all."""
    seeds = lambda count: range(options.first, options.first + count)
    kinds = [
        [("none", s) for s in seeds(options.nulls)],
        [(name, s) for s in seeds(options.each) for name in EFFECTS],
        [(pair(s, False), s) for s in seeds(options.pairs)],
        [(pair(s, True), s) for s in seeds(options.mixed)],
    ]
    return [job for _, job in sorted(((k + 0.5) / len(jobs), job) for jobs in kinds for k, job in enumerate(jobs))]


def ask(program, model, folder, limit):
    """The answer of the program about one pair of recordings."""
    command = [program, "diagnose", model, "fit.csv", "--held-out", "val.csv", "--json", "--time-limit", str(limit)]
    start = time.time()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=os.environ | {"RAYON_NUM_THREADS": "1"})
    line = {"seconds": round(time.time() - start, 1), "status": done.returncode}
    try:
        said = json.loads(done.stdout)
    except ValueError:
        said = {}
    if "verdict" not in said:
        gate = said.get("gate") or done.returncode == 2
        return line | {"verdict": "refused" if gate else "failed", "said": (done.stdout + done.stderr)[-1500:]}
    line |= {key: said.get(key) for key in KEPT}
    line["effects"] = [{key: e.get(key) for key in ("name", "probability", "explained", "parameters")} for e in said["effects"]]
    few = sorted(said["candidates"], key=lambda c: c["p_adjusted"])[:6]
    line["candidates"] = [{key: c.get(key) for key in ("name", "p_adjusted", "alone", "outcome", "probability")} for c in few]
    line["formula"] = said.get("unexplained") if isinstance(said.get("unexplained"), str) else None
    line["patterns"] = [p["sentence"] for p in ((said.get("left_at") or {}).get("patterns") or [])[:4]]
    return line


def run(options):
    from campaign import make

    data = pathlib.Path(options.data).resolve()
    data.mkdir(parents=True, exist_ok=True)
    answers = data / "answers.jsonl"
    model = str(pathlib.Path(options.model).resolve())
    program = str(pathlib.Path(options.program).resolve())
    digest = hashlib.sha256(pathlib.Path(program).read_bytes()).hexdigest()[:12]
    done = {(a["effect"], a["seed"]) for a in read(data)}
    for effect, seed in plan(options):
        if (effect, seed) in done:
            continue
        folder = data / f"{effect}-{seed}"
        try:
            truth = json.loads((folder / "truth.json").read_text()) if (folder / "truth.json").exists() else make(model, effect, seed, folder)
            line = truth | ask(program, model, folder, options.time_limit)
        except RuntimeError as error:
            line = {"effect": effect, "seed": seed, "verdict": "not made", "said": str(error)}
        line["program"] = digest
        with answers.open("a") as file:
            file.write(json.dumps(line) + "\n")
        grade = judge(line)
        print(effect, seed, line["verdict"], [(e["name"], e["probability"]) for e in line.get("effects", [])], grade, line.get("seconds"), flush=True)
        if grade in ("right", "named") and not options.keep:
            for name in ("fit.csv", "val.csv"):
                (folder / name).unlink(missing_ok=True)
            (folder / "truth.json").unlink(missing_ok=True)


def read(data):
    file = pathlib.Path(data) / "answers.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines() if line.strip()] if file.exists() else []


def sets(answer):
    """The named effects, each with those it cannot be distinguished from."""
    out = []
    for e in answer["effects"]:
        group = {e["name"]}
        for names in answer["indistinguishable"] or []:
            if e["name"] in names:
                group |= set(names)
        out.append(group)
    return out


def judge(a):
    """The grade of an answer by the rules above."""
    verdict, effect = a["verdict"], a["effect"]
    if verdict in ("undecided", "refused", "failed", "not made"):
        return verdict
    if effect == "none":
        return "right" if verdict == "none" else "false alarm"
    if effect.startswith("unknown"):
        return {"unknown": "right", "none": "none"}.get(verdict, "wrong")
    groups, names = sets(a), [e["name"] for e in a["effects"]]
    if "+" in effect:
        return judge_pair(effect.split("+"), groups, a)
    if verdict == "unknown" or not names:
        return "none" if verdict == "none" else "unknown"
    if names == [effect] and verdict != "ambiguous":
        return "named"
    if len(groups) == 1 and effect in groups[0]:
        return "set"
    return "among" if any(effect in g for g in groups) else "wrong"


def judge_pair(hidden, groups, a):
    """The grade of an answer about two hidden effects, the second of which may be outside the catalogue."""
    known = {name for name in hidden if not name.startswith("unknown")}
    if not groups:
        return "one" if a["verdict"] == "unknown" and len(known) == 1 else a["verdict"]
    if not all(group & known for group in groups):
        return "wrong"
    if len(groups) < len(known) or not known <= set().union(*groups):
        return "one"
    if len(known) == 1:
        return "right" if a["verdict"] == "unknown" or a["unknown_beside"] else "one"
    return "set" if a["verdict"] == "ambiguous" else "named"


def claim(a):
    """Probability that the program states for its names, None if it names nothing."""
    if a["verdict"] not in ("effect", "several", "ambiguous") or not a["effects"]:
        return None
    return min(e["probability"] for e in a["effects"])


def interval(k, n):
    """Clopper and Pearson, 95 %."""
    from scipy.stats import beta

    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return low, high


def rate(k, n):
    if not n:
        return "–"
    low, high = interval(k, n)
    return f"{k}/{n} = {100 * k / n:.1f} % ({100 * low:.1f}–{100 * high:.1f} %)"


def alarms(nulls, key, title):
    groups = collections.defaultdict(list)
    for a in nulls:
        groups[key(a)].append(judge(a) == "false alarm")
    print(f"\n| false alarms by {title} | |\n|---|---|")
    for name in sorted(groups):
        print(f"| {name} | {rate(sum(groups[name]), len(groups[name]))} |")


def table(options):
    answers = read(options.data)
    counted = [a for a in answers if judge(a) not in ("undecided", "refused", "failed", "not made")]
    nulls = [a for a in counted if a["effect"] == "none"]
    print(f"{len(answers)} recordings, {len(counted)} answers, median {sorted(a['seconds'] for a in counted)[len(counted) // 2]:.0f} s;",
          dict(collections.Counter(a["verdict"] for a in answers if a not in counted)), "without answer")
    wrong = [a for a in nulls if judge(a) == "false alarm"]
    print(f"\nFalse alarms: {rate(len(wrong), len(nulls))};", dict(collections.Counter(
        "unknown" if a["verdict"] == "unknown" else "+".join(e["name"] for e in a["effects"]) for a in wrong)))
    alarms(nulls, lambda a: a["noise"], "noise")
    alarms(nulls, lambda a: "%g–%g rad" % ((1e-5, 1e-4), (1e-4, 3e-4), (3e-4, 1e-3))[sum(max(a["encoder"][:3]) > x for x in (1e-4, 3e-4))], "coarsest arm encoder")
    alarms(nulls, lambda a: f"{a['rate']:6.0f} Hz", "sampling rate")
    print("\n| claimed | right | of these robots with an effect |\n|---|---|---|")
    bins = [(0, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 0.97), (0.97, 1.01), (0.9, 1.01)]
    for low, high in bins:
        here = [a for a in counted if claim(a) is not None and low <= claim(a) < high]
        good = [judge(a) in ("named", "set", "right") for a in here]
        hidden = [judge(a) in ("named", "set", "right") for a in here if a["effect"] != "none"]
        print(f"| {low:.2f}–{min(high, 1):.2f} | {rate(sum(good), len(good))} | {rate(sum(hidden), len(hidden))} |")
    grades = ["named", "set", "among", "one", "right", "unknown", "none", "wrong"]
    print("\n| hidden | " + " | ".join(grades) + " | mistaken for |\n|---|" + "---|" * (len(grades) + 1))
    pairs = {"two effects": lambda e: "+" in e and "unknown" not in e, "effect + law outside": lambda e: "+unknown" in e}
    for name, holds in [(name, lambda e, name=name: e == name) for name in EFFECTS] + list(pairs.items()):
        here = [a for a in counted if holds(a["effect"])]
        count = collections.Counter(judge(a) for a in here)
        taken = collections.Counter("+".join(e["name"] for e in a["effects"]) for a in here if judge(a) in ("wrong", "among"))
        print(f"| `{name}` | " + " | ".join(str(count[g] or "–") for g in grades) + " | " + ", ".join(f"{k} {v}" for k, v in taken.items()) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["run", "table"])
    parser.add_argument("--data", required=True)
    parser.add_argument("--program", default="deltatwin")
    parser.add_argument("--model", default="models/irb360-6-1600.toml")
    parser.add_argument("--nulls", type=int, default=200)
    parser.add_argument("--each", type=int, default=7)
    parser.add_argument("--pairs", type=int, default=0, help="robots with two effects of the catalogue")
    parser.add_argument("--mixed", type=int, default=0, help="robots with an effect and a law outside the catalogue")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--time-limit", type=int, default=900, help="of one diagnosis, s")
    parser.add_argument("--keep", action="store_true", help="keep the recordings of right answers as well")
    options = parser.parse_args()
    {"run": run, "table": table}[options.what](options)


if __name__ == "__main__":
    main()
