"""The states to publish over MQTT: the newest of each key of the state view. Pure.

No message waits in a queue: for each key only the version that was sent is kept. Memory therefore
does not grow without a broker, and a new connection gets the present states.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from mission_service.interfaces.mqtt.topics import EVENT, PARTS, TELEMETRY, Topic
from mission_service.runtime.state_view import StateView

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext

STATE_EVERY_US = 500_000  # shortest interval between two of one vehicle
_encode = msgspec.json.Encoder().encode


class Publication(NamedTuple):
    """One message; ``name`` is the vehicle or command in its topic, if there is one."""

    topic: Topic
    payload: bytes
    name: str = ""

    @property
    def path(self) -> str:
        """The part of the topic after the site's topic."""
        return self.topic.path.format(self.name)


class PublishSchedule:
    """Selects the states that are due, by a monotonic clock.

    States have QoS 0: all are sent again after each new connection. Announcements have QoS 1, since
    no newer message replaces them.
    """

    def __init__(self, telemetry_hz: float) -> None:
        self._telemetry_every_us = round(1e6 / telemetry_hz)
        self._sent: dict[str, int] = {}  # version of the state view, by key
        self._due_us: dict[str, int] = {}
        self._announcement_id = 0

    def begin(self) -> None:
        """Send all states again: a new connection begins."""
        self._sent.clear()

    def states(self, context: "RunContext", now_us: int) -> Iterator[Publication]:
        """The states that are due; each counts as sent when the next one is taken."""
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
        """Announcements that were not sent; each counts as sent when the next is taken."""
        for line in state_view.announcements_after(self._announcement_id):
            yield Publication(EVENT, _encode(line))
            self._announcement_id = line.id
