#!/usr/bin/env python3
"""Compares rows of `glasshouse evaluate`, means over seeds, with paired 95 % intervals over pictures.

    docs/proof/table.py EVALUATION.csv ROW OTHER [ROW OTHER ...]

A row is the name of a method, whose seeds are called NAME-seed-1, NAME-seed-2, ...: `composed linear` prints the differences
of composed to linear, in dB before and after own factors and in SSIM, for all pictures and for each group, and both spreads of
seeds.
"""

import csv
import random
import statistics
import sys

# Column, name and decimals.
SCORES = (("psnr_colour_db", "raw", 2), ("psnr_own_factor_db", "own", 2), ("ssim_grey", "SSIM", 4))


def read(path):
    """Returns the scores of seeds: method -> picture -> scores, and the group of each picture."""
    scores, groups = {}, {}
    with open(path, newline="") as file:
        for line in csv.DictReader(file):
            scores.setdefault(line["method"], {})[line["image"]] = [float(line[column]) for column, *_ in SCORES]
            groups[line["image"]] = line["group"]
    return scores, groups


def seeds_of(scores, row):
    """Returns the scores of a row's seeds, or of the row itself."""
    found = [of for name, of in scores.items() if name == row or name.rpartition("-seed-")[0] == row]
    if not found:
        sys.exit(f"no method {row} or {row}-seed-N; there are {', '.join(scores)}")
    return found


def interval(differences):
    """Returns the mean and the percentile interval of 4,000 resamples."""
    drawn, count = random.Random(1), len(differences)
    means = sorted(statistics.fmean(drawn.choices(differences, k=count)) for _ in range(4000))
    return statistics.fmean(differences), means[100], means[3899]


def compare(scores, groups, row, other):
    ones, others = seeds_of(scores, row), seeds_of(scores, other)
    print(f"\n{row} ({len(ones)} seeds) - {other} ({len(others)})")
    names = sorted(set(groups.values()))
    for group in ["all", *(names if len(names) > 1 else [])]:
        pictures = [picture for picture, of in groups.items() if group in ("all", of)]
        cells = []
        for column, (_, name, decimals) in enumerate(SCORES):
            by_seed = [[statistics.fmean(s[p][column] for p in pictures) for s in of] for of in (ones, others)]
            spread = " + ".join(f"{statistics.stdev(means):.{decimals}f}" if len(means) > 1 else "?" for means in by_seed)
            means = [{p: statistics.fmean(s[p][column] for s in of) for p in pictures} for of in (ones, others)]
            mean, low, high = interval([means[0][p] - means[1][p] for p in pictures])
            limits = f"[{low:+.{decimals}f}, {high:+.{decimals}f}]"
            cells.append(f"{name} {mean:+.{decimals}f} {limits} (seeds {spread})")
        print(f"  {group:10} n {len(pictures):3}  {'; '.join(cells)}")


def main():
    if len(sys.argv) < 4 or len(sys.argv) % 2:
        sys.exit(__doc__)
    scores, groups = read(sys.argv[1])
    for row, other in zip(sys.argv[2::2], sys.argv[3::2], strict=True):
        compare(scores, groups, row, other)


if __name__ == "__main__":
    main()
