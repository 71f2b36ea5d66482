"""Reads records from a file in chunks, and joins records that continue in the next chunk."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.logs.entries import Damage, Log, LogEvent

CHUNK_BYTES = 1 << 19
LEAP_US = 600_000_000  # larger steps in time occur only where a log restarts

Values = dict[str, Any]
Message = tuple[str, Values]  # name, and values by column


def chunks(path: Path) -> Iterator[bytes]:
    """Yield the bytes of a file, in order. Raises BridgeError for an unreadable file."""
    try:
        with path.open("rb", buffering=0) as file:
            while chunk := file.read(CHUNK_BYTES):
                yield chunk
    except OSError as error:
        raise BridgeError(f"{path}: cannot be read: {error.strerror}") from None


def records(
    log: Log,
    ahead_bytes: int,
    length_at: Callable[[bytes, int, bool], int],
    next_start: Callable[[bytes, int], int],
    damaged: str,
) -> Iterator[tuple[bytes, int, int]]:
    """Yield the data, offset and length of each record; update ``messages`` and ``damage``.

    ``length_at(data, at, lost)`` returns the length of the record at ``at``; 0 if no complete
    record begins there. The function needs ``ahead_bytes`` of data except at the end of the file.
    ``lost`` is True if the bytes before ``at`` were not a record. ``next_start(data, at)`` returns
    the next offset, from ``at`` on, at which a record may begin; -1 if there is none.
    """
    log.messages, log.damage = 0, []
    data, at, base, lost_at = b"", 0, 0, -1
    source, more = chunks(log.path), True
    while more:
        chunk = next(source, b"")
        more = bool(chunk)
        base += at
        data, at = data[at:] + chunk, 0
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


def steady(messages: Iterator[Message], time_key: str) -> Iterator[Message]:
    """Yield the messages, without those whose time differs greatly from neighbouring times.

    In formats without checksums such a message is noise. A leap in time is accepted if the time of
    the next message confirms the leap.
    """
    latest_us: int | None = None
    held: Message | None = None
    for message in messages:
        at_us = message[1][time_key]
        if latest_us is not None and abs(at_us - latest_us) <= LEAP_US:
            held = None
        elif held is not None and abs(at_us - held[1][time_key]) <= LEAP_US:
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
    messages: Iterator[Message],
    convert: Callable[[str, Values], list[LogEvent]],
) -> Iterator[LogEvent]:
    """Yield the events into which ``convert`` converts the messages.

    A message that lacks an expected field is omitted, because the description of its type is
    damaged or unknown. The name of such a message is recorded once as damage.
    """
    reported = set[str]()
    for name, values in messages:
        try:
            events = convert(name, values)
        except KeyError as error:
            if name not in reported:
                reported.add(name)
                log.damage.append(Damage(0, 0, f"{name} has no field {error} and is omitted"))
            continue
        yield from events
