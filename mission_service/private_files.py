"""Files for their user alone: mode 0600, in folders of mode 0700, never behind a symbolic link.

A link that was planted where a journal or a state is to be written would have the service write to
what the link names, with its user's rights; so it is refused, and never followed.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mission_service.errors import MissionServiceError

FILE_MODE, FOLDER_MODE = 0o600, 0o700
LINK = "is a symbolic link, and files of a run are never behind one; remove it"


def opened(path: Path, flags: int) -> int:
    """A file descriptor of a regular file. Raises OSError; with ELOOP for a symbolic link."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC, FILE_MODE)


def in_words(error: OSError) -> str:
    """Why a file that was to be opened for writing was not."""
    return LINK if error.errno == errno.ELOOP else f"cannot be written: {error.strerror}"


def refuse_links(folder: Path, stem: str) -> None:
    """Raise MissionServiceError in one line if a file whose name begins so is a symbolic link."""
    for each in sorted(folder.glob(f"{stem}*")):
        if each.is_symlink():
            raise MissionServiceError(f"{each}: {LINK}, or choose another --out")


def written_by_others(folder: Path) -> bool:
    """Whether others may write in a folder."""
    return bool(folder.stat().st_mode & 0o022)


@contextmanager
def private() -> Iterator[None]:
    """All that this process makes meanwhile is for its user alone."""
    before = os.umask(0o077)
    try:
        yield
    finally:
        os.umask(before)
