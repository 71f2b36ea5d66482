"""The state of one vehicle, whatever it flies."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from mission_service.commands import Announce
from mission_service.config.sections import VehicleSection
from mission_service.missions.landing import Landing
from mission_service.vehicles.availability import Presence

Floats = NDArray[np.float64]


@dataclass
class Pending:
    """A mission on its way to the vehicle."""

    mission_id: int
    line: shapely.LineString
    takes_off: bool = False  # whether it begins with a takeoff
    due: str = ""  # why it was due at once, when it was planned


@dataclass(frozen=True)
class Refusal:
    """A proposed mission that an operator has refused: none like it is proposed again."""

    by: str
    due: str  # why it was due at once, if it was
    line: shapely.LineString


@dataclass
class Doubt:
    """What was so when the service went down, and may be otherwise now."""

    pending: Pending | None
    recalled: bool  # it was ordered home
    starting: bool
    resumed: bool = False  # by a person, since: it is started when its mission is known


@dataclass
class Vehicle:
    """What the core knows of one vehicle."""

    section: VehicleSection
    presence: Presence
    home_m: tuple[float, float]
    landing: Landing  # of its missions
    atomic_upload: bool = False
    deployed: bool = False
    started: bool = False
    holding: bool = False
    ordered: Literal["", "hold"] = ""  # by a person
    hold_under_way_s: float | None = None  # since when a hold has had no answer
    hold_again_at_s: float | None = None  # until its autopilot has said yes
    waits_for_crew: bool = False  # it has flown: on the ground only an operator's order starts it
    start_again_at_s: float | None = None
    return_again_at_s: float | None = None
    going_home: bool = False  # led there, because its time in the air is nearly over
    sent_home: bool = False
    pending: Pending | None = None
    proposed: Pending | None = None  # waits for an operator's approval
    refusal: Refusal | None = None
    airspeed_m_s: float | None = None  # a mean of what its autopilot measures
    airspeed_differs_since_s: float | None = None  # from the commanded one
    airspeed_alarm: bool = False
    text_at_s: float | None = None  # its autopilot's last warning that stands as an alarm
    flown_line: shapely.LineString | None = None  # of the mission on board that can be trusted
    takes_off: bool = False  # by its mission, and has not gone on to the next item
    uploaded_at_s: float = -1e9
    not_before_s: float = -1e9
    due: str = ""  # why a new mission is due at once
    mode: str = ""  # as told last
    accepted: Pending | None = None  # the mission that its autopilot has said yes to last
    start_under_way: bool = False
    start_told: bool = False  # that its mission was started, and nothing has ended that since
    doubt: Doubt | None = None  # since the service was down, until its mission was read back
    read_back: Literal["", "same", "new", "unknown"] = ""

    @property
    def name(self) -> str:
        """By the scenario."""
        return self.section.name

    @property
    def awaits_mission(self) -> bool:
        """Whether a mission is on its way to it, or waits for an operator's approval."""
        return self.pending is not None or self.proposed is not None

    def end_intentions(self) -> None:
        """Cancel commands that were to be repeated, or to follow another one."""
        self.start_again_at_s = self.return_again_at_s = None
        self.holding = self.start_under_way = False


def say(vehicle: Vehicle, text: str, warning: bool = False) -> Announce:
    """A line for the operator."""
    return Announce(vehicle.name, text, "warning" if warning else "info")
