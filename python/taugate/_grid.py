"""Density grids from arrays: the native part reads them from temporary files."""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
import weakref

import numpy as np

from ._errors import SettingsError

_files: weakref.WeakValueDictionary[str, GridFile] = weakref.WeakValueDictionary()
_lock = threading.Lock()


class GridFile:
    """A temporary file (.npy) with the densities of an array. It is deleted with this object."""

    def __init__(self, array, key):
        with tempfile.NamedTemporaryFile(prefix=f"taugate-grid-{key[:8]}-", suffix=".npy", delete=False) as file:
            self.path = file.name
            self._finalizer = weakref.finalize(self, _remove, self.path)
            np.save(file, array)


def grid_file(array):
    """The :class:`GridFile` of an array (Z, Y, X) of densities. Equal arrays share a file, so renders need not prepare the grid again."""
    if array.ndim != 3 or array.dtype.kind not in "fiub":
        raise SettingsError(f"density_grid is an array of {array.dtype} with the shape {array.shape}, but must be numbers (Z, Y, X)")
    array = np.ascontiguousarray(array, dtype="<f4")
    key = hashlib.sha256(str(array.shape).encode() + array.tobytes()).hexdigest()
    with _lock:
        file = _files.get(key)
        if file is None:
            file = _files[key] = GridFile(array, key)
        return file


def _remove(path):
    try:
        os.remove(path)
    except OSError:
        # Somebody has cleaned the folder of temporary files.
        pass
