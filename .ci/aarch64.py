"""Compares the numbers in the files of two folders; part of .ci/aarch64."""

import pathlib
import re
import sys

# Largest difference of a number, relative to the largest of its column (CSV), or to itself (other files). What
# follows an impact amplifies the last bit.
BOUNDS = {"crash.csv": 1e-4}
BOUND = 1e-9
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def columns(path):
    """The numbers of a file by column, or one column per number."""
    text = path.read_text()
    if path.suffix == ".csv":
        rows = [[float(cell) for cell in line.split(",")] for line in text.splitlines()[1:] if line]
        return [list(column) for column in zip(*rows)]
    return [[float(number)] for number in NUMBER.findall(text)]


def difference(path, other):
    """The largest difference of two files, relative to the largest number of its column."""
    mine, its = columns(path), columns(other)
    if [len(c) for c in mine] != [len(c) for c in its]:
        return float("inf")
    worst = 0.0
    for a, b in zip(mine, its):
        size = max(map(abs, a), default=0.0)
        gap = max((abs(x - y) for x, y in zip(a, b)), default=0.0)
        worst = max(worst, gap / size if size > 0.0 else gap)
    return worst


def main():
    """Prints a line for every file; returns the exit status."""
    here, there = map(pathlib.Path, sys.argv[1:3])
    good = True
    for path in sorted(p for p in here.iterdir() if p.suffix in (".csv", ".json", ".toml")):
        other = there / path.name
        if path.read_bytes() == other.read_bytes():
            print(f"{path.name}: the same bytes")
            continue
        worst, bound = difference(path, other), BOUNDS.get(path.name, BOUND)
        good &= worst <= bound
        print(f"{path.name}: {worst:.1e} of its column at most, bound {bound:.0e}")
    return 0 if good else 1


sys.exit(main())
