"""The interfaces of planners, which make decisions, and of the guidance, which commands vehicles.

A planner makes the decisions for one vehicle. Vehicles that share a plan are members of a team;
each member is a planner too. Planners are pure: they use no clock, network or random numbers. A
position is the row and column in the landscape's grid, as floats; row 0 is in the north.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from autopilot_bridge.items import MissionItem
from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, DirectionDecision, Drop
from mission_service.events import (
    AnyEvent,
    AnyOperatorEvent,
    FrontsEstimated,
    Observed,
    VehicleEvent,
)
from mission_service.position_fix import PositionFix
from mission_service.vehicles.vehicle_state import Vehicle

if TYPE_CHECKING:
    from mission_service.fire.estimated_fire import EstimatedFire

Floats = NDArray[np.float64]
Phase = Literal["approach", "initial circle", "monitor"]


@dataclass(frozen=True)
class Ground:
    """The monitored area: the grid, the cell where the fire was reported, and the ignition time."""

    landscape: Landscape
    centre: tuple[float, float]  # row, col
    burns_from_s: float


@dataclass(frozen=True, slots=True)
class Decision:
    """A decision on the direction of flight along the front, made at one cell of the front.

    ``importance_back`` is the value of a reversal, and ``importance_front`` is the value of keeping
    the direction. Both values are in the planner's unit (Islam & Hu: eqs. 5 and 6).
    """

    clockwise: bool
    reversed: bool
    importance_back: float
    importance_front: float
    front_cells: int


class Steered(Protocol):
    """The receiver of one vehicle's observations, wind and positions."""

    def observe(self, observed: Observed) -> None:
        """Update the map from a window seen by this vehicle's camera."""

    def correct(self, observed: Observed) -> None:
        """Apply an operator's correction: a window that overrides earlier views."""

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Apply a wind measurement from this vehicle's autopilot.

        ``from_deg`` is the direction from which the wind blows, clockwise from true north.
        """

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Set the vehicle's position; return the decision made there, or None."""

    def left(self, at_s: float) -> None:
        """Exclude the vehicle from planning, because it is lost, recalled or on the ground."""


@runtime_checkable
class ReadsFronts(Protocol):
    """A planner that uses the fronts of the estimated fire."""

    def on_fronts(self, event: FrontsEstimated) -> None:
        """Replace the fronts of the fire."""


class Planner(Steered, Protocol):
    """A planner, which decides the direction in which one vehicle flies along the front."""

    @property
    def phase(self) -> Phase:
        """The phase of the flight: approach to the fire, first lap, or monitoring."""

    @property
    def clockwise(self) -> bool:
        """Whether the vehicle flies clockwise around the fire."""

    @property
    def reversals(self) -> int:
        """The number of times that the vehicle has turned back."""

    def path(self, row: float, col: float) -> Floats:
        """Return the path to fly along the front ahead: an array (n, 2) with row and column."""

    def shape(self, row: float, col: float) -> Floats:
        """Return the front that the planner estimates: distances in cells on 360 bearings."""


def decided(name: str, planner: Planner, decision: Decision) -> DirectionDecision:
    """Return a command that reports a vehicle's decision to the journal and the interfaces."""
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
    """The importance of each cell of the front for a vehicle at its position, for display.

    ``rows``, ``cols`` and ``values`` are float arrays (n), which begin at the vehicle and continue
    along the front behind the vehicle. ``back`` is the sum of ``values`` over the window behind the
    vehicle, and ``front`` is the sum over the window ahead.
    """

    rows: Floats
    cols: Floats
    values: Floats
    back: float
    front: float


@runtime_checkable
class ComparesParts(Protocol):
    """A planner that compares parts of the front for its decision."""

    def compared(self, row: float, col: float, at_s: float) -> Compared:
        """Return the importance and the position of each part of the front; change no state."""


class Awaited(NamedTuple):
    """The operator input that the guidance awaits.

    ``plan_hash`` identifies the plan to approve ("" if there is none). ``answers`` is True if
    answers to the GO/NO-GO checklist are awaited.
    """

    plan_hash: str
    answers: bool


