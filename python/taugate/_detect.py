"""Photon counts of a detector, such as a SPAD array."""

from __future__ import annotations

import json
import os
import pathlib
from typing import Any, Optional, Union

import numpy as np

from . import _native
from ._errors import SettingsError
from ._image import Histogram, Image
from ._scan import Scan
from ._words import span


class Counts:
    """The counts of a detector over all pulses.

    ``data`` is a float32 array with the axes of the light; with ``mono=True``, images have one channel. ``description`` is the JSON of the
    program: gates, detector, settings.
    """

    def __init__(self, data: np.ndarray, description: dict[str, Any]) -> None:
        self.data, self.description = data, description

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the array (.npy) and its description (.json), as ``taugate detect`` does."""
        path = pathlib.Path(path)
        if path.suffix != ".npy":
            raise SettingsError(f"the output {path} must end in .npy")
        _native.write_scan(path, self.data, None, None, None, json.dumps(self.description))

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray:
        return np.array(self.data, dtype=dtype or np.float32)

    def __repr__(self) -> str:
        return f"<taugate.Counts {' x '.join(map(str, self.data.shape))}, {self.data.sum(dtype=float):.0f} counts>"


def detect(
    light: Union[Image, Histogram, Scan],
    photons: float,
    *,
    pulses: int = 1,
    efficiency: float = 1.0,
    background: Union[float, Image, np.ndarray] = 0.0,
    dark_counts: float = 0.0,
    jitter: Union[None, float, str] = None,
    dead_time: Union[None, float, str] = None,
    first_photon: bool = False,
    mono: bool = False,
    seed: int = 0,
) -> Counts:
    """Draws the photon counts of a detector that sees ``light``, and returns :class:`Counts`. The same bits as ``taugate detect``.

    The arguments are the flags of the program. ``photons``: photons that reach a pixel per pulse for each unit of the light, J/(m^2 sr).
    ``background``: daylight in W/(m^2 sr), as a number, or as an image without a gate or an array (H, W, 3). ``jitter`` and ``dead_time``:
    text such as ``"50ps"``, or metres of optical path. Wrong values raise :class:`SettingsError`.
    """
    if isinstance(light, Scan):
        data, description = light.data, json.dumps(light.description)
    elif isinstance(light, (Image, Histogram)):
        data, description = light.pixels, light._native.description()
        if isinstance(light, Histogram) and data.shape[2] == 1:
            data = data[:, :, 0]
    else:
        raise SettingsError(f"the light is a {type(light).__name__}, but must be an Image, a Histogram or a Scan")
    numbers = (photons, pulses, efficiency, dark_counts, span(jitter), span(dead_time), first_photon)
    data = np.ascontiguousarray(data, np.float32)
    counts, about = _native.detect(data, description, numbers, _background(background, light), mono, seed)
    description = json.loads(about)
    description["detector"]["background"] = float(background) if np.isscalar(background) else None
    return Counts(counts, description)


def _crop(image):
    """The part of the whole image that an image shows, and the size of the whole image."""
    description = json.loads(image._native.description())
    return description["crop"], description["resolution"]


def _background(background, light):
    """R, G, B of the background per pixel."""
    is_scan = isinstance(light, Scan)
    pixels = int(np.prod(light.data.shape[1:])) if is_scan else light.pixels.shape[0] * light.pixels.shape[1]
    if isinstance(background, Image):
        if background.gate != (0.0, float("inf")):
            raise SettingsError("the background has a gate, but daylight has none; render it without a gate")
        if not is_scan and _crop(background) != _crop(light):
            raise SettingsError("the background shows another part of the image than the light; render it with the same crop")
        background = background.pixels
    values = np.asarray(background, np.float32)
    shape = (pixels, 3) if is_scan else (*light.pixels.shape[:2], 3)
    if values.ndim and (is_scan or values.shape != shape):
        raise SettingsError(f"the background has the shape {values.shape}, but must be a number or have the shape {shape}")
    if not np.isfinite(values).all() or (values < 0).any():
        raise SettingsError("the background must be finite, 0 or more")
    return np.ascontiguousarray(np.broadcast_to(values, shape), np.float32).reshape(-1)
