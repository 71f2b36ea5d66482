"""Reads and writes QGroundControl .plan files: mission (simple items), geofence, rally points.

QGroundControl's developer guide describes the format ("Plan File Format"). The conversion to
mission items is the same as in QGroundControl and MAVSDK.
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import (
    Items,
    MissionItem,
    Plan,
    has_position,
    item_of_params,
    jumps_moved,
    params_of,
)
from autopilot_bridge.missions import fence_file, wpl_file
from autopilot_bridge.missions.plan_values import array, null_or_number, number, whole
from autopilot_bridge.missions.text_file import read_text, write_text
from autopilot_bridge.stacks.stacks import Stack

# QGroundControl's AltitudeMode for each frame. The numbers of the modes differ between versions, so
# the reader uses only the frame.
_ALTITUDE_MODES = {3: 1, 6: 1, 0: 2, 5: 2, 10: 4, 11: 4}
PLAN_SUFFIX = ".plan"
WPL_SUFFIXES = (".waypoints", ".txt")


def read_any(path: Path | str) -> Plan:
    """Read a plan file; the content determines the format: .plan or QGC WPL.

    Args:
        path: The file.

    Returns:
        Mission, fence, rally points and home.

    Raises:
        BridgeError: The file cannot be read, or an item is not valid; the message names the item.
    """
    path = Path(path)
    text = read_text(path)
    return wpl_file.parse(path, text) if text.startswith("QGC WPL") else _parse(path, text)


def write_any(path: Path | str, plan: Plan, stack: Stack | None) -> None:
    """Write a plan file.

    Args:
        path: The file; its suffix selects the format: .plan, or .waypoints or .txt (QGC WPL 110).
        plan: Mission, fence, rally points and home.
        stack: The stack to name in a .plan file; None means a generic autopilot and vehicle.

    Raises:
        BridgeError: The file cannot be written, the suffix is not one of these, or the format
            cannot hold an item.
    """
    path = Path(path)
    if path.suffix.lower() not in (PLAN_SUFFIX, *WPL_SUFFIXES):
        raise BridgeError(
            f"{path}: the suffix does not select a format; use {PLAN_SUFFIX}, "
            f"{' or '.join(WPL_SUFFIXES)}"
        )
    if path.suffix.lower() in WPL_SUFFIXES:
        wpl_file.write_wpl(path, plan)
    else:
        write_plan(path, plan, stack)


def write_plan(path: Path, plan: Plan, stack: Stack | None) -> None:
    """Write a .plan file.

    In this format polygons come before circles, rally altitudes are above home, and fence points
    and rally points have no ``autocontinue``. If the format cannot hold an item, the function
    raises a BridgeError that names the item.
    """
    try:
        content = {
            "fileType": "Plan",
            "groundStation": "mission-service",
            "version": 1,
            "geoFence": fence_file.fence_json(plan.fence),
            "rallyPoints": fence_file.rally_json(plan.rally),
            "mission": {
                "version": 2,
                "firmwareType": stack.autopilot if stack else mavlink.MAV_AUTOPILOT_GENERIC,
                "vehicleType": stack.mav_type if stack else mavlink.MAV_TYPE_GENERIC,
                "globalPlanAltitudeMode": 0,  # each item has its own mode
                "cruiseSpeed": 18,
                "hoverSpeed": 8,
                "plannedHomePosition": list(plan.home or (0.0, 0.0, 0.0)),
                "items": [
                    _simple(item, index) for index, item in enumerate(jumps_moved(plan.mission, 1))
                ],
            },
        }
        text = json.dumps(content, indent=2, allow_nan=False)
    except ValueError as error:
        raise BridgeError(f"{path}: cannot be written: {error}") from None
    write_text(path, text + "\n")


def _simple(item: MissionItem, index: int) -> dict[str, Any]:
    params = [null_or_number(value) for value in params_of(item)]
    simple = {
        "type": "SimpleItem",
        "autoContinue": bool(item.autocontinue),
        "command": item.command,
        "doJumpId": index + 1,
        "frame": item.frame,
        "params": params,
    }
    if has_position(item.command) and item.frame in _ALTITUDE_MODES:
        simple |= {
            "AMSLAltAboveTerrain": None,
            "Altitude": params[6],
            "AltitudeMode": _ALTITUDE_MODES[item.frame],
        }
    return simple


def _parse(path: Path, text: str) -> Plan:
    """Return the plan in the text of a .plan file; errors name ``path``.

    Parameters that are ``null`` become NaN. The frame and params of an item are used, not the
    values that QGroundControl displays.
    """
    content = _json(path, text)
    mission = content.get("mission")
    if content.get("fileType") != "Plan" or not isinstance(mission, dict):
        raise BridgeError(f"{path}: not a QGroundControl .plan file with a mission")
    if (content.get("version"), mission.get("version")) != (1, 2):
        raise BridgeError(
            f"{path}: plan version {content.get('version')}, mission version "
            f"{mission.get('version')}; these must be 1 and 2: save the file again in "
            "QGroundControl"
        )
    try:
        return Plan(
            _mission(array(mission.get("items"), "items")),
            fence_file.fence_of(content.get("geoFence")),
            fence_file.rally_of(content.get("rallyPoints")),
            _home(mission.get("plannedHomePosition")),
        )
    except ValueError as error:
        raise BridgeError(f"{path}: {error}") from None


def _json(path: Path, text: str) -> dict[str, Any]:
    try:
        content = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise BridgeError(f"{path}: not a QGroundControl .plan file with a mission")
    return content


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is not valid JSON")


def _home(value: Any) -> tuple[float, float, float] | None:
    if value is None:
        return None
    lat_deg, lon_deg, altitude_m = (
        number(part, "plannedHomePosition") for part in array(value, "plannedHomePosition", 3)
    )
    home = (lat_deg, lon_deg, altitude_m)
    return home if any(home) else None


def _mission(entries: list[Any]) -> Items:
    items = tuple(_numbered_item(index, entry) for index, entry in enumerate(entries))
    ids = {repr(entry.get("doJumpId")): index for index, entry in enumerate(entries)}
    return tuple(
        _jump(index, item, ids) if item.command == mavlink.MAV_CMD_DO_JUMP else item
        for index, item in enumerate(items)
    )


def _jump(index: int, item: MissionItem, ids: dict[str, int]) -> MissionItem:
    target = ids.get(f"{item.param1:g}")
    if target is None:
        raise ValueError(
            f"item {index} jumps to doJumpId {item.param1:g}, which no item has; choose another "
            "target"
        )
    return replace(item, param1=float(target))


def _numbered_item(index: int, entry: Any) -> MissionItem:
    try:
        return _item(entry)
    except ValueError as error:
        raise ValueError(f"item {index} {error}") from None


def _item(entry: Any) -> MissionItem:
    if not isinstance(entry, dict):
        raise ValueError("is not a JSON object")
    if entry.get("type") != "SimpleItem":
        kind = entry.get("complexItemType")
        shown = f"{entry.get('type')} ({kind})" if kind else entry.get("type")
        raise ValueError(
            f"is a {shown}; only simple items can be uploaded: convert this item to waypoints first"
        )
    try:
        params = [
            math.nan if value is None else number(value, "params")
            for value in array(entry.get("params"), "params", 7)
        ]
        command = whole(entry.get("command"), "command", 65535)
        frame = whole(entry.get("frame"), "frame", 255)
        autocontinue = entry.get("autoContinue")
        if not isinstance(autocontinue, bool):
            raise ValueError("autoContinue is not true or false")
        return item_of_params(command, frame, params, int(autocontinue))
    except ValueError as error:
        raise ValueError(f"is invalid: {error}") from None
