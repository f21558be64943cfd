"""Arrays of vertices, indices and matrices, checked and copied."""

from __future__ import annotations

import numpy as np

from ._errors import SettingsError

# Largest error of a vertex from rounding to 32 bits, relative to the size of the mesh. Above it, vertices are stored relative to its centre.
MAX_ROUNDING = 1e-5


def array_of(values, kind, axes, what):
    """A copy of the values as an array of this type and number of axes."""
    values = np.asarray(values)
    if values.ndim != axes:
        raise SettingsError(f"{what} have the shape {values.shape}, but must have {axes} axes")
    if np.issubdtype(kind, np.integer) and values.size and (values.dtype.kind not in "iu" or values.min() < 0):
        raise SettingsError(f"{what} must be whole numbers from 0 on")
    return np.array(values, dtype=kind, order="C")


def near_origin(vertices):
    """The vertices as 32-bit numbers, and the point that they are relative to. This point is the origin, unless rounding would move a vertex
    by more than 1e-5 of the size of the mesh, as in a small mesh with geographic coordinates."""
    rounded = array_of(vertices, np.float32, 2, "vertices")
    vertices = np.asarray(vertices)
    if vertices.dtype != np.float32 and vertices.shape[1] == 3 and vertices.size and np.isfinite(rounded).all():
        low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
        if np.abs(rounded - vertices).max() > MAX_ROUNDING * (high - low).max():
            centre = (low + high) / 2
            return array_of(vertices - centre, np.float32, 2, "vertices"), centre
    return rounded, np.zeros(3)


def translation(offset):
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def matrix_of(matrix):
    """A copy of a 4 x 4 matrix; the identity if there is none."""
    if matrix is None:
        return np.eye(4)
    matrix = np.array(matrix, dtype=float)
    if matrix.shape != (4, 4) or not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise SettingsError("a transform is a 4 x 4 matrix with the last row 0, 0, 0, 1")
    return matrix
