"""Shapes of Mitsuba without vertices, as triangles in their own space: vertices, triangles, normals or ``None``, and texture coordinates."""

import math

import numpy as np

# Segments per circle.
PARTS = 64


def _rectangle():
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], float)
    return corners, np.array([(0, 1, 2), (0, 2, 3)]), None, (corners[:, :2] + 1) / 2


def _disk():
    k = np.arange(PARTS + 1)
    angles = 2 * math.pi * k / PARTS
    # The polygon has the area of the disk.
    radius = math.sqrt(math.pi / (PARTS / 2 * math.sin(2 * math.pi / PARTS)))
    rim = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    k = k[:-1]
    # Each triangle has a centre of its own, because v is the angle.
    uvs = np.vstack([np.stack([0 * angles + 1, angles / (2 * math.pi)], axis=1), np.stack([0 * k, (k + 0.5) / PARTS], axis=1)])
    return np.vstack([rim, np.zeros((PARTS, 3))]), np.stack([PARTS + 1 + k, k, k + 1], axis=1), None, uvs


def _sphere():
    rows = PARTS // 2
    theta, phi = np.meshgrid(math.pi * np.arange(rows + 1) / rows, 2 * math.pi * np.arange(PARTS + 1) / PARTS, indexing="ij")
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(rows), np.arange(PARTS), indexing="ij"))
    a, b = i * (PARTS + 1) + j, (i + 1) * (PARTS + 1) + j
    triangles = np.concatenate([np.stack([a, b, b + 1], axis=1)[i < rows - 1], np.stack([a, b + 1, a + 1], axis=1)[i > 0]])
    u, v = phi / (2 * math.pi), theta / math.pi
    # Each pole has one vertex per triangle, with the longitude of the middle of the triangle.
    u[0] += 0.5 / PARTS
    u[-1] -= 0.5 / PARTS
    return points, triangles, points, np.stack([u, v], axis=-1).reshape(-1, 2)


def _cylinder():
    angles = 2 * math.pi * np.arange(PARTS + 1) / PARTS
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    k = np.arange(PARTS)
    top = k + PARTS + 1
    triangles = np.concatenate([np.stack([k, k + 1, top + 1], axis=1), np.stack([k, top + 1, top], axis=1)])
    u = angles / (2 * math.pi)
    uvs = np.vstack([np.stack([u, 0 * u], axis=1), np.stack([u, 0 * u + 1], axis=1)])
    return np.vstack([ring, ring + (0, 0, 1)]), triangles, np.vstack([ring, ring]), uvs


SHAPES = {"Rectangle": _rectangle, "Disk": _disk, "Sphere": _sphere, "Cylinder": _cylinder}
