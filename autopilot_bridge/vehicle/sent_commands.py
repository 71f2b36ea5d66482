"""Records the sent commands that may still be acknowledged.

A COMMAND_ACK contains only the number of the command. After an order replaces another one with the
same number (most orders of ArduPilot change the mode), or after a command was repeated, an
acknowledgement may therefore belong to an earlier frame.
"""

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions.transfer import is_for
from autopilot_bridge.stacks.stacks import Stack

ANSWERED_WITHIN_US = 3_000_000  # a later acknowledgement is assumed to be lost
COMMANDS = ("COMMAND_LONG", "COMMAND_INT")
MAX_EXPECTED = 32  # acknowledgements of one command; more are not sent within the time above


class SentCommands:
    """The times at which commands were sent that have not been acknowledged, by number.

    A time is recorded once for each expected acknowledgement. ``own`` is this station: its system
    id and component id.
    """

    def __init__(self, own: tuple[int, int]) -> None:
        self.own = own
        self._sent_us: dict[int, deque[int]] = {}

    def sent(self, message: Message, now_us: int, stack: Stack) -> None:
        """Record a message that is sent, if it is a command."""
        if message.get_type() in COMMANDS:
            sent_us = self._sent_us.setdefault(message.command, deque(maxlen=MAX_EXPECTED))
            sent_us.extend([now_us] * stack.acks_of(message.command))

    def receive(self, message: Message, now_us: int) -> None:
        """Record a final COMMAND_ACK for this station, which belongs to the oldest frame."""
        sent_us = self._sent_us.get(message.command)
        is_final = message.result != mavlink.MAV_RESULT_IN_PROGRESS
        if not (sent_us and is_final and is_for(message, self.own)):
            return
        while len(sent_us) > 1 and now_us - sent_us[0] > ANSWERED_WITHIN_US:
            sent_us.popleft()
        sent_us.popleft()

    def may_be_acknowledged(self, command: int, now_us: int) -> bool:
        """Return whether an acknowledgement of a frame sent until now may still arrive."""
        sent_us = self._sent_us.get(command, ())
        return any(now_us - at_us <= ANSWERED_WITHIN_US for at_us in sent_us)
