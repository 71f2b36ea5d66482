"""Converts log entries to JSON messages with Foxglove's schemas.

The fields are those of foxglove-sdk's ``schemas/jsonschema``. Plot panels receive rows of the
tables in ``flight_tables.py``, without the columns for time and vehicle, and without unknown
values, because Foxglove rejects null.
"""

import json
import math
from collections.abc import Iterator
from datetime import datetime
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import Items, command_name, place_of
from autopilot_bridge.logs.entries import LogEvent, MissionLoaded
from autopilot_bridge.vehicle.client_events import Attitude, Position
from mission_service.replay.flights.flight_tables import HEAD, OWN, Columns, Row
from mission_service.runtime.track import feature


class Message(NamedTuple):
    """A message; ``topic`` is relative to the vehicle's name."""

    topic: str
    schema: str
    content: dict[str, Any]


def _object(required: bool = True, **properties: Any) -> dict[str, Any]:
    described = {"type": "object", "properties": properties}
    return {**described, "required": list(properties)} if required else described


NUMBER, INTEGER, STRING = ({"type": kind} for kind in ("number", "integer", "string"))
TIME = {**_object(sec=INTEGER, nsec=INTEGER), "title": "time"}
VECTOR = _object(x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION = _object(x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
JSON_KINDS = {str: STRING, int: INTEGER, float: NUMBER, bool: {"type": "boolean"}, datetime: STRING}
UNKNOWN_COVARIANCE = 0  # foxglove.PositionCovarianceType
DEBUG, INFO, WARNING, ERROR, FATAL = range(1, 6)  # foxglove.LogLevel
LEVELS = (FATAL, FATAL, FATAL, ERROR, WARNING, INFO, INFO, DEBUG)  # log level for each MAV_SEVERITY
WARNINGS = ("link_lost", "rebooted")  # kinds of events with log level WARNING
WITH_WORDS = ("events", "missions")  # tables whose rows are not plotted: see /log and /mission


def _plotted(table: str, columns: Columns) -> dict[str, Any]:
    kinds = {name: JSON_KINDS[kind] for name, kind in columns.items()}
    return {"title": f"mission_service.{table}", **_object(False, **kinds)}


SCHEMAS: dict[str, dict[str, Any]] = {
    "foxglove.LocationFix": _object(
        timestamp=TIME,
        frame_id=STRING,
        latitude=NUMBER,
        longitude=NUMBER,
        altitude=NUMBER,
        position_covariance={"type": "array", "items": NUMBER, "minItems": 9, "maxItems": 9},
        position_covariance_type=INTEGER,
        heading=NUMBER,
    ),
    "foxglove.PoseInFrame": _object(
        timestamp=TIME, frame_id=STRING, pose=_object(position=VECTOR, orientation=QUATERNION)
    ),
    "foxglove.GeoJSON": _object(geojson=STRING),
    "foxglove.Log": _object(
        timestamp=TIME, level=INTEGER, message=STRING, name=STRING, file=STRING, line=INTEGER
    ),
    **{
        f"mission_service.{table}": _plotted(table, columns)
        for table, columns in OWN.items()
        if table not in WITH_WORDS
    },
}


def messages_of(
    name: str, at_ns: int, event: LogEvent, rows: list[tuple[str, Row]]
) -> Iterator[Message]:
    """Yield the messages for an event of vehicle ``name``; ``rows`` are the event's rows."""
    time = {"sec": at_ns // 1_000_000_000, "nsec": at_ns % 1_000_000_000}
    match event:
        case Position() if math.isfinite(event.lat_deg + event.lon_deg + event.altitude_amsl_m):
            yield Message("location", "foxglove.LocationFix", _location(name, time, event))
        case Attitude() if math.isfinite(event.roll_deg + event.pitch_deg + event.yaw_deg):
            pose = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": quaternion(event)}
            content = {"timestamp": time, "frame_id": name, "pose": pose}
            yield Message("pose", "foxglove.PoseInFrame", content)
        case MissionLoaded():
            geojson = json.dumps(mission_geojson(event.items))
            yield Message("mission", "foxglove.GeoJSON", {"geojson": geojson})
        case _:
            pass
    for table, row in rows:
        own = dict(zip(OWN[table], row[len(HEAD) :], strict=True))
        if table not in WITH_WORDS:
            values = {column: value for column, value in own.items() if value is not None}
            yield Message(table, f"mission_service.{table}", values)
        if table in ("events", "modes"):
            level, text = _words(table, own)
            entry = {"timestamp": time, "level": level, "message": text}
            entry |= {"name": name, "file": row[0], "line": 0}
            yield Message("log", "foxglove.Log", entry)


def _location(name: str, time: dict[str, int], fix: Position) -> dict[str, Any]:
    return {
        "timestamp": time,
        "frame_id": name,
        "latitude": fix.lat_deg,
        "longitude": fix.lon_deg,
        "altitude": fix.altitude_amsl_m,
        "position_covariance": [0.0] * 9,
        "position_covariance_type": UNKNOWN_COVARIANCE,
        "heading": math.radians(fix.heading_deg) if math.isfinite(fix.heading_deg) else 0.0,
    }


def _words(table: str, own: dict[str, Any]) -> tuple[int, str]:
    """Return the log level and the text for a row of events or modes."""
    if table == "modes":
        armed = "armed" if own["armed"] else "disarmed"
        return INFO, f"mode {own['mode'] or own['custom_mode']}, {armed}"
    if own["kind"] == "text":
        return LEVELS[min(own["severity"], len(LEVELS) - 1)], own["text"]
    level = WARNING if own["kind"] in WARNINGS else INFO
    return level, f"{own['kind']}: {own['text']}"


def quaternion(attitude: Attitude) -> dict[str, float]:
    """Return the rotation from a vehicle's axes (forward, left, up) to east, north, up."""
    roll, pitch, yaw = (
        math.radians(angle_deg) / 2
        for angle_deg in (attitude.roll_deg, -attitude.pitch_deg, 90.0 - attitude.yaw_deg)
    )
    (cos_r, sin_r), (cos_p, sin_p), (cos_y, sin_y) = (
        (math.cos(half), math.sin(half)) for half in (roll, pitch, yaw)
    )
    return {
        "x": sin_r * cos_p * cos_y - cos_r * sin_p * sin_y,
        "y": cos_r * sin_p * cos_y + sin_r * cos_p * sin_y,
        "z": cos_r * cos_p * sin_y - sin_r * sin_p * cos_y,
        "w": cos_r * cos_p * cos_y + sin_r * sin_p * sin_y,
    }


def mission_geojson(items: Items) -> dict[str, Any]:
    """Return items with a position as named points, and a line through the navigation items."""
    features, line = [], []
    for seq, item in enumerate(items):
        if place := place_of(item):
            point = [place[1], place[0]]
            features.append(feature("Point", point, name=f"{seq} {command_name(item.command)}"))
            if item.command < mavlink.MAV_CMD_NAV_LAST and item.command != mavlink.MAV_CMD_NAV_ROI:
                line.append(point)
    if len(line) > 1:
        features.insert(0, feature("LineString", line, name="mission"))
    return {"type": "FeatureCollection", "features": features}
