"""QGroundControl .plan files (missions of simple items)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.stacks import Stack

_RELATIVE, _ABSOLUTE = 1, 2  # QGroundControl's AltitudeMode


def write_plan(
    path: Path, items: Sequence[MissionItem], home: tuple[float, float, float], stack: Stack | None
) -> None:
    """Write items; ``home`` is (lat_deg, lon_deg, altitude_amsl_m)."""
    plan = {
        "fileType": "Plan",
        "groundStation": "mission-service",
        "version": 1,
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": stack.autopilot if stack else mavlink.MAV_AUTOPILOT_GENERIC,
            "vehicleType": stack.mav_type if stack else mavlink.MAV_TYPE_GENERIC,
            "globalPlanAltitudeMode": _ABSOLUTE,
            "cruiseSpeed": 18,
            "hoverSpeed": 8,
            "plannedHomePosition": list(home),
            "items": [_simple(item, index) for index, item in enumerate(items)],
        },
    }
    try:
        path.write_text(json.dumps(plan, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise BridgeError(f"{path}: cannot be written: {error.strerror}") from None


def _simple(item: MissionItem, index: int) -> dict[str, Any]:
    absolute = item.frame in (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
    return {
        "type": "SimpleItem",
        "AMSLAltAboveTerrain": None,
        "Altitude": item.z,
        "AltitudeMode": _ABSOLUTE if absolute else _RELATIVE,
        "autoContinue": bool(item.autocontinue),
        "command": item.command,
        "doJumpId": index + 1,
        "frame": item.frame,
        "params": [
            item.param1,
            item.param2,
            item.param3,
            item.param4,
            item.x / 1e7,
            item.y / 1e7,
            item.z,
        ],
    }


def read_plan(path: Path) -> tuple[MissionItem, ...]:
    """The items of a .plan file. Raises BridgeError naming file and item."""
    try:
        items = json.loads(path.read_text(encoding="utf-8"))["mission"]["items"]
    except OSError as error:
        raise BridgeError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise BridgeError(f"{path}: not a QGroundControl .plan file with a mission") from None
    return tuple(_item(path, index, entry) for index, entry in enumerate(items))


def _item(path: Path, index: int, entry: dict[str, Any]) -> MissionItem:
    if entry.get("type") != "SimpleItem":
        raise BridgeError(
            f"{path}: item {index} is a {entry.get('type')}; only simple items can be uploaded"
        )
    try:
        # QGroundControl writes null where a parameter is to be left to the autopilot (NaN).
        values = [float("nan") if value is None else float(value) for value in entry["params"]]
        param1, param2, param3, param4, lat_deg, lon_deg, altitude_m = values
        return MissionItem(
            int(entry["command"]),
            int(entry["frame"]),
            round(lat_deg * 1e7),
            round(lon_deg * 1e7),
            altitude_m,
            param1,
            param2,
            param3,
            param4,
            int(entry["autoContinue"]),
        )
    except (KeyError, TypeError, ValueError):
        raise BridgeError(f"{path}: item {index} is damaged") from None
