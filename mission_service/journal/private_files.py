"""Files that only their user can read: mode 0600, in folders of mode 0700, no symbolic links.

A symbolic link planted in the place of a journal or a state would make the service write to its
target with the rights of the service's user; it is therefore refused and never followed.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mission_service.errors import MissionServiceError

FILE_MODE, FOLDER_MODE = 0o600, 0o700
LINK = "is a symbolic link, which is not followed for files of a run; remove it"


def opened(path: Path, flags: int) -> int:
    """A file descriptor of a regular file. Raises OSError; with ELOOP for a symbolic link."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, FILE_MODE)


def in_words(error: OSError) -> str:
    """The reason why a file could not be opened for writing."""
    return LINK if error.errno == errno.ELOOP else f"cannot be written: {error.strerror}"


def refuse_links(folder: Path, stem: str = "") -> None:
    """Raise MissionServiceError if a file whose name begins with ``stem`` is a symbolic link."""
    for each in sorted(folder.glob(f"{stem}*")):
        if each.is_symlink():
            raise MissionServiceError(f"{each}: {LINK}, or choose another --out")


def written_by_others(folder: Path) -> bool:
    """Whether other users may write in a folder."""
    return bool(folder.stat().st_mode & 0o022)


@contextmanager
def private() -> Iterator[None]:
    """A context in which this process creates all files for its user only (umask 077)."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)
