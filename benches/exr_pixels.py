#!/usr/bin/env python3
"""Tests whether two EXR files have the same channels with the same bits: exr_pixels.py A.exr B.exr. Exit code 0 if equal, else 1.

Attributes such as the render time and the version may differ. The script compares the compressed scan lines byte by byte, so both
files must come from the same encoder.
"""

import struct
import sys

# Attributes that determine how to read the bytes of the pixels.
MEANING = {b"channels", b"compression", b"dataWindow", b"lineOrder", b"type"}


def pixels(path):
    with open(path, "rb") as file:
        data = file.read()
    if data[:4] != b"\x76\x2f\x31\x01":
        sys.exit(f"{path}: not an EXR file")
    at, meaning = 8, {}
    while data[at]:
        name, kind, rest = data[at:].split(b"\0", 2)
        at += len(name) + len(kind) + 2
        (size,) = struct.unpack_from("<i", data, at)
        if name in MEANING:
            meaning[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    # The table of offsets follows the header. Its first entry is the position of the first scan line.
    (first,) = struct.unpack_from("<Q", data, at + 1)
    return meaning, data[first:]


if len(sys.argv) != 3:
    sys.exit(__doc__)
sys.exit(0 if pixels(sys.argv[1]) == pixels(sys.argv[2]) else 1)
