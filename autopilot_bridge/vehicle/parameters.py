"""Reads one or all parameters of an autopilot, or sets one (MAVLink parameter protocol).

read one: requested --PARAM_VALUE of that name--> ended; repeated on timeout
read all: list requested --PARAM_VALUE ... pause--> missing indexes requested, some at a time -->
    ended
set: sent --PARAM_VALUE of that name--> ended; repeated on timeout

A value is sent as a float. PX4 puts the four bytes of an int32 into the float; ArduPilot converts
the number to a float. Neither stack replies to a request with an unknown name.
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
QUIET_US = 1_000_000  # a longer pause means the end of the list or lost messages
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
    """The result of a parameter request.

    ``rejected``: the autopilot kept another value. ``failed``: no valid reply arrived.
    """

    outcome: Literal["accepted", "rejected", "failed", "cancelled"]
    reason: str
    parameters: tuple[Parameter, ...] = ()


def decoded_value(wire: float, kind: int, bytewise: bool) -> float:
    """Return the number that the float of a PARAM_VALUE represents."""
    if not bytewise or kind not in _FORMATS:
        return wire
    code = _FORMATS[kind]
    value: int = struct.unpack_from(f"<{code}", struct.pack("<f", wire))[0]
    return float(value)


def encoded_value(value: float, kind: int, bytewise: bool) -> float:
    """Return the float for a PARAM_SET.

    Raises BridgeError if the value does not fit the type of the parameter.
    """
    if kind not in _FORMATS:
        return value
    code = _FORMATS[kind]
    try:
        if value != int(value):
            raise ValueError
        whole = struct.pack(f"<{code}", int(value))
    except (ValueError, OverflowError, struct.error):
        bits = struct.calcsize(code) * 8
        sign = "an unsigned" if code.isupper() else "a signed"
        raise BridgeError(f"{value} is not {sign} integer of {bits} bits") from None
    if not bytewise:
        return float(int(value))
    wire: float = struct.unpack("<f", whole.ljust(4, b"\0"))[0]
    return wire


def checked_name(name: str) -> str:
    """Return ``name``. Raises BridgeError for an invalid parameter name."""
    if not (0 < len(name) <= LONGEST_NAME and name.isascii() and name.isprintable()):
        raise BridgeError(
            f"{name!r} is not a valid parameter name; use 1 to 16 printable ASCII characters"
        )
    return name


def parameter_of(message: Message, bytewise: bool) -> Parameter:
    """Return the parameter in a PARAM_VALUE."""
    kind = message.param_type
    return Parameter(message.param_id, decoded_value(message.param_value, kind, bytewise), kind)


class _ParameterExchange:
    """The base class of reads and writes: sender, deadline, tries, result."""

    def __init__(self, target: tuple[int, int], bytewise: bool, timing: TransferTiming) -> None:
        self.result: ParametersResult | None = None
        self._target = target
        self._bytewise = bytewise
        self._timing = timing
        self._deadline_us = 0
        self._tries = 0

    def next_timer(self) -> int:
        """Return the time of the next ``handle_timer`` call."""
        return self._deadline_us

    def cancel(self) -> None:
        """End the exchange without a message; the autopilot stores no state of an exchange."""
        if self.result is None:
            self.result = ParametersResult("cancelled", "cancelled")

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the request, or fail after the last retry."""
        if self.result is not None or now_us < self._deadline_us:
            return []
        self._tries += 1
        if self._tries <= self._timing.retries:
            return self._repeat(now_us)
        self.result = self._failure()
        return []

    def _repeat(self, now_us: int) -> list[Message]:
        """Return the request to send again after a timeout."""
        raise NotImplementedError

    def _failure(self) -> ParametersResult:
        """Return the result after the last retry."""
        raise NotImplementedError

    def _concerns(self, message: Message) -> bool:
        source = (message.get_srcSystem(), message.get_srcComponent())
        is_value = message.get_type() == "PARAM_VALUE" and source == self._target
        return is_value and self.result is None

    def _send(self, message: Message, now_us: int) -> list[Message]:
        self._deadline_us = now_us + self._timing.timeout_us
        return [message]


