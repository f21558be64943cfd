#!/usr/bin/env python3
"""Draws the points of a LiDAR over a street, seen from behind and above it: points.py POINTS.npy OUT.png time|object

The points are those of taugate lidar, as .npy. With time, their colour goes from blue, the first shots, to orange, the last ones. With
object, echoes of fog are blue. Brightness is that of the surface. Needs numpy and Pillow.
"""

import sys

import numpy
from PIL import Image

WIDTH, HEIGHT, FOCAL = 640, 300, 400
LIDAR = numpy.array([0.0, 1.6, 0.0])

if len(sys.argv) != 4 or sys.argv[3] not in ("time", "object"):
    sys.exit(__doc__)
EYE = numpy.array([7.0, 9.0, 14.0] if sys.argv[3] == "time" else [5.0, 5.5, 5.0])
TOWARDS = numpy.array([-1.0, 0.5, -14.0] if sys.argv[3] == "time" else [-1.5, 0.6, -10.0])
points = numpy.load(sys.argv[1])
places = numpy.stack([points[name] for name in "xyz"], axis=1)
forward = (TOWARDS - EYE) / numpy.linalg.norm(TOWARDS - EYE)
right = numpy.cross(forward, [0, 1, 0])
right /= numpy.linalg.norm(right)
depth = (places - EYE) @ forward
x = (WIDTH / 2 + FOCAL * ((places - EYE) @ right) / depth).astype(int)
y = (HEIGHT / 2 - FOCAL * ((places - EYE) @ numpy.cross(right, forward)) / depth).astype(int)
white = numpy.clip(points["intensity"] * ((places - LIDAR) ** 2).sum(axis=1), 0, 1)
if sys.argv[3] == "time":
    late = points["time"] / points["time"].max()
    colour = numpy.stack([0.25 + 0.75 * late, 0.35 + 0.4 * white, 1 - 0.75 * late], axis=1)
    colour *= 0.45 + 0.55 * numpy.clip(1.5 * white, 0, 1)[:, None]
else:
    # Fog and the windscreen take most of the light.
    bright = numpy.sqrt(white / numpy.percentile(white, 98)).clip(0.25, 1)[:, None]
    colour = numpy.where(points["object_id"][:, None] > 0, bright * [1.0, 0.75, 0.4], [0.2, 0.35, 0.7])
picture = numpy.full((HEIGHT, WIDTH, 3), 0.04)
for k in numpy.argsort(-depth):
    if depth[k] > 0.5 and 0 <= x[k] < WIDTH and 0 <= y[k] < HEIGHT:
        side = 2 if depth[k] < 22 else 1
        picture[y[k] : y[k] + side, x[k] : x[k] + side] = colour[k]
Image.fromarray((255 * numpy.clip(picture, 0, 1)).astype(numpy.uint8)).quantize(64).save(sys.argv[2], optimize=True)
