"""Renders on many machines, with Dask (``pip install "taugate[farm]"``).

    client = dask.distributed.Client("tcp://scheduler:8786")
    image = taugate.farm.render("room.glb", client=client, gate="12.5m..12.8m", error=0.01)

A render is divided into parts: runs of iterations, whose random numbers are those of the whole render. Each part is a task of Dask and
returns sums. The sums of all parts add up to the image that one machine would render. A part counts in full or not at all, whatever happens to
its machine.
"""

from __future__ import annotations

import copy
import hashlib
import numbers
import os
import pathlib
import pickle
import time as clock
import uuid
import warnings
import weakref
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from . import _native
from ._errors import Error, Interrupted, SettingsError
from ._files import remove_abandoned, write
from ._image import Histogram, Image
from ._render import AnyScene, Progress, Watcher, all_warnings, watcher
from ._scene import Scene, load
from ._words import word
from ._worker import ENDINGS, KEPT, LASTING, accumulate, checked, refuse_black, render_whole

if TYPE_CHECKING:
    from distributed import Client

#: Samples per pixel of the first parts, which show how long a sample takes.
FIRST_SAMPLES = 4
#: Tasks per worker thread that run or are queued at a time. While one runs, the next one is queued, so no worker is idle.
AHEAD = 2
#: How often Dask repeats a part that failed.
RETRIES = 3
#: The error of an image with fewer iterations is not tested: its estimate is too rough.
MIN_ITERATIONS = 16
#: If only the setting `error` can end a render, it ends after this number of parts if the image is still black.
BLACK_PARTS = 16
#: Seconds between two looks for finished parts.
PATIENCE = 0.02
#: A part that takes this many times as long as the others on average is slow.
SLOW = 2.0

#: Seconds between two questions to the scheduler how many threads the workers have.
BETWEEN_COUNTS = 1.0

#: The scenes of each client on its workers, by the key of the job.
_on_workers: weakref.WeakKeyDictionary[Any, dict[str, Any]] = weakref.WeakKeyDictionary()
#: For each client, when the threads of its workers were last counted, and how many there were.
_threads_of: weakref.WeakKeyDictionary[Any, tuple[float, int]] = weakref.WeakKeyDictionary()


def render(
    scene: AnyScene,
    *,
    client: Client,
    spp: Optional[int] = None,
    time: Optional[Union[float, str]] = None,
    error: Optional[Union[float, str]] = None,
    part_seconds: float = 10.0,
    on_update: Optional[Callable[[Union[Image, Histogram]], Any]] = None,
    progress: Optional[Watcher] = None,
    **settings: Any,
) -> Union[Image, Histogram]:
    """Renders on the workers of ``client``, a ``dask.distributed.Client``. Returns an :class:`Image`, or a :class:`Histogram` if there are
    several gates.

    ``scene``: a :class:`Scene`, or the name of a file. A ``.glb`` file and arrays are sent to each worker once. Other files must have the same
    name on all machines.

    The render ends after ``spp`` samples per pixel, after ``time`` seconds, or when the relative error of the image is at most ``error``,
    whichever comes first. If none of the three is given, the settings of the scene decide, by default 64 samples. ``time`` may be a text such as
    ``"8h"``, and ``error`` one such as ``"1%"``. The relative error is the root mean square of the standard errors of all pixels, divided by the
    mean of the image. For a histogram it is the error of the sum of its gates; single gates have larger errors. It counts from the 16th iteration
    on, and one more part must confirm it.

    A part takes about ``part_seconds``. After each one, ``on_update`` gets the image so far, and ``progress`` a :class:`Progress`. Further keyword
    arguments are settings, as for :func:`taugate.render`. An interrupt raises :class:`Interrupted`, whose ``image`` is the image so far.

    If a worker is lost, another one renders its parts. If all others wait for the part of a slow worker, one of them renders it too. A part
    that fails four times is left out with a warning. The render ends if four parts per worker thread fail one after the other: it returns the
    image so far with a warning. Without an image, it raises an :class:`Error` that quotes the last exception. The sums are added in the order
    of the iterations, not in the order of arrival. After ``time``, finished parts are added even if an earlier part still runs. With ``spp``
    and ``sampling="uniform"``, the image is that of :func:`taugate.render`. With adaptive sampling each part adapts by itself, so the image
    depends on how the render was divided into parts.

    ``image.save("x.acc")`` writes the sums, which ``taugate develop`` and ``merge`` read. If the scene is a file, ``render --resume`` goes on. A
    scan, auxiliary layers (``aov``) and ``strict`` are refused.
    """
    job = _Job(scene, settings, spp)
    fingerprint, default_spp, default_seconds = _native.check_parts(job.native, job.flags)
    job.contents = fingerprint or job.key
    time, error = _seconds(time), _share(error)
    if (job.spp, time, error) == (None, None, None):
        job.spp, time = default_spp, default_seconds
    with watcher(progress) as watch:
        run = _Run(job, client, time, error, float(part_seconds), on_update, watch)
        try:
            run.until_the_end()
            run.refuse_black()
        except KeyboardInterrupt as interrupt:
            raise Interrupted(run.image()) from interrupt
        finally:
            run.cancel()
    image = run.image()
    if image is None:
        raise Error(f"no part of the render succeeded; the last one failed with: {run.failure}")
    for warning in [*all_warnings(image), *run.warnings()]:
        warnings.warn(warning, stacklevel=2)
    return image


