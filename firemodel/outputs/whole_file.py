"""Write a file completely or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a path to write to, which becomes ``path`` when the block ends without an error.

    After an error the new file is removed, and a file that existed under ``path`` is unchanged.

    Args:
        path: The file to write. Its folder must exist.

    Raises:
        OSError: The file cannot be moved to ``path``.
    """
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text file (UTF-8) completely or not at all (see ``whole_file``)."""
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
