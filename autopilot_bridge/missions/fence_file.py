"""Converts the geofence and rally points of a .plan file to mission items and back.

The items are those that QGroundControl sends. Fence points are in frame GLOBAL at altitude 0, and
param1 of each vertex is the number of vertices of its polygon. Rally altitudes are above home;
autocontinue is 0. If a point is wrong, the functions raise a ValueError that names the point.
"""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import (
    AMSL_FRAMES,
    RELATIVE_FRAMES,
    Items,
    MissionItem,
    command_name,
)
from autopilot_bridge.missions.plan_values import array, number

POLYGONS = (
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
)
CIRCLES = (
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
)
_RETURN = mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT


def _point(command: int, frame: int, place: list[Any], name: str, value: float) -> MissionItem:
    lat_deg, lon_deg = (number(part, name) for part in place[:2])
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        raise ValueError(f"{name}: {lat_deg:g}, {lon_deg:g} is not a latitude and longitude")
    z = number(place[2], name) if len(place) > 2 else 0.0
    x, y = round(lat_deg * 1e7), round(lon_deg * 1e7)
    return MissionItem(command, frame, x, y, z, param1=value, autocontinue=0)


def fence_of(fence: Any) -> Items:
    """Return the items of ``geoFence``: the polygons, the circles, then the return point."""
    if fence is None:
        return ()
    if not isinstance(fence, dict):
        raise ValueError("geoFence is not an object")
    if fence.get("version") != 2:
        if fence.get("polygon"):
            raise ValueError(
                f"geoFence has version {fence.get('version')}, but only version 2 can be read; "
                "save the file again in QGroundControl"
            )
        return ()
    items: list[MissionItem] = []
    for index, entry in enumerate(array(fence.get("polygons"), "geoFence.polygons")):
        name = f"geofence polygon {index}"
        vertices = array(_of(entry, "polygon", name), name)
        if not vertices:
            raise ValueError(f"{name} has no vertices")
        command = POLYGONS[_inclusion(entry, name)]
        items += [
            _point(command, AMSL_FRAMES[0], array(place, name, 2), name, float(len(vertices)))
            for place in vertices
        ]
    for index, entry in enumerate(array(fence.get("circles"), "geoFence.circles")):
        name = f"geofence circle {index}"
        circle = _of(entry, "circle", name)
        centre = array(_of(circle, "center", name), name, 2)
        radius_m = number(_of(circle, "radius", name), name)
        items.append(
            _point(CIRCLES[_inclusion(entry, name)], AMSL_FRAMES[0], centre, name, radius_m)
        )
    if fence.get("breachReturn") is not None:
        place = array(fence["breachReturn"], "breachReturn", 3)
        items.append(_point(_RETURN, RELATIVE_FRAMES[0], place, "breachReturn", 0.0))
    return tuple(items)


def _of(entry: Any, key: str, name: str) -> Any:
    if not isinstance(entry, dict) or key not in entry:
        raise ValueError(f"{name} has no {key}")
    return entry[key]


def _inclusion(entry: Any, name: str) -> bool:
    inclusion = _of(entry, "inclusion", name)
    if not isinstance(inclusion, bool):
        raise ValueError(f"{name}: inclusion is not true or false")
    return inclusion


def fence_json(fence: Items) -> dict[str, Any]:
    """Return the ``geoFence`` of a plan file for these items."""
    polygons: list[dict[str, Any]] = []
    circles: list[dict[str, Any]] = []
    written: dict[str, Any] = {"circles": circles, "polygons": polygons, "version": 2}
    rest = list(enumerate(fence))
    while rest:
        index, item = rest.pop(0)
        place = _place(index, item, "fence")
        if item.command in POLYGONS:
            count = int(item.param1) if 1.0 <= item.param1 <= len(fence) else 0
            others, rest = rest[: count - 1], rest[max(count - 1, 0) :]
            same_kind = all((b.command, b.param1) == (item.command, item.param1) for _, b in others)
            if not same_kind or len(others) != count - 1:
                raise ValueError(
                    f"fence item {index} is one of {item.param1:g} vertices, but the list does "
                    "not contain that many consecutive vertices of its kind"
                )
            vertices = [place, *(_place(at, other, "fence") for at, other in others)]
            inclusion = bool(POLYGONS.index(item.command))
            polygons.append({"inclusion": inclusion, "polygon": vertices, "version": 1})
        elif item.command in CIRCLES:
            circle = {"center": place, "radius": item.param1}
            inclusion = bool(CIRCLES.index(item.command))
            circles.append({"circle": circle, "inclusion": inclusion, "version": 1})
        elif item.command == _RETURN and "breachReturn" not in written:
            if item.frame not in RELATIVE_FRAMES:
                raise ValueError(_not_relative(f"fence item {index}", item))
            written["breachReturn"] = [*place, item.z]
        else:
            raise ValueError(f"fence item {index}: unexpected {command_name(item.command)}")
    return written


def _not_relative(name: str, item: MissionItem) -> str:
    return (
        f"{name} has frame {item.frame}, but altitudes in a .plan file are above home (frame "
        f"{RELATIVE_FRAMES[0]} or {RELATIVE_FRAMES[1]})"
    )


def _place(index: int, item: MissionItem, name: str) -> list[float]:
    if any((item.param2, item.param3, item.param4)):
        raise ValueError(f"{name} item {index} has params 2 to 4, which a .plan file cannot store")
    return [item.x / 1e7, item.y / 1e7]


def rally_of(rally: Any) -> Items:
    """Return the items of ``rallyPoints``."""
    if rally is None:
        return ()
    points = array(_of(rally, "points", "rallyPoints"), "rallyPoints.points")
    command = mavlink.MAV_CMD_NAV_RALLY_POINT
    named = ((f"rally point {index}", point) for index, point in enumerate(points))
    return tuple(
        _point(command, RELATIVE_FRAMES[0], array(point, name, 3), name, 0.0)
        for name, point in named
    )


def rally_json(rally: Items) -> dict[str, Any]:
    """Return the ``rallyPoints`` of a plan file for these items."""
    points = []
    for index, item in enumerate(rally):
        if item.command != mavlink.MAV_CMD_NAV_RALLY_POINT:
            raise ValueError(f"rally item {index} is a {command_name(item.command)}")
        if item.frame not in RELATIVE_FRAMES:
            raise ValueError(_not_relative(f"rally point {index}", item))
        points.append([*_place(index, item, "rally"), item.z])
    return {"points": points, "version": 2}