class Guidance(ABC):
    """The guidance of a run, which commands the available vehicles in the air.

    ``planners`` maps each vehicle's name to its planner. By default the methods do nothing; each
    way of flying overrides the methods that it needs.
    """

    planners: Mapping[str, Steered]

    def on_vehicle(self, vehicle: Vehicle, event: VehicleEvent) -> list[AnyCommand]:
        """Process a vehicle's event, which ``DecisionEngine`` has already processed."""
        return []

    def on_operator(self, event: AnyOperatorEvent) -> list[AnyCommand]:
        """Process an operator's request."""
        return []

    def announcements(
        self, vehicle: Vehicle, at_s: float, decision: Decision | None
    ) -> list[AnyCommand]:
        """Return the announcements to make at a vehicle's new position."""
        return []

    @abstractmethod
    def lead(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand]:
        """Return the commands for a vehicle that is flying and has endurance left."""

    def way_home(self, vehicle: Vehicle, fix: PositionFix) -> list[AnyCommand] | None:
        """Return commands to fly home at the end of the endurance; None if ``Return`` suffices."""
        return None

    @abstractmethod
    def first_path(self, vehicle: Vehicle, fix: PositionFix) -> Floats | None:
        """Return the first mission's path, (n, 2) x, y in metres; None if no path is known yet."""

    @abstractmethod
    def items(self, vehicle: Vehicle, path_m: Floats, fix: PositionFix) -> tuple[MissionItem, ...]:
        """Return a mission that follows a path and loiters at its end."""

    def send_to(self, name: str, path_m: Floats | None) -> None:
        """Send a vehicle along a path (n, 2; x, y in metres); None returns it to its planner.

        Only for ways of flying with ``relieves``.
        """
        raise NotImplementedError

    def sent_to(self, name: str) -> Floats | None:
        """Return the path along which ``send_to`` has sent a vehicle, or None."""
        raise NotImplementedError

    def task_begun(self, name: str) -> bool:
        """Return whether a vehicle's planner has found its task. Only with ``relieves``."""
        raise NotImplementedError

    def task_path(self, name: str, x_m: float, y_m: float) -> Floats | None:
        """Return the path planned for a vehicle from a position; None before its task begins.

        The path is (n, 2) x, y in metres. Only for ways of flying with ``relieves``.
        """
        raise NotImplementedError

    def in_mission(self, name: str) -> bool:
        """Return whether this airborne vehicle is flying the mission on board."""
        return True

    def further_commands(
        self, event: AnyEvent, leaving: list[AnyCommand], vehicles: Mapping[str, Vehicle]
    ) -> list[AnyCommand]:
        """Return further commands after an event that caused the commands ``leaving``."""
        return []

    # For operators and interfaces -----------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """Return the state for interfaces; if ``complete``, nothing is lost if the run ends now."""
        return {"complete": True}

    def preview(self, vehicle: Vehicle, fix: PositionFix) -> tuple[MissionItem, ...] | None:
        """Return the mission that an update would send now, or None; change no state."""
        return None

    def compared(self, name: str, fix: PositionFix) -> Compared | None:
        """Return the importance values that a planner compares at a position, or None."""
        return None

    def settings(self) -> dict[str, float]:
        """Return the current values of settings that may change in flight."""
        return {}

    def awaited(self) -> Awaited:
        """Return the operator input that the guidance awaits."""
        return Awaited("", False)

    @property
    def estimated_fire(self) -> "EstimatedFire | None":
        """The estimated fire on which plans are based; None if plans use the monitored fire."""
        return None


class Lock(Protocol):
    """A lock: the last check before a command is sent to a vehicle, independent of the guidance."""

    def apply(self, event: AnyEvent) -> None:
        """Update the lock's state from an event."""

    def on_commands(self, commands: Iterable[AnyCommand]) -> None:
        """Update the lock's state from the commands of the core."""

    def unfinished_drops(self) -> list[Drop]:
        """Return the ordered drops that have no reported outcome."""

    def refuses(self, drop: Drop, at_us: int) -> str | None:
        """Return the reason why a drop must not be ordered now, or None if the drop is allowed."""

    def may_drop(self, items: Iterable[MissionItem]) -> bool:
        """Return whether any item of a mission could switch an output."""

    def status(self) -> dict[str, Any]:
        """Return the lock's state for interfaces."""
