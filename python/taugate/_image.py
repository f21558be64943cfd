"""Results of renders."""

from __future__ import annotations

import functools
import os
from typing import TYPE_CHECKING, Any, Optional

import numpy as np

from ._camera import Camera
from ._errors import SettingsError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ._native import NativeImage

#: Auxiliary layers: their names, and the names of their channels.
_LAYERS = {"depth": "Z", "normal": "XYZ", "albedo": "RGB", "object": ("ID",), "arrival": "Z"}


class _Result:
    """What an image and a histogram have in common. They can be pickled and copied."""

    def __init__(self, native: NativeImage) -> None:
        self._native = native

    @property
    def samples(self) -> int:
        """Samples per pixel, on average."""
        return self._native.samples

    @property
    def mean(self) -> tuple[float, Optional[float]]:
        """Mean over all pixels and channels, and its standard error; ``None`` instead of the error after one iteration."""
        return self._native.mean

    @property
    def iterations(self) -> int:
        """Number of iterations; the variances are estimated from them."""
        return self._native.iterations

    @property
    def seconds(self) -> float:
        """Time of all iterations, without preparations."""
        return self._native.seconds

    @property
    def settings(self) -> str:
        """All settings with their defaults, as an experiment file (TOML) of the program, without arrays and the transforms of moved objects."""
        return self._native.settings

    @property
    def notes(self) -> list[str]:
        """Choices that taugate made, one sentence each."""
        return self._native.notes

    @property
    def warnings(self) -> list[str]:
        """Warnings, one sentence each."""
        return self._native.warnings

    @property
    def dropped(self) -> int:
        """Samples that were not finite and count as 0."""
        return self._native.dropped

    @functools.cached_property
    def camera(self) -> Camera:
        """The camera, with intrinsics and pose as matrices."""
        return Camera._of(self._native.view)

    @functools.cached_property
    def layers(self) -> dict[str, np.ndarray]:
        """Auxiliary layers (``aov=...``) by name: ``depth`` (H, W) length of the camera ray in metres, ``normal`` (H, W, 3), ``albedo``
        (H, W, 3), ``object`` (H, W) numbers of :attr:`objects`, ``arrival`` (H, W) metres of optical path. Where the camera ray meets no
        surface, they are 0."""
        channels = self._native.layers()
        layers = {}
        for group, parts in _LAYERS.items():
            names = [f"{group}.{part}" for part in parts]
            if all(name in channels for name in names):
                planes = [channels.pop(name) for name in names]
                layers[group] = planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)
        return {**layers, **channels}

    def __getattr__(self, name: str) -> np.ndarray:
        if name in _LAYERS:
            if name in self.layers:
                return self.layers[name]
            raise AttributeError(f"this render has no layer {name}; render with aov='{name}'")
        raise AttributeError(f"{type(self).__name__} has no {name}")

    @functools.cached_property
    def objects(self) -> dict[int, str]:
        """Names of the objects in the layer ``object``, by number. The numbers are those of ``scene.info()["objects"]``."""
        return self._native.objects()

    def save(self, path: str | os.PathLike[str], exposure: Optional[float] = None) -> None:
        """Writes the files of the program: ``.exr``, or ``.npy`` with a description ``.json`` and variances ``.variance.npy``, or a picture
        ``.png`` with this exposure in stops (``None``: automatic). Only results of ``taugate.farm`` can be saved as sums (``.acc``);
        other renders write them with ``checkpoint``.
        If there are no variances, an older ``.variance.npy`` is removed."""
        self._native.save(path, exposure)


