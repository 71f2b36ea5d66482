"""Manages the files of one journal: closed segments, the segment being written, and states.

A state is a snapshot of the service (``snapshot.py``).

journal.jsonl            the segment being written
journal-000001.jsonl     a closed segment; the oldest has the smallest number
journal-000002.state     the state at the beginning of segment 2 (segment 1 has none)
journal.state            the newest state; journal.earlier.state is the previous state
"""

import contextlib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from mission_service.errors import JournalError
from mission_service.events import LinesSkipped
from mission_service.journal.journal_file import (
    Entry,
    Rest,
    SegmentReader,
    Unreadable,
    next_path,
    segment_path,
)
from mission_service.journal.private_files import sync

SKIPPED = b'{"event":{"type":"LinesSkipped"'
NEVER_DELETED = 2  # number of segments: the segment being written, and the preceding segment


def closed_segments(path: Path) -> dict[int, Path]:
    """Return the closed segments of the journal at ``path`` by number, oldest first."""
    form = re.compile(rf"{re.escape(path.stem)}-(\d{{6}}){re.escape(path.suffix)}")
    found = ((form.fullmatch(each.name), each) for each in path.parent.glob(f"{path.stem}-*"))
    return dict(sorted((int(match[1]), each) for match, each in found if match))


def journal_of(segment: Path) -> Path | None:
    """Return the journal of a closed segment; None for a file with a different kind of name."""
    found = re.fullmatch(r"(.+)-\d{6}", segment.stem)
    return None if found is None else segment.with_name(found[1] + segment.suffix)


def begin_state(path: Path, number: int) -> Path:
    """Return the path of the state at the beginning of a segment."""
    return segment_path(path, number).with_suffix(".state")


def newest_state(path: Path) -> Path:
    """Return the path of the newest state."""
    return path.with_suffix(".state")


def earlier_state(path: Path) -> Path:
    """Return the path of the previous state."""
    return path.with_suffix(".earlier.state")


def states(path: Path) -> list[Path]:
    """Return the paths of all existing states, the newest first."""
    closed = list(closed_segments(path))
    begins = [begin_state(path, number + 1) for number in reversed(closed)]
    oldest = [begin_state(path, number) for number in closed[:1]]
    found = [newest_state(path), earlier_state(path), *begins, *oldest]
    return [each for each in found if each.exists()]


def synced(path: Path) -> None:
    """Flush a file and its folder to the disk."""
    sync(path)
    sync(path.parent)


def complete(path: Path) -> None:
    """Complete a segment change that a kill interrupted, and remove incomplete files."""
    new = next_path(path)
    if new.exists():
        if path.exists():
            new.unlink()
        else:
            new.rename(path)
    for half in path.parent.glob(f"{path.stem}*.half"):
        half.unlink()


def move(path: Path, to: Path) -> None:
    """Rename a journal, its segments and the states at their beginnings; delete other states."""
    closed = closed_segments(path)
    for number in (*closed, max(closed, default=0) + 1):
        if begin_state(path, number).exists():
            begin_state(path, number).rename(begin_state(to, number))
    for number, each in closed.items():
        each.rename(segment_path(to, number))
    for state in states(path):
        state.unlink()
    if path.exists():
        path.rename(to)


def trim(path: Path, keep_bytes: int) -> list[Path]:
    """Delete the oldest segments while the total size exceeds ``keep_bytes``, and return them.

    A segment that would become the oldest is also deleted if the state at its beginning is missing,
    because it could not be replayed. The state is missing if the run was killed before the state
    was written.
    """
    closed, deleted = closed_segments(path), list[Path]()
    size = sum(each.stat().st_size for each in (path, *closed.values(), *states(path)))
    for number, each in list(closed.items())[: max(len(closed) + 1 - NEVER_DELETED, 0)]:
        if size <= keep_bytes and (not deleted or begin_state(path, number).exists()):
            break
        for old in (each, begin_state(path, number)):
            if old.exists():
                size -= old.stat().st_size
                old.unlink()
        deleted.append(each)
    return deleted


class Chain:
    """The segments of a journal, read in order as one file.

    Raises JournalError if a segment cannot be read, is missing, or does not continue the preceding
    segment.
    """

    def __init__(self, path: Path) -> None:
        last = SegmentReader(path)
        closed = [SegmentReader(each) for each in closed_segments(path).values()]
        self.readers = [each for each in closed if each.segment < last.segment] + [last]
        numbers = [reader.segment for reader in self.readers]
        for number, reader in zip(range(numbers[0], numbers[-1] + 1), self.readers, strict=False):
            if reader.segment != number:
                raise JournalError(f"{segment_path(path, number)}: is missing from the journal")

    @property
    def last(self) -> SegmentReader:
        """The segment being written."""
        return self.readers[-1]

    @property
    def begin(self) -> Rest:
        """The position at the beginning of the oldest existing segment."""
        return self.readers[0].begin

    def holds(self, place: Rest) -> bool:
        """Return whether a position is the end of a line of this journal."""
        for reader in self.readers:
            if reader.segment == place.segment:
                return place == reader.begin or _line_ends(reader.path, place)
        return False

    def after(self, place: Rest) -> Iterator[tuple[SegmentReader, Entry]]:
        """Yield each entry after a position, with its segment."""
        for reader, number, body, intact in self.lines(place):
            yield reader, reader.entry(number, body, intact)

    def lines(self, place: Rest) -> Iterator[tuple[SegmentReader, int, bytes, bool]]:
        """Yield the segment, number and body of each line, and whether the checksum matches."""
        for reader, begin in self._places(place):
            for line in reader.lines(begin):
                yield reader, *line

    def trusted(self, place: Rest) -> Iterator[tuple[SegmentReader, Entry | Unreadable]]:
        """Yield the entries of ``after``, and ``Unreadable`` for altered or undecodable lines."""
        for reader, begin in self._places(place):
            for entry in reader.trusted(begin):
                yield reader, entry

    def _places(self, place: Rest) -> Iterator[tuple[SegmentReader, Rest]]:
        """Yield each segment from a position on, and the position at which to start reading."""
        before: SegmentReader | None = None
        for reader in self.readers:
            if reader.segment < place.segment:
                continue
            if before is not None:
                _check_continuation(before, reader)
            yield reader, place if reader.segment == place.segment else reader.begin
            before = reader


def lines_skipped(
    lines: Iterable[tuple[SegmentReader, int, bytes, bool]],
) -> dict[tuple[int, int], str]:
    """Return the reasons why restarts have skipped lines, by (segment, line)."""
    found: dict[tuple[int, int], str] = {}
    with contextlib.suppress(JournalError):  # raised again by a reader of all entries
        for reader, number, body, intact in lines:
            if intact and SKIPPED in body[:200]:
                content = reader.entry(number, body, intact).content
                if isinstance(content, LinesSkipped):
                    found |= {(each[0], each[1]): each[2] for each in content.lines}
    return found


def _line_ends(path: Path, place: Rest) -> bool:
    tail = b',"crc":"%08x"}\n' % place.crc
    with path.open("rb") as file:
        file.seek(max(place.at_byte - len(tail), 0))
        return file.read(len(tail)) == tail


def _check_continuation(before: SegmentReader, reader: SegmentReader) -> None:
    previous = (reader.header["previous_bytes"], reader.header["previous_crc"])
    end = (before.rest.at_byte, f"{before.rest.crc:08x}")
    if before.cut_at_line is not None or previous != end:
        raise JournalError(
            f"{before.path}: is incomplete, or {reader.path.name} does not continue it"
        )