class ParameterRead(_ParameterExchange):
    """A request for one parameter by name."""

    def __init__(
        self, target: tuple[int, int], name: str, bytewise: bool, timing: TransferTiming
    ) -> None:
        super().__init__(target, bytewise, timing)
        self._name = checked_name(name)

    def start(self, now_us: int) -> list[Message]:
        """Request the parameter."""
        name = self._name.encode()
        return self._send(
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

    _repeat = start

    def _failure(self) -> ParametersResult:
        return _no_reply(self._name)


class ParameterSet(_ParameterExchange):
    """A change of one parameter: read the type, send the value, wait for the reported value."""

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
            raise BridgeError(f"parameter {name}: {value} is not a finite number")
        self._value = value
        self._kind: int | None = None
        self._reported: Parameter | None = None  # set only if the reported value is finite

    def start(self, now_us: int) -> list[Message]:
        """Request the parameter's type, or send the value if the type is known."""
        name = self._name.encode()
        if self._kind is None:
            request = mavlink.MAVLink_param_request_read_message(*self._target, name, -1)
            return self._send(request, now_us)
        wire = encoded_value(self._value, self._kind, self._bytewise)
        message = mavlink.MAVLink_param_set_message(*self._target, name, wire, self._kind)
        return self._send(message, now_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a PARAM_VALUE: the first shows the type, a later one the value that was set."""
        if not self._concerns(message) or message.param_id != self._name:
            return []
        reported = parameter_of(message, self._bytewise)
        if not math.isfinite(reported.value):
            self.result = _no_number(reported)
            return []
        self._reported = reported
        if self._kind is None:
            self._kind, self._tries = message.param_type, 0
            try:
                return self.start(now_us)
            except BridgeError as error:
                words = f"parameter {self._name}: {error}"
                self.result = ParametersResult("rejected", words, (self._reported,))
                return []
        if _same(self._reported.value, self._value):
            self.result = ParametersResult("accepted", "accepted", (self._reported,))
        # Another value may be a late reply to the request for the type, so wait for the timeout.
        return []

    _repeat = start

    def _failure(self) -> ParametersResult:
        if self._reported is None:
            return _no_reply(self._name)
        words = f"the autopilot keeps {self._name} at {self._reported.value:g}"
        return ParametersResult("rejected", words, (self._reported,))


def _no_reply(name: str) -> ParametersResult:
    words = f"no reply for parameter {name}; the autopilot may not have it"
    return ParametersResult("failed", words)


def _no_number(reported: Parameter) -> ParametersResult:
    words = (
        f"the autopilot sent {reported.value} for parameter {reported.name}: not a finite number"
    )
    return ParametersResult("failed", words)


def _same(reported: float, requested: float) -> bool:
    """Return whether two values are equal in single precision."""
    return abs(reported - requested) <= 1e-6 * max(abs(requested), 1e-6)


class ParametersRead(_ParameterExchange):
    """A request for all parameters: the list, then missing indexes; NaN values are omitted."""

    def __init__(self, target: tuple[int, int], bytewise: bool, timing: TransferTiming) -> None:
        super().__init__(target, bytewise, timing)
        self._count: int | None = None
        self._parameters: dict[int, Parameter] = {}
        self._requested: set[int] = set()  # missing indexes that are requested one by one

    def start(self, now_us: int) -> list[Message]:
        """Request the list."""
        self._deadline_us = now_us + FIRST_WAIT_US
        return [mavlink.MAVLink_param_request_list_message(*self._target)]

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a PARAM_VALUE; index 65535 (PX4's hash) is not part of the list."""
        if not self._concerns(message) or message.param_index >= message.param_count:
            return []
        if message.param_index not in self._parameters:
            self._tries = 0
        self._count = message.param_count
        self._parameters[message.param_index] = parameter_of(message, self._bytewise)
        self._deadline_us = now_us + QUIET_US
        if len(self._parameters) == self._count:
            self.result = self._ended("accepted", "accepted")
        elif message.param_index in self._requested:
            self._requested.discard(message.param_index)
            return [] if self._requested else self._request_missing(now_us)
        return []

    def _request_missing(self, now_us: int) -> list[Message]:
        assert self._count is not None
        self._deadline_us = now_us + QUIET_US
        missing = [index for index in range(self._count) if index not in self._parameters]
        missing = missing[:MISSING_AT_A_TIME]
        self._requested = set(missing)
        return [
            mavlink.MAVLink_param_request_read_message(*self._target, b"", index)
            for index in missing
        ]

    def _ended(self, outcome: Literal["accepted", "failed"], reason: str) -> ParametersResult:
        reported = (self._parameters[index] for index in sorted(self._parameters))
        found = tuple(parameter for parameter in reported if math.isfinite(parameter.value))
        return ParametersResult(outcome, reason, found)

    def _repeat(self, now_us: int) -> list[Message]:
        """Request the list again, or its missing indexes."""
        return self.start(now_us) if self._count is None else self._request_missing(now_us)

    def _failure(self) -> ParametersResult:
        words = f"{len(self._parameters)} of {self._count} parameters arrived"
        return self._ended(
            "failed", words if self._parameters else "the autopilot reports no parameters"
        )
