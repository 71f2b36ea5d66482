"""Writes and reads a JSON Lines journal, with each event before the commands that it causes.

The first line is the header (versions, seed, scenario, landscape). Each further line contains one
event or one command; a final line marks the regular end of the run. Every line ends in a checksum
that depends on all earlier lines after the header, so that a changed, lost, added or moved line is
detected. The checksum of the header covers only the header.

An event is written before the event is handled. Every written line can be read back: a line is
decoded before it is written, and refused if the result differs (msgspec writes NaN as null) or a
value exceeds the limits of its type. Only the owner can read the files of a journal and of its
states. A symbolic link in place of such a file is refused. A new journal is locked while it is
written, so that a second command in the same folder does not empty it.
"""

import contextlib
import fcntl
import os
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO

import msgspec

from mission_service import __version__, value_errors
from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario
from mission_service.errors import JournalError, RefusedEventError
from mission_service.events import AnyEvent, OperatorEvent
from mission_service.journal.private_files import in_words, opened

FORMAT = 2  # 1: version 0.1, with other names of events and keys
_EVENT, _COMMAND, _HEADER = b'{"event":', b'{"command":', b'{"header":'
_END = b'{"end":'
_CHECK = b',"crc":"'
_BUFFERED_BYTES = 1 << 16

_encode = msgspec.json.Encoder().encode
_decode_event = msgspec.json.Decoder(AnyEvent).decode
_decode_command = msgspec.json.Decoder(AnyCommand).decode


def header_of(scenario: Scenario, landscape_digest: str, created: str) -> dict[str, Any]:
    """Return the header of a journal; ``created`` is the wall-clock time as text."""
    packages = ("numpy", "numba", "pymavlink", "pyproj", "shapely")
    return {
        "format": FORMAT,
        "mission_service": __version__,
        "packages": {name: version(name) for name in packages},
        "created": created,
        "seed": scenario.seed,
        "landscape_sha256": landscape_digest,
        "scenario": scenario.model_dump(mode="json"),
    }


@dataclass(frozen=True, slots=True)
class Rest:
    """A position in a journal: the end of a line in a segment, with that line's checksum."""

    at_byte: int
    crc: int
    segment: int = 1


class Journal:
    """The writer of a journal. If ``durable`` (live flight), lines are not buffered in the process.

    If lines cannot be written completely, the partial lines are removed and OSError is raised; the
    journal is then unchanged, and writing may be tried again. With ``rest``, the journal of an
    interrupted run is continued after this position and keeps its header.
    """

    def __init__(
        self, path: Path, header: dict[str, Any], durable: bool, rest: Rest | None = None
    ) -> None:
        self.path = path
        self.durable = durable
        self.rest = rest or Rest(0, 0)
        self._header = {**header, "live": durable}
        self._waiting = bytearray()
        self._torn = False
        if rest is None:
            _refuse_live(path)
        try:
            if rest is not None:
                self._file = opened(path, os.O_WRONLY | os.O_APPEND)
                os.ftruncate(self._file, rest.at_byte)
            else:
                self._file = _emptied(path)
                self._put([_line(_HEADER + _encode(self._header), 0)[0]], 0)
        except OSError as error:
            raise JournalError(f"{path}: {in_words(error)}") from None

    def write_event(self, event: AnyEvent, body: bytes | None = None) -> None:
        """Append an event before it is handled; an operator's event is flushed to the disk.

        Args:
            event: The event.
            body: The event's ``event_body``, if the caller has computed it.

        Raises:
            RefusedEventError: The event would differ when read back.
            OSError: The event could not be written.
        """
        body = event_body(event) if body is None else body
        self.write_lines([body], to_disk=isinstance(event, OperatorEvent))

    def write_commands(self, commands: list[AnyCommand]) -> None:
        """Append the commands of the last event."""
        if commands:
            self.write_lines([command_body(command) for command in commands])

    def write_lines(self, bodies: list[bytes], to_disk: bool = False) -> None:
        """Append either all or none of these lines, which are given without checksums."""
        crc, lines = self.rest.crc, []
        for body in bodies:
            line, crc = _line(body, crc)
            lines.append(line)
        self._put(lines, crc, to_disk)

    def remove_last(self, before: Rest) -> None:
        """Remove all lines after a position; these lines must not have been applied."""
        unwritten = max(len(self._waiting) - (self.rest.at_byte - before.at_byte), 0)
        del self._waiting[unwritten:]
        self.rest = before
        if not self._waiting:
            self._torn = True
            self._repair()

    def end(self) -> None:
        """Write the final line, which marks a regular end; no line may follow."""
        self.write_lines([_END + b"true"], to_disk=True)

    def close(self) -> None:
        """Flush the buffer and close the file; a second call has no effect."""
        if self._file < 0:
            return
        try:
            self._flush()
        finally:
            os.close(self._file)
            self._file = -1

    def begin_segment(self) -> Path:
        """Rename this file to a closed segment, begin the next file, and return the closed file.

        After an OSError the journal is unchanged. The new names are permanent only after the caller
        has flushed the folder to the disk.
        """
        number = self.rest.segment + 1
        position = {
            "segment": number,
            "previous_bytes": self.rest.at_byte,
            "previous_crc": f"{self.rest.crc:08x}",
        }
        line = _line(_HEADER + _encode({**self._header, **position}), 0)[0]
        new, closed = next_path(self.path), segment_path(self.path, number - 1)
        file = _emptied(new)
        try:
            self._flush()
            os.fsync(self._file)  # the next segment is useless without the end of this one
            _write(file, line)
            os.fsync(file)
            self.path.rename(closed)
            try:
                new.rename(self.path)
            except OSError:
                closed.rename(self.path)
                raise
        except OSError:
            os.close(file)
            new.unlink(missing_ok=True)
            raise
        os.close(self._file)
        self._file, self.rest = file, Rest(len(line), 0, number)
        return closed

    def _put(self, lines: list[bytes], crc: int, to_disk: bool = False) -> None:
        data = b"".join(lines)
        after = Rest(self.rest.at_byte + len(data), crc, self.rest.segment)
        self._waiting += data
        if not self.durable and not to_disk and len(self._waiting) < _BUFFERED_BYTES:
            self.rest = after
            return
        try:
            self._flush()
            if to_disk:
                os.fsync(self._file)
        except OSError:
            self._torn = True
            self._waiting = bytearray()
            with contextlib.suppress(OSError):  # the next attempt repairs the file
                self._repair()
            raise
        self.rest = after

    def _repair(self) -> None:
        """Remove partially written lines."""
        if self._torn:
            os.ftruncate(self._file, self.rest.at_byte)
            self._torn = False

    def _flush(self) -> None:
        self._repair()
        if self._waiting:
            _write(self._file, self._waiting)
            self._waiting = bytearray()


