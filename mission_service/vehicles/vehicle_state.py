"""The state of one vehicle in the core, for all ways of flying."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from mission_service.commands import Announce
from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import Landing
from mission_service.vehicles.availability import VehicleAvailability

Floats = NDArray[np.float64]


@dataclass
class Pending:
    """A mission that is being uploaded."""

    mission_id: int
    line: shapely.LineString
    takes_off: bool = False  # it begins with a takeoff
    due: str = ""  # why it was due at once


@dataclass(frozen=True)
class Refusal:
    """A proposed mission that an operator refused; similar missions are not proposed again."""

    by: str
    due: str  # why it was due at once; else empty
    line: shapely.LineString


@dataclass
class UnconfirmedState:
    """State at the end of the last run that the vehicle has not confirmed since."""

    pending: Pending | None
    recalled: bool  # it was ordered home
    starting: bool
    resumed: bool = False  # by an operator since then; it starts after the read-back


@dataclass
class Vehicle:
    """The core's state of one vehicle."""

    section: VehicleSection
    availability: VehicleAvailability
    home_m: tuple[float, float]
    landing: Landing  # of its missions
    atomic_upload: bool = False
    deployed: bool = False
    started: bool = False
    holding: bool = False
    ordered: Literal["", "hold"] = ""  # by an operator
    hold_under_way_s: float | None = None  # when a hold without acknowledgement was sent
    hold_again_at_s: float | None = None  # until the autopilot accepts it
    waits_for_crew: bool = False  # has flown: only an operator's order starts it
    start_again_at_s: float | None = None
    return_again_at_s: float | None = None
    going_home: bool = False  # its endurance is nearly over
    sent_home: bool = False
    pending: Pending | None = None
    proposed: Pending | None = None  # waits for an operator's approval
    refusal: Refusal | None = None
    airspeed_m_s: float | None = None  # a mean of measurements
    airspeed_differs_since_s: float | None = None  # from the commanded one
    airspeed_alarm: bool = False
    text_at_s: float | None = None  # of the last warning text that is an alarm
    flown_line: shapely.LineString | None = None  # of the confirmed mission on board
    takes_off: bool = False  # flies the takeoff item of its mission
    uploaded_at_s: float = -1e9
    not_before_s: float = -1e9
    due: str = ""  # why a new mission is due at once
    mode: str = ""  # as reported last
    accepted: Pending | None = None  # the last mission that the autopilot accepted
    start_under_way: bool = False
    start_told: bool = False  # that its mission was started, and nothing has ended that since
    unconfirmed: UnconfirmedState | None = (
        None  # since the service was down, until its mission was read back
    )
    read_back: Literal["", "same", "new", "unknown"] = ""

    @property
    def name(self) -> str:
        """The vehicle's name in the scenario."""
        return self.section.name

    @property
    def awaits_mission(self) -> bool:
        """Whether a mission is being uploaded or waits for an operator's approval."""
        return self.pending is not None or self.proposed is not None

    def end_intentions(self) -> None:
        """Cancel commands that are due to be repeated or to follow another one."""
        self.start_again_at_s = self.return_again_at_s = None
        self.holding = self.start_under_way = False


def say(vehicle: Vehicle, text: str, warning: bool = False) -> Announce:
    """A line for the operator."""
    return Announce(vehicle.name, text, "warning" if warning else "info")