def _seconds(time):
    """A time as :func:`taugate.render` takes it, in seconds."""
    if time is None:
        return None
    return _native.seconds(word("time", time))


def _share(error):
    """A relative error: a number, or a text such as 1%."""
    if error is None:
        return None
    try:
        is_percentage = isinstance(error, str) and error.strip().endswith("%")
        share = float(error.strip()[:-1]) / 100 if is_percentage else float(error)
    except (TypeError, ValueError):
        share = np.nan
    if not 0 < share < np.inf:
        raise SettingsError(f"error is {error!r}, but must be a number above 0, such as 0.01, or '1%'")
    return share


def dataset(
    jobs: Iterable[tuple[str, AnyScene, dict[str, Any]]], *, client: Client, folder: str | os.PathLike[str], suffix: str = ".npy"
) -> Iterator[str]:
    """Renders many images, each on one worker, to files in ``folder``. Yields the path of each file as it is finished.

    ``jobs`` is an iterable of ``(name, scene, settings)``, which may be endless or made while the renders run; ``settings`` is a dictionary with
    the arguments of :func:`taugate.render`, or of :func:`taugate.histogram` if it has ``gates``. Each job writes ``folder/name.npy`` and the
    files that :meth:`Image.save` writes beside it. An image is also written as ``name.exr``. A name such as ``train/0001`` makes a folder below
    ``folder``. ``suffix`` is the ending of the file that is yielded: ``.npy``, or ``.exr`` if all results are images. If this file is there
    already, it is kept, so a data set can be continued: give equal names to equal jobs only. A job with a mistake, or one that fails four times,
    is left out, and so is a histogram if ``suffix`` is ``.exr``. After all jobs, the first exception is raised.
    """
    if suffix not in ENDINGS:
        raise SettingsError(f"suffix is {suffix!r}, but must be {' or '.join(map(repr, ENDINGS))}")
    return _dataset(jobs, client, folder, suffix)


def _dataset(jobs, client, folder, suffix):
    from distributed import as_completed

    folders = set()
    _prepare(folder, folders)
    jobs, running, failures = iter(jobs), as_completed(), []
    while True:
        while running.count() < AHEAD * max(_threads(client), 1):
            following = next(jobs, None)
            if following is None:
                break
            name, scene, settings = following
            try:
                path = _place(folder, name) + suffix
                is_finished = os.path.exists(path)
                if not is_finished:
                    job = _Job(scene, settings, None)
                    _prepare(os.path.dirname(path), folders)
            except Exception as failure:  # No failed job ends the data set.
                failures.append(failure)
                continue
            if is_finished:
                yield path
                continue
            future = client.submit(
                render_whole,
                job.key,
                _sent(client, job),
                job.files,
                settings,
                key=f"taugate-image-{name}-{uuid.uuid4().hex[:8]}",
                retries=RETRIES,
            )
            future.taugate_path, future.taugate_name = path, name + suffix
            running.add(future)
        if running.count() == 0:
            break
        future = next(running)
        try:
            files, found = checked(future.result())
        except Exception as failure:  # No failed job ends the data set.
            failures.append(failure)
            continue
        if suffix not in files:
            failures.append(SettingsError(f"{future.taugate_name} was not written, because a histogram has no {suffix}; use suffix='.npy'"))
            continue
        for warning in found:
            warnings.warn(f"{future.taugate_name}: {warning}", stacklevel=2)
        # The file that shows that the job is finished comes last.
        for ending, contents in sorted(files.items(), key=lambda file: file[0] == suffix):
            write(os.path.splitext(future.taugate_path)[0] + ending, contents)
        yield future.taugate_path
    if failures:
        raise failures[0]


def _place(folder, name):
    """The path of the files of a job in a data set, without their endings. It is below the folder."""
    path = os.path.normpath(name) if isinstance(name, str) and name else os.curdir
    if path.split(os.sep)[0] in (os.curdir, os.pardir) or pathlib.PurePath(path).anchor or "\0" in path:
        raise SettingsError(f"the name of a job is {name!r}, but must be a text such as 'seed1' or 'train/seed1' that stays in the folder")
    return os.path.join(folder, path)


