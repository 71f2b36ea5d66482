"""Selects the states to publish over MQTT: the newest for each key of the state view. Pure.

There is no queue of messages; the schedule stores only the version that was last sent for each key.
Therefore, memory does not grow without a broker, and the current states are sent over each new
connection.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from mission_service.interfaces.mqtt.topics import EVENT, PARTS, TELEMETRY, Topic
from mission_service.runtime.state_view import StateView

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

STATE_EVERY_US = 500_000  # minimum interval between two states of one key
_encode = msgspec.json.Encoder().encode


class Publication(NamedTuple):
    """One message; ``name`` is the vehicle or command in its topic, if the topic has one."""

    topic: Topic
    payload: bytes
    name: str = ""

    @property
    def path(self) -> str:
        """Return the part of the topic after the site's topic."""
        return self.topic.path.format(self.name)


class PublishSchedule:
    """A schedule of publications, based on a monotonic clock.

    States have QoS 0, because all of them are sent again over each new connection. Announcements
    have QoS 1, because no newer message replaces them.
    """

    def __init__(self, telemetry_hz: float) -> None:
        self._telemetry_every_us = round(1e6 / telemetry_hz)
        self._sent: dict[str, int] = {}  # version of the state view, by key
        self._due_us: dict[str, int] = {}
        self._announcement_id = 0

    def begin(self) -> None:
        """Mark all states as unsent, at the start of a new connection."""
        self._sent.clear()

    def states(self, context: "RunContext", now_us: int) -> Iterator[Publication]:
        """Yield the states that are due; mark each as sent when the caller requests the next."""
        for key, version in list(context.state_view.changed.items()):
            part, _, name = key.partition("/")
            topic = PARTS.get(part)
            if topic is None or topic.build is None:
                continue
            if self._sent.get(key, 0) >= version or self._due_us.get(key, 0) > now_us:
                continue
            yield Publication(topic, _encode(topic.build(context, name)), name)
            self._sent[key] = version
            every_us = self._telemetry_every_us if topic is TELEMETRY else STATE_EVERY_US
            self._due_us[key] = now_us + every_us

    def announcements(self, state_view: StateView) -> Iterator[Publication]:
        """Yield unsent announcements; mark each as sent when the caller requests the next."""
        for line in state_view.announcements_after(self._announcement_id):
            yield Publication(EVENT, _encode(line))
            self._announcement_id = line.id
