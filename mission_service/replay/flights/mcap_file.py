"""Writes logs as one MCAP file for Foxglove. Equal logs result in identical bytes."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from autopilot_bridge.logs.entries import LATEST_US, Log
from autopilot_bridge.logs.reading import merged
from mission_service.replay.flights.flight_tables import Rows
from mission_service.replay.flights.flown_vehicle import file_of
from mission_service.replay.flights.foxglove import SCHEMAS, Message, messages_of

# A constant, because the default text contains the version of mcap and would change the bytes.
LIBRARY = "mission-service"


def write_mcap(path: Path, logs: Sequence[Log], names: Mapping[tuple[int, int], str]) -> None:
    """Write all logs, with UTC times if all logs contain UTC, otherwise with the logs' own times.

    ``names`` contains the vehicles' names by the log's index and the system id.
    """
    found = [offset for log in logs if (offset := log.unix_offset_us()) is not None]
    offsets = found if len(found) == len(logs) else [0] * len(logs)
    rows = [Rows(file_of(log), None) for log in logs]
    with path.open("wb") as file:
        channels = _Channels(file)
        for _, number, (system_id, event) in merged(logs):
            if not 0 <= event.at_us < LATEST_US:
                continue
            at_ns = (event.at_us + offsets[number]) * 1000
            name = names[number, system_id]
            event_rows = list(rows[number].of(system_id, event))
            for message in messages_of(name, at_ns, event, event_rows):
                channels.write(name, at_ns, message)
        channels.finish()


class _Channels:
    """The channels of an MCAP file: one for each topic of each vehicle."""

    def __init__(self, file: Any) -> None:
        from mcap.writer import Writer

        self._writer: Any = Writer(file)
        self._writer.start(library=LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}

    def write(self, name: str, at_ns: int, message: Message) -> None:
        channel = self._channels.get((name, message.topic))
        if channel is None:
            schema = self._schema(message.schema)
            topic = f"/{name}/{message.topic}"
            channel = self._writer.register_channel(topic, "json", schema)
            self._channels[name, message.topic] = channel
        data = json.dumps(message.content, separators=(",", ":"), allow_nan=False).encode()
        self._writer.add_message(channel, log_time=at_ns, publish_time=at_ns, data=data)

    def _schema(self, name: str) -> int:
        if name not in self._schemas:
            data = json.dumps(SCHEMAS[name]).encode()
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", data)
        return self._schemas[name]

    def finish(self) -> None:
        self._writer.finish()
