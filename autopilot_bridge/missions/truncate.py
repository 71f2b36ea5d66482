"""Removes the last items of a mission that an ArduPilot vehicle is flying.

counted --request for item 0--> invalid item sent --any MISSION_ACK but "busy"--> ended
MISSION_COUNT truncates the list at once. The reply to the request for item 0 contains an unknown
command, so the transfer ends (MISSION_ACK 3) before an item is overwritten. A read-back must check
whether the list was truncated.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message, item_message
from autopilot_bridge.missions.download import RequestRepeater
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming, rejected

UNKNOWN_COMMAND = MissionItem(65535, mavlink.MAV_FRAME_GLOBAL, 0, 0, 0.0)


class Truncate(RequestRepeater):
    """The removal of all items except the first ``count``, where home counts as an item."""

    def __init__(self, address: Address, count: int, timing: TransferTiming) -> None:
        super().__init__(address, timing)
        self._count = count

    def start(self, now_us: int) -> list[Message]:
        """Send MISSION_COUNT with the new length."""
        return self._send_request(
            mavlink.MAVLink_mission_count_message(
                *self._address.target, self._count, self._address.mission_type
            ),
            now_us,
        )

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Reply to the request for item 0; the rejection ends the exchange."""
        kind = message.get_type()
        if kind not in ("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"):
            return []
        if not self._address.concerns(message):
            return []
        if kind != "MISSION_ACK":
            mission_type = self._address.mission_type
            return [item_message(self._address.target, 0, UNKNOWN_COMMAND, 0, mission_type)]
        if message.type == mavlink.MAV_MISSION_DENIED:
            self.result = rejected(message.type, None)
        else:
            self.result = TransferResult("accepted", "cut", message.type)
        return []
