"""Writes a density grid: a cloud of 80 puffs, as an array of shape (64, 64, 64). Needs numpy.

    python3 examples/cloud.py cloud.npy
"""

import sys

import numpy

z, y, x = numpy.mgrid[-1:1:64j, -1:1:64j, -1:1:64j]
random = numpy.random.default_rng(4)
density = numpy.zeros(x.shape)
for _ in range(80):
    cx, cy, cz = random.uniform(-0.7, 0.7, 3)
    density += numpy.exp(-((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) / random.uniform(0.005, 0.03))
numpy.save(sys.argv[1], density.astype("float32"))