def _prepare(folder, prepared):
    """Makes a folder for files of a data set, unless it is among those that are prepared."""
    if folder not in prepared:
        os.makedirs(folder, exist_ok=True)
        remove_abandoned(folder)
        prepared.add(folder)


class _Job:
    """A render, and what a worker needs for it."""

    def __init__(self, scene, settings, spp):
        self.scene = scene if isinstance(scene, Scene) else load(scene)
        self.settings = {key: value for key, value in settings.items() if value is not None}
        if isinstance(self.settings.get("density_grid"), np.ndarray):
            # The array goes to each worker once, with the scene, and not with each part.
            self.scene = copy.copy(self.scene)
            self.scene.settings = {**self.scene.settings, "density_grid": self.settings.pop("density_grid").copy()}
        if spp is not None and (not isinstance(spp, numbers.Integral) or spp < 1):
            raise SettingsError(f"spp is {spp!r}, but must be a whole number above 0")
        self.spp = spp
        self.native, self.flags = self.scene._job(self.settings, "farm.render")
        path = self.scene.path
        contents = None
        if path is not None and path.lower().endswith(".glb"):
            with open(path, "rb") as file:
                contents = file.read()
        self.payload = pickle.dumps((self.scene, contents))
        #: Fingerprint of the scene's files and of the files that the settings name. A worker whose files differ fails.
        self.files = self.native.files(self.flags)
        # A worker reads a scene anew if its files have changed.
        digest = hashlib.sha256(self.payload)
        digest.update((self.files or "").encode())
        self.key = digest.hexdigest()
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
        #: Sums of the parts that succeeded, and their samples that were not finite.
        self.sums, self.dropped = None, 0
        #: The last exception of a part, how many parts failed, and how many since the last one that succeeded.
        self.failure, self.failed, self.failed_together = None, 0, 0
        self.samples, self.seconds = 0, 0.0
        #: Parts that were added, and how many of the last ones had an error that is small enough.
        self.added, self.confirmed = 0, 0
        #: First iterations of the parts that came back, and the sum of their times from sending to arrival in seconds.
        self.came, self.came_seconds = set(), 0.0
        #: When each part was sent, by its first iteration, and the parts that were sent twice.
        self.sent, self.repeated = {}, set()
        self.futures = set()

    def until_the_end(self):
        self._submit()
        # A copy of a part that came back may still run on a slow worker, but nobody waits for it.
        while self.parts.count() and self.wanted < self.next:
            # After the time, a render without an image still waits for the parts that run.
            while not self.parts.has_ready() and not (self._is_late() and (self.sums is not None or self.waiting)):
                clock.sleep(PATIENCE)
                self._repeat_slow()
            while self.parts.has_ready():
                future = next(self.parts)
                begin, _ = future.taugate_range
                if begin not in self.came:
                    self.came.add(begin)
                    self.came_seconds += clock.monotonic() - self.sent[begin]
                    self.waiting[begin] = future
                elif begin not in self.waiting:
                    self.futures.discard(future)
            if self._is_late():
                for begin in sorted(self.waiting):
                    self._add(self.waiting.pop(begin))
            while self.wanted in self.waiting and not self._is_over():
                self.wanted = self._add(self.waiting.pop(self.wanted))
            if self._is_over():
                return
            if not self._is_late():
                self._submit()

    def _add(self, future):
        """Adds a finished part, or leaves it out if it failed. Returns the first iteration after it. If another copy of a failed part
        still runs, returns the first iteration of the part instead."""
        self.futures.discard(future)
        try:
            contents, dropped = checked(future.result())
            part = _native.Sums.from_bytes(contents)
            if self.sums is None:
                self.sums = part
            else:
                self.sums.merge(part)
        except Exception as failure:  # Any failure of the task, or of adding its sums.
            begin, _ = future.taugate_range
            other = self._copy_of(begin)
            if other is not None and other.done():
                return self._add(other)
            if other is not None:
                # The other copy of the part may succeed.
                self.came.discard(begin)
                return begin
            if self.sums is None and isinstance(failure, LASTING):
                raise
            self.failure = failure
            self.failed += 1
            self.failed_together += 1
            return future.taugate_range[1]
        self.failed_together = 0
        self.added += 1
        self.dropped += dropped
        self.samples += part.samples
        self.seconds += part.seconds
        if self.error is not None:
            is_small = self.sums.iterations >= MIN_ITERATIONS and self.sums.relative_error() <= self.error
            self.confirmed = self.confirmed + 1 if is_small else 0
        self._show()
        return future.taugate_range[1]

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
        # If so many parts fail one after the other, all will fail.
        if self.failed_together >= self._max_parts():
            return True
        if self.sums is None:
            return False
        # The relative error of a black image is infinite, so it never ends the render.
        only_error = self.error is not None and self.job.spp is None and self.time is None
        is_black = only_error and self.added >= BLACK_PARTS and self.sums.is_black()
        return self._is_late() or self.confirmed > 1 or is_black

    def refuse_black(self):
        """Raises the exception of :func:`taugate.render` about a black image. A worker makes it, because its advice needs a device."""
        if self.sums is not None and self.sums.is_black():
            key = f"taugate-black-{self.name}"
            future = self.client.submit(refuse_black, self.job.key, self.scene, self.job.settings, key=key, retries=RETRIES)
            checked(future.result())

    def warnings(self):
        """Sentences about the parts that are missing."""
        if not self.failed:
            return []
        return [f"{self.failed} parts of the render failed and were left out; the last one failed with: {self.failure}"]

    def _max_parts(self):
        """Maximum number of parts that are submitted and not added: they run, are queued, or wait for an earlier part."""
        return 2 * AHEAD * max(_threads(self.client), 1)

    def _submit(self):
        """Keeps all workers busy."""
        limit = self._max_parts()
        while self.parts.count() + len(self.waiting) < limit and self.parts.count() < limit // 2:
            if self.job.spp is not None and _native.samples_before_iteration(self.next) >= self.job.spp:
                break
            samples = FIRST_SAMPLES
            if self.samples:
                samples = max(FIRST_SAMPLES, self.part_seconds * self.samples / max(self.seconds, 1e-9))
            begin = self.next
            self.next, _ = _native.part(begin, samples)
            self._submit_part(begin, self.next)

    def _repeat_slow(self):
        """Sends the only part that still runs to a second worker if it takes more than `SLOW` times as long as the others, which wait for
        it. Both copies get the same random numbers, so it does not matter for the image which one comes first."""
        slow = self._copy_of(self.wanted)
        if self.waiting and self.parts.count() == 1 and slow is not None and self.wanted not in self.repeated:
            age = clock.monotonic() - self.sent[self.wanted]
            if age > SLOW * self.came_seconds / len(self.came):
                self.repeated.add(self.wanted)
                self._submit_part(*slow.taugate_range, "-again")

    def _copy_of(self, begin):
        """A future of the part with this first iteration that was not added; ``None`` if there is none."""
        return next((future for future in self.futures if future.taugate_range[0] == begin), None)

    def _submit_part(self, begin, end, copy=""):
        future = self.client.submit(
            accumulate,
            self.job.key,
            self.scene,
            self.job.files,
            self.job.settings,
            self.job.contents,
            begin,
            end,
            self.job.spp,
            key=f"taugate-part-{self.name}-{begin}-{end}{copy}",
            retries=RETRIES,
        )
        future.taugate_range = (begin, end)
        self.sent.setdefault(begin, clock.monotonic())
        self.futures.add(future)
        self.parts.add(future)

    def image(self):
        """The image so far; ``None`` before the first part."""
        if self.sums is None:
            return None
        native = _native.image_of_sums(self.job.native, self.job.flags, self.sums, self.dropped)
        return (Image if len(native.gates) == 1 else Histogram)(native)

    def cancel(self):
        """Cancels the parts that were not added."""
        if self.futures:
            self.client.cancel(list(self.futures))
            self.futures.clear()


def _sent(client, job):
    """The scene of a job on the workers, where it stays for the next renders."""
    sent = _on_workers.setdefault(client, {})
    if job.key not in sent or sent[job.key].status not in ("pending", "finished"):
        # After a restart of the scheduler, the scene is no longer there.
        sent.pop(job.key, None)
        while len(sent) >= KEPT:
            del sent[next(iter(sent))]
        # A task instead of scatter: if a worker is lost with the result, Dask repeats the task. Scattered data would be lost.
        sent[job.key] = client.submit(bytes, job.payload, key=f"taugate-scene-{job.key[:8]}-{uuid.uuid4().hex[:8]}")
    return sent[job.key]


def _threads(client):
    """Number of threads of all workers. The scheduler, which sends the records of all workers, is asked at most once per second."""
    asked, threads = _threads_of.get(client, (-np.inf, 0))
    now = clock.monotonic()
    if now - asked >= BETWEEN_COUNTS:
        threads = sum(worker["nthreads"] for worker in client.scheduler_info(n_workers=-1)["workers"].values())
        _threads_of[client] = now, threads
    return threads
