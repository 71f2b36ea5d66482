"""Reading of records from a file in chunks; records across two chunks are joined."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.logs.entries import Damage, Log, LogEvent

PIECE_BYTES = 1 << 19
LEAP_US = 600_000_000  # longer gaps occur only where a log starts again

Message = TypeVar("Message")
Values = dict[str, Any]


def chunks(path: Path) -> Iterator[bytes]:
    """Yield the bytes of a file, in order. Raises BridgeError if it cannot be read."""
    try:
        with path.open("rb", buffering=0) as file:
            while piece := file.read(PIECE_BYTES):
                yield piece
    except OSError as error:
        raise BridgeError(f"{path}: cannot be read: {error.strerror}") from None


def records(
    log: Log,
    ahead_bytes: int,
    length_at: Callable[[bytes, int, bool], int],
    next_start: Callable[[bytes, int], int],
    damaged: str,
) -> Iterator[tuple[bytes, int, int]]:
    """Data, offset and length of each record; counts records and damage in the log.

    ``length_at(data, at, lost)`` is 0 where no whole record begins; it needs ``ahead_bytes`` of
    data except at the end of the file. ``lost``: the bytes before this offset were no record.
    ``next_start(data, at)`` is the next offset, from ``at`` on, where a record may begin; -1 if
    none.
    """
    log.messages, log.damage = 0, []
    data, at, base, lost_at = b"", 0, 0, -1
    source, more = chunks(log.path), True
    while more:
        piece = next(source, b"")
        more = bool(piece)
        base += at
        data, at = data[at:] + piece, 0
        end = len(data) - (ahead_bytes if more else 0)
        while at < end:
            length = length_at(data, at, lost_at >= 0)
            if not length:
                lost_at = base + at if lost_at < 0 else lost_at
                found = next_start(data, at + 1)
                at = max(end, at + 1) if found < 0 else min(found, max(end, at + 1))
                continue
            if lost_at >= 0:
                log.damage.append(Damage(lost_at, base + at - lost_at, damaged))
                lost_at = -1
            log.messages += 1
            yield data, at, length
            at += length
    if lost_at >= 0:
        log.damage.append(Damage(lost_at, base + at - lost_at, damaged))


def steady(messages: Iterator[Message], time_of: Callable[[Message], int]) -> Iterator[Message]:
    """Yield messages without those whose time leaps away from their neighbours', which are noise in
    formats without checksums. A leap that the next message confirms is kept.
    """
    latest_us: int | None = None
    held: Message | None = None
    for message in messages:
        at_us = time_of(message)
        if latest_us is not None and abs(at_us - latest_us) <= LEAP_US:
            held = None
        elif held is not None and abs(at_us - time_of(held)) <= LEAP_US:
            yield held
            held = None
        else:
            held = message
            continue
        latest_us = at_us
        yield message
    if latest_us is None and held is not None:
        yield held


def events_of(
    log: Log,
    messages: Iterator[tuple[str, Values]],
    convert: Callable[[str, Values], list[LogEvent]],
) -> Iterator[LogEvent]:
    """Yield the events of messages, by their names. A message without the expected fields is left out and
    its kind recorded once as damage: its description differs from the autopilots' or is damaged.
    """
    strange = set[str]()
    for name, values in messages:
        try:
            events = convert(name, values)
        except KeyError as lacks:
            if name not in strange:
                strange.add(name)
                log.damage.append(Damage(0, 0, f"{name} has no {lacks}: left out"))
            continue
        yield from events
