"""What workers of a farm run (``farm.py``)."""

from __future__ import annotations

import functools
import os
import pickle
import shutil
import socket
import tempfile
import threading
import warnings
import weakref

from . import _native
from ._errors import FileError, SceneError, SettingsError
from ._files import write
from ._image import Image
from ._render import all_warnings
from ._scene import Scene

#: Exceptions that a repetition would raise again.
LASTING = (SettingsError, SceneError, TypeError)
#: Endings of the files by which a data set knows the jobs that are finished.
ENDINGS = (".npy", ".exr")
#: Number of scenes that a worker keeps, and that a client keeps on its workers.
KEPT = 4

_scenes: dict[str, Scene] = {}
_lock = threading.Lock()


def _scene(key, payload):
    """The scene of these bytes, which a worker unpacks once. Only the scene that was asked for last keeps its renderer."""
    with _lock:
        if key not in _scenes:
            scene, contents = pickle.loads(payload)
            if contents is not None:
                folder = tempfile.mkdtemp(prefix="taugate-")
                # Renders that still use the scene keep it, and so the folder, also after it left `_scenes`.
                weakref.finalize(scene, shutil.rmtree, folder, ignore_errors=True)
                scene.path = os.path.join(folder, "scene.glb")
                write(scene.path, contents)
            while len(_scenes) >= KEPT:
                del _scenes[next(iter(_scenes))]
            _scenes[key] = scene
        for other, scene in _scenes.items():
            if other != key and scene._native is not None:
                scene._native.release()
        return _scenes[key]


def _job(key, payload, files, settings):
    """The scene, its native part and the flags of a render. Fails if the files of this machine are not those of the client."""
    scene = _scene(key, payload)
    native, flags = scene._job(settings, "farm.render")
    if native.files(flags) != files:
        # Another try reads the files again.
        with _lock:
            _scenes.pop(key, None)
        machine = socket.gethostname()
        raise FileError(f"on {machine}, the scene or a file that its settings name has other contents than where the render was started")
    return scene, native, flags


def _lasting_failure_is_result(task):
    """Returns an exception that a repetition would raise again as the result, so that Dask does not repeat the task. See `checked`."""

    @functools.wraps(task)
    def run(*arguments):
        try:
            return task(*arguments)
        except LASTING as failure:
            return failure

    return run


def checked(result):
    """The result of a task, or its exception."""
    if isinstance(result, Exception):
        raise result
    return result


@_lasting_failure_is_result
def accumulate(key, payload, files, settings, contents, begin, end, spp):
    """The sums of a part as bytes, and the number of samples that were not finite."""
    _, native, flags = _job(key, payload, files, settings)
    return _native.accumulate(native, flags, contents, begin, end, spp)


@_lasting_failure_is_result
def refuse_black(key, payload, settings):
    """Raises the exception about a black image, unless the settings accept one."""
    native, flags = _scene(key, payload)._job(settings, "farm.render")
    _native.refuse_black(native, flags)


@_lasting_failure_is_result
def render_whole(key, payload, files, settings):
    """The files of an image, from their endings to their bytes, and its warnings."""
    import taugate

    scene, native, flags = _job(key, payload, files, settings)
    is_histogram = settings.get("gates") is not None or native.responses(flags) > 1
    with warnings.catch_warnings():
        # They are raised where the client is.
        warnings.simplefilter("ignore")
        image = taugate.histogram(scene, **settings) if is_histogram else taugate.render(scene, **settings)
    with tempfile.TemporaryDirectory() as folder:
        for ending in ENDINGS:
            if ending == ".npy" or isinstance(image, Image):
                image.save(os.path.join(folder, "image" + ending))
        files = {}
        for name in os.listdir(folder):
            with open(os.path.join(folder, name), "rb") as file:
                files[name[len("image") :]] = file.read()
        return files, all_warnings(image)
