#!/usr/bin/env python3
"""check.py [--complete] THRESHOLDS RUNS: hold the figures of RUNS/<name>/report.json against a table.

The table is described in thresholds.txt. Prints every figure beside its bound and exits with 1 when one is out of
bounds, missing or not a number. A run without a folder was skipped, because its recording is absent; with --complete
that counts as a failure too.
"""

import json
import math
import operator
import pathlib
import sys

OPERATORS = {"<=": operator.le, ">=": operator.ge, "==": operator.eq}


class Skipped(Exception):
    """The run was not made."""


class Unusable(Exception):
    """The run was made, but the figure is not there."""


def figure(runs, names, field):
    """Mean over the runs joined with `+` in `names` of the field, dots stepping into objects."""
    values = []
    for name in names.split("+"):
        folder = runs / name
        if not folder.is_dir():
            raise Skipped
        try:
            value = json.loads((folder / "report.json").read_text(encoding="utf-8"))
            for step in field.split("."):
                value = value[step]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise Unusable(f"{name}/report.json: {type(error).__name__} {error}") from error
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise Unusable(f"{name}/report.json: {field} is {value!r}")
        # The sign of a deviation is not what a bound is about.
        values.append(abs(value))
    return sum(values) / len(values)


def bound(runs, text, field):
    """A number, or `1.10*name`: that many times the same field of another run."""
    if "*" not in text:
        return float(text)
    factor, names = text.split("*", 1)
    return float(factor) * figure(runs, names, field)


def rows(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        parts = line.split(None, 4)
        if len(parts) < 5 or parts[2] not in OPERATORS:
            sys.exit(f"{path} line {number}: expected `run field <=|>= bound reason`")
        yield parts


def main(complete, thresholds, runs):
    failures = 0
    table = []
    for names, field, comparison, limit_text, reason in rows(thresholds):
        value_text, limit_shown = "", limit_text
        try:
            value = figure(runs, names, field)
            limit = bound(runs, limit_text, field)
            value_text, limit_shown = f"{value:.4f}", f"{limit:g}"
            verdict = "ok" if OPERATORS[comparison](value, limit) else "FAILED"
        except Skipped:
            verdict = "FAILED" if complete else "skipped"
        except Unusable as problem:
            verdict, reason = "FAILED", str(problem)
        failures += verdict == "FAILED"
        table.append((names, field, value_text, f"{comparison} {limit_shown}", verdict, reason))
    head = ("run", "figure", "value", "bound", "", "reason")
    widths = [max(len(row[column]) for row in [head, *table]) for column in range(5)]
    for row in [head, *table]:
        print("  ".join([*(cell.ljust(width) for cell, width in zip(row, widths)), row[5]]).rstrip())
    print(f"{failures} of {len(table)} out of bounds")
    return 1 if failures else 0


if __name__ == "__main__":
    arguments = sys.argv[1:]
    everything = arguments[:1] == ["--complete"]
    paths = [pathlib.Path(argument) for argument in arguments[everything:]]
    if len(paths) != 2:
        sys.exit(__doc__)
    sys.exit(main(everything, *paths))
