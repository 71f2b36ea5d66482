"""A mission in figures, for the person who is to accept it. Pure."""

from typing import Any

import numpy as np

from autopilot_bridge.items import MissionItem
from firemodel.landscape import Landscape
from mission_service.config_sections import VehicleSection
from mission_service.separation import track_of


def figures_of(
    items: tuple[MissionItem, ...],
    landscape: Landscape,
    section: VehicleSection,
    start_m: tuple[float, float] | None,
) -> dict[str, Any]:
    """How long and how high a mission leads; from ``start_m`` (x, y) if the vehicle is in the air.

    Heights are above the landscape's terrain, at the lowest the mission allows.
    """
    track = track_of(items, landscape, section.loiter_radius_m, start_m)
    x_m, y_m = track.points_m.T
    ground_m = np.asarray(landscape.elevation_at(x_m, y_m))
    lowest_m = track.lowest_m - ground_m
    at = int(np.argmin(lowest_m))
    lat_deg, lon_deg = landscape.lat_lon_of(x_m[at], y_m[at])
    way_m = float(np.hypot(*np.diff(track.points_m, axis=0).T).sum())
    on_map = [landscape.contains(*place) for place in track.points_m.tolist()]
    return {
        "items": len(items),
        "length_m": round(way_m),
        "duration_s": round(way_m / section.airspeed_m_s),
        "least_height_agl_m": round(float(lowest_m[at]), 1),
        "least_height_lat_deg": round(float(lat_deg), 6),
        "least_height_lon_deg": round(float(lon_deg), 6),
        "most_altitude_amsl_m": round(float(track.highest_m.max()), 1),
        "stays_on_map": all(on_map),
    }
