"""What flies vehicles: planners, and the guidance that has vehicles fly by them.

A planner steers one vehicle. Several vehicles that share a plan each have a seat in the team's
planner; a seat is a planner too. Planners are pure: no clock, no network, no randomness of their
own. Positions are float (row, col) of the landscape's grid, row 0 in the north.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, DirectionDecision, Drop
from mission_service.events import AnyEvent, AnyOperatorEvent, Observed, VehicleEvent
from mission_service.position_fix import PositionFix
from mission_service.vehicles.vehicle_state import Vehicle

if TYPE_CHECKING:
    from mission_service.fire.estimated import EstimatedFire

Floats = NDArray[np.float64]
Phase = Literal["approach", "initial circle", "monitor"]


@dataclass(frozen=True)
class Ground:
    """Where a fire is watched: the grid, the cell the fire is said to be in, and since when."""

    landscape: Landscape
    centre: tuple[float, float]  # row, col
    burns_from_s: float


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


def decided(name: str, planner: Planner, decision: Decision) -> DirectionDecision:
    """A vehicle's decision as it is announced and recorded."""
    return DirectionDecision(
        name,
        "clockwise" if decision.clockwise else "anticlockwise",
        decision.reversed,
        planner.reversals,
        decision.importance_back,
        decision.importance_front,
        decision.front_cells,
    )


class Compared(NamedTuple):
    """What a planner compares where its vehicle is, cell by cell of the front, for people to see.

    Rows, columns and values are (n,) float, from the vehicle backwards; the sums are of the window
    behind and of the window ahead.
    """

    rows: Floats
    cols: Floats
    values: Floats
    back: float
    front: float


class Awaited(NamedTuple):
    """What a guidance waits for: an approval of this plan ("": none), and answers to its list."""

    plan_hash: str
    answers: bool


class Guidance(ABC):
    """What vehicles do in the air, while they can be counted on; ``planners`` steer them, by name.

    Where a way of flying has nothing to do, it inherits a method that does nothing.
    """

    planners: Mapping[str, Steered]

    def heard(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Take note of any event; it has been taken in by ``DecisionEngine`` already."""
        return []

    def told(self, event: AnyOperatorEvent) -> list[AnyCommand]:
        """What a person did or said."""
        return []

    def news(self, vehicle: Vehicle, at_s: float, decision: Decision | None) -> list[AnyCommand]:
        """What there is to tell at a position."""
        return []

    @abstractmethod
    def lead(self, vehicle: Vehicle, here: PositionFix) -> list[AnyCommand]:
        """What the vehicle is to do now; it flies, and has time left."""

    def way_home(self, vehicle: Vehicle, here: PositionFix) -> list[AnyCommand] | None:
        """What it is to do whose time is nearly over; None: from here its autopilot flies home."""
        return None

    @abstractmethod
    def first_path(self, vehicle: Vehicle, here: PositionFix) -> Floats | None:
        """Where its first mission leads: (n, 2) x, y in metres; None: nothing to fly yet."""

    @abstractmethod
    def items(self, vehicle: Vehicle, path_m: Floats, here: PositionFix) -> tuple[MissionItem, ...]:
        """The mission that flies a path and loiters at its end."""

    def in_mission(self, name: str) -> bool:
        """Whether the vehicle, in the air, flies the mission it has on board."""
        return True

    def after(
        self, event: AnyEvent, leaving: list[AnyCommand], vehicles: Mapping[str, Vehicle]
    ) -> list[AnyCommand]:
        """What there is to tell after an event whose other commands leave now."""
        return []

    # For people and programs ------------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """Where it stands; ``complete``: nothing would be lost if it ended now."""
        return {"complete": True}

    def preview(self, vehicle: Vehicle, here: PositionFix) -> tuple[MissionItem, ...] | None:
        """The mission it would be sent now; nothing is changed by asking. None: there is none."""
        return None

    def compared(self, name: str, here: PositionFix) -> Compared | None:
        """What its planner compares at a place; None where it compares nothing."""
        return None

    def settings(self) -> dict[str, float]:
        """The settings that may change in flight, as they are now."""
        return {}

    def awaited(self) -> Awaited:
        """What people have to do before it goes on."""
        return Awaited("", False)

    @property
    def estimated_fire(self) -> "EstimatedFire | None":
        """The fire that it plans by, where that is not the one that is watched."""
        return None


class Lock(Protocol):
    """The last check before a command is sent to a vehicle, independent of the guidance."""

    def apply(self, event: AnyEvent) -> None:
        """Apply an event."""

    def on_commands(self, commands: Iterable[AnyCommand]) -> None:
        """Apply the commands of the core."""

    def refuses(self, drop: Drop, at_us: int) -> str | None:
        """Why a drop must not be ordered now; None: it may."""

    def may_drop(self, items: Iterable[MissionItem]) -> bool:
        """Whether anything in a mission may switch an output."""

    def status(self) -> dict[str, Any]:
        """Its state, for interfaces."""
