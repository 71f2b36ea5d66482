"""Selects the reader of a log, and merges several logs."""

import heapq
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.logs.dataflash import HEAD, DataFlashLog
from autopilot_bridge.logs.entries import Entry, Log
from autopilot_bridge.logs.record_scanner import chunks
from autopilot_bridge.logs.tlog import TlogLog
from autopilot_bridge.logs.ulog import MAGIC, UlogLog

SUFFIXES = (".tlog", ".bin", ".ulg")


def open_log(path: Path) -> Log:
    """Open a flight log: ``.tlog``, DataFlash ``.bin`` or ULog ``.ulg``.

    Args:
        path: The file; the first bytes determine the format, or the suffix if those bytes are not
            recognised.

    Returns:
        A reader; ``entries()`` yields the events in the order of the file, with times in
        microseconds of the log's clock.

    Raises:
        BridgeError: The file is empty, unreadable or in another format.
    """
    begin = next(chunks(path), b"")
    if not begin:
        raise BridgeError(f"{path}: is empty")
    if begin.startswith(MAGIC):
        return UlogLog(path)
    if begin.startswith(HEAD):
        return DataFlashLog(path)
    match path.suffix.lower():  # a file with a damaged beginning
        case ".tlog":
            return TlogLog(path)
        case ".bin":
            return DataFlashLog(path)
        case ".ulg":
            return UlogLog(path)
    raise BridgeError(f"{path}: not a supported log; supported are {', '.join(SUFFIXES)}")


class MergedEntry(NamedTuple):
    """An entry of one of several logs, with its time on the clock that the logs share."""

    at_us: int
    log: int  # index of the log
    entry: Entry


def merged(logs: Sequence[Log]) -> Iterator[MergedEntry]:
    """Yield all entries in chronological order.

    If there are several logs and all have a date, times are microseconds since 1970; otherwise the
    times of each log are those of its own clock. The entries of one log keep the order of the file,
    because autopilots write some topics slightly late.
    """
    offsets = [log.unix_offset_us() for log in logs]
    shared = all(offset is not None for offset in offsets) and len(logs) > 1
    streams = [
        _on_clock(log, number, offset if shared and offset is not None else 0)
        for number, (log, offset) in enumerate(zip(logs, offsets, strict=True))
    ]
    for _, _, entry in heapq.merge(*streams, key=lambda each: each[:2]):
        yield entry


def _on_clock(log: Log, number: int, offset_us: int) -> Iterator[tuple[int, int, MergedEntry]]:
    latest_us = -(1 << 62)
    for entry in log.entries():
        at_us = entry.event.at_us + offset_us
        latest_us = max(latest_us, at_us)
        yield latest_us, number, MergedEntry(at_us, number, entry)
