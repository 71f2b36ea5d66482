"""Raises alerts about other aircraft, and gives orders that resolve conflicts. Pure.

An order by the service takes the same path as an operator's order (``OrderByService``). It is never
given to a vehicle that is in a failsafe, in a mode selected by its pilot, on its way home or under
an operator's order, and it remains in force until an operator's order. Only one order is given for
each conflict with an aircraft, so that the service does not override an operator who has resumed
the vehicle.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from autopilot_bridge.items import LANDINGS
from firemodel.landscape.landscape import Landscape
from mission_service import events
from mission_service.commands import (
    AlertOnAircraft,
    AnyCommand,
    ClearAlarm,
    OrderByService,
    RaiseAlarm,
    Severity,
    UploadMission,
)
from mission_service.config.scenario import Scenario
from mission_service.config.surveillance_section import SurveillanceSection
from mission_service.ground_distance import M_PER_FT, distance_m, offset_m
from mission_service.surveillance.alerting import ALERT_SETS, CORRECTIVE, WARNING, AlertHistory
from mission_service.surveillance.altitude_change import AltitudeChange, VerticalLimits, violates
from mission_service.surveillance.well_clear import Encounter, WellClearVolume, violation
from mission_service.vehicles.availability import AIRBORNE_M, MISSION
from mission_service.vehicles.landing_state import LandingPhase
from mission_service.vehicles.preflight_checks import NearestAircraft
from mission_service.vehicles.vehicle_state import Vehicle, announce

ALARM = "aircraft"
LAST_LEG = (LandingPhase.FINAL, LandingPhase.GOING_AROUND)
LOW_M = 20.0  # below this height above ground, a vehicle takes off or lands: no order is given
AGAIN_US = 5_000_000  # an order lost from the journal in a crash is given again after this time
MIN_DESCENT_M = 10.0  # a smaller descent is a hold
UNDER_M = 1000.0  # a vehicle within this horizontal distance is under another vehicle
AROUND = 2.0  # loiter radii around the hold in which the terrain is considered
# A near mid-air collision: 500 ft and 100 ft (RTCA DO-365).
NEAR_COLLISION = WellClearVolume(500.0 * M_PER_FT, 100.0 * M_PER_FT)
# The default descent limits of copters with either stack, and those of a fast plane.
DESCENTS = (VerticalLimits(1.5, 1.0), VerticalLimits(4.0, 2.0))  # m/s and m/s^2


@dataclass
class _Surroundings:
    """The state for one vehicle: its motion, and the aircraft near it."""

    own: events.Telemetry | None = None
    reported: tuple[events.AircraftState, ...] = ()  # aircraft in the last report
    climb_m_s: float = 0.0
    landing_items: frozenset[int] = frozenset()  # indices of landings in the mission on board
    sent: dict[int, frozenset[int]] = field(default_factory=dict)  # likewise, by mission being sent
    landing: bool = False  # as EXTENDED_SYS_STATE reports
    histories: dict[str, AlertHistory] = field(default_factory=dict)
    alarm: tuple[str, int] | None = None  # aircraft and level of the alarm
    resolved: set[str] = field(default_factory=set)  # aircraft for which an order was given
    ordered_us: int | None = None  # time of the service's last order


class OtherAircraft:
    """The alerts about other aircraft, and their resolution."""

    def __init__(
        self, section: SurveillanceSection, scenario: Scenario, landscape: Landscape
    ) -> None:
        self._section = section
        self._landscape = landscape
        self._separation_m = scenario.mission.separation_m
        # Descending vehicles keep their order in height and their vertical separation.
        ranked = sorted(scenario.vehicles, key=lambda each: each.altitude_agl_m)
        self._layer_m = {
            each.name: rank * scenario.mission.separation_m for rank, each in enumerate(ranked)
        }
        self._around: dict[str, _Surroundings] = {}

    def _of(self, name: str) -> _Surroundings:
        return self._around.setdefault(name, _Surroundings())

    def on_event(self, event: events.AnyEvent) -> None:
        """Update the motion and the landing of a vehicle, and the orders given."""
        match event:
            case events.Telemetry():
                self._moved(self._of(event.vehicle), event)
            case events.LandedStateChanged():
                self._of(event.vehicle).landing = event.state == "landing"
            case events.UploadFinished():
                near = self._of(event.vehicle)
                items = near.sent.pop(event.mission_id, None)
                if event.outcome == "accepted" and items is not None:
                    near.landing_items = items
            case events.OrderGiven(by=events.SERVICE):
                near = self._of(event.vehicle)
                corrective = (key for key, each in near.histories.items() if _corrective(each))
                near.resolved.update(corrective)
            case _:
                pass

    def on_command(self, command: AnyCommand) -> None:
        """Record the landing items of a mission that is sent."""
        if isinstance(command, UploadMission):
            found = (n for n, item in enumerate(command.items) if item.command in LANDINGS)
            self._of(command.vehicle).sent = {command.mission_id: frozenset(found)}

    @staticmethod
    def _moved(near: _Surroundings, event: events.Telemetry) -> None:
        before = near.own
        if before is not None and before.at_us < event.at_us:
            step_s = (event.at_us - before.at_us) / 1e6
            climb_m_s = (event.altitude_amsl_m - before.altitude_amsl_m) / step_s
            weight = min(step_s, 1.0)  # smoothed over about a second
            near.climb_m_s += weight * (climb_m_s - near.climb_m_s)
        near.own = event

    def nearest(self, name: str) -> NearestAircraft | None:
        """Return the nearest aircraft in the last report for a vehicle."""
        near = self._of(name)
        if near.own is None:
            return None
        here = (near.own.lat_deg, near.own.lon_deg)
        found = (
            NearestAircraft(
                each.callsign or each.aircraft,
                distance_m(here, (each.lat_deg, each.lon_deg)),
                each.altitude_amsl_m - near.own.altitude_amsl_m,
            )
            for each in near.reported
        )
        return min(found, key=lambda each: each.distance_m, default=None)

    def reported(
        self, vehicle: Vehicle, event: events.AircraftReported, led_home: bool
    ) -> list[AnyCommand]:
        """Return changed alerts, the vehicle's alarm and, if one is due, an order.

        ``led_home`` states whether the vehicle was sent home and the service controls its way.
        """
        near = self._of(vehicle.name)
        near.reported = event.aircraft
        if near.own is None:
            return []
        if event.own_position_unknown:  # alerts, the alarm and resolved conflicts stay as they are
            words = "own position is too old: the alerts about other aircraft are not updated"
            return [announce(vehicle, words, warning=True)] if near.alarm else []
        alerts = ALERT_SETS[self._section.alerts]
        airborne = vehicle.availability.airborne
        before = {key: max(each.level, 0) for key, each in near.histories.items()}
        seen = {each.aircraft: each for each in event.aircraft if airborne}
        encounters = {key: _encounter(near, each, event.at_us) for key, each in seen.items()}
        histories = {key: near.histories.get(key) or AlertHistory() for key in seen}
        for key, encounter in encounters.items():
            histories[key].add_encounter(alerts, encounter, event.at_us)
        near.histories = histories
        levels = {key: each.level for key, each in histories.items()}
        near.resolved = {key for key in sorted(near.resolved) if levels.get(key, 0) > 0}
        commands: list[AnyCommand] = [
            AlertOnAircraft(vehicle.name, key, levels.get(key, 0))
            for key in sorted({**before, **levels})
            if levels.get(key, 0) != before.get(key, 0)
        ]
        for key, level in before.items():
            if airborne and level > 0 and key not in seen:
                words = f"aircraft {key} is out of range or no longer received; its alert ends"
                commands.append(announce(vehicle, words, warning=True))
        commands += self._alarm(vehicle, near, levels, seen, encounters)
        if led_home:
            return commands
        return commands + self._resolve(vehicle, near, levels, event.at_us)

    def _alarm(
        self,
        vehicle: Vehicle,
        near: _Surroundings,
        levels: Mapping[str, int],
        seen: Mapping[str, events.AircraftState],
        encounters: Mapping[str, Encounter],
    ) -> list[AnyCommand]:
        """Raise the alarm about the most severe alert, or clear it; announce higher levels."""
        key = max(levels, key=lambda each: (levels[each], each), default="")
        level = levels.get(key, 0)
        if level == 0:
            had, near.alarm = near.alarm, None
            return [ClearAlarm(vehicle.name, ALARM)] if had else []
        if near.alarm is not None and near.alarm[1] == level and levels.get(near.alarm[0]) == level:
            return []  # about the same aircraft
        risen = near.alarm is None or near.alarm[1] < level
        near.alarm = (key, level)
        alerts = ALERT_SETS[self._section.alerts]
        found = violation(encounters[key], alerts.levels[level - 1].volume, alerts.lookahead_s)
        words = _described(seen[key], encounters[key], found)
        severity: Severity = "severe" if level >= WARNING else "warning"
        commands: list[AnyCommand] = [RaiseAlarm(vehicle.name, ALARM, words, severity)]
        return [*commands, announce(vehicle, words, warning=True)] if risen else commands

    def _resolve(
        self, vehicle: Vehicle, near: _Surroundings, levels: Mapping[str, int], at_us: int
    ) -> list[AnyCommand]:
        """Return the service's order for a corrective alert, if it may be given."""
        new = [key for key, level in levels.items() if level >= CORRECTIVE]
        new = [key for key in new if key not in near.resolved]
        if self._section.resolution == "none" or not new or near.own is None:
            return []
        just_ordered = near.ordered_us is not None and at_us - near.ordered_us < AGAIN_US
        if (
            just_ordered
            or vehicle.ordered
            or not vehicle.availability.flies
            or self._lands(vehicle, near)
        ):
            return []
        near.ordered_us = at_us
        if self._section.resolution == "return":
            return [OrderByService(vehicle.name, "return")]
        if self._section.resolution == "hold":
            return [OrderByService(vehicle.name, "hold")]
        lower = self._lower(vehicle, near.own)
        if lower is not None and self._descent_is_worse(near, lower[2], at_us):
            words = "holds at its altitude: a descent would conflict with other aircraft"
            return [announce(vehicle, words), OrderByService(vehicle.name, "hold")]
        return [OrderByService(vehicle.name, "hold", lower)]

    def _descent_is_worse(self, near: _Surroundings, altitude_amsl_m: float, at_us: int) -> bool:
        """Return whether a lower hold conflicts more with other aircraft than a hold here.

        Near collisions are compared first, then losses of well clear. The vehicle is assumed to
        stay in place, and conflicts are counted for each of the ``DESCENTS``.
        """
        own, alerts = near.own, ALERT_SETS[self._section.alerts]
        assert own is not None
        lookahead_s = alerts.levels[CORRECTIVE - 1].early_alerting_s
        encounters = [
            _encounter(near, each, at_us)._replace(
                east_m_s=each.velocity_east_m_s, north_m_s=each.velocity_north_m_s
            )
            for each in near.reported
        ]
        later_s = max(at_us - own.at_us, 0) / 1e6
        descent_m = altitude_amsl_m - own.altitude_amsl_m - later_s * near.climb_m_s

        def conflicts(change_m: float, limits: VerticalLimits) -> tuple[int, int]:
            """Return the number of near collisions and of losses of well clear."""
            change = AltitudeChange(change_m, near.climb_m_s, limits)
            near_collisions, losses = (
                sum(
                    violates(each, change, near.climb_m_s, volume, lookahead_s, lookahead_s)
                    for each in encounters
                )
                for volume in (NEAR_COLLISION, alerts.well_clear)
            )
            return near_collisions, losses

        return all(conflicts(descent_m, each) > conflicts(0.0, each) for each in DESCENTS)

    def _lands(self, vehicle: Vehicle, near: _Surroundings) -> bool:
        """Return whether a vehicle is near the ground or on the final leg of a landing."""
        in_mission = vehicle.availability.mode == MISSION
        last_leg = in_mission and vehicle.current_seq in near.landing_items
        assert near.own is not None
        last_leg |= vehicle.landing_state.landing_phase in LAST_LEG
        return near.landing or last_leg or self._height_m(near.own) < LOW_M

    def _height_m(self, own: events.Telemetry) -> float:
        """Return the height above ground, or outside the landscape the height above home."""
        place_m = self._landscape.xy_of_lat_lon(own.lat_deg, own.lon_deg)
        if self._landscape.elevation_m is None or not self._landscape.contains(*place_m):
            return own.altitude_relative_m
        return own.altitude_amsl_m - float(self._landscape.elevation_at(*place_m))

    def _lower(self, vehicle: Vehicle, own: events.Telemetry) -> tuple[float, float, float] | None:
        """Return the position of a lower hold; None for a hold at the current altitude.

        The height ``descend_to_agl_m`` is above the highest terrain around the position. A vehicle
        in a higher layer stays above those in lower layers, and above any vehicle below it.
        """
        ground_m = own.altitude_amsl_m - own.altitude_relative_m
        x_m, y_m = self._landscape.xy_of_lat_lon(own.lat_deg, own.lon_deg)
        if self._landscape.elevation_m is not None:
            offsets = AROUND * vehicle.section.loiter_radius_m * np.linspace(-1.0, 1.0, 9)
            east_m, north_m = np.meshgrid(x_m + offsets, y_m + offsets)
            inside = [
                self._landscape.contains(float(x), float(y))
                for x, y in zip(east_m.flat, north_m.flat, strict=True)
            ]
            if not all(inside):
                return None  # the terrain is unknown
            ground_m = float(np.max(self._landscape.elevation_at(east_m, north_m)))
        height_m = self._section.descend_to_agl_m + self._layer_m[vehicle.name]
        altitude_m = round(max(ground_m + height_m, self._above_others_m(own)), 1)
        if altitude_m > own.altitude_amsl_m - MIN_DESCENT_M:
            return None
        return own.lat_deg, own.lon_deg, altitude_m

    def _above_others_m(self, own: events.Telemetry) -> float:
        """Return the lowest altitude that keeps a vehicle clear of the run's vehicles below it."""
        floor_m = -math.inf
        for name, near in sorted(self._around.items()):
            other = near.own
            if name == own.vehicle or other is None or other.altitude_relative_m < AIRBORNE_M:
                continue
            places = (own.lat_deg, own.lon_deg), (other.lat_deg, other.lon_deg)
            if distance_m(*places) < UNDER_M and other.altitude_amsl_m < own.altitude_amsl_m:
                floor_m = max(floor_m, other.altitude_amsl_m + self._separation_m)
        return floor_m


