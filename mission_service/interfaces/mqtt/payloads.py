"""Messages over MQTT besides the states of the state view: flat JSON, units in keys."""

from typing import Annotated

import msgspec
from msgspec import Meta

from mission_service.runtime.published_states import Alarm

# Python's $ also matches before a line break at the end.
PRINTED = r"^[^\x00-\x1f\x7f-\x9f]*$(?!\n)"
CommandId = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"^[!-~]+$(?!\n)")]
OperatorName = Annotated[str, Meta(min_length=1, max_length=70, pattern=PRINTED)]


class ServiceStatus(msgspec.Struct, tag="status/1", tag_field="schema"):
    """Whether the service runs, and with which scenario.

    If the connection is lost, the broker publishes a status with ``online`` false; its times are
    those of the connection's start.
    """

    at_us: int
    time_unix_us: int
    online: bool
    scenario: str
    rule: str
    vehicles: tuple[str, ...]
    not_ready: tuple[str, ...] = ()
    commands: bool = False  # whether commands are accepted over MQTT
    why: str = ""  # reason why it is not online
    replay: bool = False  # it replays a logged flight; nothing is flown now


class Alarms(msgspec.Struct, tag="alarms/1", tag_field="schema"):
    """All active alarms."""

    at_us: int
    alarms: tuple[Alarm, ...]


class Command(msgspec.Struct, tag="command/1", tag_field="schema"):
    """The keys of every command. Further keys are those of its request; others are refused."""

    id: CommandId  # set by the sender, repeated in the reply; carried out only once
    by: OperatorName
    sent_at_unix_us: Annotated[int, Meta(ge=0)]
    station: Annotated[str, Meta(max_length=70, pattern=PRINTED)] = ""


class Reply(msgspec.Struct, tag="reply/1", tag_field="schema"):
    """The reply to a command with its ``id``: whether it was carried out, else why not."""

    id: str | None  # None if it could not be read
    command: str
    at_us: int
    ok: bool
    error: str = ""
    event: str = ""  # type of its event in the journal
    messages: tuple[str, ...] = ()
    confirm: bool = False  # not carried out: send it again with ``confirmed``
    again: bool = False  # a repeated reply: it was not carried out again
