"""Sends drops: a release is sent once, immediately and before all other orders, or not at all.

sent --ACK accepted or in progress--> done; --ACK rejected--> refused; --no ACK in time--> unknown
``hold_s`` later the dropper is reset; the reset is repeated until it is acknowledged or the next
object is released

An acknowledgement contains only the number of the command, which is the same for a release and a
reset. Therefore each release and each reset has its own sender component id, and the
acknowledgement is addressed to that id.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import command_name
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.client_events import DropFinished, DropOutcome
from autopilot_bridge.vehicle.command_sequence import TAKEN, command_message, result_words
from autopilot_bridge.vehicle.orders import Dropper, drop

FIRST_COMPONENT = int(mavlink.MAV_COMP_ID_USER1)
# A component id is reused after this number of drops, because ArduPilot stores the signing
# timestamps of only 16 streams (system, component, link).
PULSES_APART = 4
RESET_INTERVAL_US = 50_000  # a dropper that has not been reset cannot release another object
MAX_RESETS = 40
# PX4's gripper acknowledges a release with ``CANCELLED`` if the reset arrives during the release,
# and with ``ALREADY_DOING_IT`` if a link has duplicated the command. In both cases the object may
# have been released.
CANCELLED = 6
ALREADY_DOING_IT = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)


@dataclass(slots=True)
class _Pulse:
    """One release and its reset; ``pending`` is set until the outcome is reported."""

    drop_id: int
    command: int
    component: int  # component id that sends the release; the next id sends the reset
    released_us: int
    release: Message
    reset_step: Step
    target: tuple[int, int]
    reset_due_us: int
    pending: bool = True
    resets: int = 0
    is_reset: bool = False


class DropSender:
    """The sender of the drops of one vehicle."""

    def __init__(
        self, system_id: int, timing: TransferTiming, report: Callable[[DropFinished], None]
    ) -> None:
        self._system_id = system_id
        self._timeout_us = timing.timeout_us
        self._report = report
        self._last_id = 0
        self._pulses: list[_Pulse] = []

    def drop(
        self,
        stack: Stack,
        dropper: Dropper,
        target: tuple[int, int],
        lost: bool,
        now_us: int,
    ) -> tuple[int, list[Message]]:
        """Return the id of the drop, and the messages of the release, which must be sent at once.

        A drop is refused if the dropper has not been reset or if the link to the vehicle is
        ``lost``. Raises BridgeError if the stack has no command for this dropper.
        """
        release, reset_step = drop(stack, dropper)
        self._last_id += 1
        last = self._pulses[-1] if self._pulses else None
        if lost:
            self._finish(self._last_id, "refused", "the link is lost", now_us)
            return self._last_id, []
        if last is not None and not last.resets:
            ago_s = (now_us - last.released_us) / 1e6
            reason = f"late: the dropper was triggered {ago_s:.2f} s ago and has not been reset yet"
            self._finish(self._last_id, "refused", reason, now_us)
            return self._last_id, []
        component = FIRST_COMPONENT + 2 * (self._last_id % PULSES_APART)
        self._end_earlier(component, now_us)
        message = command_message(target, release, 0)
        message.from_component = component
        due_us = now_us + round(dropper.hold_s * 1e6)
        self._pulses.append(
            _Pulse(
                self._last_id,
                release.command,
                component,
                now_us,
                message,
                reset_step,
                target,
                due_us,
            )
        )
        return self._last_id, [message]

    def _end_earlier(self, component: int, now_us: int) -> None:
        """End the resets of earlier pulses, so that a component id can be used again."""
        for pulse in self._pulses:
            pulse.is_reset = True
            if pulse.component == component and pulse.pending:
                self._end(pulse, "unknown", "not acknowledged before later drops", now_us)
        self._remove_ended()

    def withdraw(self, outgoing: list[Message], reason: str, now_us: int) -> None:
        """Remove the releases that are still in ``outgoing``, and report them as refused."""
        for pulse in self._pulses:
            if any(message is pulse.release for message in outgoing):
                outgoing[:] = [message for message in outgoing if message is not pulse.release]
                pulse.is_reset = True
                self._end(pulse, "refused", reason, now_us)
        self._remove_ended()

    def receive(self, message: Message, now_us: int) -> None:
        """Process an acknowledgement."""
        if message.get_type() != "COMMAND_ACK" or message.target_system != self._system_id:
            return
        for pulse in self._pulses:
            if message.command != pulse.command:
                continue
            if message.target_component == pulse.component and pulse.pending:
                self._acknowledged(pulse, message.result, now_us)
            elif message.target_component == pulse.component + 1:
                pulse.is_reset |= message.result in (*TAKEN, ALREADY_DOING_IT)
        self._remove_ended()

    def _acknowledged(self, pulse: _Pulse, result: int, now_us: int) -> None:
        if result in TAKEN:
            self._end(pulse, "done", "accepted", now_us)
        elif result not in (CANCELLED, ALREADY_DOING_IT):
            words = result_words(result)
            self._end(pulse, "refused", f"{command_name(pulse.command)} {words}", now_us)

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call; None if no action is due."""
        if not self._pulses:
            return None
        timers = [pulse.reset_due_us for pulse in self._pulses if not pulse.is_reset]
        timers += [pulse.released_us + self._timeout_us for pulse in self._pulses if pulse.pending]
        return min(timers, default=None)

    def handle_timer(self, now_us: int) -> list[Message]:
        """Return the resets that are due, and report the releases that were not acknowledged."""
        messages = []
        for pulse in self._pulses:
            if not pulse.is_reset and now_us >= pulse.reset_due_us:
                messages.append(self._reset(pulse, now_us))
            if pulse.pending and now_us >= pulse.released_us + self._timeout_us:
                name = command_name(pulse.command)
                reason = f"{name} was not acknowledged; the object may have been released"
                self._end(pulse, "unknown", reason, now_us)
        self._remove_ended()
        return messages

    def _reset(self, pulse: _Pulse, now_us: int) -> Message:
        message = command_message(pulse.target, pulse.reset_step, min(pulse.resets, 255))
        message.from_component = pulse.component + 1
        pulse.resets += 1
        pulse.reset_due_us = now_us + RESET_INTERVAL_US
        pulse.is_reset = pulse.resets >= MAX_RESETS
        return message

    def _end(self, pulse: _Pulse, outcome: DropOutcome, reason: str, now_us: int) -> None:
        pulse.pending = False
        self._finish(pulse.drop_id, outcome, reason, now_us)

    def _finish(self, drop_id: int, outcome: DropOutcome, reason: str, now_us: int) -> None:
        self._report(DropFinished(now_us, drop_id, outcome, reason))

    def _remove_ended(self) -> None:
        self._pulses = [pulse for pulse in self._pulses if pulse.pending or not pulse.is_reset]
