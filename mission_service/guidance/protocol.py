"""The interfaces of planners, which decide for vehicles, and of the guidance, which commands them.

A planner decides for one vehicle. Vehicles that share a plan are members of a team; each member is
a planner too. Planners are pure: they use no clock, network or random numbers. Positions are float
(row, col) of the landscape's grid, with row 0 in the north.
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
    from mission_service.fire.estimated_fire import EstimatedFire

Floats = NDArray[np.float64]
Phase = Literal["approach", "initial circle", "monitor"]


@dataclass(frozen=True)
class Ground:
    """The monitored area: the grid, the reported cell of the fire, and the time of ignition."""

    landscape: Landscape
    centre: tuple[float, float]  # row, col
    burns_from_s: float


@dataclass(frozen=True, slots=True)
class Decision:
    """A decision on the flying direction at one cell of the front.

    ``importance_back`` and ``importance_front`` are the values of turning back and of keeping the
    direction, in the planner's unit (Islam & Hu: eqs. 5 and 6).
    """

    clockwise: bool
    reversed: bool
    importance_back: float
    importance_front: float
    front_cells: int


class Steered(Protocol):
    """The receiver of one vehicle's observations, wind and positions."""

    def observe(self, observed: Observed) -> None:
        """Update the map by a camera window of this vehicle."""

    def correct(self, observed: Observed) -> None:
        """Apply an operator's correction of a window, which overrides earlier views."""

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Apply a wind measured by this vehicle's autopilot; its direction is from true north."""

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Set the vehicle's position; return the decision at this position, if any."""

    def left(self, at_s: float) -> None:
        """Remove a vehicle that is lost, recalled or on the ground."""


class Planner(Steered, Protocol):
    """Decides the direction in which one vehicle flies along the front."""

    @property
    def phase(self) -> Phase:
        """The phase of the flight: approach to the fire, first lap, or monitoring."""

    @property
    def clockwise(self) -> bool:
        """The flying direction around the fire."""

    @property
    def reversals(self) -> int:
        """The number of reversals so far."""

    def path(self, row: float, col: float) -> Floats:
        """Return the path to fly: (n, 2) float (row, col) along the front ahead."""

    def shape(self, row: float, col: float) -> Floats:
        """Return the planner's estimated front: distances in cells on 360 bearings."""


def decided(name: str, planner: Planner, decision: Decision) -> DirectionDecision:
    """Return the command with a vehicle's decision, for the journal and interfaces."""
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
    """The importance of each cell of the front at the vehicle's position, for display.

    Rows, columns and values are (n,) float, from the vehicle backwards; ``back`` and ``front`` are
    sums over the window behind and the window ahead.
    """

    rows: Floats
    cols: Floats
    values: Floats
    back: float
    front: float


class Awaited(NamedTuple):
    """The input that a guidance awaits: approval of a plan ("": none), answers to the GO list."""

    plan_hash: str
    answers: bool


class Guidance(ABC):
    """Commands the available vehicles in the air; ``planners`` are their planners, by name.

    The methods' defaults do nothing; a way of flying overrides those that it needs.
    """

    planners: Mapping[str, Steered]

    def on_vehicle(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Process an event of a vehicle; ``DecisionEngine`` has processed it before."""
        return []

    def on_operator(self, event: AnyOperatorEvent) -> list[AnyCommand]:
        """Process a request of an operator."""
        return []

    def announcements(
        self, vehicle: Vehicle, at_s: float, decision: Decision | None
    ) -> list[AnyCommand]:
        """Return announcements for a new position."""
        return []

    @abstractmethod
    def lead(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return commands for a vehicle that flies and has endurance left."""

    def way_home(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand] | None:
        """Return commands for a vehicle at the end of its endurance, or None for a plain return."""
        return None

    @abstractmethod
    def first_path(self, vehicle: Vehicle, fix: PositionFix) -> Floats | None:
        """Return the path of the first mission, (n, 2) x, y in metres; None: no path yet."""

    @abstractmethod
    def items(self, vehicle: Vehicle, path_m: Floats, fix: PositionFix) -> tuple[MissionItem, ...]:
        """Return the mission along a path with a loiter at its end."""

    def in_mission(self, name: str) -> bool:
        """Return whether a vehicle in the air flies the mission on board."""
        return True

    def after(
        self, event: AnyEvent, leaving: list[AnyCommand], vehicles: Mapping[str, Vehicle]
    ) -> list[AnyCommand]:
        """Return further commands after an event that caused the commands ``leaving``."""
        return []

    # For operators and interfaces -----------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """Return the state for interfaces; ``complete``: the run may end now without loss."""
        return {"complete": True}

    def preview(self, vehicle: Vehicle, fix: PositionFix) -> tuple[MissionItem, ...] | None:
        """Return the mission that a renewal would send now, or None; without side effects."""
        return None

    def compared(self, name: str, fix: PositionFix) -> Compared | None:
        """Return the importances that a planner compares at a position, or None."""
        return None

    def settings(self) -> dict[str, float]:
        """Return the present values of settings that may change in flight."""
        return {}

    def awaited(self) -> Awaited:
        """Return the operator input that the guidance awaits."""
        return Awaited("", False)

    @property
    def estimated_fire(self) -> "EstimatedFire | None":
        """The estimated fire on which plans are based; None if they use the monitored fire."""
        return None


class Lock(Protocol):
    """The last check before a command is sent to a vehicle, independent of the guidance."""

    def apply(self, event: AnyEvent) -> None:
        """Apply an event."""

    def on_commands(self, commands: Iterable[AnyCommand]) -> None:
        """Apply the commands of the core."""

    def refuses(self, drop: Drop, at_us: int) -> str | None:
        """Return the reason why a drop must not be ordered now; None if it may."""

    def may_drop(self, items: Iterable[MissionItem]) -> bool:
        """Return whether an item of a mission may switch an output."""

    def status(self) -> dict[str, Any]:
        """Return the lock's state, for interfaces."""
