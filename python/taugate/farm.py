"""Renders on many machines, with Dask (``pip install "taugate[farm]"``).

    client = dask.distributed.Client("tcp://scheduler:8786")
    image = taugate.farm.render("room.glb", client=client, gate="12.5m..12.8m", error=0.01)

A render is divided into parts: runs of iterations, whose random numbers are those of the whole render. Each part is a task of Dask and
returns sums. The sums of all parts add up to the image that one machine would render. A part counts in full or not at all, whatever happens to
its machine.
"""

import copy
import hashlib
import os
import pickle
import shutil
import tempfile
import threading
import time as clock
import uuid
import weakref

import numpy as np

from . import _native
from ._errors import Error, Interrupted, SettingsError
from ._image import Histogram, Image
from ._render import Progress, watcher
from ._scene import Scene, load

#: Samples per pixel of the first parts, which show how long a sample takes.
FIRST_SAMPLES = 4
#: Parts per worker thread that run or wait at a time. While one runs, the next one waits, so no worker is idle.
AHEAD = 2
#: How often Dask repeats a part that failed.
RETRIES = 3
#: Endings of the files by which a data set knows the jobs that are finished.
ENDINGS = (".npy", ".exr")
#: Number of scenes that a worker keeps, and that a client keeps on its workers.
KEPT = 4

_scenes = {}
_on_workers = weakref.WeakKeyDictionary()
_lock = threading.Lock()


def render(
    scene,
    *,
    client,
    spp=None,
    time=None,
    error=None,
    part_seconds=10.0,
    on_update=None,
    progress=None,
    **settings,
):
    """Renders on the workers of ``client``, a ``dask.distributed.Client``. Returns an :class:`Image`, or a :class:`Histogram` if there are
    several gates.

    ``scene``: a :class:`Scene`, or the name of a file. A ``.glb`` file and arrays are sent to each worker once. Other files must have the same
    name on all machines.

    The render ends after ``spp`` samples per pixel, after ``time`` seconds, or when the relative error of the image is at most ``error``,
    whichever comes first. If none of the three is given, the settings of the scene decide, by default 64 samples. The relative error is the root
    mean square of the standard errors of all pixels, divided by the mean of the image.

    A part takes about ``part_seconds``. After each one, ``on_update`` gets the image so far, and ``progress`` a :class:`Progress`. Further keyword
    arguments are settings, as for :func:`taugate.render`. An interrupt raises :class:`Interrupted`, whose ``image`` is the image so far.

    If a worker is lost, another one renders its parts. A part that fails four times is left out; if all parts of the first round fail, the
    render fails with the last exception. The sums are added in the order of the
    iterations, so the image does not depend on which machine was fast. With ``spp`` and ``sampling="uniform"`` it is the image of
    :func:`taugate.render`. With adaptive sampling each part adapts by itself.

    ``image.save("x.acc")`` writes the sums, which ``taugate develop``, ``merge`` and ``render --resume`` read. A scan, auxiliary layers (``aov``)
    and ``strict`` are refused.
    """
    job = _Job(scene, settings, spp)
    fingerprint, of_scene, seconds = _native.check_parts(job.native, job.flags)
    job.contents = fingerprint or job.key
    if (spp, time, error) == (None, None, None):
        job.spp, time = of_scene, seconds
    with watcher(progress) as watch:
        run = _Run(job, client, time, error, float(part_seconds), on_update, watch)
        try:
            run.until_the_end()
        except KeyboardInterrupt as interrupt:
            raise Interrupted(run.image()) from interrupt
        finally:
            run.cancel()
    image = run.image()
    if image is None:
        raise Error(f"no part of the render succeeded; the last one failed with: {run.failure}")
    return image


def dataset(jobs, *, client, folder, suffix=".npy"):
    """Renders many images, each on one worker, to files in ``folder``. Yields the path of each file as it is finished.

    ``jobs`` is an iterable of ``(name, scene, settings)``, which may be endless or made while the renders run; ``settings`` is a dictionary with
    the arguments of :func:`taugate.render`, or of :func:`taugate.histogram` if it has ``gates``. Each job writes ``folder/name.npy`` with the
    files beside it, and an image also ``name.exr``. ``suffix`` is the ending of the file that is yielded: ``.npy``, or ``.exr`` if all results
    are images. If this file is there already, it is kept, so a data set can be continued: give equal names to equal jobs only. A job that
    fails four times is left out, and so is a histogram if ``suffix`` is ``.exr``. After all jobs, the first exception is raised.
    """
    if suffix not in ENDINGS:
        raise SettingsError(f"suffix is {suffix!r}, but must be {' or '.join(map(repr, ENDINGS))}")
    return _dataset(jobs, client, folder, suffix)


