"""Parameters of one autopilot, sans-IO: read one, read all, set one (MAVLink parameter protocol).

read one: requested --PARAM_VALUE of that name--> ended; repeated on timeout
read all: listed --PARAM_VALUE ...-- quiet --> missing indexes requested, some at a time --> ended
set: sent --PARAM_VALUE of that name--> ended; sent again on timeout

A value travels in a float: PX4 puts the bytes of an int32 there, ArduPilot converts the number.
Neither answers to an unknown name.
"""

import math
import struct
from dataclasses import dataclass
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import TransferTiming

LONGEST_NAME = 16
QUIET_US = 1_000_000  # a list of parameters that pauses for so long has ended or lost some
FIRST_WAIT_US = 5_000_000  # ArduPilot counts its parameters before it sends the first
MISSING_AT_A_TIME = 10
REAL32 = mavlink.MAV_PARAM_TYPE_REAL32
_FORMATS = {
    mavlink.MAV_PARAM_TYPE_UINT8: "B",
    mavlink.MAV_PARAM_TYPE_INT8: "b",
    mavlink.MAV_PARAM_TYPE_UINT16: "H",
    mavlink.MAV_PARAM_TYPE_INT16: "h",
    mavlink.MAV_PARAM_TYPE_UINT32: "I",
    mavlink.MAV_PARAM_TYPE_INT32: "i",
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter as the autopilot reported it; ``kind`` is its MAV_PARAM_TYPE."""

    name: str
    value: float
    kind: int


@dataclass(frozen=True, slots=True)
class ParametersResult:
    """A result. ``rejected``: the autopilot kept another value. ``failed``: no answer."""

    outcome: Literal["accepted", "rejected", "failed", "cancelled"]
    reason: str
    parameters: tuple[Parameter, ...] = ()


def decoded_value(wire: float, kind: int, bytewise: bool) -> float:
    """Return the number in a PARAM_VALUE."""
    if not bytewise or kind not in _FORMATS:
        return wire
    code = _FORMATS[kind]
    value: int = struct.unpack_from(f"<{code}", struct.pack("<f", wire))[0]
    return float(value)


def encoded_value(value: float, kind: int, bytewise: bool) -> float:
    """Return the float to put into a PARAM_SET. Raises BridgeError if the type cannot hold the value."""
    if kind not in _FORMATS:
        return value
    code = _FORMATS[kind]
    try:
        if value != int(value):
            raise ValueError
        whole = struct.pack(f"<{code}", int(value))
    except (ValueError, OverflowError, struct.error):
        bits = struct.calcsize(code) * 8
        sort = "unsigned whole" if code.isupper() else "whole"
        raise BridgeError(f"{value} is not a {sort} number of {bits} bits") from None
    if not bytewise:
        return float(int(value))
    wire: float = struct.unpack("<f", whole.ljust(4, b"\0"))[0]
    return wire


def checked_name(name: str) -> str:
    """Return the name itself; raises BridgeError if it is not a valid parameter name."""
    if not (0 < len(name) <= LONGEST_NAME and name.isascii() and name.isprintable()):
        raise BridgeError(f"{name!r} is no parameter name; they have 1 to 16 ASCII characters")
    return name


def parameter_of(message: Message, bytewise: bool) -> Parameter:
    """Return the parameter in a PARAM_VALUE."""
    kind = message.param_type
    return Parameter(message.param_id, decoded_value(message.param_value, kind, bytewise), kind)


class _ParameterExchange:
    """Common parts of reading and setting: source of messages, deadline, tries, result."""

    def __init__(self, target: tuple[int, int], bytewise: bool, timing: TransferTiming) -> None:
        self.result: ParametersResult | None = None
        self._target = target
        self._bytewise = bytewise
        self._timing = timing
        self._deadline_us = 0
        self._tries = 0

    def next_timer(self) -> int:
        """Return time of the next ``handle_timer`` call."""
        return self._deadline_us

    def cancel(self) -> None:
        """End the exchange; the autopilot holds no state that must be ended."""
        if self.result is None:
            self.result = ParametersResult("cancelled", "cancelled")

    def _concerns(self, message: Message) -> bool:
        source = (message.get_srcSystem(), message.get_srcComponent())
        is_value = message.get_type() == "PARAM_VALUE" and source == self._target
        return is_value and self.result is None

    def _again(self, message: Message, now_us: int) -> list[Message]:
        self._deadline_us = now_us + self._timing.timeout_us
        return [message]

    def _no_more(self, now_us: int) -> bool:
        """Count a try; returns whether it was the last one."""
        self._tries += 1
        return self._tries > self._timing.retries


class ParameterRead(_ParameterExchange):
    """Reads one parameter by name."""

    def __init__(
        self, target: tuple[int, int], name: str, bytewise: bool, timing: TransferTiming
    ) -> None:
        super().__init__(target, bytewise, timing)
        self._name = checked_name(name)

    def start(self, now_us: int) -> list[Message]:
        """Request the parameter."""
        name = self._name.encode()
        return self._again(
            mavlink.MAVLink_param_request_read_message(*self._target, name, -1), now_us
        )

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a PARAM_VALUE."""
        if self._concerns(message) and message.param_id == self._name:
            read = parameter_of(message, self._bytewise)
            if math.isfinite(read.value):
                self.result = ParametersResult("accepted", "accepted", (read,))
            else:
                self.result = _no_number(read)
        return []

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the request, or fail after the last retry."""
        if self.result is not None or now_us < self._deadline_us:
            return []
        if not self._no_more(now_us):
            return self.start(now_us)
        words = f"no answer for parameter {self._name}; does the autopilot have it?"
        self.result = ParametersResult("failed", words)
        return []


class ParameterSet(_ParameterExchange):
    """Sets one parameter: reads its type, sends the value, and waits until it is reported."""

    def __init__(
        self,
        target: tuple[int, int],
        name: str,
        value: float,
        bytewise: bool,
        timing: TransferTiming,
    ) -> None:
        super().__init__(target, bytewise, timing)
        self._name = checked_name(name)
        if not math.isfinite(value):
            raise BridgeError(f"parameter {name}: {value} is no number to set")
        self._value = value
        self._kind: int | None = None
        self._told: Parameter | None = None  # a finite number

    def start(self, now_us: int) -> list[Message]:
        """Request the parameter's type, in which the value has to be sent."""
        name = self._name.encode()
        if self._kind is None:
            ask = mavlink.MAVLink_param_request_read_message(*self._target, name, -1)
            return self._again(ask, now_us)
        wire = encoded_value(self._value, self._kind, self._bytewise)
        sets = mavlink.MAVLink_param_set_message(*self._target, name, wire, self._kind)
        return self._again(sets, now_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a PARAM_VALUE: first the type, later the value set."""
        if not self._concerns(message) or message.param_id != self._name:
            return []
        told = parameter_of(message, self._bytewise)
        if not math.isfinite(told.value):
            self.result = _no_number(told)
            return []
        self._told = told
        if self._kind is None:
            self._kind, self._tries = message.param_type, 0
            try:
                return self.start(now_us)
            except BridgeError as error:
                words = f"parameter {self._name}: {error}"
                self.result = ParametersResult("rejected", words, (self._told,))
                return []
        if _same(self._told.value, self._value):
            self.result = ParametersResult("accepted", "accepted", (self._told,))
        # Another value may be a late answer to the question for the type; a timeout settles it.
        return []

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the message, or fail after the last retry."""
        if self.result is not None or now_us < self._deadline_us:
            return []
        if not self._no_more(now_us):
            return self.start(now_us)
        if self._told is None:
            words = f"no answer for parameter {self._name}; does the autopilot have it?"
            self.result = ParametersResult("failed", words)
        else:
            words = f"the autopilot keeps {self._name} at {self._told.value:g}"
            self.result = ParametersResult("rejected", words, (self._told,))
        return []


def _no_number(told: Parameter) -> ParametersResult:
    words = f"the autopilot sent {told.value} for parameter {told.name}: not a finite number"
    return ParametersResult("failed", words)


def _same(told: float, wanted: float) -> bool:
    """Equal in single precision."""
    return abs(told - wanted) <= 1e-6 * max(abs(wanted), 1e-6)


class ParametersRead(_ParameterExchange):
    """Reads all parameters: the list, then its missing indexes; NaN values are left out."""

    def __init__(self, target: tuple[int, int], bytewise: bool, timing: TransferTiming) -> None:
        super().__init__(target, bytewise, timing)
        self._count: int | None = None
        self._found: dict[int, Parameter] = {}
        self._asked: set[int] = set()  # one by one, not answered yet

    def start(self, now_us: int) -> list[Message]:
        """Request the list."""
        self._deadline_us = now_us + FIRST_WAIT_US
        return [mavlink.MAVLink_param_request_list_message(*self._target)]

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a PARAM_VALUE; index 65535 (PX4's hash) is not part of the list."""
        if not self._concerns(message) or message.param_index >= message.param_count:
            return []
        if message.param_index not in self._found:
            self._tries = 0
        self._count = message.param_count
        self._found[message.param_index] = parameter_of(message, self._bytewise)
        self._deadline_us = now_us + QUIET_US
        if len(self._found) == self._count:
            self._end("accepted", "accepted")
        elif message.param_index in self._asked:
            self._asked.discard(message.param_index)
            return [] if self._asked else self._request_missing(now_us)
        return []

    def _request_missing(self, now_us: int) -> list[Message]:
        assert self._count is not None
        self._deadline_us = now_us + QUIET_US
        missing = [index for index in range(self._count) if index not in self._found]
        self._asked = set(missing[:MISSING_AT_A_TIME])
        return [
            mavlink.MAVLink_param_request_read_message(*self._target, b"", index)
            for index in missing[:MISSING_AT_A_TIME]
        ]

    def _end(self, outcome: Literal["accepted", "failed"], reason: str) -> None:
        told = (self._found[index] for index in sorted(self._found))
        found = tuple(parameter for parameter in told if math.isfinite(parameter.value))
        self.result = ParametersResult(outcome, reason, found)

    def handle_timer(self, now_us: int) -> list[Message]:
        """Request the list again, or its missing indexes."""
        if self.result is not None or now_us < self._deadline_us:
            return []
        if self._no_more(now_us):
            all_of_them = "any" if self._count is None else f"all {self._count}"
            words = f"{len(self._found)} parameters came, not {all_of_them}"
            self._end("failed", words if self._found else "the autopilot reports no parameters")
            return []
        if self._count is None:
            return self.start(now_us)
        return self._request_missing(now_us)
