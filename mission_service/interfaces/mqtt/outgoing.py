"""What is still to be told over MQTT: the newest of each part of the picture. Pure.

No message waits in a queue: there are keys of the picture, and the versions that were sent. So
nothing grows while there is no broker, and what is sent then is what is true then.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from mission_service.interfaces.mqtt.topics import EVENT, PARTS, TELEMETRY, Topic
from mission_service.runtime.picture import Picture

if TYPE_CHECKING:
    from mission_service.runtime.hub import Hub

STATE_EVERY_US = 500_000  # one vehicle's state or mission is sent no sooner again
_encode = msgspec.json.Encoder().encode


class Publication(NamedTuple):
    """One message; ``name`` is its topic's vehicle or command, if it has one."""

    topic: Topic
    payload: bytes
    name: str = ""

    @property
    def path(self) -> str:
        """What follows the site's topic."""
        return self.topic.path.format(self.name)


class Outgoing:
    """Which states are to be sent at which time of a clock that never jumps.

    States go with QoS 0: after each new connection all are sent again, and a broker that is there
    loses none. Lines for people go with QoS 1, since there is no newer one in their place.
    """

    def __init__(self, telemetry_hz: float) -> None:
        self._telemetry_every_us = round(1e6 / telemetry_hz)
        self._sent: dict[str, int] = {}  # version of the picture, by key
        self._due_us: dict[str, int] = {}
        self._news_id = 0

    def begin(self) -> None:
        """A broker is there, and may know nothing."""
        self._sent.clear()

    def states(self, hub: "Hub", now_us: int) -> Iterator[Publication]:
        """What is due of the state view; each counts as sent when the next is asked for."""
        for key, version in list(hub.picture.changed.items()):
            part, _, name = key.partition("/")
            topic = PARTS.get(part)
            if topic is None or topic.build is None:
                continue
            if self._sent.get(key, 0) >= version or self._due_us.get(key, 0) > now_us:
                continue
            yield Publication(topic, _encode(topic.build(hub, name)), name)
            self._sent[key] = version
            every_us = self._telemetry_every_us if topic is TELEMETRY else STATE_EVERY_US
            self._due_us[key] = now_us + every_us

    def news(self, picture: Picture) -> Iterator[Publication]:
        """Lines for people that were not sent; each counts as sent when the next is asked for."""
        for line in picture.news_after(self._news_id):
            yield Publication(EVENT, _encode(line))
            self._news_id = line.id
