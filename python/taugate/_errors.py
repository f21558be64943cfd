"""Exceptions. Their messages are the sentences of the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Optional, TypeVar, Union

if TYPE_CHECKING:
    from ._image import Histogram, Image
    from ._scan import Scan

    Result = Union[Image, Histogram, Scan]

T = TypeVar("T")


class Error(Exception):
    """An error of taugate."""


class SettingsError(Error, ValueError):
    """A keyword argument has a wrong value.

    ``setting`` is the keyword argument to change, and ``remedy`` says what to do. Both are ``None`` if they are not known; the message always
    has all that is known.
    """

    setting: Optional[str] = None
    remedy: Optional[str] = None


class SceneError(Error, ValueError):
    """The scene must be changed."""


class FileError(Error, OSError):
    """A file has the wrong contents, or cannot be read or written."""


class DeviceError(Error, RuntimeError):
    """There is no usable Vulkan device, its memory is too small, or it was lost.

    ``image`` is the image, histogram or scan that was rendered before the device was lost; otherwise ``None``.
    """

    image: Optional[Result] = None


class NotFiniteError(Error, ArithmeticError):
    """A sample was not finite, in a render with ``strict=True``."""


class Interrupted(KeyboardInterrupt):
    """An interrupt (Ctrl-C, or Stop in a notebook) ended a render early.

    ``image`` is the image, histogram or scan so far; ``None`` if nothing was rendered yet. As this is a ``KeyboardInterrupt``, loops over many
    renders end too.
    """

    def __init__(self, image: Optional[Result] = None) -> None:
        super().__init__("the render was interrupted; the result so far is in .image")
        self.image = image


def early_end(exception, image):
    """The exception for a render that ended early, with the image so far."""
    if isinstance(exception, DeviceError):
        exception.image = image
        return exception
    interrupted = Interrupted(image)
    interrupted.__cause__ = exception
    return interrupted


def explain_changes(cls: type[T]) -> type[T]:
    """Makes a frozen dataclass say what to do instead of changing a field."""

    def refuse(self, field, *_):
        raise SettingsError(f"a {cls.__name__} does not change; make another one with dataclasses.replace(old, {field}=...), and add that one")

    setattr(cls, "__setattr__", refuse)
    setattr(cls, "__delattr__", refuse)
    return cls
