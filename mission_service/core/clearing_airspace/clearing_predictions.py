"""Predicts when each vehicle is out while airspace is being cleared, and states a time. Pure."""

import math

import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from firemodel.landscape.landscape import Landscape
from mission_service.airspace.volumes import Volume
from mission_service.core.clearing_airspace.clearing_times import (
    copter_landing_s,
    exit_s,
    out_by_s,
    plane_landing_s,
    queued,
)
from mission_service.core.energy_watch import EnergyWatch
from mission_service.core.landings import Landings
from mission_service.errors import ScenarioError
from mission_service.vehicles.clearing_state import ClearingProgress, ClearingState
from mission_service.vehicles.vehicle_state import Vehicle


class ClearingPredictions:
    """The predicted flights of all vehicles."""

    def __init__(
        self,
        landscape: Landscape,
        vehicles: dict[str, Vehicle],
        landings: Landings,
        energy: EnergyWatch,
    ) -> None:
        self._landscape = landscape
        self._vehicles = vehicles
        self._landings = landings
        self._energy = energy
        self._flights_s: dict[str, float] = {}  # durations of landings that have not begun

    def turn(self, vehicle: Vehicle) -> tuple[bool, float, float, str]:
        """Return the sort key of landings: those already begun, then by least time left on task.

        Of the vehicles without an energy estimate, the one nearest to home lands first.
        """
        found, fix = vehicle.energy.estimate, vehicle.availability.fix
        on_task_s = math.inf if found is None else found.time_on_task_s
        away_m = math.inf if fix is None else math.dist((fix.x_m, fix.y_m), vehicle.home_m)
        return not vehicle.landing_state.active, on_task_s, away_m, vehicle.name

    def predict(self, state: ClearingState, volume: Volume | None, at_s: float) -> None:
        """Update all vehicles' expected times, and state a time for those that have none."""
        if volume is None:
            self._expect_landings(state, at_s)
        else:
            for name, progress in state.vehicles.items():
                self._expect_exit(self._vehicles[name], progress, volume, at_s)
        for progress in state.vehicles.values():
            expected_s = progress.expected_at_s
            if expected_s is not None and progress.out_by_s is None:
                progress.out_by_s = out_by_s(at_s, expected_s)

    def _expect_landings(self, state: ClearingState, at_s: float) -> None:
        """Predict the landings of the vehicles that are ordered to land, in landing order."""
        under_way = ("ordered", "acknowledged", "waiting", "on its way")
        names = [name for name, each in state.vehicles.items() if each.phase in under_way]
        begun, waiting = [], []
        for name in names:
            landing = self._vehicles[name].landing_state
            progress = state.vehicles[name]
            if landing.uses_field or progress.phase == "on its way":
                begun.append(name)
                if progress.flies_until_s is None:
                    progress.flies_until_s = at_s + self._landing_s(self._vehicles[name], at_s)
            else:
                waiting.append(name)
                progress.flies_until_s = None
                if progress.out_by_s is None:
                    self._flights_s[name] = self._landing_s(self._vehicles[name], at_s)
        turns = [*begun, *sorted(waiting, key=self._turn_now)]
        ends_s = queued(
            [
                (
                    self._vehicles[name].home_m,
                    state.vehicles[name].flies_until_s,
                    self._flights_s.get(name, 0.0),
                )
                for name in turns
            ],
            at_s,
        )
        for progress in state.vehicles.values():
            progress.expected_at_s = None
        for name, end_s in zip(turns, ends_s, strict=True):
            state.vehicles[name].expected_at_s = end_s if math.isfinite(end_s) else None

    def _turn_now(self, name: str) -> tuple[bool, float, int, str]:
        """Return the sort key of waiting vehicles; those not yet ordered to land come last."""
        landing = self._vehicles[name].landing_state
        return not landing.active, *landing.turn(name)

    def _landing_s(self, vehicle: Vehicle, at_s: float) -> float:
        """Return the duration (s) of a landing that begins now; infinity if it is unknown."""
        fix = vehicle.availability.fix
        if fix is None:
            return math.inf
        wind_m_s = self._energy.wind_m_s(vehicle, at_s)
        if vehicle.section.kind == "copter":
            height_m = self._energy.return_height_m(vehicle)
            return copter_landing_s(vehicle, fix, wind_m_s, height_m)
        mission = vehicle.landing_state.mission if vehicle.landing_state.uses_field else None
        try:
            mission = mission or self._landings.mission_from(vehicle, fix)
        except ScenarioError:
            return math.inf
        loiter = next(
            item for item in mission.items if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT
        )
        x_m, y_m = self._landscape.xy_of_lat_lon(loiter.x / 1e7, loiter.y / 1e7)
        return plane_landing_s(vehicle, fix, mission, (float(x_m), float(y_m)), wind_m_s)

    def _expect_exit(
        self, vehicle: Vehicle, progress: ClearingProgress, volume: Volume, at_s: float
    ) -> None:
        """Predict when a vehicle leaves a volume, once its way out is planned."""
        fix, line = vehicle.availability.fix, _way_out(vehicle, progress)
        if progress.phase in ("out", "on the ground", "not reached") or fix is None:
            progress.expected_at_s = None
        elif progress.expected_at_s is not None:
            progress.expected_at_s = max(progress.expected_at_s, at_s)
        elif line is not None:
            wind_m_s = self._energy.wind_m_s(vehicle, at_s)
            progress.expected_at_s = at_s + exit_s(vehicle, fix, line, volume.area_m, wind_m_s)


def _way_out(vehicle: Vehicle, progress: ClearingProgress) -> shapely.LineString | None:
    """Return the path by which a vehicle leaves a volume, if it is planned."""
    pending = vehicle.pending
    if pending is not None and pending.evades:
        return pending.line
    return vehicle.flown_line if progress.phase in ("acknowledged", "on its way") else None
