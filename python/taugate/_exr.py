"""OpenEXR files from arrays."""

from __future__ import annotations

import struct
from typing import BinaryIO

import numpy as np


def write_exr(file: BinaryIO, image: np.ndarray) -> None:
    """Writes an OpenEXR file without compression. `image` is (H, W, 3), linear, row 0 at the top."""
    height, width = image.shape[:2]
    text = lambda name: name.encode() + b"\0"
    attribute = lambda name, kind, data: text(name) + text(kind) + struct.pack("<i", len(data)) + data
    # The pixels of each channel are 32-bit floats (type 2) without subsampling.
    channels = b"".join(text(name) + struct.pack("<iIii", 2, 0, 1, 1) for name in "BGR") + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = b"".join([
        struct.pack("<II", 20000630, 2),
        attribute("channels", "chlist", channels),
        attribute("compression", "compression", b"\0"),
        attribute("dataWindow", "box2i", window),
        attribute("displayWindow", "box2i", window),
        attribute("lineOrder", "lineOrder", b"\0"),
        attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
        attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
        b"\0",
    ])
    size = 12 * width
    first = len(header) + 8 * height
    offsets = struct.pack(f"<{height}Q", *(first + row * (8 + size) for row in range(height)))
    file.write(header + offsets)
    for row, pixels in enumerate(image):
        # In each line, the channels follow each other in the order of their names.
        file.write(struct.pack("<ii", row, size) + np.ascontiguousarray(pixels[:, ::-1].T, "<f4").tobytes())
