"""Defines the MQTT messages that are not states in the state view.

The messages are flat JSON with units in the keys.
"""

from typing import Annotated

import msgspec
from msgspec import Meta

from mission_service.fire_arrival.arrival_times import FireArrival
from mission_service.requests import PRINTED, VISIBLE
from mission_service.runtime.published_states import Alarm, NearbyAircraft

CommandId = Annotated[str, Meta(min_length=1, max_length=80, pattern=VISIBLE)]
OperatorName = Annotated[str, Meta(min_length=1, max_length=70, pattern=PRINTED)]


class ServiceStatus(msgspec.Struct, tag="status/1", tag_field="schema"):
    """State of the service: whether it runs, and its scenario.

    If the connection is lost, the broker publishes a status with ``online`` false; its times are
    from the start of the connection.
    """

    at_us: int
    time_unix_us: int
    online: bool
    scenario: str
    rule: str
    vehicles: tuple[str, ...]
    not_ready: tuple[str, ...] = ()
    commands: bool = False  # whether the service accepts commands over MQTT
    why: str = ""  # the reason for ``online`` false
    replay: bool = False  # the service replays a logged flight; no vehicle flies


class Alarms(msgspec.Struct, tag="alarms/1", tag_field="schema"):
    """All active alarms."""

    at_us: int
    alarms: tuple[Alarm, ...]


class Aircraft(msgspec.Struct, tag="nearby/1", tag_field="schema"):
    """All other aircraft near the vehicles."""

    at_us: int
    aircraft: tuple[NearbyAircraft, ...]


class FireArrivals(msgspec.Struct, tag="fire_arrivals/1", tag_field="schema"):
    """When the fire reaches people and values at risk, the earliest first."""

    at_us: int
    arrivals: tuple[FireArrival, ...]


class Command(msgspec.Struct, tag="command/1", tag_field="schema"):
    """The keys of every command. A command also has the keys of its request and no others."""

    id: CommandId  # set by the sender and copied to the reply; a repeated id has no effect
    by: OperatorName
    sent_at_unix_us: Annotated[int, Meta(ge=0)]
    station: Annotated[str, Meta(max_length=70, pattern=PRINTED)] = ""


class Reply(msgspec.Struct, tag="reply/1", tag_field="schema"):
    """The reply to a command: its ``id``, and whether the command was carried out."""

    id: str | None  # None if the command has no valid id
    command: str
    at_us: int
    ok: bool
    error: str = ""  # the reason for ``ok`` false
    event: str = ""  # type of the command's event in the journal
    messages: tuple[str, ...] = ()
    confirm: bool = False  # not carried out: the sender must repeat it with ``confirmed``
    again: bool = False  # reply to a repeated command, which was not carried out again