class Image(_Result):
    """An image of one gate, or of all light.

    ``pixels`` and ``variance`` are float32 arrays (H, W, 3), row 0 at the top: radiance in W/(m^2 sr), integrated over the gate, and the variance
    of its mean. With ``fireflies="damp"``, the variance is that of ``undamped``.
    """

    @functools.cached_property
    def pixels(self) -> np.ndarray:
        return self._native.pixels()

    @functools.cached_property
    def undamped(self) -> Optional[np.ndarray]:
        """The unbiased image of a render with ``fireflies="damp"``, whose ``pixels`` are damped. Else ``None``."""
        return self._native.undamped()

    @functools.cached_property
    def variance(self) -> np.ndarray:
        return self._native.variance()

    @property
    def gate(self) -> tuple[float, float]:
        """Begin and end of the gate in metres of optical path; ``(0, inf)`` for all light."""
        [(_, begin, end)] = self._native.gates
        return begin, end

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray:
        return np.array(self.pixels, dtype=dtype or np.float32)

    def show(self, exposure: Optional[float] = None, ax: Optional[Axes] = None) -> Axes:
        """Plots the picture with matplotlib, and returns the axes."""
        ax = ax or _pyplot().subplots()[1]
        ax.imshow(self._native.picture(exposure))
        ax.set_axis_off()
        begin, end = self.gate
        ax.set_title("all light" if end == float("inf") else f"{begin:.6g} m to {end:.6g} m")
        return ax

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        return f"<taugate.Image {width}x{height}, gate {self._native.support}, {self.samples} samples>"


class Histogram(_Result):
    """Images of many gates, from the same light paths.

    ``pixels`` is a float32 array (H, W, T, 3): radiance in W/(m^2 sr), integrated over each gate. ``variance`` has the same shape; it is ``None``
    unless the render had ``variance=True`` or a single gate.
    """

    @functools.cached_property
    def pixels(self) -> np.ndarray:
        return self._native.bins()

    @functools.cached_property
    def variance(self) -> Optional[np.ndarray]:
        return self._native.bin_variance()

    @functools.cached_property
    def gates(self) -> np.ndarray:
        """Begin and end of each gate in metres of optical path: (T, 2)."""
        return np.array([(begin, end) for _, begin, end in self._native.gates])

    @property
    def names(self) -> list[str]:
        """Names of the gates."""
        return [name for name, _, _ in self._native.gates]

    @functools.cached_property
    def edges(self) -> np.ndarray:
        """The T + 1 edges of the gates in metres of optical path, like those of ``numpy.histogram``. Fails if the gates do not abut."""
        gates = self.gates
        if not np.allclose(gates[1:, 0], gates[:-1, 1], rtol=1e-12):
            raise SettingsError("these gates do not abut, so they have no common edges; use .gates")
        return np.append(gates[:, 0], gates[-1, 1])

    @property
    def centers(self) -> np.ndarray:
        """The middle of each gate in metres of optical path."""
        return self.gates.mean(axis=1)

    def to_mitransient(self) -> tuple[np.ndarray, np.ndarray]:
        """The pair (steady, transient) as ``mi.render`` of mitransient gives it: (H, W, 3) and (H, W, T, 3). ``steady`` is the sum over the
        gates. That of mitransient also has the light outside the gates: :func:`taugate.render` without a gate gives it.
        :meth:`mitransient_film` gives the settings of the film."""
        return self.pixels.sum(axis=2), self.pixels

    def mitransient_film(self) -> dict[str, float]:
        """``start_opl``, ``bin_width_opl`` and ``temporal_bins`` of mitransient's film. Fails if the gates have different widths."""
        uniform = self._native.uniform
        if uniform is None:
            raise SettingsError("mitransient's film has gates of one width that abut, such as gates='1m..2m/100'")
        start, width, count = uniform
        return {"start_opl": start, "bin_width_opl": width, "temporal_bins": count}

    def show(self, pixel: Optional[tuple[int, int]] = None, ax: Optional[Axes] = None) -> Axes:
        """Plots the histogram of a pixel (column, row), or of the mean over all pixels, with matplotlib. Returns the axes."""
        ax = ax or _pyplot().subplots()[1]
        light = self.pixels.mean(axis=(0, 1)) if pixel is None else self.pixels[pixel[1], pixel[0]]
        ax.stairs(light.mean(axis=-1), self.edges)
        ax.set_xlabel("optical path (m)")
        ax.set_ylabel("radiance in each gate (W/m$^2$/sr)")
        ax.set_title("mean over all pixels" if pixel is None else f"pixel {pixel[0]}, {pixel[1]}")
        return ax

    def __repr__(self) -> str:
        height, width, count, _ = self.pixels.shape
        return f"<taugate.Histogram {width}x{height}, {count} gates in {self._native.support}, {self.samples} samples>"


def _pyplot():
    try:
        import matplotlib.pyplot
    except ImportError:
        raise ImportError("show() needs matplotlib: pip install matplotlib") from None
    return matplotlib.pyplot
