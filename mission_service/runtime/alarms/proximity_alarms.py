"""Raises and clears the alarms about aircraft that are too close to each other. Pure."""

import math

import numpy as np

from mission_service.ground_distance import M_PER_DEG
from mission_service.runtime.published_states import TelemetryState
from mission_service.runtime.state_view import StateView
from mission_service.vehicles.availability import AIRBORNE_M

CHECK_EVERY_US = 1_000_000
FRESH_US = 3_000_000  # older positions are not compared


def near_pairs(
    telemetry: dict[str, TelemetryState], at_us: int, separation_m: float
) -> dict[tuple[str, str], float]:
    """Return the 3-D distances in m of airborne pairs that are closer than ``separation_m``."""
    flying = [
        state
        for _, state in sorted(telemetry.items())
        if state.altitude_relative_m >= AIRBORNE_M and at_us - state.at_us <= FRESH_US
    ]
    if len(flying) < 2:
        return {}
    lat, lon, up_m = np.array(
        [(state.lat_deg, state.lon_deg, state.altitude_amsl_m) for state in flying]
    ).T
    north_m, east_m = M_PER_DEG * lat, M_PER_DEG * math.cos(math.radians(float(lat[0]))) * lon
    places = np.column_stack([north_m, east_m, up_m])
    apart_m = np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2))
    pairs = np.argwhere(np.triu(apart_m < separation_m, k=1))
    return {
        (flying[one].vehicle, flying[other].vehicle): float(apart_m[one, other])
        for one, other in pairs.tolist()
    }


class ProximityAlarms:
    """The alarms about pairs of aircraft that are closer together than required."""

    def __init__(self, state_view: StateView, separation_m: float) -> None:
        """Raise alarms in ``state_view``."""
        self._state_view = state_view
        self._separation_m = separation_m
        self._due_us = 0
        self._near: set[str] = set()

    def check_pairs(self, now_us: int) -> None:
        """Check all pairs, at most once a second; ``now_us`` is the time on the machine's clock."""
        if now_us < self._due_us:
            return
        self._due_us = now_us + CHECK_EVERY_US
        found = set()
        view = self._state_view
        pairs = near_pairs(view.telemetry, view.at_us, self._separation_m)
        for (one, other), apart_m in pairs.items():
            key = f"near/{one}/{other}"
            found.add(key)
            if key not in self._near:
                text = f"{one} and {other} are {apart_m:.0f} m apart"
                view.alarm(key, text, "severe", one)
        for key in self._near - found:
            view.clear_alarm(key)
        self._near = found
