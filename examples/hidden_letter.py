"""Finds what a confocal scan hides: python3 examples/hidden_letter.py SCAN.npy LETTER.png (needs numpy and matplotlib)

Each measurement says how much light came from points at one distance from a point of the wall. So every point of a volume collects
the light at its distance from each point of the wall (back-projection). The second derivative along the depth then sharpens the
surfaces.
"""

import json
import sys

import matplotlib.pyplot
import numpy

scan, picture = sys.argv[1:]
light = numpy.load(scan)  # gates x points
about = json.load(open(scan.removesuffix(".npy") + ".json"))
side, depth = numpy.linspace(-0.8, 0.8, 81), numpy.linspace(0.6, 1.4, 17)
volume = numpy.stack(numpy.meshgrid(side, side, depth, indexing="ij"), axis=-1)
collected = numpy.zeros(volume.shape[:3])
for point, seen in zip(about["laser_points"], light.T):
    way = 2 * numpy.linalg.norm(volume - point, axis=-1)
    gate = ((way - about["start_opl"]) // about["bin_width_opl"]).astype(int)
    inside = (gate >= 0) & (gate < len(seen))
    collected[inside] += seen[gate[inside]]
sharp = -numpy.gradient(numpy.gradient(collected, axis=2), axis=2)
column, row, layer = numpy.unravel_index(sharp.argmax(), sharp.shape)
print(f"brightest point: x = {side[column]:.2f} m, y = {side[row]:.2f} m, z = {depth[layer]:.2f} m")
pixels = numpy.kron(sharp.max(axis=2).T.clip(0), numpy.ones((4, 4)))
matplotlib.pyplot.imsave(picture, pixels, origin="lower")
