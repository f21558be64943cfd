"""Scans: a laser and a sensor that look at points of a wall, and the HDF5 files of tal."""

from __future__ import annotations

import io
import json
import os
import pathlib
import warnings
from typing import Any, Optional

import numpy as np

from . import _native
from ._errors import SettingsError, early_end
from ._files import writing
from ._render import AnyScene, Watcher, watcher
from ._scene import Scene, load

# Numbers of tal's enumerations HFormat, GridFormat and VolumeFormat.
H_FORMATS = {"T_Sx_Sy": 1, "T_Lx_Ly_Sx_Sy": 2, "T_Si": 3, "T_Li_Si": 4}
GRID_FORMATS = {2: 1, 3: 2}
UNKNOWN_VOLUME = 0


class Scan:
    """The result of a scan.

    ``data`` is a float32 array: (T, points) for a confocal scan, else (T, points of the laser, points of the sensor). It holds the radiance of
    the points in W/(m^2 sr), as the mean of red, green and blue. Points that an interrupt left out are NaN. ``variance`` has the
    same shape; ``None`` if the scan had no ``variance=True``. ``velocity`` has a last axis for the mean radial velocity of the light and its
    standard deviation in m/s, NaN without light; ``None`` if the scan had no ``doppler``. ``description`` is the JSON of the program:
    positions, gates, settings.
    ``layers`` are the auxiliary layers of a scan that the program made with ``--aov``: an array with one field per layer, else ``None``.
    """

    def __init__(
        self,
        data: np.ndarray,
        description: dict[str, Any],
        variance: Optional[np.ndarray] = None,
        layers: Optional[np.ndarray] = None,
        velocity: Optional[np.ndarray] = None,
    ) -> None:
        self.data, self.description, self.variance = data, description, variance
        self.layers, self.velocity = layers, velocity

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scan:
        """Reads the array ``path`` (.npy) that the program or :meth:`save` wrote, and its description (.json) beside it. Raises
        :class:`FileError` if the two do not belong together."""
        path = pathlib.Path(path)
        description = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        if "laser_points" not in description:
            raise SettingsError(f"{path} is no scan, but an image")
        data = np.load(path)
        variance, velocity, layers = (np.load(beside) if beside else None for beside in _native.check_scan(path))
        if variance is not None and variance.shape != data.shape:
            # The file is from an older scan of the same name, by a version that recorded no check sums.
            variance = None
        return cls(data, description, variance, layers, velocity)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the array (.npy), its description (.json), its variances (.variance.npy), its velocities (.velocity.npy) and its layers
        (.aov.npy): all of them or none. Those of an older scan are removed if there are no new ones."""
        path = pathlib.Path(path)
        if path.suffix != ".npy":
            raise SettingsError(f"the output {path} must end in .npy; to_tal writes HDF5")
        numbers = (self.data, self.variance, self.velocity)
        arrays = [None if array is None else np.asarray(array, np.float32) for array in numbers]
        layers = None
        if self.layers is not None:
            written = io.BytesIO()
            np.save(written, self.layers)
            layers = written.getvalue()
        _native.write_scan(path, *arrays, layers, json.dumps(self.description))

    @property
    def is_confocal(self) -> bool:
        """Whether laser and sensor always look at the same point."""
        return self.data.ndim == 2

    @property
    def laser_points(self) -> np.ndarray:
        """Positions (N, 3) of the points of the laser, in metres."""
        return np.array(self.description["laser_points"])

    @property
    def sensor_points(self) -> np.ndarray:
        """Positions (N, 3) of the points of the sensor, in metres."""
        return np.array(self.description["sensor_points"])

    @property
    def edges(self) -> np.ndarray:
        """The T + 1 edges of the gates in metres of optical path."""
        start, width, count = self._bins()
        return start + width * np.arange(count + 1)

    def _bins(self):
        keys = ("start_opl", "bin_width_opl", "temporal_bins")
        if not all(key in self.description for key in keys):
            raise SettingsError("the gates of this scan have different widths; scan with gates='A..B/N'")
        return tuple(self.description[key] for key in keys)

    def to_tal(self, path: str | os.PathLike[str]) -> None:
        """Writes the HDF5 file of tal (y-tal), which reconstructs hidden scenes. Needs h5py.

        Grids of points become axes x (columns) and y (rows). H is the sum over the channels. A single point of the laser has no axis in H.
        Normals are those of the plane through the points, on the side of the laser or the sensor.
        """
        if "laser_places" in self.description:
            raise SettingsError("tal has one place for the laser, and this LiDAR moves; scan without trajectory")
        try:
            import h5py
        except ImportError:
            raise ImportError("to_tal() needs h5py: pip install h5py") from None
        start, width, _ = self._bins()
        about = self.description
        laser, sensor = np.array(about["laser"]), np.array(about["sensor"])
        laser_axes, laser_grid = _grid(self.laser_points, about["laser_grid"])
        sensor_axes, sensor_grid = _grid(self.sensor_points, about["sensor_grid"])
        H = 3 * self.data
        bins = [len(H)]
        if self.is_confocal:
            H, name = _columns_first(H.reshape(bins + sensor_axes), 1), ["T_Si", "T_Sx_Sy"][len(sensor_axes) - 1]
        elif len(self.laser_points) == 1:
            H, name = _columns_first(H.reshape(bins + sensor_axes), 1), ["T_Si", "T_Sx_Sy"][len(sensor_axes) - 1]
            # tal expects a grid of one point beside a grid.
            laser_grid = laser_grid.reshape([1] * len(sensor_axes) + [3])
        elif len(laser_axes) != len(sensor_axes):
            raise SettingsError("tal needs two grids or two lists of points, not one of each")
        else:
            H = H.reshape(bins + laser_axes + sensor_axes)
            H, name = (H, "T_Li_Si") if len(laser_axes) == 1 else (_columns_first(H, 1, 3), "T_Lx_Ly_Sx_Sy")
        info = {"original_format": "HDF5_TAL", "config": {"renderer": about["version"], "unit": about["unit"]}}
        contents = {
            "H": H.astype(np.float32),
            "H_format": H_FORMATS[name],
            "sensor_xyz": sensor.astype(np.float32),
            "sensor_grid_xyz": sensor_grid.astype(np.float32),
            "sensor_grid_normals": _normals(sensor_grid, sensor).astype(np.float32),
            "sensor_grid_format": GRID_FORMATS[sensor_grid.ndim],
            "laser_xyz": laser.astype(np.float32),
            "laser_grid_xyz": laser_grid.astype(np.float32),
            "laser_grid_normals": _normals(laser_grid, laser, sensor_grid).astype(np.float32),
            "laser_grid_format": GRID_FORMATS[laser_grid.ndim],
            "volume_format": UNKNOWN_VOLUME,
            "delta_t": np.float32(width),
            "t_start": np.float32(start),
            "t_accounts_first_and_last_bounces": bool(about["account_first_and_last_bounces"]),
            # tal reads YAML, and JSON is valid YAML.
            "scene_info": json.dumps(info),
        }
        with writing(path) as temporary, h5py.File(temporary, "w") as file:
            for key, value in contents.items():
                file[key] = value

    def __repr__(self) -> str:
        return f"<taugate.Scan {' x '.join(map(str, self.data.shape))}>"


def scan(scene: AnyScene, *, progress: Optional[Watcher] = None, **settings: Any) -> Scan:
    """Measures a scan and returns a :class:`Scan`.

    ``scene`` is an experiment (.toml) with a table ``[scan]``, or a :class:`Scene` that was loaded from one. Keyword arguments and ``progress`` are
    as for :func:`render`; ``spp`` counts samples per pair of points. An interrupt raises :class:`Interrupted`, and the loss of the device
    raises :class:`DeviceError`. Their ``image`` is the scan so far.
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    native, flags = scene._job(settings, "scan")
    with watcher(progress) as watch:
        arrays, found, interrupt = _native.scan(native, flags, watch)
    for warning in found:
        warnings.warn(warning, stacklevel=2)
    if arrays is None:
        raise early_end(interrupt, None)
    data, description, variance, velocity = arrays
    result = Scan(data, json.loads(description), variance, velocity=velocity)
    if interrupt is not None:
        raise early_end(interrupt, result)
    return result


def _grid(points, grid):
    """The axes of points in an array, and their positions with columns before rows."""
    if grid is None:
        return [len(points)], points
    columns, rows = grid
    return [rows, columns], points.reshape(rows, columns, 3).swapaxes(0, 1)


def _columns_first(H, *first):
    """Swaps the rows and columns of the grids that begin at these axes."""
    for axis in first:
        if H.ndim > axis + 1:
            H = H.swapaxes(axis, axis + 1)
    return H


def _normals(points, place, plane=None):
    """Unit normals, one per point, of the plane through the points, on the side of `place`. One or two points use the plane of `plane`."""
    around = (points if plane is None or points.size > 6 else plane).reshape(-1, 3)
    _, spread, axes = np.linalg.svd(around - around.mean(axis=0))
    towards = place - points
    if len(around) < 3 or spread[1] < 1e-9 * spread[0]:
        # Fewer than three points, or points on a line, define no plane.
        return towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    return axes[2] * np.sign(towards @ axes[2])[..., None]