def _dataset(jobs, client, folder, suffix):
    from distributed import as_completed

    os.makedirs(folder, exist_ok=True)
    jobs, running, failures = iter(jobs), as_completed(), []
    while True:
        while running.count() < AHEAD * max(_threads(client), 1):
            following = next(jobs, None)
            if following is None:
                break
            name, scene, settings = following
            path = os.path.join(folder, name + suffix)
            if os.path.exists(path):
                yield path
                continue
            job = _Job(scene, settings, None)
            future = client.submit(
                _render_whole, job.key, _sent(client, job), settings, key=f"taugate-image-{name}-{uuid.uuid4().hex[:8]}", retries=RETRIES
            )
            future.taugate_path = path
            running.add(future)
        if running.count() == 0:
            break
        future = next(running)
        try:
            files = future.result()
        except Exception as failure:  # of the job, whatever it is
            failures.append(failure)
            continue
        if suffix not in files:
            name = os.path.basename(future.taugate_path)
            failures.append(SettingsError(f"{name} was not written, because a histogram has no {suffix}; use suffix='.npy'"))
            continue
        # The file that shows that the job is finished comes last.
        for ending, contents in sorted(files.items(), key=lambda file: file[0] == suffix):
            _write(os.path.splitext(future.taugate_path)[0] + ending, contents)
        yield future.taugate_path
    if failures:
        raise failures[0]


class _Job:
    """A render, and what a worker needs for it."""

    def __init__(self, scene, settings, spp):
        self.scene = scene if isinstance(scene, Scene) else load(scene)
        self.settings = {key: value for key, value in settings.items() if value is not None}
        if isinstance(self.settings.get("density_grid"), np.ndarray):
            # The array goes to each worker once, with the scene, and not with each part.
            self.scene = copy.copy(self.scene)
            self.scene.settings = {**self.scene.settings, "density_grid": self.settings.pop("density_grid").copy()}
        self.spp = spp
        self.native, self.flags = self.scene._job(self.settings, "farm.render")
        path = self.scene.path
        contents = None
        if path is not None and path.lower().endswith(".glb"):
            with open(path, "rb") as file:
                contents = file.read()
        self.payload = pickle.dumps((self.scene, contents))
        self.key = hashlib.sha256(self.payload).hexdigest()
        #: What identifies the scene in the sums.
        self.contents = self.key


class _Run:
    """The parts of one render."""

    def __init__(self, job, client, time, error, part_seconds, on_update, watch):
        from distributed import as_completed

        self.job, self.client, self.time, self.error = job, client, time, error
        self.part_seconds, self.on_update, self.watch = part_seconds, on_update, watch
        # Part of the names of the tasks. Each run has its own names, so that Dask never returns a task of a cancelled run.
        self.name = f"{job.key[:8]}-{uuid.uuid4().hex[:8]}"
        self.started = clock.monotonic()
        self.parts = as_completed()
        self.scene = _sent(client, job)
        #: First iteration of the next part to submit, and of the next part to add.
        self.next, self.wanted = 0, 0
        #: Finished parts that wait for an earlier part, by their first iteration. Their results stay on the workers.
        self.waiting = {}
        #: Sums of the parts that succeeded, the last exception of a part, and how many parts failed.
        self.sums, self.failure, self.failed = None, None, 0
        self.samples, self.seconds = 0, 0.0
        self.futures = set()

    def until_the_end(self):
        self._submit()
        while self.parts.count():
            future = next(self.parts)
            self.waiting[future.taugate_range[0]] = future
            self._add_in_order()
            if self._is_over():
                return
            # After the time, a render without an image still waits for the parts that run.
            if not self._is_late():
                self._submit()

    def _add_in_order(self):
        """Adds the finished parts in order, up to the first part that is not finished."""
        while self.wanted in self.waiting:
            future = self.waiting.pop(self.wanted)
            self.wanted = future.taugate_range[1]
            self.futures.discard(future)
            try:
                part = _native.Sums.from_bytes(future.result())
            except (SettingsError, TypeError):
                raise
            except Exception as failure:  # of the worker, whatever it is
                self.failure = failure
                self.failed += 1
                continue
            self.samples += part.samples
            self.seconds += part.seconds
            if self.sums is None:
                self.sums = part
            else:
                self.sums.merge(part)
            self._show()

    def _show(self):
        if self.on_update is not None:
            self.on_update(self.image())
        if self.watch is not None:
            seconds = clock.monotonic() - self.started
            shares = [0.0]
            if self.job.spp is not None:
                shares.append(self.sums.samples / self.job.spp)
            if self.time is not None:
                shares.append(seconds / self.time)
            if self.error is not None:
                # The relative error may be 0.
                relative = self.sums.relative_error()
                shares.append(1.0 if relative <= self.error else (self.error / relative) ** 2)
            self.watch(*Progress(min(1.0, max(shares)), self.sums.samples, seconds))

    def _is_late(self):
        return self.time is not None and clock.monotonic() - self.started >= self.time

    def _is_over(self):
        if self.sums is None:
            # If a whole round fails, so will all parts.
            return self.failed >= self._round()
        return self._is_late() or (self.error is not None and self.sums.relative_error() <= self.error)

    def _round(self):
        """The most parts that run or wait at a time."""
        return 2 * AHEAD * max(_threads(self.client), 1)

    def _submit(self):
        """Keeps all workers busy."""
        limit = self._round()
        while self.parts.count() + len(self.waiting) < limit and self.parts.count() < limit // 2:
            if self.job.spp is not None and _native.samples_before_iteration(self.next) >= self.job.spp:
                return
            samples = FIRST_SAMPLES
            if self.samples:
                samples = max(FIRST_SAMPLES, self.part_seconds * self.samples / max(self.seconds, 1e-9))
            begin = self.next
            self.next, _ = _native.part(begin, samples)
            future = self.client.submit(
                _accumulate,
                self.job.key,
                self.scene,
                self.job.settings,
                self.job.contents,
                begin,
                self.next,
                self.job.spp,
                key=f"taugate-part-{self.name}-{begin}-{self.next}",
                retries=RETRIES,
            )
            future.taugate_range = (begin, self.next)
            self.futures.add(future)
            self.parts.add(future)

    def image(self):
        """The image so far; ``None`` before the first part."""
        if self.sums is None:
            return None
        native = _native.developed(self.job.native, self.job.flags, self.sums)
        return (Image if len(native.gates) == 1 else Histogram)(native, self.job.scene)

    def cancel(self):
        """Cancels the parts that were not added."""
        if self.futures:
            self.client.cancel(list(self.futures))
            self.futures.clear()


