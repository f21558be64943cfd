"""Writes a density grid: a cloud of 60 puffs, as an array of shape (64, 64, 64). Needs numpy.

    python3 examples/cloud.py cloud.npy
"""

import sys

import numpy

z, y, x = numpy.mgrid[-1:1:64j, -1:1:64j, -1:1:64j]
random = numpy.random.default_rng(4)
density = numpy.zeros(x.shape)
for _ in range(60):
    cx, cy, cz = random.uniform(-0.6, 0.6, 3)
    density += numpy.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / random.uniform(0.005, 0.04))
# Thin parts become clear air, so the cloud has an edge.
numpy.save(sys.argv[1], numpy.maximum(density - 0.6, 0).astype("float32"))
