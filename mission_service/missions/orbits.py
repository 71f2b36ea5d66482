"""Plans circles over terrain: their positions and altitudes, and missions that contain them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem, loiter_unlimited, takeoff
from firemodel.landscape.landscape import Landscape
from mission_service.airspace.occupied_space import LOITER_RADIUS_FACTOR
from mission_service.commands import Orbit
from mission_service.config.sections import VehicleSection

Place = tuple[float, float]  # x, y in metres
Floats = NDArray[np.float64]

CLIMBS_FIRST_M = 100.0  # a vehicle climbs this high above a leg's terrain before the leg
CORRIDOR_M = 150.0  # terrain within this distance to either side of a leg counts


@dataclass(frozen=True, slots=True)
class Circle:
    """A circle flown ``climb_m`` above the usual height; a negative radius means anticlockwise."""

    x_m: float
    y_m: float
    radius_m: float
    climb_m: float = 0.0

    @property
    def centre_m(self) -> Place:
        """The centre (x, y) in metres."""
        return self.x_m, self.y_m


def highest_ground_m(landscape: Landscape, start: Place, end: Place, within_m: float) -> float:
    """Return the highest ground within a distance of the line between two positions.

    Outside the grid, the elevation of the grid's edge is used. Raises FireModelError if the
    landscape has no elevation.
    """
    highest_m = max(float(landscape.elevation_at(*place)) for place in (start, end))
    elevation_m = landscape.elevation_m
    assert elevation_m is not None
    (row, col), (end_row, end_col) = landscape.row_col_of(*start), landscape.row_col_of(*end)
    reach = within_m / landscape.cell_size_m
    top, left = (
        max(math.ceil(least - reach), 0) for least in (min(row, end_row), min(col, end_col))
    )
    below, beyond = (
        max(math.floor(most + reach) + 1, 0) for most in (max(row, end_row), max(col, end_col))
    )
    window = elevation_m[top:below, left:beyond]
    if window.size == 0:
        return highest_m
    down = np.arange(top, top + window.shape[0])[:, None] - row
    across = np.arange(left, left + window.shape[1])[None, :] - col
    leg_down, leg_across = end_row - row, end_col - col
    square = leg_down * leg_down + leg_across * leg_across
    if square > 0.0:
        along = np.clip((down * leg_down + across * leg_across) / square, 0.0, 1.0)
        down, across = down - along * leg_down, across - along * leg_across
    near = window[down * down + across * across <= reach * reach]
    return max(highest_m, float(near.max())) if near.size else highest_m


def altitude_amsl_m(
    landscape: Landscape, circle: Circle, altitude_agl_m: float, from_m: Place
) -> float:
    """Return the altitude that clears all terrain within a circle and on the leg to it."""
    reach_m = LOITER_RADIUS_FACTOR * abs(circle.radius_m)
    ground_m = highest_ground_m(landscape, circle.centre_m, circle.centre_m, reach_m)
    if math.dist(from_m, circle.centre_m) > reach_m:
        ground_m = max(ground_m, highest_ground_m(landscape, from_m, circle.centre_m, CORRIDOR_M))
    return round(ground_m + altitude_agl_m + circle.climb_m, 1)


def orbit_of(vehicle: str, landscape: Landscape, circle: Circle, altitude_m: float) -> Orbit:
    """Return the command to fly a circle."""
    lat_deg, lon_deg = landscape.lat_lon_of(*circle.centre_m)
    place = (round(float(lat_deg), 7), round(float(lon_deg), 7))
    return Orbit(vehicle, *place, altitude_m, circle.radius_m)


def loiter_mission(
    landscape: Landscape, circle: Circle, altitude_m: float, landing: tuple[MissionItem, ...]
) -> tuple[MissionItem, ...]:
    """Return a mission with an unlimited loiter on a circle, followed by ``landing``."""
    lat_deg, lon_deg = landscape.lat_lon_of(*circle.centre_m)
    place = (float(lat_deg), float(lon_deg))
    return (loiter_unlimited(*place, altitude_m, circle.radius_m), *landing)


def first_mission(
    landscape: Landscape, circle: Circle, section: VehicleSection, landing: tuple[MissionItem, ...]
) -> tuple[MissionItem, ...]:
    """Return a mission with a takeoff, a climb clear of the terrain, and a loiter on a circle."""
    home_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    altitude_m = altitude_amsl_m(landscape, circle, section.altitude_agl_m, home_m)
    ground_m = highest_ground_m(landscape, home_m, circle.centre_m, CORRIDOR_M)
    first_m = round(ground_m + min(CLIMBS_FIRST_M, section.altitude_agl_m), 1)
    up = takeoff(section.home_lat_deg, section.home_lon_deg, min(first_m, altitude_m))
    return (up, *loiter_mission(landscape, circle, altitude_m, landing))


def waiting_place(
    number: int, centre_m: Place, reach_m: float, home_m: Place, apart_m: float
) -> Place:
    """Return a vehicle's waiting position, on the side of the fire that faces its home.

    The positions form rows of eight across the line from home to the fire, so that no path leads
    over the fire. The first row is ``reach_m`` from the fire's centre.
    """
    away_m = max(math.dist(centre_m, home_m), 1.0)
    out = ((home_m[0] - centre_m[0]) / away_m, (home_m[1] - centre_m[1]) / away_m)
    row, place = divmod(number, 8)
    ahead_m, across_m = reach_m + row * apart_m, (place - 3.5) * apart_m
    return (
        centre_m[0] + ahead_m * out[0] - across_m * out[1],
        centre_m[1] + ahead_m * out[1] + across_m * out[0],
    )


def pushed_out(place_m: Place, centre_m: Place, reach_m: float) -> Place:
    """Return a position at least ``reach_m`` from the centre, in the direction of ``place_m``."""
    away_m = math.dist(place_m, centre_m)
    if away_m >= reach_m:
        return place_m
    out = (place_m[0] - centre_m[0], place_m[1] - centre_m[1])
    if away_m < 1.0:
        out, away_m = (1.0, 0.0), 1.0
    scale = reach_m / away_m
    return centre_m[0] + scale * out[0], centre_m[1] + scale * out[1]