def _sent(client, job):
    """The scene of a job on the workers, where it stays for the next renders."""
    sent = _on_workers.setdefault(client, {})
    if job.key not in sent:
        while len(sent) >= KEPT:
            del sent[next(iter(sent))]
        # A task instead of scatter: if a worker is lost with the result, Dask repeats the task. Scattered data would be lost.
        sent[job.key] = client.submit(bytes, job.payload, key=f"taugate-scene-{job.key[:8]}-{uuid.uuid4().hex[:8]}")
    return sent[job.key]


def _threads(client):
    return sum(worker["nthreads"] for worker in client.scheduler_info(n_workers=-1)["workers"].values())


# On a worker.


def _scene(key, payload):
    """The scene of these bytes, which a worker unpacks once."""
    with _lock:
        if key not in _scenes:
            scene, contents = pickle.loads(payload)
            if contents is not None:
                folder = tempfile.mkdtemp(prefix="taugate-")
                # Renders that still use the scene keep it, and so the folder, also after it left `_scenes`.
                weakref.finalize(scene, shutil.rmtree, folder, ignore_errors=True)
                scene.path = os.path.join(folder, "scene.glb")
                _write(scene.path, contents)
            while len(_scenes) >= KEPT:
                del _scenes[next(iter(_scenes))]
            _scenes[key] = scene
        return _scenes[key]


def _accumulate(key, payload, settings, contents, begin, end, spp):
    """The sums of a part, as bytes."""
    scene = _scene(key, payload)
    native, flags = scene._job(settings, "farm.render")
    return _native.accumulate(native, flags, contents, begin, end, spp)


def _render_whole(key, payload, settings):
    """The files of an image: from their endings to their bytes."""
    import taugate

    scene = _scene(key, payload)
    image = taugate.histogram(scene, **settings) if settings.get("gates") is not None else taugate.render(scene, **settings)
    with tempfile.TemporaryDirectory() as folder:
        for ending in ENDINGS:
            if ending == ".npy" or isinstance(image, Image):
                image.save(os.path.join(folder, "image" + ending))
        files = {}
        for name in os.listdir(folder):
            with open(os.path.join(folder, name), "rb") as file:
                files[name[len("image") :]] = file.read()
        return files


def _write(path, contents):
    """Writes a file, whole or not at all."""
    folder, name = os.path.split(path)
    with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{name}-", delete=False) as file:
        file.write(contents)
        file.flush()
        os.fsync(file.fileno())
    os.replace(file.name, path)
