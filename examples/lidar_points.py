"""Points of a LiDAR scan: python3 examples/lidar_points.py SCAN.npy POINTS.ply [ECHOES] (needs numpy)

Each beam has up to ECHOES points (default 3): the peaks of its histogram, the earliest first. The file has position and intensity of
each point, and opens in CloudCompare, MeshLab and Blender.
"""

import json
import sys

import numpy

scan, points = sys.argv[1:3]
echoes = int(sys.argv[3]) if len(sys.argv) > 3 else 3
light = numpy.load(scan)  # gates x beams
about = json.load(open(scan.removesuffix(".npy") + ".json"))
laser = numpy.array(about["laser"])
beams = numpy.array(about["laser_points"]) - laser
beams /= numpy.linalg.norm(beams, axis=1, keepdims=True)
distance = 0.5 * (about["start_opl"] + about["bin_width_opl"] * (numpy.arange(len(light)) + 0.5))
found = []
for beam, seen in zip(beams, light.T):
    around = numpy.pad(seen, 1)
    peaks = numpy.flatnonzero((seen > around[:-2]) & (seen >= around[2:]) & (seen > 0.01 * seen.max()))
    found += [(*(laser + distance[k] * beam), seen[k]) for k in peaks[:echoes]]
header = f"ply\nformat ascii 1.0\nelement vertex {len(found)}\n"
header += "".join(f"property float {name}\n" for name in ["x", "y", "z", "intensity"]) + "end_header"
numpy.savetxt(points, numpy.array(found).reshape(-1, 4), fmt="%.4f %.4f %.4f %.6g", header=header, comments="")
print(f"{points}: {len(found)} points of {len(beams)} beams")
