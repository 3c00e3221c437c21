#!/usr/bin/env python3
"""elf_size.py FILE: bytes of flash and RAM of a little-endian 32-bit ELF program for ARM; fails on anything else."""

import struct
import sys

ELF32_LITTLE = b"\x7fELF\x01\x01"
MACHINE_ARM = 40
ALLOCATED, WRITABLE, NO_BITS = 0x2, 0x1, 8


def main(path):
    with open(path, "rb") as file:
        data = file.read()
    if data[:6] != ELF32_LITTLE or struct.unpack_from("<H", data, 18)[0] != MACHINE_ARM:
        sys.exit(f"{path}: not a 32-bit ARM program")
    (offset,) = struct.unpack_from("<I", data, 32)
    size, count = struct.unpack_from("<HH", data, 46)
    flash = ram = 0
    for index in range(count):
        _, kind, flags, _, _, length = struct.unpack_from("<6I", data, offset + index * size)
        if flags & ALLOCATED:
            flash += 0 if kind == NO_BITS else length
            ram += length if flags & WRITABLE else 0
    print(f"links: {flash} bytes of flash, {ram} bytes of static RAM")


if __name__ == "__main__":
    main(sys.argv[1])
