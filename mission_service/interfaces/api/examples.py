"""Examples in the API's description; a test checks each against its schema."""

from typing import Any

HASH = "9f" * 32
PLACE = {"lat_deg": 36.3512, "lon_deg": -84.1603}
TOLD = {"ok": True, "at_s": 1830.0, "event": "Ordered", "said": ["hawk: hold, by anna"]}
TELEMETRY = {
    "schema": "telemetry/1",
    "at_us": 1830000000,
    "vehicle": "hawk",
    **PLACE,
    "altitude_amsl_m": 812.4,
    "altitude_relative_m": 401.2,
    "height_agl_m": 148.9,
    "heading_deg": 87.5,
    "ground_speed_m_s": 19.8,
    "track_deg": 88.1,
}
VEHICLE: dict[str, Any] = {
    "schema": "vehicle/1",
    "at_us": 1829800000,
    "vehicle": "hawk",
    "kind": "plane",
    "stack": "px4",
    "system_id": 1,
    "home_lat_deg": 36.34,
    "home_lon_deg": -84.17,
    "link": "online",
    "heard_stack": "px4 plane",
    "mode": "mission",
    "armed": True,
    "current_seq": 3,
    "battery_pct": 71.0,
    "decisions": 212,
    "reversals": 4,
    "direction": "clockwise",
}
ITEM = {
    "command": 16,
    "name": "NAV_WAYPOINT",
    "frame": 0,
    **PLACE,
    "altitude_m": 812.0,
    "params": [0.0, 0.0, 0.0, 0.0],
}
MISSION = {
    "schema": "mission/1",
    "at_us": 1822000000,
    "vehicle": "hawk",
    "on_board": {
        "mission_id": 17,
        "at_us": 1822000000,
        "why": "the mission is nearly flown",
        "outcome": "accepted",
        "reason": "",
        "mission_hash": HASH,
        "items": [ITEM],
    },
    "sending": None,
    "proposed": None,
}
ALARM = {
    "schema": "alarm/1",
    "alarm": "link/hawk",
    "at_us": 1800000000,
    "vehicle": "hawk",
    "severity": "severe",
    "text": "hawk: link lost",
    "cleared_at_us": None,
}
NEWS = {
    "schema": "event/1",
    "id": 911,
    "at_us": 1830000000,
    "vehicle": "hawk",
    "level": "info",
    "text": "phase: monitor",
}
FIRE = {
    "schema": "fire/1",
    "at_us": 1830000000,
    "version": 2,
    "area_ha": 41.3,
    "wind_speed_m_s": 4.0,
    "wind_from_deg": 225.0,
    "wind_told_by": "anna",
    "corrections": [],
}
LAND = {
    "bounds": [-84.26, 36.29, -84.06, 36.41],
    "corners_lon_lat": [[-84.26, 36.41], [-84.06, 36.41], [-84.06, 36.29], [-84.26, 36.29]],
    "cell_size_m": 30.0,
    "rows": 500,
    "cols": 500,
}
STATUS = {
    "schema": "run/1",
    "at_us": 1830000000,
    "time_unix_us": 1790000000000000,
    "scenario": "demo",
    "rule": "damped",
    "duration_s": 7200.0,
    "not_ready": [],
    "stopping": False,
}
REPLAY = {
    "schema": "replay/1",
    "at_us": 120000000,
    "logs": ["flight.tlog"],
    "log_begin_us": 1790000000000000,
    "log_end_us": 1790000900000000,
    "log_at_us": 1790000120000000,
    "begin_us": 0,
    "speed": 10.0,
    "paused": False,
    "seeking": False,
    "ended": False,
    "jumps": 0,
}
STATE = {
    "version": 4711,
    "status": STATUS,
    "roles": ["look", "correct", "fly", "approve"],
    "by": "anna",
    "vehicles": [VEHICLE],
    "telemetry": [TELEMETRY],
    "missions": [MISSION],
    "fire": FIRE,
    "burn": None,
    "alarms": [ALARM],
    "news": [NEWS],
    "landscape": LAND,
    "rule": "damped",
    "planner": {"rule": "damped", "alpha": 1.0},
    "replay": None,
}
FIGURES = {
    "items": 6,
    "length_m": 2980.0,
    "duration_s": 248.0,
    "least_height_agl_m": 118.0,
    "least_height_lat_deg": 36.3524,
    "least_height_lon_deg": -84.1588,
    "highest_amsl_m": 842.0,
    "farthest_from_home_m": 3310.0,
    "outside_landscape": False,
    "problems": [],
}
PREVIEW = {
    "at_us": 1830000000,
    "vehicle": "hawk",
    "mission_hash": HASH,
    "items": [ITEM],
    "figures": FIGURES,
    "difference": {"alike_first": 2, "added": 4, "removed": 3, "farthest_moved_m": 84.0},
}
IMPORTANCE = {
    "at_us": 1830000000,
    "vehicle": "hawk",
    "rule": "damped",
    "importance_back": 81.2,
    "importance_front": 77.9,
    "cells": [[36.3512, -84.1603, 0.41]],
}
AREA = {"type": "Polygon", "coordinates": [[[-84.16, 36.35], [-84.15, 36.35], [-84.15, 36.36]]]}
FRONT = {"type": "Feature", "geometry": AREA, "properties": {"at_s": 3600.0, "in_s": 1770.0}}
FRONTS = {"type": "FeatureCollection", "features": [FRONT]}
TRACK = {
    "type": "Feature",
    "geometry": {"type": "LineString", "coordinates": [[-84.16, 36.35, 812.4]]},
    "properties": {"vehicle": "hawk", "at_us": [1830000000]},
}
CORRECT = {"state": "burning", "shape": "line", "points": [[36.351, -84.161], [36.352, -84.16]]}
CORRECTION = {**CORRECT, "at_us": 1700000000, "marked_at_us": 1700000000, "by": "anna"}
