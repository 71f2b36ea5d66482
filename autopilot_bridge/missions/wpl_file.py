"""Reads and writes QGC WPL text files (MAVProxy, Mission Planner, older QGroundControl).

The columns of a line are separated by tabs: index, current, frame, command, params 1 to 4,
latitude, longitude, altitude, autocontinue (mavlink.io, "Mission Plain-Text File Format"). In
version 110, item 0 is the home position. A file of version 120 has no home. (QGroundControl treats
the two versions in this way.) The format has no fence and no rally points.
"""

import math
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import (
    AMSL_FRAMES,
    MissionItem,
    Plan,
    command_name,
    item_of_params,
    jumps_moved,
    params_of,
)
from autopilot_bridge.missions.plan_values import whole
from autopilot_bridge.missions.text_file import write_text

_HOME_ITEMS = {"QGC WPL 110": 1, "QGC WPL 120": 0}  # number of home items at the beginning


def parse(path: Path, text: str) -> Plan:
    """Return the plan in a file's text. Raises a BridgeError that names ``path`` and the line."""
    lines = [(at, line.strip()) for at, line in enumerate(text.splitlines(), 1)]
    version = lines[0][1] if lines else ""
    if version not in _HOME_ITEMS:
        raise BridgeError(f"{path}: line 1 is {version[:40]!r}, not QGC WPL 110 or QGC WPL 120")
    items: list[MissionItem] = []
    for at, line in lines[1:]:
        if not line or line.startswith("#"):
            continue
        try:
            items.append(_item(line, len(items)))
        except ValueError as error:
            raise BridgeError(f"{path}: line {at}: {error}") from None
    homes = _HOME_ITEMS[version]
    home = _home(path, items[0]) if homes and items else None
    return Plan(jumps_moved(items[homes:], -homes), home=home)


def _item(line: str, index: int) -> MissionItem:
    words = line.split()
    if len(words) != 12:
        raise ValueError(f"{len(words)} values instead of 12")
    if words[0] != str(index):
        raise ValueError(f"the item has number {words[0]} instead of {index}; renumber the items")
    params = [float(word) for word in words[4:11]]
    if any(math.isinf(value) for value in params):
        raise ValueError("an infinite value")
    frame, command = whole(int(words[2]), "frame", 255), whole(int(words[3]), "command", 65535)
    return item_of_params(command, frame, params, whole(int(words[11]), "autocontinue", 1))


def _home(path: Path, item: MissionItem) -> tuple[float, float, float] | None:
    # This check prevents the loss of the first item of a file that has no home. Mission Planner
    # writes home as command 0.
    if item.command not in (0, mavlink.MAV_CMD_NAV_WAYPOINT) or item.frame not in AMSL_FRAMES:
        raise BridgeError(
            f"{path}: item 0 is a {command_name(item.command)} in frame {item.frame}, but in QGC "
            "WPL 110 it is the home position (WAYPOINT in frame 0); add it, or save the file as "
            "QGC WPL 120"
        )
    home = (item.x / 1e7, item.y / 1e7, item.z)
    return home if any(home) else None


def write_wpl(path: Path, plan: Plan) -> None:
    """Write a QGC WPL 110 file; if the plan has no home, the position of item 0 is all zeros.

    Raises BridgeError if the plan has a fence or rally points, which the format cannot contain.
    """
    if plan.fence or plan.rally:
        raise BridgeError(
            f"{path}: a WPL file cannot store a fence or rally points; write a .plan file instead"
        )
    lat_deg, lon_deg, altitude_m = plan.home or (0.0, 0.0, 0.0)
    position = (0.0, 0.0, 0.0, 0.0, lat_deg, lon_deg, altitude_m)
    home = item_of_params(mavlink.MAV_CMD_NAV_WAYPOINT, AMSL_FRAMES[0], position, 1)
    lines = [_line(at, item) for at, item in enumerate((home, *jumps_moved(plan.mission, 1)))]
    if any("inf" in line for line in lines):
        raise BridgeError(f"{path}: cannot be written: an item has an infinite value")
    write_text(path, "\n".join(("QGC WPL 110", *lines, "")))


def _line(index: int, item: MissionItem) -> str:
    values = "\t".join(repr(float(value)) for value in params_of(item))
    current = int(index == 0)
    return f"{index}\t{current}\t{item.frame}\t{item.command}\t{values}\t{item.autocontinue}"
