"""Changes the flight mode as part of a transfer.

waiting --HEARTBEAT in the mode to be left--> sent --HEARTBEAT in the new mode--> ended
sent --COMMAND_ACK with an error--> ended
any --HEARTBEAT in another mode--> ended: the autopilot or a pilot has taken over

The command is sent right after a heartbeat. The command is repeated (its acknowledgement may be
lost) only after another heartbeat. A mode that the autopilot selects in the meantime is therefore
detected and not overridden.
"""

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import (
    Address,
    Exchange,
    TransferResult,
    TransferTiming,
    is_for,
)
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.command_sequence import TAKEN, command_message, result_words


def changed_meanwhile(stack: Stack, custom_mode: int) -> str:
    """Return the reason for ending an operation after the autopilot or a pilot changed the mode."""
    return f"the autopilot changed to {stack.mode_name(custom_mode)} in the meantime"


class ModeChange(Exchange):
    """A mode change, made only from the mode ``before``; a HEARTBEAT must confirm the new mode."""

    def __init__(
        self,
        address: Address,
        stack: Stack,
        before: int,
        new_mode: int,
        timing: TransferTiming,
    ) -> None:
        super().__init__(address, timing)
        self.new_mode = new_mode
        self._stack = stack
        self._before = before
        self._step = stack.set_mode(new_mode)
        self._tries = 0
        self._again_us = 0

    def start(self, now_us: int) -> list[Message]:
        """Start waiting for a heartbeat; return no messages."""
        self._again_us = now_us
        self._deadline_us = now_us + self._timing.timeout_us * (self._timing.retries + 1)
        return []

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a heartbeat or acknowledgement; the new mode or a rejection ends the exchange."""
        if not self._is_from_target(message):
            return []
        kind = message.get_type()
        if kind == "HEARTBEAT":
            return self._heartbeat(message.custom_mode, now_us)
        if kind != "COMMAND_ACK" or not is_for(message, self._address.own):
            return []
        refused = message.result not in TAKEN
        if refused and message.command == self._step.command and self._tries:
            words = result_words(message.result)
            self.result = TransferResult("rejected", f"the mode change: {words}")
        return []

    def _heartbeat(self, custom_mode: int, now_us: int) -> list[Message]:
        if self.result is not None:
            return []
        if custom_mode == self.new_mode:
            self.result = TransferResult("accepted", "the mode is changed")
        elif custom_mode != self._before:
            self.stop_commands(changed_meanwhile(self._stack, custom_mode))
        elif now_us >= self._again_us:
            self._again_us = now_us + self._timing.timeout_us
            self._tries += 1
            return [command_message(self._address.target, self._step, self._tries - 1)]
        return []

    def stop_commands(self, why: str) -> None:
        """End the mode change, because the autopilot or a pilot has changed the mode."""
        if self.result is None:
            self.result = TransferResult("failed", why)

    def handle_timer(self, now_us: int) -> list[Message]:
        """End the change as failed after the timeout."""
        if self.result is None and now_us >= self._deadline_us:
            self.result = TransferResult("failed", "no HEARTBEAT reported the new mode")
        return []
