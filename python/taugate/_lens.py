"""Lens distortion: the models of OpenCV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

STEPS = 10


def images(to: np.ndarray, k: Sequence[float], fisheye: bool) -> np.ndarray:
    """Images (..., 2) of directions (..., 3) with x right, y down and z along the view, in focal lengths from the principal point."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if fisheye and k:
            aside = np.linalg.norm(to[..., :2], axis=-1)
            distance, _ = _distance(np.arctan2(aside, to[..., 2]), k)
            return to[..., :2] * np.where(aside > 0, distance / aside, 1.0)[..., None]
        pinhole = to[..., :2] / to[..., 2:]
        return _distort(pinhole, k)[0] if k else pinhole


def directions(image: np.ndarray, k: Sequence[float], fisheye: bool) -> np.ndarray:
    """Directions (..., 3) with these images: the inverse of ``images``."""
    if not k:
        return np.concatenate([image, np.ones_like(image[..., :1])], axis=-1)
    if fisheye:
        distance = np.linalg.norm(image, axis=-1)
        angle = distance
        for _ in range(STEPS):
            found, slope = _distance(angle, k)
            angle = angle - (found - distance) / slope
        scale = np.divide(np.sin(angle), distance, out=np.ones_like(angle), where=distance > 0)
        return np.concatenate([image * scale[..., None], np.cos(angle)[..., None]], axis=-1)
    p = image
    for _ in range(STEPS):
        found, derivative = _distort(p, k)
        p = p - np.linalg.solve(derivative, (found - image)[..., None])[..., 0]
    return np.concatenate([p, np.ones_like(p[..., :1])], axis=-1)


def _distance(a, k):
    """Distance of a fisheye's image from the principal point at the angle ``a``, and its derivative."""
    k1, k2, k3, k4 = k
    a2 = a * a
    return (
        a * (1 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))),
        1 + a2 * (3 * k1 + a2 * (5 * k2 + a2 * (7 * k3 + a2 * 9 * k4))),
    )


def _distort(p, k):
    """The image of a pinhole's image, and its derivative (..., 2, 2)."""
    k1, k2, p1, p2, k3, k4, k5, k6 = (*k[:8], *(0.0,) * (8 - len(k[:8])))
    x, y = p[..., 0], p[..., 1]
    r2 = x * x + y * y
    below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    factor = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / below
    slope = (k1 + r2 * (2 * k2 + 3 * r2 * k3) - factor * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / below
    image = np.stack(
        [x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=-1
    )
    mixed = 2 * x * y * slope + 2 * (p1 * x + p2 * y)
    xx = factor + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    yy = factor + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    return image, np.stack([np.stack([xx, mixed], axis=-1), np.stack([mixed, yy], axis=-1)], axis=-2)
