"""DropSender, sans-IO: a release is sent once, at once, ahead of all other orders, or not at all.

sent --ACK accepted or in progress--> done; --ACK refuses--> refused; --no ACK in time--> unknown
set back ``hold_s`` later, again and again until acknowledged or until the next release

An acknowledgement has only the number of the command, which is the same for release and setting
back. So each release and each setting back is sent from a component id of its own, which its
acknowledgement is addressed to.
"""

from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.client_events import DropFinished, DropOutcome
from autopilot_bridge.vehicle.command_sequence import command_message, command_name, result_words
from autopilot_bridge.vehicle.orders import Dropper, drop

FIRST_COMPONENT = int(mavlink.MAV_COMP_ID_USER1)
# ArduPilot keeps the signatures of 16 streams (system, component, link).
PULSES_APART = 4
BACK_EVERY_US = 50_000  # a dropper that is not set back releases nothing more
MAX_BACKS = 40
TAKEN = (int(mavlink.MAV_RESULT_ACCEPTED), int(mavlink.MAV_RESULT_IN_PROGRESS))
# PX4's gripper answers a release with the former when the setting back arrives, and with the latter
# when a link has doubled it: neither means that nothing fell.
CANCELLED = 6
ALREADY_DOING_IT = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)


@dataclass(slots=True)
class _Pulse:
    """One release and its setting back; ``waits`` is for the outcome."""

    drop_id: int
    command: int
    component: int  # of the release; the next one sets back
    released_us: int
    release: Message
    back: Step
    target: tuple[int, int]
    back_due_us: int
    waits: bool = True
    backs: int = 0
    is_back: bool = False


class DropSender:
    """The drops of one vehicle."""

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
        """Return the drop's id, and the release to send at once; the drop is refused if it would be late.

        ``lost``: the vehicle is silent. Raises BridgeError if the stack has no command for this
        dropper.
        """
        release, back = drop(stack, dropper)
        self._last_id += 1
        last = self._pulses[-1] if self._pulses else None
        if lost:
            self._finish(self._last_id, "refused", "the link is lost", now_us)
            return self._last_id, []
        if last is not None and not last.backs:
            ago_s = (now_us - last.released_us) / 1e6
            reason = f"late: the dropper was set {ago_s:.2f} s ago and is not set back yet"
            self._finish(self._last_id, "refused", reason, now_us)
            return self._last_id, []
        component = FIRST_COMPONENT + 2 * (self._last_id % PULSES_APART)
        self._forget(component, now_us)
        message = command_message(target, release, 0)
        message.from_component = component
        due_us = now_us + round(dropper.hold_s * 1e6)
        self._pulses.append(
            _Pulse(self._last_id, release.command, component, now_us, message, back, target, due_us)
        )
        return self._last_id, [message]

    def _forget(self, component: int, now_us: int) -> None:
        """End the setting back of earlier pulses, and reuse old component ids."""
        for pulse in self._pulses:
            pulse.is_back = True
            if pulse.component == component and pulse.waits:
                self._end(pulse, "unknown", "not acknowledged before others were", now_us)
        self._tidy()

    def withdraw(self, outgoing: list[Message], reason: str, now_us: int) -> None:
        """Withdraw releases that are not sent yet."""
        for pulse in self._pulses:
            if any(message is pulse.release for message in outgoing):
                outgoing[:] = [message for message in outgoing if message is not pulse.release]
                pulse.is_back = True
                self._end(pulse, "refused", reason, now_us)
        self._tidy()

    def receive(self, message: Message, now_us: int) -> None:
        """Process an acknowledgement."""
        if message.get_type() != "COMMAND_ACK" or message.target_system != self._system_id:
            return
        for pulse in self._pulses:
            if message.command != pulse.command:
                continue
            if message.target_component == pulse.component and pulse.waits:
                self._acknowledged(pulse, message.result, now_us)
            elif message.target_component == pulse.component + 1:
                pulse.is_back |= message.result in (*TAKEN, ALREADY_DOING_IT)
        self._tidy()

    def _acknowledged(self, pulse: _Pulse, result: int, now_us: int) -> None:
        if result in TAKEN:
            self._end(pulse, "done", "accepted", now_us)
        elif result not in (CANCELLED, ALREADY_DOING_IT):
            words = result_words(result)
            self._end(pulse, "refused", f"{command_name(pulse.command)} {words}", now_us)

    def next_timer(self) -> int | None:
        """Return time of the next ``handle_timer`` call; None without one."""
        if not self._pulses:
            return None
        timers = [pulse.back_due_us for pulse in self._pulses if not pulse.is_back]
        timers += [pulse.released_us + self._timeout_us for pulse in self._pulses if pulse.waits]
        return min(timers, default=None)

    def handle_timer(self, now_us: int) -> list[Message]:
        """Set back droppers that are due; end overdue waits for an outcome."""
        messages = []
        for pulse in self._pulses:
            if not pulse.is_back and now_us >= pulse.back_due_us:
                messages.append(self._set_back(pulse, now_us))
            if pulse.waits and now_us >= pulse.released_us + self._timeout_us:
                reason = f"{command_name(pulse.command)} was not acknowledged; it may have fallen"
                self._end(pulse, "unknown", reason, now_us)
        self._tidy()
        return messages

    def _set_back(self, pulse: _Pulse, now_us: int) -> Message:
        message = command_message(pulse.target, pulse.back, min(pulse.backs, 255))
        message.from_component = pulse.component + 1
        pulse.backs += 1
        pulse.back_due_us = now_us + BACK_EVERY_US
        pulse.is_back = pulse.backs >= MAX_BACKS
        return message

    def _end(self, pulse: _Pulse, outcome: DropOutcome, reason: str, now_us: int) -> None:
        pulse.waits = False
        self._finish(pulse.drop_id, outcome, reason, now_us)

    def _finish(self, drop_id: int, outcome: DropOutcome, reason: str, now_us: int) -> None:
        self._report(DropFinished(now_us, drop_id, outcome, reason))

    def _tidy(self) -> None:
        self._pulses = [pulse for pulse in self._pulses if pulse.waits or not pulse.is_back]
