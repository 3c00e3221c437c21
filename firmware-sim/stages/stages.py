#!/usr/bin/env python3
"""stages.py map ELF: the entries of the stages' functions in a firmware image, as `stages.c` reads them."""

import subprocess
import sys

# Each stage with what the names of its functions contain. The functions are too large to be inlined, or told not to be.
STAGES = [
    ("preintegrate", ["imu::stretch::integrate", "imu::stretch::extend", "InertialHistory<T,_>::rotation"]),
    ("pyramid", ["PyramidPair<_>::push"]),
    ("track", ["FrontEnd<_,_>::follow"]),
    ("reject", ["FrontEnd<_,_>::verify"]),
    ("detect", ["FrontEnd<_,_>::replenish"]),
    ("start", ["Estimator<T,_,_,_,_>>::step_starting", "Estimator<T,_,_,_,_>>::start_moving", "Estimator<T,_,_,_,_>>::align"]),
    ("solve", ["Estimator<T,_,_,_,_>>::solve", "Estimator<T,_,_,_,_>>::activate_landmarks"]),
    ("depth", ["schedule::take_depth"]),
    ("planes", ["PlaneKeeper<T,_,_,_>::look", "PlaneKeeper<T,_,_,_>::attach"]),
    ("marginalise", ["Estimator<T,_,_,_,_>>::retire_oldest", "Estimator<T,_,_,_,_>>::drop_frame"]),
]
END_OF_IMAGE = "libella_end_of_image"


def symbols(image):
    listed = subprocess.run(["arm-none-eabi-nm", "-C", image], check=True, capture_output=True, text=True).stdout
    for line in listed.splitlines():
        address, kind, name = line.split(" ", 2)
        if kind in "tT":
            yield int(address, 16) & ~1, name


def main(image):
    functions = list(symbols(image))
    ends = [address for address, name in functions if name == END_OF_IMAGE]
    if len(ends) != 1:
        sys.exit(f"{image}: no single {END_OF_IMAGE}")
    print(f"{ends[0]:x} 0")
    for number, (stage, names) in enumerate(STAGES, start=1):
        found = [address for address, name in functions if any(name.endswith(wanted) for wanted in names)]
        if not found:
            print(f"{image}: {stage} has no function of its own: it counts among the rest", file=sys.stderr)
        for address in found:
            print(f"{address:x} {number}")


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] != "map":
        sys.exit(__doc__)
    main(sys.argv[2])
