"""Sends commands to a vehicle through MAVSDK, which repeats each until it is acknowledged."""

import json
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.mavsdk_library import MAVSDK_IDS, library, raw_message
from autopilot_bridge.clients.mavsdk_system import NO_ANSWER, MavsdkSystem
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import is_for
from autopilot_bridge.stacks.stacks import Stack, Step
from autopilot_bridge.vehicle.command_sequence import (
    RESULT_AFTER_RECEIPT_US,
    TAKEN,
    command_message,
    result_words,
)
from autopilot_bridge.vehicle.commanded_modes import CommandedModes, modes_of_step
from autopilot_bridge.vehicle.mode_change import changed_meanwhile
from autopilot_bridge.vehicle.monitor import VehicleMonitor

REPLY_TIMEOUT_S = 1.5
NOT_REPORTED = "no HEARTBEAT reported the new mode"


class MavsdkCommands:
    """Sends commands to one vehicle until the autopilot or a pilot changes the mode.

    ``overrides`` contains descriptions of the mode changes that were not commanded.
    """

    def __init__(
        self,
        system: MavsdkSystem,
        monitor: VehicleMonitor,
        target: tuple[int, int],
        clock: Callable[[], int],
    ) -> None:
        self.overrides: list[str] = []
        self._system = system
        self._monitor = monitor
        self._target = target
        self._clock = clock
        self._modes = CommandedModes()
        self._heartbeats = 0
        self._refused: dict[int, int] = {}  # by command: the last result that refused it

    def receive(self, message: Message) -> None:
        """Count the heartbeats of the vehicle, and record the commands that it refuses."""
        kind = message.get_type()
        self._heartbeats += kind == "HEARTBEAT"
        if kind == "COMMAND_ACK" and is_for(message, MAVSDK_IDS) and message.result not in TAKEN:
            self._refused[message.command] = message.result

    def mode_changed(self, stack: Stack, mode: int, now_us: int) -> str | None:
        """Process a mode change; return a description if it was not commanded, else None."""
        if self._modes.has(mode, now_us):
            return None
        self.overrides.append(changed_meanwhile(stack, mode))
        return self.overrides[-1]

    async def send_steps(self, steps: tuple[Step, ...], stack: Stack) -> tuple[bool, str]:
        """Send commands in sequence until a command is refused; MAVSDK repeats each command.

        No command is sent after a failsafe or after a pilot has taken control.
        """
        overrides = len(self.overrides)
        for step in steps:
            if len(self.overrides) > overrides:
                return False, self.overrides[-1]
            refusal = await self._send_step(step, stack, overrides, is_last=step is steps[-1])
            if refusal:
                return False, refusal
        return True, "accepted"

    async def _send_step(self, step: Step, stack: Stack, overrides: int, is_last: bool) -> str:
        """Send a command, and return the reason why it was refused; "" if it was accepted.

        If PX4 reports neither a refusal nor the new mode, the last step counts as accepted after
        ``RESULT_AFTER_RECEIPT_US``, so that the next command is not delayed; another step is
        refused, because a command follows that requires the mode.
        """
        modes, command = modes_of_step(step, stack), step.command
        self._modes.expect(modes, self._clock())
        self._refused.pop(command, None)
        request = command_message(self._target, step, 0)
        try:
            ack = await self._system.call(
                self._system.direct.send_command(raw_message(request, self._target))
            )
        except library().direct.MavlinkDirectError as error:
            return f"command {command}: no acknowledgement ({error.result.name})"
        except TimeoutError:
            return f"command {command}: no acknowledgement ({NO_ANSWER})"
        result = json.loads(ack.fields_json)["result"]
        if result != mavlink.MAV_RESULT_ACCEPTED:
            return f"command {command} {result_words(result)}"
        if stack.acks_of(command) == 1:
            return ""
        # MAVSDK returns the acknowledgement of the receipt, not that of the result.
        heartbeats = self._heartbeats
        await self._system.until(
            lambda: (
                command in self._refused
                or len(self.overrides) > overrides
                or (self._heartbeats > heartbeats and self._monitor.custom_mode in modes)
            ),
            RESULT_AFTER_RECEIPT_US / 1e6 if is_last else 2 * REPLY_TIMEOUT_S,
        )
        if command in self._refused:
            return f"command {command} {result_words(self._refused[command])}"
        if len(self.overrides) > overrides:
            return self.overrides[-1]
        return "" if is_last or self._monitor.custom_mode in modes else NOT_REPORTED

    async def change_mode(self, stack: Stack, before: int, custom_mode: int) -> tuple[bool, str]:
        """Change the mode right after a heartbeat, and only if the mode is still ``before``."""
        heartbeats = self._heartbeats
        await self._system.until(lambda: self._heartbeats > heartbeats, 2 * REPLY_TIMEOUT_S)
        if self._monitor.custom_mode != before:
            return False, changed_meanwhile(stack, self._monitor.custom_mode)
        accepted, reason = await self.send_steps((stack.set_mode(custom_mode),), stack)
        if not accepted:
            return False, reason
        changed = await self._system.until(
            lambda: self._monitor.custom_mode == custom_mode, 2 * REPLY_TIMEOUT_S
        )
        return changed, "accepted" if changed else NOT_REPORTED
