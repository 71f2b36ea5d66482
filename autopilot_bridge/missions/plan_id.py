"""The opaque id that an autopilot assigns to a list of items, computed from the items.

PX4 1.17 (read: ``mavlink_mission.cpp``, ``crc32_for_mission_item``; seen in simulation): a CRC-32
without inversions, from 0, over frame, command, autocontinue, params 1 to 4, x, y and z of every
item as received in its MISSION_ITEM_INT, 32 bytes each. Neither ``current`` nor the mission type is
in it, so two plans that differ in their first item to fly only have one id. A list without items
has id 0. The id is in MISSION_ACK.opaque_id, in MISSION_COUNT.opaque_id when a list is read, in
MISSION_CURRENT (once a second, and at once after a change) and survives a reboot. The id of a fence
loaded from a file on the vehicle is computed differently. ArduPilot 4.6 has no ids.
"""

import binascii
import struct
from collections.abc import Sequence

from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks.stacks import Stack

_ITEM = struct.Struct("<BHB4fiif")
_INVERTED = 0xFFFFFFFF  # binascii inverts before and after, PX4 does not


def mission_id_of(items: Sequence[MissionItem], stack: Stack) -> int | None:
    """The id after an upload of these items by MISSION_ITEM_INT; None where a stack has no ids.

    ``items`` as they are sent (a mission, a fence or rally points). The id can be compared with
    what a codec's message has; there 0 means none, so 0 is no proof of an empty list.
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
