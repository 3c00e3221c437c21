#!/usr/bin/env python3
"""check.py [--bless] [--stages CSV] FOLDER MACHINE...: what the firmware told against `expected/`, and the table of its figures.

Poses are compared bit for bit, on every machine. Of a flight with a fault the outcomes are compared, not the poses. Figures may
differ by TOLERANCE from the expected ones, which another compiler needs; limits hold absolutely, unless LIMITS says that they do
not yet.
"""

import argparse
import pathlib
import re
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent / "stages"))
from stages import STAGES  # noqa: E402

EXPECTED = pathlib.Path(__file__).parent / "expected"
EXACT = ["none", "moving", "planes", "depth", "full", "full-moving"]
FAULTS = ["nan-imu", "stuck-camera", "time-back", "gap", "nan-depth", "zero-depth", "inverted-depth"]
TOLERANCE = 0.10
CLOCK_HZ = 400e6
# Figure, limit, and whether it is kept today.
LIMITS = [
    ("flash, bytes", 256_000, True),
    ("RAM and stack, bytes", 110_000, True),
    ("RAM and stack, planes and depth, bytes", 110_000, True),
    ("RAM and stack, moving start, bytes", 110_000, True),
    ("RAM and stack, moving start with depth, bytes", 110_000, True),
    ("stack while the estimator is made, bytes", 20_000, True),
    ("instructions an image, mean", 20_000_000, True),
    ("instructions an image, worst", 40_000_000, True),
    ("instructions an image, planes and depth, mean", 20_000_000, True),
    ("instructions an image, planes and depth, worst", 40_000_000, True),
    ("instructions an image, worst, moving start", 40_000_000, False),
    ("instructions an image, worst, moving start with depth", 40_000_000, True),
]


class Flight:
    def __init__(self, path):
        self.lines, self.costs, self.numbers = [], [], {}
        for line in path.read_text().splitlines():
            kind, *words = line.split()
            if kind == "cost":
                self.costs.append([int(word) for word in words])
            elif kind == "ticks":
                # A loop of a million instructions.
                self.instructions_per_tick = 1e6 / int(words[0])
            elif kind in ("stack", "memory"):
                self.numbers |= {f"{kind} {name}": int(value) for name, value in zip(words[::2], words[1::2])}
            else:
                self.lines.append(line)

    def outcomes(self):
        """The lines without poses, and without repetitions."""
        kept = []
        for line in self.lines:
            words = [word for word in line.split() if not re.fullmatch("[0-9a-f]{8}", word)]
            if words[0] == "end" or not kept or words[2:] != kept[-1][2:]:
                kept.append(words)
        return [" ".join(words) for words in kept]

    def instructions(self):
        return [sum(cost) * self.instructions_per_tick for cost in self.costs]


def sections(path):
    found = {}
    for line in path.read_text().splitlines():
        words = line.split()
        if len(words) == 3 and words[1].isdigit():
            found[words[0]] = int(words[1])
    return found


def figures(folder, machine, flights):
    size = sections(folder / f"{machine}.size.txt")
    flash = sum(size.get(name, 0) for name in (".vector_table", ".text", ".rodata", ".data"))
    ram = sum(size.get(name, 0) for name in (".data", ".bss", ".uninit"))
    ways = {"": flights["none"], ", planes and depth": flights["full"], ", moving start": flights["moving"]}
    ways[", moving start with depth"] = flights["full-moving"]
    stacks = {way: flight.numbers["stack peak"] for way, flight in ways.items()}
    costs = {way: flight.instructions() for way, flight in ways.items()}
    full = costs[", planes and depth"]
    # Which of them is dearest hangs on what a flight's planes and depths turn out to be.
    worst = max(max(flights[plan].instructions()) for plan in ("planes", "depth", "full"))
    return {
        "flash, bytes": flash,
        "static RAM, bytes": ram,
        **{f"stack{way}, bytes": stack for way, stack in stacks.items()},
        "stack while the estimator is made, bytes": flights["none"].numbers["stack start"],
        **{f"RAM and stack{way}, bytes": ram + stack for way, stack in stacks.items()},
        "instructions an image, mean": round(statistics.mean(costs[""])),
        "instructions an image, worst": round(max(costs[""])),
        "instructions an image, planes and depth, mean": round(statistics.mean(full)),
        "instructions an image, planes and depth, worst": round(worst),
        "instructions an image, worst, moving start": round(max(costs[", moving start"])),
        "instructions an image, worst, moving start with depth": round(max(costs[", moving start with depth"])),
    }


