#!/usr/bin/env python3
"""panics.py [--bless|--places] ELF: where the firmware could panic, against `expected/panics.txt`.

A panic that the compiler could not rule out is a call of one of `core`'s panicking functions. Each is attributed, by the line tables,
to the innermost file of the estimator that it was inlined into. What REASONS says of a file is why no input reaches its panics: argued,
not proven. More places than expected fail, and so does a file without a reason.
"""

import collections
import pathlib
import re
import subprocess
import sys

EXPECTED = pathlib.Path(__file__).parent / "expected" / "panics.txt"
# Functions of `core` that never return.
PANICS = re.compile(r"core::(panicking|slice::index::slice|option::\w+_failed|result::\w+_failed|cell::panic|str::slice_error)|len_mismatch_fail|rust_begin_unwind")
# Why no input reaches the panics of a folder or file; the longest match counts.
REASONS = {
    "core/src/camera": "arrays of fixed length",
    "core/src/depth": "as many values as landmarks of the window, at most POINTS",
    "core/src/estimator": "frames of the window, below its length by the loop or the check before",
    "core/src/estimator/keeper.rs": "the samples of a look, by the ranges of their groups",
    "core/src/factor": "fixed-size blocks, and rows of the window's frames: at most FRAMES of 15",
    "core/src/imu": "views of 3 and 15 rows into matrices of fixed size",
    "core/src/init": "the first `frames` of FRAMES places, refused at the entry when there are more; fixed-size matrices",
    "core/src/lie": "matrices of fixed size",
    "core/src/plane": "places below the number of samples, by the ranges of the groups; corners below V; eigenvalues of 3×3",
    "core/src/real": "none",
    "core/src/robust": "a slice that is not empty by the check before, and places between its ends",
    "core/src/solve": "blocks of frames of the window, at places below PAIRS = FRAMES (FRAMES + 1) / 2",
    "core/src/storage": "places below the capacity, by the type's invariant",
    "core/src/window": "frames of the window, at most FRAMES",
    "core/src/image": "levels below MAX_LEVELS by the loop",
    "core/src/track": "cells and tracks below the capacity by the loop",
    "firmware-sim/src": "the command line that the emulator hands over; not part of the estimator",
    "outside": "sorting and eigenvalues of libraries, on slices and matrices whose size they checked",
}


def calls(image):
    """Addresses of the calls of panicking functions, with the name of what they call and where from."""
    listing = subprocess.run(["arm-none-eabi-objdump", "-d", "-C", "--no-show-raw-insn", image], check=True, capture_output=True, text=True)
    inside = ""
    for line in listing.stdout.splitlines():
        if head := re.match(r"[0-9a-f]{8} <(.*)>:$", line):
            inside = head[1]
        elif call := re.match(r"\s*([0-9a-f]+):\s+(?:bl|b|b\.w|b\.n)\s+[0-9a-f]+ <(.*)>$", line):
            if PANICS.search(call[2]) and not PANICS.search(inside):
                yield call[1], re.sub(r".*::", "", call[2].split("+")[0]), inside


def places(image):
    found = list(calls(image))
    wanted = "\n".join(address for address, _, _ in found)
    # Innermost frame first; `-a` prints the address before each stack of frames.
    answer = subprocess.run(["arm-none-eabi-addr2line", "-e", image, "-a", "-i", "-f", "-C"], input=wanted, check=True, capture_output=True, text=True)
    stacks = re.split(r"^0x[0-9a-f]+\n", answer.stdout, flags=re.M)[1:]
    counts = collections.Counter()
    for (_, kind, inside), stack in zip(found, stacks):
        lines = stack.splitlines()
        frames = [(name, place) for name, place in zip(lines[::2], lines[1::2])]
        ours = next(((name, place) for name, place in frames if "/core/src/" in place and "/library/" not in place and "/rust" not in place), None)
        ours = ours or next(((name, place) for name, place in frames if "firmware-sim/src/" in place), None)
        if ours is None:
            counts["outside", re.sub(r"<.*", "", inside), kind] += 1
        else:
            file = re.sub(r".*/(core|firmware-sim)/src/", r"\1/src/", ours[1].split(":")[0])
            counts[file, re.sub(r"<.*>|\{.*", "", ours[0]).split("::")[-1], kind] += 1
    return counts


def reason(file):
    known = [folder for folder in REASONS if file.startswith(folder)]
    return REASONS[max(known, key=len)] if known else None


def main():
    counts = collections.Counter()
    for (file, _, _), count in places(sys.argv[-1]).items():
        counts[file] += count
    if sys.argv[1] == "--bless":
        EXPECTED.write_text("".join(f"{file} {count}\n" for file, count in sorted(counts.items())))
    expected = {file: int(count) for file, count in (line.split() for line in EXPECTED.read_text().splitlines())}
    failed = False
    for file, count in sorted(counts.items()):
        if reason(file) is None:
            print(f"{file}: {count} possible panics and no reason given")
            failed = True
        elif count > expected.get(file, 0):
            print(f"{file}: {count} possible panics, {expected.get(file, 0)} expected (see `panics.py --places`)")
            failed = True
    print(f"{sum(counts.values())} places of {len(counts)} files where the compiler could not rule out a panic")
    sys.exit(1 if failed else 0)


if __name__ == "__main__" and sys.argv[1] == "--places":
    for (file, function, kind), count in sorted(places(sys.argv[-1]).items()):
        print(file, function, kind, count, "|", reason(file))
elif __name__ == "__main__":
    main()
