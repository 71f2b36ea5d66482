"""Change of flight mode as part of a transfer, sans-IO.

asked --HEARTBEAT in that mode--> ended; asked --COMMAND_ACK that refuses--> ended
the command is repeated on timeout: its acknowledgement may be lost, the heartbeat tells
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.codec import Message
from autopilot_bridge.command import RESULTS
from autopilot_bridge.download import Asking
from autopilot_bridge.stacks import Stack
from autopilot_bridge.transfer import Address, TransferResult, TransferTiming

TAKEN = (mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_IN_PROGRESS)


class SetMode(Asking):
    """Changes the mode; done when a HEARTBEAT shows it."""

    def __init__(
        self, address: Address, stack: Stack, custom_mode: int, timing: TransferTiming
    ) -> None:
        super().__init__(address, timing)
        self._custom_mode = custom_mode
        self._command, self._params, _ = stack.set_mode(custom_mode)

    def start(self, now_us: int) -> list[Message]:
        """Ask for it."""
        values = [*self._params, *[0.0] * (7 - len(self._params))]
        return self._ask(
            mavlink.MAVLink_command_long_message(*self._address.target, self._command, 0, *values),
            now_us,
        )

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """A heartbeat in the mode ends it, and so does a refusal."""
        if (message.get_srcSystem(), message.get_srcComponent()) != self._address.target:
            return []
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.custom_mode == self._custom_mode:
            self.result = TransferResult("accepted", "the mode is changed")
        refused = kind == "COMMAND_ACK" and message.result not in TAKEN
        if refused and message.command == self._command:
            words = RESULTS.get(message.result, f"MAV_RESULT {message.result}")
            self.result = TransferResult("rejected", f"the change of mode {words}")
        return []