def stage_table(path, flight):
    rows = [[int(value) for value in line.split(",")] for line in path.read_text().splitlines()]
    names = [name for name, _ in STAGES]
    total = flight.instructions()
    table = {}
    for number, name in enumerate(names, start=1):
        values = [row[number] for row in rows]
        table[name] = (statistics.mean(values), max(values))
    named = [sum(row[1 : len(names) + 1]) for row in rows]
    rest = [whole - part for whole, part in zip(total, named)]
    table["rest"] = (statistics.mean(rest), max(rest))
    table["all"] = (statistics.mean(total), max(total))
    return table


def compare(name, lines, bless, faults):
    path = EXPECTED / name
    text = "".join(line + "\n" for line in lines)
    if bless:
        path.write_text(text)
    elif not path.exists() or path.read_text() != text:
        expected = path.read_text().splitlines() if path.exists() else []
        first = next((k for k, pair in enumerate(zip(expected, lines)) if pair[0] != pair[1]), min(len(expected), len(lines)))
        faults.append(f"{name}: line {first + 1}: expected {expected[first:first + 1]}, got {lines[first:first + 1]}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--bless", action="store_true")
    parser.add_argument("--stages", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("machines", nargs="+")
    arguments = parser.parse_args()
    faults, table = [], {}
    path = EXPECTED / "figures.txt"
    expected = {}
    if path.exists():
        for line in path.read_text().splitlines():
            machine, name, value = line.split(" | ")
            expected[machine, name] = float(value)
    for position, machine in enumerate(arguments.machines):
        flights = {plan: Flight(arguments.folder / f"{machine}.{plan}.txt") for plan in EXACT + FAULTS}
        bless = arguments.bless and position == 0
        for plan in EXACT:
            compare(f"{plan}.txt", flights[plan].lines, bless, faults)
        for plan in FAULTS:
            compare(f"{plan}.txt", flights[plan].outcomes(), bless, faults)
        table[machine] = figures(arguments.folder, machine, flights)
        if machine == "mps2-an500" and arguments.stages:
            for name, (mean, worst) in stage_table(arguments.stages, flights["full"]).items():
                table[machine][f"{name}, instructions, mean"] = round(mean)
                table[machine][f"{name}, instructions, worst"] = round(worst)
    for machine, found in table.items():
        for name, value in found.items():
            wanted = expected.get((machine, name))
            if arguments.bless:
                expected[machine, name] = value
            # Stages may move between each other by little things: only what matters is held.
            elif wanted is None or value > wanted * (1 + TOLERANCE) + 1000 or value < wanted * (1 - 2 * TOLERANCE) - 1000:
                faults.append(f"{machine}: {name}: {value} where {wanted} was expected")
        for name, limit, kept in LIMITS:
            if found[name] > limit:
                print(f"{machine}: {name}: {found[name]} is over the limit of {limit}")
                if kept:
                    faults.append(f"{machine}: {name} over its limit")
    if arguments.bless:
        path.write_text("".join(f"{machine} | {name} | {value:.0f}\n" for (machine, name), value in expected.items()))
    show(table)
    for fault in faults:
        print(fault)
    sys.exit(1 if faults else 0)


def show(table):
    names = [name for name in next(iter(table.values())) if ", instructions, " not in name]
    print(f"| {'' :53} |" + "".join(f" {machine} |" for machine in table))
    for name in names:
        print(f"| {name:53} |" + "".join(f" {found[name]:>{len(machine)},} |" for machine, found in table.items()))
    found = table.get("mps2-an500", {})
    if "all, instructions, mean" not in found:
        return
    print(f"\n| {'stage':14} | M instructions, mean | worst | ms at {CLOCK_HZ / 1e6:.0f} MHz, 1 instruction a cycle |")
    for name in [name for name, _ in STAGES] + ["rest", "all"]:
        mean, worst = found[f"{name}, instructions, mean"], found[f"{name}, instructions, worst"]
        print(f"| {name:14} | {mean / 1e6:20.3f} | {worst / 1e6:5.2f} | {mean / CLOCK_HZ * 1e3:37.2f} |")


main()
