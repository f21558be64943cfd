"""Shapes of Mitsuba as triangles.

Shapes without vertices get them in their own space: vertices, triangles, normals or ``None``, and texture coordinates.
"""

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
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    # Rounding would leave gaps at the seam and at the poles, and a medium or glass inside needs a closed mesh.
    points[:, -1] = points[:, 0]
    points[0], points[-1] = (0, 0, 1), (0, 0, -1)
    points = points.reshape(-1, 3)
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
    ring[-1] = ring[0]
    k = np.arange(PARTS)
    top = k + PARTS + 1
    triangles = np.concatenate([np.stack([k, k + 1, top + 1], axis=1), np.stack([k, top + 1, top], axis=1)])
    u = angles / (2 * math.pi)
    uvs = np.vstack([np.stack([u, 0 * u], axis=1), np.stack([u, 0 * u + 1], axis=1)])
    return np.vstack([ring, ring + (0, 0, 1)]), triangles, np.vstack([ring, ring]), uvs


SHAPES = {"Rectangle": _rectangle, "Disk": _disk, "Sphere": _sphere, "Cylinder": _cylinder}


def fronts(mi, shape, vertices, triangles, normals):
    """For each triangle, whether its front is the side from which its corners run clockwise; and the normals, towards the front.

    In Mitsuba, the side of a surface is that of its shading normal. Mitsuba merges shapes with the same BSDF, so the triangles of a mesh may
    be wound in different ways.
    """
    corners = vertices[triangles].astype(float)
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if shape.class_name() in SHAPES:
        flipped = np.full(len(triangles), _is_flipped(mi, shape, corners, crosses))
        return flipped, -normals if normals is not None and flipped.any() else normals
    towards = _shading_normals(mi, shape, len(triangles))
    flipped = (crosses * towards).sum(axis=1) < 0
    if normals is not None and (normals[triangles].mean(axis=1) * towards).sum() < 0:
        normals = -normals
    return flipped, normals


def _shading_normals(mi, shape, count):
    """Mitsuba's shading normals (N, 3) at the centres of the triangles of a mesh."""
    import drjit as dr

    if mi.variant().startswith("scalar"):
        ray, found = mi.Ray3f(mi.Point3f(0.0), mi.Vector3f(0.0, 0.0, 1.0)), []
        hit = mi.PreliminaryIntersection3f()
        hit.t, hit.prim_uv, hit.shape = 1.0, mi.Point2f(1 / 3, 1 / 3), shape
        for index in range(count):
            hit.prim_index = index
            found.append(np.array(shape.compute_surface_interaction(ray, hit).sh_frame.n, float))
        return np.array(found).reshape(-1, 3)
    hits = dr.zeros(mi.PreliminaryIntersection3f, count)
    hits.t, hits.prim_index = dr.full(mi.Float, 1.0, count), dr.arange(mi.UInt32, count)
    hits.prim_uv, hits.shape = mi.Point2f(dr.full(mi.Float, 1 / 3, count)), mi.ShapePtr(shape)
    ray = dr.zeros(mi.Ray3f, count)
    ray.d = mi.Vector3f(0.0, 0.0, 1.0)
    normals = shape.compute_surface_interaction(ray, hits).sh_frame.n
    return np.stack([np.broadcast_to(np.array(normals[k], float), count) for k in range(3)], axis=-1)


def _is_flipped(mi, shape, corners, crosses):
    """Whether the front of a shape without vertices is the back of its triangles."""
    sample = shape.sample_position(0, mi.Point2f(0.3, 0.4))
    point, normal = (np.array(value, float).reshape(3) for value in (sample.p, sample.n))
    nearest = np.linalg.norm(corners.mean(axis=1) - point, axis=1).argmin()
    return bool(crosses[nearest] @ normal < 0)
