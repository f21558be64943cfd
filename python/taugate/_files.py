"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import time
import uuid
from collections.abc import Iterator

#: Age in seconds of a file without its end at which its writer is no longer at work.
ABANDONED = 3600
#: Ending of a file that is being written.
PARTIAL = ".taugate-partial"


@contextlib.contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[str]:
    """The name of a temporary file, which replaces `path` at the end. After an exception it is removed, and `path` stays as it was. Files
    that the caller creates have the usual permissions."""
    # The file that a symbolic link leads to is replaced, not the link.
    path = os.path.realpath(path)
    folder, name = os.path.split(path)
    temporary = os.path.join(folder, f".{name}-{uuid.uuid4().hex[:8]}{PARTIAL}")
    try:
        yield temporary
        with open(temporary, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.remove(temporary)
        raise


def write(path: str | os.PathLike[str], contents: bytes) -> None:
    """Writes a file, whole or not at all."""
    with writing(path) as temporary, open(temporary, "xb") as file:
        file.write(contents)


def remove_abandoned(folder: str | os.PathLike[str]) -> None:
    """Removes what clients that were killed have left of their files."""
    for entry in os.scandir(os.fspath(folder)):
        with contextlib.suppress(OSError):
            if entry.name.startswith(".") and entry.name.endswith(PARTIAL) and time.time() - entry.stat().st_mtime > ABANDONED:
                os.remove(entry.path)
