"""Commands (COMMAND_LONG), one after another, sans-IO (MAVLink command protocol)."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.codec import Message
from autopilot_bridge.stacks import Step
from autopilot_bridge.transfer import TransferTiming

RESULTS = {
    mavlink.MAV_RESULT_TEMPORARILY_REJECTED: "temporarily rejected",
    mavlink.MAV_RESULT_DENIED: "denied",
    mavlink.MAV_RESULT_UNSUPPORTED: "not supported",
    mavlink.MAV_RESULT_FAILED: "failed",
    6: "cancelled",  # not in this dialect
}


class CommandSequence:
    """Sends steps one by one, each when the one before was accepted; repeats what gets no answer.

    ``outcome`` becomes (accepted, reason) when the last step was accepted or one was refused.
    """

    def __init__(
        self, name: str, target: tuple[int, int], steps: tuple[Step, ...], timing: TransferTiming
    ) -> None:
        self.name = name
        self.outcome: tuple[bool, str] | None = None
        self._target = target
        self._steps = steps
        self._timing = timing
        self._index = 0
        self._tries = 0
        self._deadline_us = 0

    def start(self, now_us: int) -> list[Message]:
        """The first step."""
        return self._send(now_us)

    def _send(self, now_us: int) -> list[Message]:
        self._deadline_us = now_us + self._timing.timeout_us
        command, params = self._steps[self._index]
        values = [*params, *[0.0] * (7 - len(params))]
        return [mavlink.MAVLink_command_long_message(*self._target, command, self._tries, *values)]

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Take in a COMMAND_ACK."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() != "COMMAND_ACK" or source != self._target:
            return []
        command = self._steps[self._index][0]
        if message.command != command:
            return []
        if message.result == mavlink.MAV_RESULT_IN_PROGRESS:
            self._deadline_us = now_us + self._timing.timeout_us
            return []
        if message.result != mavlink.MAV_RESULT_ACCEPTED:
            words = RESULTS.get(message.result, f"MAV_RESULT {message.result}")
            self.outcome = (False, f"command {command} {words}")
            return []
        self._index += 1
        self._tries = 0
        if self._index == len(self._steps):
            self.outcome = (True, "accepted")
            return []
        return self._send(now_us)

    def next_timer(self) -> int:
        """When to call ``handle_timer``."""
        return self._deadline_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the step or give up."""
        if self.outcome is not None or now_us < self._deadline_us:
            return []
        self._tries += 1
        if self._tries > self._timing.retries:
            command = self._steps[self._index][0]
            self.outcome = (False, f"command {command} was not answered")
            return []
        return self._send(now_us)
