"""The one place where bytes become MAVLink 2 messages and back (pymavlink's generated codec)."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import MissionItem

Message = Any  # pymavlink's messages carry no types


class Codec:
    """Encoder and parser of one end of one link."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._mav.robust_parsing = True

    def encode(self, message: Message) -> bytes:
        """The frame of a message, with the next sequence number."""
        frame: bytes = message.pack(self._mav, force_mavlink1=False)
        self._mav.seq = (self._mav.seq + 1) % 256
        return bytes(frame)

    def decode(self, data: bytes) -> list[Message]:
        """The messages in the data; what is no message is passed over."""
        found = self._mav.parse_buffer(data) or []
        return [message for message in found if message.get_type() != "BAD_DATA"]

    def decode_frames(self, frames: list[bytes]) -> list[Message]:
        """The messages in whole frames, faster than ``decode``."""
        found = []
        for frame in frames:
            try:
                found.append(self._mav.decode(bytearray(frame)))
            except mavlink.MAVError:  # of another dialect
                continue
        return found


def item_message(
    target: tuple[int, int], seq: int, item: MissionItem, current: int, mission_type: int
) -> Message:
    """MISSION_ITEM_INT for one item."""
    return mavlink.MAVLink_mission_item_int_message(
        *target,
        seq,
        item.frame,
        item.command,
        current,
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
        mission_type,
    )


def item_of(message: Message) -> MissionItem:
    """The item a MISSION_ITEM_INT carries."""
    return MissionItem(
        message.command,
        message.frame,
        message.x,
        message.y,
        message.z,
        message.param1,
        message.param2,
        message.param3,
        message.param4,
        message.autocontinue,
    )
