"""Sends sequences of commands using the MAVLink command protocol (COMMAND_LONG and COMMAND_INT).

sent --ACK accepted--> next step; sent --ACK in progress--> working; sent --ACK rejected--> ended
sent --ACK on receipt--> received
received --ACK accepted--> next step; received --ACK rejected--> ended
received --no ACK in time--> sent again; the second time--> next step
sent: the command is repeated on timeout
working: the command was accepted and is not repeated; its completion may be reported late or never
"""

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import command_name
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import TransferTiming, is_for
from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.parameters import ParameterSet
from autopilot_bridge.vehicle.sent_commands import ANSWERED_WITHIN_US, SentCommands

RESULTS = {
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "temporarily rejected",
    mavlink.MAV_RESULT_DENIED: "denied",
    mavlink.MAV_RESULT_UNSUPPORTED: "not supported",
    mavlink.MAV_RESULT_FAILED: "failed",
    6: "cancelled",  # this and the following results are not in this dialect
    7: "accepted as COMMAND_LONG only",
    8: "accepted as COMMAND_INT only",
    9: "not supported in this frame",
    10: "denied: another station is in control",
}


def result_words(result: int) -> str:
    """Return a MAV_RESULT in words."""
    return RESULTS.get(result, f"MAV_RESULT {result}")


MAX_LOST_RESULTS = 2
RESULT_AFTER_RECEIPT_US = 500_000  # longest wait for the second acknowledgement of a command
# The reason for a rejection may arrive later as a text (ArduPilot queues its texts).
TEXT_AFTER_US = 300_000
WORKING_FOR_US = 60_000_000
HEARTBEAT_US = 1_200_000  # time within which a HEARTBEAT arrives
WARNING = mavlink.MAV_SEVERITY_WARNING
TAKEN = (int(mavlink.MAV_RESULT_ACCEPTED), int(mavlink.MAV_RESULT_IN_PROGRESS))


@dataclass(frozen=True, slots=True)
class SetParameter:
    """A step that sets a parameter."""

    name: str
    value: float


AnyStep = Step | SetParameter


def command_message(target: tuple[int, int], step: Step, tries: int) -> Message:
    """Return a step as a COMMAND_INT if the step has a position, otherwise as a COMMAND_LONG."""
    command, params, place = step
    if place is None:
        values = [*params, *[0.0] * (7 - len(params))]
        return mavlink.MAVLink_command_long_message(*target, command, tries, *values)
    frame, x, y, z = place
    values = [*params, *[0.0] * (4 - len(params))]
    return mavlink.MAVLink_command_int_message(*target, frame, command, 0, 0, *values, x, y, z)


