"""Validates MQTT commands before the service handles them. Pure: times are arguments.

The broker controls which user may publish to which topic, so every command has a separate topic.
The service cannot identify the sender of a command, and therefore refuses every request that
permits drops. The service accepts an abort with any content.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from mission_service.core.request_events import ABORT, ALL_REQUESTS
from mission_service.errors import did_you_mean
from mission_service.interfaces.limits import RateLimiter
from mission_service.interfaces.mqtt.payloads import Command, CommandId, Reply
from mission_service.value_errors import UNKNOWN, in_words

MQTT = "mqtt"  # prefix of the names of operators and stations
MAX_BYTES = 64 * 1024
MAX_NAME = 40
OLD_US = 30_000_000
REMEMBERED_S = 600.0
A_SECOND, AT_ONCE = 10.0, 30.0  # rate limit and burst; commands above the limits get no reply
MAX_REMEMBERED = int(REMEMBERED_S * A_SECOND + AT_ONCE)
ABORTS_APART_S = 0.2  # an abort within this time after another counts as a repetition
TAKEN = tuple(name for name, kind in ALL_REQUESTS.items() if kind.over_mqtt)
_ENVELOPE = ("schema", "id", "sent_at_unix_us")

Ask = Callable[[dict[str, Any]], dict[str, Any]]


class _Named(msgspec.Struct):
    id: CommandId


class _RefusedError(Exception):
    """A command is refused; the text gives the reason."""


@dataclass(slots=True)
class _Answered:
    at_s: float
    digest: bytes
    reply: Reply


class CommandGate:
    """A filter that passes valid commands to the request handler and stores the replies.

    The filter stores ``MAX_REMEMBERED`` replies, as many as the rate limit allows in
    ``REMEMBERED_S``.
    """

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._answered: OrderedDict[tuple[str, str, str], _Answered] = OrderedDict()
        self._rate = RateLimiter(A_SECOND, AT_ONCE)
        self._aborted_s = -ABORTS_APART_S
        self.unanswered = 0

    def accept(
        self, name: str, payload: bytes, retained: bool, at_us: int, now_s: float, unix_us: int
    ) -> Reply | None:
        """Handle the command ``name`` and return the reply, or None.

        There is no reply above the rate limit, nor to a name longer than ``MAX_NAME``: the topic of
        the reply contains the name and could be longer than MQTT permits.
        ``at_us`` is mission time, ``now_s`` a monotonic clock, ``unix_us`` the wall clock.
        """
        if name == ABORT:
            return self._abort(payload, retained, at_us, now_s, unix_us)
        if len(name) > MAX_NAME or self._rate.consume(MQTT, now_s):
            self.unanswered += 1
            return None
        try:
            command, request = _read(payload)
            _refuse_names(name)
            if retained:
                raise _RefusedError(
                    "the message is retained: the broker would send it again at each start"
                )
            _refuse_old(command, unix_us)
            return self._once(name, command, request, payload, at_us, now_s)
        except _RefusedError as problem:
            return Reply(_id_in(payload), name, at_us, False, f"{name}: {problem}")

    def _once(
        self,
        name: str,
        command: Command,
        request: dict[str, Any],
        payload: bytes,
        at_us: int,
        now_s: float,
    ) -> Reply:
        """Handle a command, or return the stored reply if the same command was handled before."""
        while self._answered and next(iter(self._answered.values())).at_s < now_s - REMEMBERED_S:
            self._answered.popitem(last=False)
        key, digest = (name, command.by, command.id), hashlib.sha256(payload).digest()
        before = self._answered.get(key)
        if before is not None:
            if before.digest != digest:
                raise _RefusedError(f"id {command.id} belongs to an earlier command; use a new id")
            return msgspec.structs.replace(before.reply, again=True)
        reply = self._handle(name, command.id, request, at_us)
        self._answered[key] = _Answered(now_s, digest, reply)
        if len(self._answered) > MAX_REMEMBERED:
            self._answered.popitem(last=False)
        return reply

    def _abort(
        self, payload: bytes, retained: bool, at_us: int, now_s: float, unix_us: int
    ) -> Reply:
        """Handle an abort; refuse an old retained abort, which would stop the run at each start."""
        command_id = _id_in(payload)
        try:
            command, request = _read(payload)
        except _RefusedError:
            command, request = None, {}
        if retained and (command is None or abs(unix_us - command.sent_at_unix_us) > OLD_US):
            why = "abort: the message is retained and old; the broker would send it at each start"
            return Reply(command_id, ABORT, at_us, False, why)
        if now_s - self._aborted_s < ABORTS_APART_S:
            return Reply(command_id, ABORT, at_us, True, event="Aborted", again=True)
        self._aborted_s = now_s
        user = {"by": request.get("by", f"{MQTT}:unknown"), "station": request.get("station", MQTT)}
        return self._handle(ABORT, command_id, user, at_us)

    def _handle(
        self, name: str, command_id: str | None, request: dict[str, Any], at_us: int
    ) -> Reply:
        answer = self._ask({**request, "do": name})
        return Reply(
            command_id,
            name,
            at_us,
            answer["ok"],
            answer.get("error", ""),
            answer.get("event", ""),
            tuple(answer.get("messages", ())),
            confirm=answer.get("confirm", False),
        )


def _refuse_names(name: str) -> None:
    if name in ALL_REQUESTS and not ALL_REQUESTS[name].over_mqtt:
        raise _RefusedError(
            "never accepted over MQTT, which identifies no user; use the map or the control socket"
        )
    if name not in TAKEN:
        listed = f"{', '.join(TAKEN)}{did_you_mean(name, TAKEN)}"
        raise _RefusedError(f"unknown command; the commands are {listed}")


def _read(payload: bytes) -> tuple[Command, dict[str, Any]]:
    """Decode a command, and return it with the request for the request handler."""
    if len(payload) > MAX_BYTES:
        raise _RefusedError(f"the message has {len(payload)} bytes; the limit is {MAX_BYTES}")
    found = UNKNOWN
    try:
        found = msgspec.json.decode(payload)
        if isinstance(found, dict):
            found.setdefault("schema", "command/1")
        command = msgspec.convert(found, Command)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _RefusedError(
            f"the message cannot be read: {in_words(error, Command, found)}"
        ) from None
    if "do" in found:
        raise _RefusedError('unknown key "do": the topic contains the command')
    request = {key: value for key, value in found.items() if key not in _ENVELOPE}
    # Without the prefix, a command would count as the presence of an operator at a station that
    # approves plans.
    station = f"{MQTT}:{command.station}" if command.station else MQTT
    return command, {**request, "by": f"{MQTT}:{command.by}", "station": station}


def _id_in(payload: bytes) -> str | None:
    """Return the id in a payload, even of an invalid command, or None if there is none."""
    if len(payload) > MAX_BYTES:
        return None
    try:
        return msgspec.json.decode(payload, type=_Named).id
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def _refuse_old(command: Command, unix_us: int) -> None:
    age_us = unix_us - command.sent_at_unix_us
    if abs(age_us) > OLD_US:
        when = "ago" if age_us > 0 else "in the future"
        raise _RefusedError(
            f"sent_at_unix_us is {abs(age_us) / 1e6:.0f} s {when}; the limit is "
            f"{OLD_US / 1e6:.0f} s: use microseconds since 1970, and check the sender's clock"
        )
