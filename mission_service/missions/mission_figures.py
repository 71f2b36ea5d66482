"""Computes the key figures of a mission that awaits an operator's acceptance. Pure."""

import msgspec
import numpy as np

from autopilot_bridge.items import Items
from autopilot_bridge.missions.check import check
from autopilot_bridge.stacks.stacks import stack_named
from firemodel.landscape.landscape import Landscape
from mission_service.config.sections import VehicleSection
from mission_service.missions.separation import track_of


class Figures(msgspec.Struct):
    """The figures of a mission; ``min_height_…`` describes the lowest point above the terrain."""

    items: int
    length_m: float
    duration_s: float
    min_height_agl_m: float
    min_height_lat_deg: float
    min_height_lon_deg: float
    highest_amsl_m: float
    farthest_from_home_m: float
    outside_landscape: bool
    problems: list[str]  # reasons why the vehicle's autopilot would reject the mission


def figures_of(
    items: Items, landscape: Landscape, section: VehicleSection, start_m: tuple[float, float] | None
) -> Figures:
    """Return a mission's figures; ``start_m`` (x, y) is the position of a vehicle in flight."""
    track = track_of(items, landscape, section.loiter_radius_m, start_m)
    x_m, y_m = track.points_m.T
    lowest_m = track.lowest_m - np.asarray(landscape.elevation_at(x_m, y_m))
    at = int(np.argmin(lowest_m))
    lat_deg, lon_deg = landscape.lat_lon_of(x_m[at], y_m[at])
    home_m = landscape.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg)
    length_m = float(np.hypot(*np.diff(track.points_m, axis=0).T).sum())
    on_map = [landscape.contains(*place) for place in track.points_m.tolist()]
    return Figures(
        items=len(items),
        length_m=round(length_m),
        duration_s=round(length_m / section.airspeed_m_s),
        min_height_agl_m=round(float(lowest_m[at]), 1),
        min_height_lat_deg=round(float(lat_deg), 6),
        min_height_lon_deg=round(float(lon_deg), 6),
        highest_amsl_m=round(float(track.highest_m.max()), 1),
        farthest_from_home_m=round(float(np.hypot(x_m - home_m[0], y_m - home_m[1]).max()), 1),
        outside_landscape=not all(on_map),
        problems=[str(each) for each in check(items, stack_named(section.stack, section.kind))],
    )
