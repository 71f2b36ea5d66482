"""Events to decisions: who can be counted on, and what the planners decide. No missions yet.

The core flies by this, and ``decide`` runs it alone on a journal.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from firemodel.landscape import Landscape
from mission_service.commands import Decided
from mission_service.config import Scenario
from mission_service.events import (
    LinkLost,
    LinkRestored,
    ModeChanged,
    Observed,
    Telemetry,
    VehicleConnected,
    VehicleEvent,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.planners.protocol import Decision, Planner, Steered

AIRBORNE_M = 15.0
GOING_HOME = ("return", "land")  # by the bridge's names of modes


@dataclass(frozen=True, slots=True)
class Here:
    """Where a vehicle is: on the grid, in metres, and how it moves over the ground."""

    at_s: float
    row: float
    col: float
    x_m: float
    y_m: float
    altitude_m: float
    east_m_s: float
    north_m_s: float


@dataclass(slots=True)
class Presence:
    """Whether a vehicle can be counted on."""

    online: bool = False
    airborne: bool = False
    recalled: bool = False  # on its way home, or told to go
    took_off_at_s: float = np.inf
    wind_m_s: float = 0.0
    mode: str = ""  # as told last
    here: Here | None = None

    @property
    def flies(self) -> bool:
        """Heard, in the air and not on its way home."""
        return self.online and self.airborne and not self.recalled


class Steering:
    """What steers a scenario's vehicles, fed with events."""

    def __init__(
        self, scenario: Scenario, landscape: Landscape, planners: Mapping[str, Steered]
    ) -> None:
        self.planners = planners
        self.presence = {section.name: Presence() for section in scenario.vehicles}
        self._landscape = landscape
        self._deploy_at_s = scenario.deploy_at_s
        burn = scenario.burn
        self._airborne_m = AIRBORNE_M if burn is None else burn.drop_height_m / 2.0

    def take(self, event: VehicleEvent) -> Decision | None:
        """Take in one event; the decision it leads to, if any."""
        name, at_s = event.vehicle, event.at_us / 1e6
        presence = self.presence[name]
        match event:
            case Telemetry():
                return self._moved(presence, event)
            case Observed(corrects=True):
                self.planners[name].correct(event)
            case Observed():
                self.planners[name].observe(event)
            case WindMeasured() if presence.airborne:  # on the ground it is a guess
                presence.wind_m_s = event.speed_m_s
                self.planners[name].wind(event.speed_m_s, event.from_deg, at_s)
            case VehicleConnected() | LinkRestored():
                presence.online = True
            case LinkLost():
                presence.online = False
                self.planners[name].left(at_s)
            case VehicleRebooted():
                presence.airborne = presence.recalled = False
                presence.mode = ""
                self.planners[name].left(at_s)
            case ModeChanged():
                self._mode_changed(name, event.mode, event.armed, at_s)
            case _:
                pass
        return None

    def recall(self, name: str, at_s: float) -> None:
        """The vehicle is told to fly home."""
        self.presence[name].recalled = True
        self.planners[name].left(at_s)

    def _mode_changed(self, name: str, mode: str, armed: bool, at_s: float) -> None:
        presence = self.presence[name]
        presence.mode = mode
        if not armed:
            presence.airborne = presence.recalled = False
            self.planners[name].left(at_s)
        elif mode in GOING_HOME and presence.airborne:
            self.recall(name, at_s)
        elif mode == "mission":  # somebody has sent it back to its mission
            presence.recalled = False

    def _moved(self, presence: Presence, told: Telemetry) -> Decision | None:
        x_m, y_m = self._landscape.xy_of_lat_lon(told.lat_deg, told.lon_deg)
        if not math.isfinite(x_m + y_m):  # too far from the landscape for its projection
            return None
        row, col = (float(value) for value in self._landscape.row_col_of(x_m, y_m))
        at_s = told.at_us / 1e6
        velocity = (told.velocity_east_m_s, told.velocity_north_m_s)
        presence.here = Here(at_s, row, col, x_m, y_m, told.altitude_amsl_m, *velocity)
        # Home may lie on a hill: once up, a vehicle flies until it disarms.
        if not presence.airborne and told.altitude_relative_m >= self._airborne_m:
            presence.airborne, presence.took_off_at_s = True, at_s
            if presence.mode in GOING_HOME:  # told before it was known to be in the air
                self.recall(told.vehicle, at_s)
        if not presence.flies or at_s < self._deploy_at_s:
            return None
        return self.planners[told.vehicle].at(row, col, at_s)


def decided(name: str, planner: Planner, decision: Decision) -> Decided:
    """A decision as it is told and recorded."""
    return Decided(
        name,
        "clockwise" if decision.clockwise else "anticlockwise",
        decision.reversed,
        planner.reversals,
        decision.importance_back,
        decision.importance_front,
        decision.front_cells,
    )
