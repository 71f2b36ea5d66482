"""Converts the airspace of a scenario to the fence of an autopilot. Pure.

The fence of an autopilot has no times, and its polygons and circles have no limits of altitude. So
it contains the volumes that are closed during the whole run from the ground to above all missions,
and the outline of the allowed areas. Other volumes are left out, because the autopilot would also
keep the vehicle out of them while the service flies there.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from autopilot_bridge.items import Items
from autopilot_bridge.missions.fence_file import fence_of
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import parts_of
from mission_service.airspace.occupied_space import RETURN_ABOVE_M
from mission_service.airspace.volumes import Volume, area_of, closed_in, ground_range_m, volume_of
from mission_service.config.airspace_section import AreaSection
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection


class VehicleFence(NamedTuple):
    """The items of a fence, and why volumes are left out: a line for each of them."""

    items: Items
    left_out: tuple[str, ...]


def fence_for(vehicle: VehicleSection, scenario: Scenario, landscape: Landscape) -> VehicleFence:
    """Return the fence of a vehicle.

    Args:
        vehicle: The vehicle.
        scenario: Its airspace and times.
        landscape: The terrain.

    Returns:
        Polygons and circles, in the order of the scenario, and the volumes that are left out.

    Raises:
        ScenarioError: A file of volumes cannot be read, or an area cannot be used.
    """
    section = scenario.airspace
    top_m = _highest_m(vehicle, scenario, landscape)
    polygons: list[dict[str, Any]] = []
    circles: list[dict[str, Any]] = []
    left_out = []
    for entry in closed_in(section):
        volume = volume_of(entry, landscape)
        parts = _polygons(volume.area_m)
        reason = _unusable(volume, scenario, top_m, landscape) or _not_outlined(parts)
        if reason:
            left_out.append(f"{entry.name}: {reason}")
        elif entry.radius_m is not None:
            circles.append(_circle(entry, False))
        else:
            polygons += [_polygon(each, False, landscape) for each in parts]
    if section.allowed:
        inside = _polygons(
            shapely.union_all([area_of(each, landscape) for each in section.allowed])
        )
        reason = _not_outlined(inside)
        if reason or len(inside) > 1:
            left_out.append(f"allowed areas: {reason or 'they are not connected'}")
        elif len(section.allowed) == 1 and section.allowed[0].radius_m is not None:
            circles.append(_circle(section.allowed[0], True))
        else:
            polygons.append(_polygon(inside[0], True, landscape))
    fence = {"version": 2, "polygons": polygons, "circles": circles}
    return VehicleFence(fence_of(fence), tuple(left_out))


def _highest_m(vehicle: VehicleSection, scenario: Scenario, landscape: Landscape) -> float:
    """Return the highest altitude of a vehicle's missions and returns, above mean sea level."""
    elevation_m = landscape.elevation_m
    ground_m = 0.0 if elevation_m is None else float(np.nanmax(elevation_m))
    burn_m = 0.0 if scenario.burn is None else scenario.burn.safe_height_m
    return_m = max(RETURN_ABOVE_M, vehicle.return_height_m or 0.0)
    return ground_m + max(vehicle.altitude_agl_m, burn_m, return_m)


def _unusable(volume: Volume, scenario: Scenario, top_m: float, landscape: Landscape) -> str:
    """Return why a fence cannot contain a volume; "" if it can."""
    if volume.from_s > scenario.first_flight_s or volume.until_s < scenario.duration_s:
        return "it is not closed for the whole run"
    if volume.floor_m == -math.inf and volume.ceiling_m == math.inf:
        return ""
    if landscape.elevation_m is None:
        return "it has altitude limits, but the landscape has no elevation"
    lowest_m = ground_range_m(volume.area_m, landscape)[0]
    if not volume.floor_m <= lowest_m:  # also if the ground is not known
        return "its floor is above the ground"
    if not volume.ceiling_m >= top_m:
        return f"its ceiling is below {top_m:.0f} m AMSL, up to which the vehicle may fly"
    return ""


def _not_outlined(parts: Sequence[shapely.Polygon]) -> str:
    """Return why the outlines of polygons do not describe them; "" if they do."""
    return "" if parts and not any(part.interiors for part in parts) else "its outline has a hole"


def _polygons(area_m: BaseGeometry) -> list[shapely.Polygon]:
    """Return the polygons of an area, also those in nested collections."""
    return [part for part in parts_of([area_m]) if isinstance(part, shapely.Polygon)]


def _circle(entry: AreaSection, inclusion: bool) -> dict[str, Any]:
    """Return the circle of a plan file."""
    circle = {"center": [entry.lat_deg, entry.lon_deg], "radius": entry.radius_m}
    return {"circle": circle, "inclusion": inclusion}


def _polygon(part: shapely.Polygon, inclusion: bool, landscape: Landscape) -> dict[str, Any]:
    """Return the polygon of a plan file for the outline of an area (x, y in metres)."""
    places_m = shapely.get_coordinates(part.exterior)[:-1]
    lat_deg, lon_deg = landscape.lat_lon_of(places_m[:, 0], places_m[:, 1])
    corners = [[float(lat), float(lon)] for lat, lon in zip(lat_deg, lon_deg, strict=True)]
    return {"inclusion": inclusion, "polygon": corners}
