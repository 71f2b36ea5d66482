"""The journal: every input before it is handled, every command after. JSON Lines.

The first line is the header (versions, seed, scenario, landscape). Each further line holds one
event or one command; the last one says that the run ended in order. Every line ends in a checksum
that runs on from the line before (the header's stands alone), so that a line that was changed,
lost, added or moved is found and named.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any

import msgspec

from mission_service import __version__
from mission_service.commands import AnyCommand
from mission_service.config import Scenario
from mission_service.errors import JournalError
from mission_service.events import AnyEvent

FORMAT = 1
_EVENT, _COMMAND, _HEADER = b'{"event":', b'{"command":', b'{"header":'
_END = b'{"end":'
_CHECK = b',"crc":"'

_encode = msgspec.json.Encoder().encode
_decode_event = msgspec.json.Decoder(AnyEvent).decode
_decode_command = msgspec.json.Decoder(AnyCommand).decode


def header_of(scenario: Scenario, landscape_digest: str, created: str) -> dict[str, Any]:
    """What a journal says of itself; ``created`` is the wall-clock time in words."""
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
    """Where a journal goes on: after its last whole line, with that line's checksum."""

    at_byte: int
    crc: int


class Journal:
    """Appends to one journal file. ``durable`` flushes after each input (live flight).

    With ``rest`` it goes on with the journal of a run that was cut off; the header is that one's.
    """

    def __init__(
        self, path: Path, header: dict[str, Any], durable: bool, rest: Rest | None = None
    ) -> None:
        self.path = path
        self._durable = durable
        self._crc = 0 if rest is None else rest.crc
        try:
            self._file: IO[bytes] = path.open("wb" if rest is None else "r+b")
            if rest is not None:
                self._file.truncate(rest.at_byte)
                self._file.seek(rest.at_byte)
        except OSError as error:
            raise JournalError(f"{path}: cannot be written: {error.strerror}") from None
        if rest is None:
            self._file.write(_line(_HEADER + _encode({**header, "live": durable}), 0)[0])
            if durable:
                self._file.flush()

    def event(self, event: AnyEvent) -> None:
        """Write down an input; call it before the input is handled."""
        self._write(_EVENT + _encode(event))
        if self._durable:
            self._file.flush()

    def commands(self, commands: list[AnyCommand]) -> None:
        """Write down what the last input led to."""
        for command in commands:
            self._write(_COMMAND + _encode(command))
        if self._durable and commands:
            self._file.flush()

    def end(self) -> None:
        """Write down that the run ended in order; nothing may follow."""
        self._write(_END + b"true")

    def close(self) -> None:
        """Write out what is buffered and close the file."""
        self._file.close()

    def _write(self, body: bytes) -> None:
        line, self._crc = _line(body, self._crc)
        self._file.write(line)


def _line(body: bytes, crc: int) -> tuple[bytes, int]:
    crc = zlib.crc32(body, crc)
    return b'%b%b%08x"}\n' % (body, _CHECK, crc), crc


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a journal: an event or a command, and whether its checksum holds."""

    line: int
    content: AnyEvent | AnyCommand
    is_event: bool
    intact: bool


class JournalReader:
    """Reads a journal line by line; a line cut off at the end is reported in ``cut_at_line``.

    Once all is read, ``rest`` says where it goes on, and ``ended`` whether its run ended in order.
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
            raise JournalError(
                f"{path}: journal format {self.header['format']}; this version reads {FORMAT}"
            )
        self.rest = Rest(len(first), 0)

    def __iter__(self) -> Iterator[Entry]:
        with self.path.open("rb") as file:
            self.rest = Rest(len(file.readline()), 0)
            for number, raw in enumerate(file, start=2):
                if not raw.endswith(b"\n"):
                    self.cut_at_line = number
                    return
                if self.ended:
                    raise JournalError(f"{self.path}: line {number} stands after the end")
                body, intact, crc = _checked(raw[:-1], self.rest.crc)
                self.rest = Rest(self.rest.at_byte + len(raw), crc)
                if body.startswith(_END) and intact:
                    self.ended = True
                else:
                    yield self._entry(number, body, intact)

    def _entry(self, number: int, body: bytes, intact: bool) -> Entry:
        try:
            if body.startswith(_EVENT):
                return Entry(number, _decode_event(body[len(_EVENT) :]), True, intact)
            if body.startswith(_COMMAND):
                return Entry(number, _decode_command(body[len(_COMMAND) :]), False, intact)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise JournalError(f"{self.path}: line {number} cannot be read: {error}") from None
        raise JournalError(f"{self.path}: line {number} is neither an event nor a command")


def _checked(line: bytes, crc: int) -> tuple[bytes, bool, int]:
    """Split a line into body and checksum: (body, does it match, checksum as written)."""
    body, found, tail = line.rpartition(_CHECK)
    if not found or len(tail) != 10:
        return line, False, 0
    try:
        written = int(tail[:8], 16)
    except ValueError:
        return body, False, 0
    return body, zlib.crc32(body, crc) == written and tail[8:] == b'"}', written
