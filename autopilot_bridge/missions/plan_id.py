"""The opaque id that an autopilot assigns to a list of items, computed from the items.

PX4 1.17 (source: ``mavlink_mission.cpp``, ``crc32_for_mission_item``; observed in simulation)
computes a CRC-32 without inversions, from 0, over frame, command, autocontinue, params 1 to 4, x, y
and z of every item as received in its MISSION_ITEM_INT, 32 bytes each. It includes neither
``current`` nor the mission type, so plans that differ only in the first item to fly have the same
id. A list without items has id 0. PX4 sends the id in MISSION_ACK.opaque_id, in
MISSION_COUNT.opaque_id when a list is read, and in MISSION_CURRENT (once a second, and at once
after a change); the id survives a reboot. The id of a fence loaded from a file on the vehicle is
computed differently. ArduPilot 4.6 has no ids.
"""

import binascii
import struct
from collections.abc import Sequence

from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks.stacks import Stack

_ITEM = struct.Struct("<BHB4fiif")
_INVERTED = 0xFFFFFFFF  # binascii inverts before and after, PX4 does not


def mission_id_of(items: Sequence[MissionItem], stack: Stack) -> int | None:
    """Compute the id of a list uploaded by MISSION_ITEM_INT; None if the stack has no ids.

    ``items`` are the sent items (a mission, a fence or rally points). The result can be compared
    with the id in a message; there 0 is also the value without an id, so it does not prove that the
    list is empty.
    """
    if stack.name != "px4":
        return None
    crc = 0
    for item in items:
        raw = _ITEM.pack(
            item.frame,
            item.command,
            item.autocontinue,
            *(item.param1, item.param2, item.param3, item.param4),
            *(item.x, item.y, item.z),
        )
        crc = binascii.crc32(raw, crc ^ _INVERTED) ^ _INVERTED
    return crc
