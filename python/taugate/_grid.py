"""Density grids, skies and vignetting from arrays: the native part reads them from temporary files."""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
import weakref

import numpy as np

from ._errors import SettingsError
from ._exr import write_exr

_files: weakref.WeakValueDictionary[str, ArrayFile] = weakref.WeakValueDictionary()
_lock = threading.Lock()


class ArrayFile:
    """A temporary file with an array. It is deleted with this object."""

    def __init__(self, array, write, prefix, suffix):
        with tempfile.NamedTemporaryFile(prefix=prefix, suffix=suffix, delete=False) as file:
            self.path = file.name
            self._finalizer = weakref.finalize(self, _remove, self.path)
            write(file, array)


def grid_file(array):
    """The :class:`ArrayFile` (.npy) of an array (Z, Y, X) of densities. Equal arrays share a file, so renders need not prepare the grid
    again."""
    if array.ndim != 3 or array.dtype.kind not in "fiub":
        raise SettingsError(f"density_grid is an array of {array.dtype} with the shape {array.shape}, but must be numbers (Z, Y, X)")
    return _file("grid", np.ascontiguousarray(array, dtype="<f4"), np.save, ".npy")


def sky_file(array):
    """The :class:`ArrayFile` (.exr) of the image (H, W, 3) of a sky."""
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "fiub" or 0 in array.shape:
        raise SettingsError(f"sky is an array of {array.dtype} with the shape {array.shape}, but must be a radiance, or numbers (H, W, 3)")
    return _file("sky", np.ascontiguousarray(array, dtype="<f4"), write_exr, ".exr")


def vignetting_file(rows):
    """The :class:`ArrayFile` (.csv) of rows (N, 2) of angles in degrees and shares of the light."""
    try:
        array = np.asarray(rows)
    except ValueError:
        raise SettingsError("the rows of vignetting have different lengths; give an angle in degrees and a share in each") from None
    if array.ndim != 2 or array.shape[1] != 2 or array.dtype.kind not in "fiu":
        raise SettingsError(f"vignetting has the shape {array.shape}, but must be 'cos4', a file, or angles in degrees and shares (N, 2)")
    rows = np.ascontiguousarray(array, dtype="<f8")
    return _file("vignetting", rows, lambda file, rows: np.savetxt(file, rows, fmt="%.17g", delimiter=","), ".csv")


def _file(kind, array, write, suffix):
    key = kind + hashlib.sha256(str(array.shape).encode() + array.tobytes()).hexdigest()
    with _lock:
        file = _files.get(key)
        if file is None:
            file = _files[key] = ArrayFile(array, write, f"taugate-{kind}-{key[len(kind):][:8]}-", suffix)
        return file


def _remove(path):
    try:
        os.remove(path)
    except OSError:
        # Somebody has cleaned the folder of temporary files.
        pass