def _corrective(history: AlertHistory) -> bool:
    return history.level >= CORRECTIVE


def _encounter(near: _Surroundings, other: events.AircraftState, at_us: int) -> Encounter:
    """Return the encounter; the vehicle's position is extrapolated to the given time."""
    own = near.own
    assert own is not None
    later_s = max(at_us - own.at_us, 0) / 1e6
    north_m, east_m = offset_m((own.lat_deg, own.lon_deg), (other.lat_deg, other.lon_deg))
    own_up_m = own.altitude_amsl_m + later_s * near.climb_m_s
    return Encounter(
        east_m - later_s * own.velocity_east_m_s,
        north_m - later_s * own.velocity_north_m_s,
        other.altitude_amsl_m - own_up_m,
        other.velocity_east_m_s - own.velocity_east_m_s,
        other.velocity_north_m_s - own.velocity_north_m_s,
        other.climb_m_s - near.climb_m_s,
    )


def _described(
    other: events.AircraftState, encounter: Encounter, found: tuple[float, float] | None
) -> str:
    """Return an alert in words."""
    bearing_deg = math.degrees(math.atan2(encounter.east_m, encounter.north_m)) % 360.0
    side = "above" if encounter.up_m >= 0.0 else "below"
    if found is None:
        when = "it has passed"
    elif found[0] <= 0.0:
        when = "not well clear"
    else:
        when = f"not well clear in {found[0]:.0f} s"
    return (
        f"aircraft {other.callsign or other.aircraft} {encounter.distance_m / 1e3:.1f} km at "
        f"{bearing_deg:03.0f} deg, {abs(encounter.up_m):.0f} m {side}: {when}"
    )
