"""Computes the opaque id that an autopilot assigns to a list of items.

PX4 1.17 (source: ``mavlink_mission.cpp``, ``crc32_for_mission_item``; observed in simulation)
computes a CRC-32 with the initial value 0 and without inversions. The CRC covers 32 bytes of each
MISSION_ITEM_INT as received: frame, command, autocontinue, params 1 to 4, x, y and z. The CRC does
not cover ``current`` or the mission type, so two plans that differ only in the first item to fly
have the same id. A list without items has id 0. PX4 sends the id in MISSION_ACK.opaque_id, in
MISSION_COUNT.opaque_id when a list is read, and in MISSION_CURRENT (once a second, and at once
after a change). The id remains the same after a reboot. PX4 computes the id of a fence differently
if it loads the fence from a file on the vehicle. ArduPilot 4.6 has no ids.
"""

import binascii
import struct
from collections.abc import Sequence

from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks.stacks import Stack

_ITEM = struct.Struct("<BHB4fiif")
_INVERTED = 0xFFFFFFFF  # binascii inverts the CRC at the start and the end, PX4 does not


def mission_id_of(items: Sequence[MissionItem], stack: Stack) -> int | None:
    """Return the id of a list uploaded as MISSION_ITEM_INT; None if the stack has no ids.

    ``items`` are the items that were sent: a mission, a fence or rally points. The result can be
    compared with the id in a message. An id of 0 in a message does not prove that the list is
    empty, because 0 can also mean that there is no id.
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
