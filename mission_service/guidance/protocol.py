"""What every planner does, so that the core, the experiments and the replay can fly any of them.

A planner steers one vehicle. Several vehicles that share a plan each have a seat in the team's
planner; a seat is a planner too. Planners are pure: no clock, no network, no randomness of their
own. Positions are float (row, col) of the landscape's grid, row 0 in the north.
"""

from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from mission_service.commands import AnyCommand
from mission_service.events import CrewEvent, Observed, VehicleEvent
from mission_service.position_fix import Here
from mission_service.vehicles.state import Vehicle

Floats = NDArray[np.float64]
Phase = Literal["approach", "initial circle", "monitor"]


@dataclass(frozen=True, slots=True)
class Decision:
    """Which way to fly, taken at one cell of the front.

    ``importance_back`` and ``importance_front`` are what speaks for turning back and for going on,
    in the planner's own unit (Islam & Hu: eqs. 5 and 6).
    """

    clockwise: bool
    reversed: bool
    importance_back: float
    importance_front: float
    front_cells: int


class Steered(Protocol):
    """What takes in all that is told of one vehicle."""

    def observe(self, observed: Observed) -> None:
        """Take in what this vehicle's camera saw."""

    def correct(self, told: Observed) -> None:
        """Take in what people say of a window of the fire, whatever was seen there."""

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Take in the wind that this vehicle's autopilot measured; from true north."""

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """The vehicle is here now; a decision whenever one is taken."""

    def left(self, at_s: float) -> None:
        """The vehicle is lost, recalled or on the ground: others take over what it watched."""


class Planner(Steered, Protocol):
    """Decides for one vehicle which way along the front it flies."""

    @property
    def phase(self) -> Phase:
        """Where it stands: still on its way to the fire, on its first lap, or monitoring."""

    @property
    def clockwise(self) -> bool:
        """The flying direction around the fire."""

    @property
    def reversals(self) -> int:
        """How often it has turned back."""

    def path(self, row: float, col: float) -> Floats:
        """Where to fly: (n, 2) float (row, col) along the front ahead, in flying direction."""

    def shape(self, row: float, col: float) -> Floats:
        """The fire as the planner believes it to be: its front in cells on 360 bearings."""


class Leader(Protocol):
    """What a vehicle does in the air, while it can be counted on: along a front, or on orbits."""

    def heard(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Take note of any event; it has been taken in by ``Steering`` already."""

    def told(self, event: CrewEvent) -> list[AnyCommand]:
        """What a person did or said."""

    def news(self, vehicle: Vehicle, at_s: float, decision: Decision | None) -> list[AnyCommand]:
        """What there is to tell at a position."""

    def lead(self, vehicle: Vehicle, here: Here) -> list[AnyCommand]:
        """What the vehicle is to do now; it flies, and has time left."""

    def way_home(self, vehicle: Vehicle, here: Here) -> list[AnyCommand] | None:
        """What it is to do whose time is nearly over; None: from here its autopilot flies home."""

    def first_path(self, vehicle: Vehicle, here: Here) -> Floats | None:
        """Where its first mission leads: (n, 2) x, y in metres; None: nothing to fly yet."""

    def items(self, vehicle: Vehicle, path_m: Floats, here: Here) -> tuple[MissionItem, ...]:
        """The mission that flies a path and loiters at its end."""

    def status(self) -> dict[str, Any]:
        """Where it stands, for people; ``complete``: nothing would be lost if it ended now."""

    def in_mission(self, name: str) -> bool:
        """Whether the vehicle, in the air, flies the mission it has on board."""
