"""All topics of a site: what follows ``PREFIX/v1/SITE/``, what it carries, when and how. Pure.

A part of the state view (``part``) is published when it changes, and what has ``build`` alone
whenever it is another; the publisher asks for the rest itself. The schemas and the table of
``docs/mqtt.md`` are made from this table too.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from mission_service.interfaces.mqtt.payloads import Alarms, Reply, ServiceStatus
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.published_states import (
    Announcement,
    MissionState,
    TelemetryState,
    VehicleState,
)

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext


class Topic(NamedTuple):
    """A topic, or one for each name that takes the place of ``{}``."""

    path: str
    carries: type[msgspec.Struct] | str  # or the name of a schema that is written by hand
    qos: int
    retained: bool
    when: str  # for docs/mqtt.md
    part: str = ""  # of the state view
    build: Callable[["RunContext", str], Any] | None = (
        None  # its message now, for a name; None: none
    )

    @property
    def schema(self) -> str:
        """The name and version of what it carries."""
        if isinstance(self.carries, str):
            return self.carries
        return str(self.carries.__struct_config__.tag)


STATUS = Topic(
    "status",
    ServiceStatus,
    1,
    True,
    "at each connection and when what is not ready changes; last will and farewell with "
    "`online` false",
)
TELEMETRY = Topic(
    "vehicle/{}/telemetry",
    TelemetryState,
    0,
    False,
    "on change, at most `telemetry_hz` a second",
    "telemetry",
    lambda context, name: context.state_view.telemetry[name],
)
VEHICLE = Topic(
    "vehicle/{}/state",
    VehicleState,
    0,
    True,
    "on change, at most twice a second",
    "vehicle",
    lambda context, name: context.state_view.vehicles[name],
)
MISSION = Topic(
    "vehicle/{}/mission",
    MissionState,
    0,
    True,
    "on change, at most twice a second",
    "mission",
    lambda context, name: context.state_view.missions[name],
)
FRONT = Topic(
    "fire/front", "front/1", 0, True, "each 10 s, and within 2 s when people change the fire"
)
ALARM = Topic(
    "alarm",
    Alarms,
    0,
    True,
    "all that is wrong now, on change, at most twice a second",
    "alarms",
    lambda context, name: Alarms(
        context.state_view.at_us, tuple(context.state_view.alarms.values())
    ),
)
REPLAY = Topic(
    "replay",
    ReplayState,
    0,
    True,
    "of replays alone: where it is and how fast, on change, at most twice a second",
    build=lambda context, name: context.replay and context.replay(),
)
EVENT = Topic("event", Announcement, 1, False, "each line for people")
COMMAND = Topic("cmd/{}", "command/1", 1, False, "sent by you, answered on")
REPLY = Topic("cmd/{}/reply", Reply, 1, False, "each command that came, once")
TOPICS = (STATUS, TELEMETRY, VEHICLE, MISSION, FRONT, ALARM, REPLAY, EVENT, COMMAND, REPLY)
PARTS = {topic.part: topic for topic in TOPICS if topic.part}
POLLED = tuple(topic for topic in TOPICS if topic.build and not topic.part)
