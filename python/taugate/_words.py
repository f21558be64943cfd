"""Keyword arguments as words of the command line."""

from __future__ import annotations

import difflib
import numbers
import os

import numpy as np

from . import _native
from ._errors import SettingsError
from ._grid import grid_file, sky_file, vignetting_file

FLAGS = {name.replace("-", "_"): (name, *about) for name, about in _native.flags().items()}
# Units of numbers, by what the help text calls the value.
UNITS = {"DURATION": "s", "TIME": "s", "LENGTH": "m", "DIAMETER|f/N@LENGTH": "m"}


class Words(list):
    """Pairs of a flag and its words. The temporary files that the words name exist as long as this list."""

    def __init__(self):
        super().__init__()
        self.files = []


def words(settings, call):
    """The settings of the function `call` as pairs of a flag and its words. Settings that are ``None`` are left out."""
    pairs = Words()
    for keyword, value in settings.items():
        if value is None:
            continue
        if keyword not in FLAGS:
            near = difflib.get_close_matches(keyword, FLAGS, 1)
            hint = f"; did you mean {near[0]}?" if near else "; taugate.settings() lists them"
            reason = _native.reason_of_missing(keyword.replace("_", "-"))
            hint = f": {reason}" if reason else hint
            raise TypeError(f"{call}() has no setting '{keyword}'{hint}")
        flag, form, bare, *_ = FLAGS[keyword]
        if keyword == "density_grid" and isinstance(value, np.ndarray):
            pairs.files.append(grid_file(value))
            value = pairs.files[-1].path
        if keyword == "sky" and isinstance(value, np.ndarray) and value.ndim > 1:
            pairs.files.append(sky_file(value))
            value = pairs.files[-1].path
        if keyword == "vignetting" and not isinstance(value, (str, os.PathLike)):
            pairs.files.append(vignetting_file(value))
            value = pairs.files[-1].path
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if value is True and form in ("switch", "optional"):
            pairs.append((flag, [bare]))
        elif value is False and form == "optional":
            continue
        elif form == "repeated" and _is_list(value) and not all(isinstance(x, numbers.Real) for x in value):
            pairs.append((flag, [word(keyword, one) for one in value]))
        else:
            pairs.append((flag, [word(keyword, value)]))
    return pairs


def _is_list(value):
    return isinstance(value, (list, tuple))


def word(keyword, value):
    """One value as the command line takes it."""
    *_, kind, _ = FLAGS.get(keyword, ("", ""))
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if _is_list(value):
        if kind == "A..B" and len(value) == 2:
            return f"{_metres(value[0])}..{_metres(value[1])}"
        if kind == "A..B/N" and len(value) == 3:
            return f"{_metres(value[0])}..{_metres(value[1])}/{_number(value[2])}"
        return ("x" if kind == "WxH" else ",").join(word("", one) for one in value)
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, numbers.Real):
        return _number(value) + UNITS.get(kind, "")
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    raise SettingsError(f"{keyword} is a {type(value).__name__}, but must be text, a number or a list of them")


def _metres(value):
    """A length as text. Infinity has no unit, as on the command line."""
    return "inf" if value == float("inf") else _number(value) + "m"


def span(value):
    """A length of optical path or a time, as text: numbers are metres. ``None`` stays."""
    return value if value is None or isinstance(value, str) else _metres(value)


def _number(value):
    """A number as text, with all digits that are needed to read the same number."""
    return str(int(value)) if isinstance(value, numbers.Integral) else repr(float(value))


def settings() -> dict[str, str]:
    """All settings of a render: a dictionary from keyword to help text. The same names with dashes are the flags of the program."""
    return {keyword: " ".join(about[-1].split()) for keyword, about in FLAGS.items()}