def _emptied(path: Path) -> int:
    """Open an empty file under a lock. Raises JournalError if another command has locked it."""
    file = opened(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(file)
        raise JournalError(
            f"{path}: another command writes to this folder; wait for its end or choose another "
            "folder"
        ) from None
    except OSError:
        pass  # a network file system without locks
    os.ftruncate(file, 0)
    return file


def _refuse_live(path: Path) -> None:
    """Raise JournalError if the file is the journal of a live run, which must be preserved."""
    if not begins_journal(path):
        return
    with path.open("rb") as file:
        body, intact, _ = _checked(file.readline().rstrip(b"\n"), 0)
    if not intact or msgspec.json.decode(body[len(_HEADER) :]).get("live"):
        raise JournalError(
            f"{path}: is the journal of a live run and is not overwritten; move it or choose "
            "another folder"
        )


def _write(file: int, data: bytes | bytearray) -> None:
    done = 0
    with memoryview(data) as view:  # also released on errors, so that the data can be cleared
        while done < len(view):
            with view[done:] as rest:
                done += os.write(file, rest)


def begins_journal(path: Path) -> bool:
    """Return whether a file begins like a journal; False for a file that cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(len(_HEADER)) == _HEADER
    except OSError:
        return False


def event_body(event: AnyEvent) -> bytes:
    """Return the line of an event without its checksum.

    Raises RefusedEventError if the line could not be read back.
    """
    return _EVENT + _readable(event, _decode_event)


def command_body(command: AnyCommand) -> bytes:
    """Return the line of a command without its checksum.

    Raises RefusedEventError if the line could not be read back.
    """
    return _COMMAND + _readable(command, _decode_command)


def _readable(content: AnyEvent | AnyCommand, decode: Callable[[bytes], object]) -> bytes:
    name = type(content).__name__
    try:
        body = _encode(content)
        again = decode(body)
    except (msgspec.MsgspecError, UnicodeError, OverflowError, TypeError, ValueError) as error:
        words = value_errors.in_words(error, type(content))
        raise RefusedEventError(f"{name} refused: {words}") from None
    if again != content:
        raise RefusedEventError(f"{name} refused: it differs after encoding and decoding")
    return body


def next_path(path: Path) -> Path:
    """Return the path of the file in which the next segment of a journal is prepared."""
    return path.with_name(f"{path.name}.next")


def segment_path(path: Path, number: int) -> Path:
    """Return the path of a closed segment of the journal at ``path``."""
    return path.with_name(f"{path.stem}-{number:06d}{path.suffix}")


def _line(body: bytes, crc: int) -> tuple[bytes, int]:
    crc = zlib.crc32(body, crc)
    return b'%b%b%08x"}\n' % (body, _CHECK, crc), crc


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a journal: an event or a command, and whether the line's checksum matches.

    ``sure`` is False after a skipped line: the commands of a replay may then differ from the
    recorded commands.
    """

    line: int
    content: AnyEvent | AnyCommand
    is_event: bool
    intact: bool
    sure: bool = True


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A line that was altered, or is neither an event nor a command; ``why`` is the reason."""

    line: int
    why: str


class SegmentReader:
    """A reader of one segment; ``cut_at_line`` is the number of an incomplete last line.

    After the last line was read, ``rest`` is the position from which writing can continue, and
    ``ended`` is set if the run ended regularly.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cut_at_line: int | None = None
        self.ended = False
        try:
            with path.open("rb") as file:
                first = file.readline()
        except OSError as error:
            raise JournalError(f"{path}: cannot be read: {error.strerror}") from None
        body, intact, _ = _checked(first.rstrip(b"\n"), 0)
        if not body.startswith(_HEADER):
            raise JournalError(f"{path}: not a journal of mission-service (no header in line 1)")
        if not intact:
            raise JournalError(f"{path}: line 1 (header) was altered: its checksum does not match")
        self.header: dict[str, Any] = msgspec.json.decode(body[len(_HEADER) :])
        if self.header["format"] != FORMAT:
            written = self.header["format"]
            remedy = "use version 0.1, which wrote it" if written == 1 else "use a later version"
            raise JournalError(f"{path}: journal format {written}, not {FORMAT}: {remedy}")
        self.segment: int = self.header.get("segment", 1)
        self.rest = self.begin = Rest(len(first), 0, self.segment)
        self._first = first

    def __iter__(self) -> Iterator[Entry]:
        return self.after(self.begin)

    def after(self, place: Rest) -> Iterator[Entry]:
        """Yield entries after a position. Raises JournalError for an undecodable line."""
        for number, body, intact in self.lines(place):
            yield self.entry(number, body, intact)

    def trusted(self, place: Rest) -> Iterator[Entry | Unreadable]:
        """Yield entries after a position, with ``Unreadable`` for altered or undecodable lines."""
        altered = 0
        for number, body, intact in self.lines(place):
            if not intact:
                why = "was altered: its checksum does not match"
                if number == altered + 1:  # the checksum of the preceding line may be lost
                    why = (
                        f"was altered or cannot be checked: its checksum depends on line {altered}"
                    )
                altered = number
                yield Unreadable(number, f"{self.path}: line {number} {why}")
                continue
            try:
                yield self.entry(number, body, intact)
            except JournalError as error:
                yield Unreadable(number, str(error))

    def lines(self, place: Rest) -> Iterator[tuple[int, bytes, bool]]:
        """Yield the number and body of lines after a position, and whether the checksum matches."""
        self.rest = place
        self.cut_at_line, self.ended = None, False
        with self._opened() as file:
            first = 1 + _lines_in(file, place.at_byte)
            for number, raw in enumerate(file, start=first):
                if not raw.endswith(b"\n"):
                    self.cut_at_line = number
                    return
                if self.ended:
                    raise JournalError(f"{self.path}: line {number} follows the end of the run")
                body, intact, crc = _checked(raw[:-1], self.rest.crc)
                self.rest = Rest(self.rest.at_byte + len(raw), crc, self.segment)
                if body.startswith(_END) and intact:
                    self.ended = True
                else:
                    yield number, body, intact

    def _opened(self) -> BinaryIO:
        """Open the file, under its new name if the run has closed this segment meanwhile."""
        for path in (self.path, segment_path(self.path, self.segment)):
            with contextlib.suppress(FileNotFoundError):
                file = path.open("rb")
                if file.readline() == self._first:
                    file.seek(0)
                    self.path = path
                    return file
                file.close()
        raise JournalError(f"{self.path}: was replaced or removed while it was read")

    def entry(self, number: int, body: bytes, intact: bool) -> Entry:
        """Decode an event or a command. Raises JournalError for any other line."""
        try:
            if body.startswith(_EVENT):
                return Entry(number, _decode_event(body[len(_EVENT) :]), True, intact)
            if body.startswith(_COMMAND):
                return Entry(number, _decode_command(body[len(_COMMAND) :]), False, intact)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise JournalError(f"{self.path}: line {number} cannot be read: {error}") from None
        raise JournalError(f"{self.path}: line {number} is neither an event nor a command")


def _lines_in(file: BinaryIO, first_bytes: int) -> int:
    """Read the first bytes of a file and return the number of line ends in it."""
    count = 0
    while first_bytes > 0 and (block := file.read(min(first_bytes, 1 << 20))):
        count += block.count(b"\n")
        first_bytes -= len(block)
    return count


def _checked(line: bytes, crc: int) -> tuple[bytes, bool, int]:
    """Return the body of a line, whether its checksum matches, and the checksum as written."""
    body, found, tail = line.rpartition(_CHECK)
    if not found or len(tail) != 10:
        return line, False, 0
    running = zlib.crc32(body, crc)
    if tail == b'%08x"}' % running:
        return body, True, running
    try:
        return body, False, int(tail[:8], 16)
    except ValueError:
        return body, False, 0
