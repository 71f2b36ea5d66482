"""Derives, from events and commands, the other aircraft that interfaces show. Pure."""

import math
from typing import get_args

from mission_service.events import AircraftReported, AircraftState
from mission_service.ground_distance import offset_m
from mission_service.runtime.published_states import (
    AircraftAlert,
    NearbyAircraft,
    TelemetryState,
)

ALERTS: tuple[AircraftAlert, ...] = get_args(AircraftAlert)  # by level


class AircraftView:
    """The aircraft near each vehicle, and their alert levels."""

    def __init__(self) -> None:
        self._reported: dict[str, AircraftReported] = {}
        self._levels: dict[tuple[str, str], int] = {}  # by vehicle and aircraft

    def on_reported(self, event: AircraftReported) -> None:
        """Replace the aircraft near a vehicle."""
        self._reported[event.vehicle] = event

    def on_level(self, vehicle: str, aircraft: str, level: int) -> None:
        """Set a vehicle's alert level for an aircraft; 0 ends the alert."""
        if level:
            self._levels[vehicle, aircraft] = level
        else:
            self._levels.pop((vehicle, aircraft), None)

    def nearby(self, telemetry: dict[str, TelemetryState]) -> list[NearbyAircraft]:
        """Return each aircraft once, ordered by identifier."""
        found: dict[str, NearbyAircraft] = {}
        for name, event in sorted(self._reported.items()):
            fix = telemetry.get(name)
            if fix is None:
                continue
            for each in event.aircraft:
                level = self._levels.get((name, each.aircraft), 0)
                state = _state(event.at_us, each, level, fix)
                before = found.get(each.aircraft)
                if before is None or _order(state) < _order(before):
                    found[each.aircraft] = state
        return [found[key] for key in sorted(found)]


def _order(state: NearbyAircraft) -> tuple[int, float]:
    return -ALERTS.index(state.alert), state.distance_m


def _state(at_us: int, aircraft: AircraftState, level: int, fix: TelemetryState) -> NearbyAircraft:
    north_m_s, east_m_s = aircraft.velocity_north_m_s, aircraft.velocity_east_m_s
    north_m, east_m = offset_m((fix.lat_deg, fix.lon_deg), (aircraft.lat_deg, aircraft.lon_deg))
    return NearbyAircraft(
        at_us,
        aircraft.aircraft,
        aircraft.callsign,
        aircraft.lat_deg,
        aircraft.lon_deg,
        aircraft.altitude_amsl_m,
        round(math.hypot(north_m_s, east_m_s), 2),
        round(math.degrees(math.atan2(east_m_s, north_m_s)) % 360.0, 1),
        aircraft.climb_m_s,
        aircraft.age_s,
        aircraft.source,
        ALERTS[level],
        fix.vehicle,
        round(math.hypot(north_m, east_m), 1),
        round(aircraft.altitude_amsl_m - fix.altitude_amsl_m, 1),
    )
