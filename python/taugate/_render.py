"""Renders, and their progress."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from typing import Any, Callable, NamedTuple, Optional, Union

from ._errors import Interrupted, SettingsError, early_end
from ._image import Histogram, Image
from ._scene import Scene, load
from ._words import word

LOG = logging.getLogger("taugate")


class Progress(NamedTuple):
    """What a progress callback gets: the share of the budget that is used (0 to 1), samples per pixel, and seconds."""

    fraction: float
    samples: int
    seconds: float


#: A scene, or the name of its file.
AnyScene = Union[Scene, str, os.PathLike]
FileName = Union[str, os.PathLike]
#: A function that is told of the progress, or whether there is a progress bar.
Watcher = Union[bool, Callable[[Progress], Any]]


def render(
    scene: AnyScene,
    *,
    progress: Optional[Watcher] = None,
    checkpoint: Optional[FileName] = None,
    every: Optional[Union[float, str]] = None,
    resume: Optional[FileName] = None,
    **settings: Any,
) -> Image:
    """Renders the image of one gate, or of all light, and returns an :class:`Image`.

    ``scene`` is a :class:`Scene`, or the name of a file. Keyword arguments are settings with the names of the flags of the program, with
    underscores for dashes; :func:`settings` lists them. Values are text as on the command line, or numbers, tuples and arrays in metres and
    seconds. The same settings give the same bits as the program. ``camera`` may be a :class:`Camera`.

    ``progress``: a function that gets a :class:`Progress` after each iteration, or ``True`` for a progress bar (tqdm, if it is installed). A
    function that is slower than the iterations gets the newest one. An exception of the function ends the render. An interrupt (Ctrl-C)
    raises :class:`Interrupted`, and the loss of the device raises :class:`DeviceError`. Their ``image`` is the image so far.

    ``checkpoint="x.acc"`` writes the sums to this file at the end and ``every`` so often (60 s by default). If the file exists, the render goes on
    from it, so after a crash the same call makes the image of a render that never stopped. ``resume="x.acc"`` goes on from sums without writing
    them. Both need a scene in files, without moved nodes.
    """
    return _run("render", Image, True, scene, progress, settings, checkpoint=checkpoint, every=every, resume=resume)


def histogram(
    scene: AnyScene,
    *,
    progress: Optional[Watcher] = None,
    checkpoint: Optional[FileName] = None,
    every: Optional[Union[float, str]] = None,
    resume: Optional[FileName] = None,
    **settings: Any,
) -> Histogram:
    """Renders the images of many gates from the same light paths, and returns a :class:`Histogram`. Arguments as for :func:`render`.

    ``gates="A..B/N"`` or ``(A, B, N)`` in metres divides a range into N gates; ``response`` and ``cw`` define other responses.
    ``variance=True`` also estimates variances.
    """
    return _run("histogram", Histogram, False, scene, progress, settings, checkpoint=checkpoint, every=every, resume=resume)


def _run(call, kind, single, scene, progress, settings, **sum_files):
    scene = scene if isinstance(scene, Scene) else load(scene)
    native, flags = scene._job(settings, call)
    # `every` is a duration, as `time` is.
    kinds = {"every": "time"}
    flags.extend((name, [word(kinds.get(name, name), value)]) for name, value in sum_files.items() if value is not None)
    with watcher(progress) as watch:
        try:
            image, interrupt = native.render(flags, single, watch)
        except KeyboardInterrupt as interrupt:
            raise Interrupted() from interrupt
    result = kind(image)
    for note in result.notes:
        LOG.info(note)
    for warning in all_warnings(result):
        warnings.warn(warning, stacklevel=3)
    if interrupt is not None:
        raise early_end(interrupt, result if result.samples else None)
    return result


def all_warnings(image):
    """Sentences about an image: its warnings, and the samples that were not finite."""
    dropped = [f"{image.dropped} samples were not finite and count as 0"] if image.dropped else []
    return [*image.warnings, *dropped]


def watcher(progress):
    """A context manager that returns the callback for the native part, or ``None`` without progress."""
    if progress is None or progress is False:
        return _Silent()
    return _Bar() if progress is True else _Caller(progress)


class _Silent:
    def __enter__(self):
        return None

    def __exit__(self, *_):
        return None


class _Caller(_Silent):
    def __init__(self, call):
        if not callable(call):
            raise SettingsError("progress must be True or a function")
        self.call = call

    def __enter__(self):
        return lambda *step: self.call(Progress(*step))


class _Bar(_Silent):
    """A bar of tqdm, or a line on stderr."""

    def __enter__(self):
        try:
            from tqdm.auto import tqdm
        except ImportError:
            self.bar = None
            return lambda fraction, samples, seconds: print(
                f"\r{100 * fraction:3.0f} %, {samples} samples, {seconds:.0f} s", end="", file=sys.stderr
            )
        self.bar = tqdm(total=100, bar_format="{l_bar}{bar}| {elapsed}<{remaining}{postfix}")
        return self._update

    def _update(self, fraction, samples, seconds):
        self.bar.set_postfix_str(f"{samples} samples", refresh=False)
        self.bar.update(100 * fraction - self.bar.n)

    def __exit__(self, *_):
        if self.bar is None:
            print(file=sys.stderr)
        else:
            self.bar.close()
