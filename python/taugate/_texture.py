"""Textures."""

from __future__ import annotations

import dataclasses
from typing import Optional, Union

import numpy as np
from numpy.typing import ArrayLike

from ._errors import SettingsError, explain_changes

WRAPS = ("repeat", "mirror", "clamp")
FILTERS = ("linear", "nearest")
# Limits of the program: of the sides in texels, and of the entries of a transform.
MAX_SIDE = 16384
MAX_TRANSFORM = 1e6
# Rows that are converted at a time, so that large images need little more memory than their bytes.
ROWS = 256


@explain_changes
@dataclasses.dataclass(frozen=True)
class Texture:
    """An image on a surface, with its filter and its place. A material also takes the texels alone.

    ``texels`` (H, W), (H, W, 1), (H, W, 3) or (H, W, 4); row 0 is at the top. Colours are sRGB as uint8, or linear as floats from 0 to 1.
    Alpha, and numbers such as roughness, are linear: uint8 (255 means 1) or floats from 0 to 1. The renderer has 8 bits per channel.

    ``wrap``: ``"repeat"``, ``"mirror"`` or ``"clamp"`` outside the image, or a pair of these for u and v. ``filter``: ``"linear"`` or ``"nearest"``.
    ``transform`` (3 x 3) maps the ``uvs`` of the mesh to those of the image, where (0, 0) is the top left corner and (1, 1) the bottom right one.
    The fields do not change, see :class:`Material`.
    """

    texels: ArrayLike
    wrap: Union[str, tuple[str, str]] = "repeat"
    filter: str = "linear"
    transform: Optional[ArrayLike] = None

    def _sampler(self, what):
        """Wrap modes, filter and transform as the native part takes them."""
        wrap = list(self.wrap) if isinstance(self.wrap, (list, tuple)) else [self.wrap] * 2
        if len(wrap) != 2 or any(mode not in WRAPS for mode in wrap):
            raise SettingsError(f"the wrap mode of the {what} is {self.wrap!r}; choose repeat, mirror or clamp, or two of them for u and v")
        if self.filter not in FILTERS:
            raise SettingsError(f"the filter of the {what} is {self.filter!r}; choose linear or nearest")
        matrix = np.eye(3) if self.transform is None else np.array(self.transform, float)
        if matrix.shape != (3, 3) or not np.allclose(matrix[2], (0, 0, 1)):
            raise SettingsError(f"the transform of the {what} must be a 3 x 3 matrix with the last row 0, 0, 1")
        if not (np.abs(matrix) <= MAX_TRANSFORM).all():
            raise SettingsError(f"the transform of the {what} has numbers that are not finite, or above 1e6")
        return {"wrap": wrap, "linear": self.filter == "linear", "transform": matrix[:2].tolist()}


def color_bytes(texels, name):
    """Colours as sRGB bytes with alpha (H, W, 4). `name`: of the material."""
    texels = _checked(texels, f"texture of '{name}'", (1, 3, 4))
    if texels.dtype == np.uint8 and texels.shape[2] == 4:
        return np.ascontiguousarray(texels)
    colors = 3 if texels.shape[2] > 1 else 1
    bytes = np.full((*texels.shape[:2], 4), 255, np.uint8)
    for rows in blocks(texels):
        part = texels[rows]
        is_bytes = texels.dtype == np.uint8
        bytes[rows, :, :3] = part[..., :colors] if is_bytes else srgb_bytes(part[..., :colors])
        if texels.shape[2] == 4:
            bytes[rows, :, 3] = linear_bytes(part[..., 3])
    return bytes


def surface_bytes(roughness, metallic, name):
    """The metallic-roughness texture of glTF as bytes (H, W, 4): green is the roughness and blue the metalness. One of them may be ``None``.
    `name`: of the material."""
    bytes = None
    for channel, what, texels in ((1, "roughness_texture", roughness), (2, "metallic_texture", metallic)):
        if texels is None:
            continue
        texels = _checked(texels, f"{what} of '{name}'", (1,))
        if bytes is None:
            bytes = np.full((*texels.shape[:2], 4), 255, np.uint8)
        if texels.shape[:2] != bytes.shape[:2]:
            raise SettingsError(f"the roughness_texture and the metallic_texture of '{name}' become one image; give them the same shape")
        bytes[..., channel] = texels[..., 0] if texels.dtype == np.uint8 else linear_bytes(texels[..., 0])
    return bytes


def blocks(texels):
    """Slices of rows that together are the image."""
    return [slice(row, row + ROWS) for row in range(0, len(texels), ROWS)]


def srgb_bytes(linear):
    """sRGB of linear values from 0 to 1 (IEC 61966-2-1)."""
    linear = np.asarray(linear, np.float32)
    return linear_bytes(np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** np.float32(1 / 2.4) - 0.055))


def linear_bytes(values):
    return (255 * np.asarray(values, np.float32) + 0.5).astype(np.uint8)


def srgb_to_linear(bytes):
    """Linear values from 0 to 1 of sRGB bytes."""
    values = np.arange(256) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4).astype(np.float32)[bytes]


def _checked(texels, what, channels):
    """The texels with three axes."""
    texels = np.asarray(texels)
    image = texels[..., None] if texels.ndim == 2 else texels
    if image.ndim != 3 or image.shape[2] not in channels:
        shapes = ["(H, W)"] + [f"(H, W, {count})" for count in channels]
        raise SettingsError(f"the {what} has the shape {texels.shape}, but must be {', '.join(shapes[:-1])} or {shapes[-1]}")
    if not all(1 <= side <= MAX_SIDE for side in image.shape[:2]):
        raise SettingsError(f"the {what} has the shape {texels.shape}, but each side must have from 1 to {MAX_SIDE:,} texels; scale it down")
    if image.dtype != np.uint8:
        if image.dtype.kind != "f":
            raise SettingsError(f"the {what} has the type {image.dtype}, but must be uint8, or floats from 0 to 1")
        if not (image.min() >= 0 and image.max() <= 1):
            raise SettingsError(f"the {what} has values that are not from 0 to 1")
    return image
