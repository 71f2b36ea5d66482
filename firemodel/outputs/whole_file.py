"""Write a file completely or not at all."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from firemodel.errors import FireModelError

SQLITE = ("-journal", "-wal", "-shm")  # files that SQLite writes beside a GeoPackage


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path, which is renamed to ``path`` if the block ends without an error.

    After an error the new file is removed, and any existing file at ``path`` is unchanged. A
    temporary file that a killed process left is removed first.

    Args:
        path: The file to write. Its folder must exist.

    Raises:
        FireModelError: The file cannot be written, or is a device; the message names ``path``.
    """
    part = path.parent / f".{path.stem}.part{path.suffix}"
    try:
        check_target(path)
        _remove(part)
        yield part
        part.replace(path)
    except OSError as error:
        raise write_error(path, error) from None
    finally:
        with suppress(OSError):
            _remove(part)


def _remove(part: Path) -> None:
    for each in (part, *(part.with_name(part.name + end) for end in SQLITE)):
        each.unlink(missing_ok=True)


def check_target(path: Path) -> None:
    """Raise OSError if no file can be created or replaced at a path, for example a device."""
    if not path.parent.is_dir():
        raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
    if path.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if path.exists() and not path.is_file():
        raise OSError(errno.EEXIST, "it is a device, a pipe or a socket")


def write_error(path: Path, error: Exception) -> FireModelError:
    """Return the error for a file that cannot be written."""
    reason = getattr(error, "strerror", None) or " ".join(str(error).split())
    return FireModelError(f"{path}: cannot be written: {reason}; use another path")


def remove_parts(folder: Path) -> None:
    """Remove the incomplete files that a killed process left in a folder (``whole_file``)."""
    for part in folder.glob(".*.part.*"):
        part.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text file (UTF-8) completely or not at all (see ``whole_file``).

    Raises FireModelError if the file cannot be written.
    """
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
