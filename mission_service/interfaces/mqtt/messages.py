"""What is told and asked over MQTT beside the states of the picture: flat JSON, units in keys."""

from typing import Annotated

import msgspec
from msgspec import Meta

from mission_service.runtime.published_states import Alarm

# Python's $ would let a line end pass behind the last character.
PRINTED = r"^[^\x00-\x1f\x7f-\x9f]*$(?!\n)"
CommandId = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"^[!-~]+$(?!\n)")]
Who = Annotated[str, Meta(min_length=1, max_length=70, pattern=PRINTED)]


class ServiceStatus(msgspec.Struct, tag="status/1", tag_field="schema"):
    """Whether the service runs, and what; with ``online`` false it is the broker's last word of it.

    Of a service that ended without a farewell, times are those at which it connected.
    """

    at_us: int
    time_unix_us: int
    online: bool
    scenario: str
    rule: str
    vehicles: tuple[str, ...]
    not_ready: tuple[str, ...] = ()
    commands: bool = False  # whether they are taken over MQTT
    why: str = ""  # it is not online
    replay: bool = False  # of a logged flight: nothing of it happens now


class Alarms(msgspec.Struct, tag="alarms/1", tag_field="schema"):
    """All that is wrong now."""

    at_us: int
    alarms: tuple[Alarm, ...]


class Command(msgspec.Struct, tag="command/1", tag_field="schema"):
    """What every command says. Further keys are the request's own; nothing else is taken."""

    id: CommandId  # the sender's own, for the answer; the same one is not done twice
    by: Who
    sent_at_unix_us: Annotated[int, Meta(ge=0)]
    station: Annotated[str, Meta(max_length=70, pattern=PRINTED)] = ""


class Reply(msgspec.Struct, tag="reply/1", tag_field="schema"):
    """What became of a command: its own ``id``, whether it was done, else why not."""

    id: str | None  # none where it could not be read
    command: str
    at_us: int
    ok: bool
    error: str = ""
    event: str = ""  # what it is in the journal
    said: tuple[str, ...] = ()
    confirm: bool = False  # not ordered: send it again with ``confirmed`` if it is meant
    again: bool = False  # answered from memory: it was not done a second time
