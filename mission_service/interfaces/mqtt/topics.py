"""All topics of a site; their paths are below ``PREFIX/v1/SITE/``. Pure."""

from typing import NamedTuple


class Topic(NamedTuple):
    """A topic (a name replaces ``{}``), the schema of its messages, and their delivery."""

    path: str
    schema: str
    qos: int
    retained: bool


STATUS = Topic("status", "status/1", 1, True)
TELEMETRY = Topic("vehicle/{}/telemetry", "telemetry/1", 0, False)
VEHICLE = Topic("vehicle/{}/state", "vehicle/1", 0, True)
MISSION = Topic("vehicle/{}/mission", "mission/1", 0, True)
FRONT = Topic("fire/front", "front/1", 0, True)
ALARM = Topic("alarm", "alarms/1", 0, True)
REPLAY = Topic("replay", "replay/1", 0, True)  # only for replays
EVENT = Topic("event", "event/1", 1, False)
COMMAND = Topic("cmd/{}", "command/1", 1, False)
REPLY = Topic("cmd/{}/reply", "reply/1", 1, False)
TOPICS = (STATUS, TELEMETRY, VEHICLE, MISSION, FRONT, ALARM, REPLAY, EVENT, COMMAND, REPLY)
