#!/usr/bin/env python3
"""same_trajectory.py TOLERANCE_M A B: whether two TUM trajectories have the same stamps and positions within the tolerance."""

import math
import sys


def read(path):
    with open(path) as file:
        return [[float(word) for word in line.split()] for line in file if line.strip() and not line.startswith("#")]


def main(tolerance_m, first, second):
    a, b = read(first), read(second)
    if not a or [row[0] for row in a] != [row[0] for row in b]:
        sys.exit(f"{len(a)} and {len(b)} poses, not at the same times")
    farthest = max(math.dist(p[1:4], q[1:4]) for p, q in zip(a, b))
    identical = sum(p == q for p, q in zip(a, b))
    print(f"{len(a)} poses, {identical} the same as printed, others at most {farthest:.2e} m apart")
    if farthest > tolerance_m:
        sys.exit(f"more than {tolerance_m} m apart")


main(float(sys.argv[1]), sys.argv[2], sys.argv[3])
