"""Lists all topics of a site: names after ``PREFIX/v1/SITE/``, payloads, QoS and times. Pure.

A topic with ``part`` is published when that part of the state view changes. A topic with only
``build`` is published when its message differs from the last message. The publisher builds the
messages of all other topics. The schemas and the table of ``docs/mqtt.md`` are generated from this
table.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from mission_service.interfaces.mqtt.payloads import (
    Aircraft,
    Alarms,
    FireArrivals,
    Reply,
    ServiceStatus,
)
from mission_service.runtime.play_head import ReplayState
from mission_service.runtime.published_states import (
    AirspaceStatus,
    Announcement,
    MissionState,
    TelemetryState,
    VehicleState,
)

if TYPE_CHECKING:
    from mission_service.runtime.run_context import RunContext


class Topic(NamedTuple):
    """A topic; ``{}`` stands for the name of a vehicle or command."""

    path: str
    carries: type[msgspec.Struct] | str  # the Struct of the messages, or the name of a schema
    qos: int
    retained: bool
    when: str  # time of publication, for docs/mqtt.md
    part: str = ""  # name of a part of the state view
    # Returns the current message for the name of a vehicle.
    build: Callable[["RunContext", str], Any] | None = None

    @property
    def schema(self) -> str:
        """The name and version of the schema of the topic's messages."""
        if isinstance(self.carries, str):
            return self.carries
        return str(self.carries.__struct_config__.tag)


STATUS = Topic(
    "status",
    ServiceStatus,
    1,
    True,
    "at each connection and when `not_ready` changes; last will and farewell with `online` false",
)
TELEMETRY = Topic(
    "vehicle/{}/telemetry",
    TelemetryState,
    0,
    False,
    "on change, at most `telemetry_hz` times a second",
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
    "fire/front", "front/1", 0, True, "every 10 s, and within 2 s after a correction of the fire"
)
AIRSPACE = Topic(
    "airspace",
    AirspaceStatus,
    0,
    True,
    "the closed volumes, on change",
    "airspace",
    lambda context, name: context.airspace(),
)
ALARM = Topic(
    "alarm",
    Alarms,
    0,
    True,
    "all active alarms, on change, at most twice a second",
    "alarms",
    lambda context, name: Alarms(
        context.state_view.at_us, tuple(context.state_view.alarms.values())
    ),
)
AIRCRAFT = Topic(
    "aircraft",
    Aircraft,
    0,
    False,
    "other aircraft near the vehicles, on change, at most twice a second",
    "aircraft",
    lambda context, name: Aircraft(context.state_view.at_us, tuple(context.state_view.aircraft())),
)
FIRE_ARRIVALS = Topic(
    "fire/arrivals",
    FireArrivals,
    0,
    False,
    "with `[service.fire_arrival]` only: times at which the fire reaches people and values at risk",
    "fire_arrivals",
    lambda context, name: FireArrivals(context.state_view.at_us, tuple(context.arrivals)),
)
REPLAY = Topic(
    "replay",
    ReplayState,
    0,
    True,
    "in replays only: position and speed, on change, at most twice a second",
    build=lambda context, name: context.replay and context.replay(),
)
EVENT = Topic("event", Announcement, 1, False, "each announcement")
COMMAND = Topic("cmd/{}", "command/1", 1, False, "sent by clients; reply on `cmd/NAME/reply`")
REPLY = Topic("cmd/{}/reply", Reply, 1, False, "each command received, once")
TOPICS = (
    STATUS,
    TELEMETRY,
    VEHICLE,
    MISSION,
    FRONT,
    AIRSPACE,
    ALARM,
    AIRCRAFT,
    FIRE_ARRIVALS,
    REPLAY,
    EVENT,
    COMMAND,
    REPLY,
)
PARTS = {topic.part: topic for topic in TOPICS if topic.part}
POLLED = tuple(topic for topic in TOPICS if topic.build and not topic.part)