class CommandSequence:
    """A sequence of steps that are sent one after another.

    A step is sent when the previous one has been accepted, and is sent again if no reply arrives in
    time. Repetition is harmless: each step commands a state or a position, never a change. When the
    last step is accepted, or any step is rejected, ``outcome`` becomes the pair (accepted, reason).
    The reason for a rejection includes the autopilot's last warning text.

    If frames with the same command were sent before a step and may still be acknowledged, no
    acknowledgement is used until ``ANSWERED_WITHIN_US`` have passed; the step is sent again
    meanwhile. If a step is acknowledged on receipt, its second acknowledgement contains the result.
    If none arrives within ``RESULT_AFTER_RECEIPT_US``, the step is repeated once; if none arrives
    again, it counts as accepted, because another version may send only one acknowledgement.
    """

    def __init__(
        self,
        name: str,
        target: tuple[int, int],
        steps: tuple[AnyStep, ...],
        timing: TransferTiming,
        sent: SentCommands,
        stack: Stack,
        after_heartbeats: bool = False,
        without_heartbeats: bool = False,
    ) -> None:
        """Create the sequence.

        With ``after_heartbeats``, a command is repeated only right after a HEARTBEAT, because the
        HEARTBEAT shows whether the autopilot has changed the mode in the meantime. With
        ``without_heartbeats``, the command is also repeated while no HEARTBEAT arrives.
        """
        self.name = name
        self.outcome: tuple[bool, str] | None = None
        self._target = target
        self._steps = steps
        self._timing = timing
        self._sent = sent
        self._doubtful_until_us = 0  # until when earlier frames may be acknowledged
        self._stack = stack
        self._after_heartbeats = after_heartbeats
        self._without_heartbeats = without_heartbeats
        self._repeats = False  # whether to repeat the command after the next heartbeat
        self._index = 0
        self._tries = 0
        self._deadline_us = 0
        self._working = False
        self._is_received = False  # the step was acknowledged, and its result is still to come
        self._lost_results = 0  # how often no result followed
        self._setting: ParameterSet | None = None
        self._refusal: str | None = None
        self._text = ""

    @property
    def steps(self) -> tuple[AnyStep, ...]:
        """The steps of the sequence."""
        return self._steps

    def start(self, now_us: int) -> list[Message]:
        """Return the messages of the first step."""
        if not self._steps:
            self.outcome = (True, "nothing to do")
            return []
        return self._begin(now_us)

    def _begin(self, now_us: int) -> list[Message]:
        step = self._steps[self._index]
        self._tries, self._working, self._repeats = 0, False, False
        self._is_received, self._lost_results = False, 0
        if isinstance(step, Step):
            self._setting = None
            is_doubtful = self._sent.may_be_acknowledged(step.command, now_us)
            self._doubtful_until_us = now_us + ANSWERED_WITHIN_US if is_doubtful else 0
            return self._send(step, now_us)
        self._setting = ParameterSet(
            self._target, step.name, step.value, self._stack.bytewise, self._timing
        )
        messages = self._setting.start(now_us)
        self._deadline_us = self._setting.next_timer()
        return messages

    def _send(self, step: Step, now_us: int) -> list[Message]:
        self._deadline_us = now_us + self._timing.timeout_us
        return [command_message(self._target, step, self._tries)]

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process an acknowledgement, a text or a parameter."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source != self._target or self.outcome is not None:
            return []
        kind = message.get_type()
        if kind == "HEARTBEAT" and self._repeats:
            self._repeats = False
            step = self._steps[self._index]
            return self._send(step, now_us) if isinstance(step, Step) else []
        if kind == "STATUSTEXT" and message.severity <= WARNING:
            self._text = message.text.strip()
            if self._refusal is not None:
                self._end_refused()
        elif self._refusal is None and self._setting is not None:
            messages = self._setting.receive(message, now_us)
            return messages + self._after_setting(now_us)
        elif self._refusal is None and kind == "COMMAND_ACK":
            return self._acknowledged(message, now_us)
        return []

    def _after_setting(self, now_us: int) -> list[Message]:
        assert self._setting is not None
        self._deadline_us = self._setting.next_timer()
        result = self._setting.result
        if result is None:
            return []
        if result.outcome != "accepted":
            self.outcome = (False, result.reason)
            return []
        return self._next(now_us)

    def _acknowledged(self, message: Message, now_us: int) -> list[Message]:
        step = self._steps[self._index]
        assert isinstance(step, Step)
        if not is_for(message, self._sent.own) or message.command != step.command:
            return []
        if now_us < self._doubtful_until_us:
            return []
        self._repeats = False
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            self._working = True
            self._deadline_us = now_us + WORKING_FOR_US
            return []
        if message.result != mavlink.MAV_RESULT_ACCEPTED:
            words = result_words(message.result)
            self._refusal = f"{command_name(step.command)} {words}"
            if self._tries:
                self._refusal += " when it was repeated; it may have been accepted before"
            self._deadline_us = now_us + TEXT_AFTER_US
            if self._text:
                self._end_refused()
            return []
        if self._stack.acks_of(step.command) > 1 and not self._is_received:
            self._is_received = True
            self._deadline_us = now_us + RESULT_AFTER_RECEIPT_US
            return []
        return self._next(now_us)

    def _next(self, now_us: int) -> list[Message]:
        self._index += 1
        if self._index == len(self._steps):
            self.outcome = (True, "accepted")
            return []
        return self._begin(now_us)

    def _end_refused(self) -> None:
        detail = f": {self._text}" if self._text else ""
        self.outcome = (False, f"{self._refusal}{detail}")

    def next_timer(self) -> int:
        """Return the time of the next ``handle_timer`` call."""
        return self._deadline_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the step, or fail after the last retry."""
        if self.outcome is not None or now_us < self._deadline_us:
            return []
        if self._refusal is not None:
            self._end_refused()
            return []
        if self._setting is not None:
            messages = self._setting.handle_timer(now_us)
            return messages + self._after_setting(now_us)
        if self._is_received:
            self._is_received = False
            self._lost_results += 1
            if self._lost_results == MAX_LOST_RESULTS:
                return self._next(now_us)
        step = self._steps[self._index]
        assert isinstance(step, Step)
        if self._repeats and self._without_heartbeats:
            self._repeats = False
            return self._send(step, now_us)
        name = command_name(step.command)
        self._tries += 1
        if self._working:
            limit_s = WORKING_FOR_US // 10**6
            self.outcome = (False, f"{name} began but did not end within {limit_s} s")
        elif self._tries > self._timing.retries:
            self.outcome = (False, f"{name} was not acknowledged")
        elif self._after_heartbeats:
            self._repeats = True
            self._deadline_us = now_us + HEARTBEAT_US
        else:
            return self._send(step, now_us)
        return []
