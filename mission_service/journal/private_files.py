"""Handles files that only their owner can read: file mode 0600, folder mode 0700, no links.

Through a symbolic link in place of a journal or a state, another user could make the service
overwrite any file of the user who runs the service. Symbolic links are therefore refused and never
followed.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mission_service.errors import MissionServiceError

FILE_MODE, FOLDER_MODE = 0o600, 0o700
LINK = "is a symbolic link, and files of a run must not be links; remove it"


def opened(path: Path, flags: int) -> int:
    """Open a file and return its descriptor. Raises OSError, with ELOOP for a symbolic link."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, FILE_MODE)


def in_words(error: OSError) -> str:
    """Return the reason why a file could not be opened for writing."""
    return LINK if error.errno == errno.ELOOP else f"cannot be written: {error.strerror}"


def refuse_links(folder: Path, stem: str = "") -> None:
    """Raise MissionServiceError if a file whose name begins with ``stem`` is a symbolic link."""
    for each in sorted(folder.glob(f"{stem}*")):
        if each.is_symlink():
            raise MissionServiceError(f"{each}: {LINK}, or choose another --out")


def writable_by_others(found: os.stat_result) -> bool:
    """Return whether other users may write to a file or a folder."""
    return bool(found.st_mode & 0o022)


def sync(path: Path) -> None:
    """Flush a file or a folder to the disk (fsync)."""
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


@contextmanager
def private() -> Iterator[None]:
    """Set the umask to 077 within the context: only the owner can read new files."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)
