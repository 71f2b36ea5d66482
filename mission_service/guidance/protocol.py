"""The interfaces of planners and of the guidance, which has vehicles fly the planners' decisions.

A planner steers one vehicle. Vehicles of a team share a plan: each has a member of the team as its
planner. Planners are pure: they use no clock, no network and no randomness of their own. Positions
are float (row, col) of the landscape's grid, row 0 in the north.
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
    """The ground of an observed fire: the grid, the reported cell of the fire, and its start."""

    landscape: Landscape
    centre: tuple[float, float]  # row, col
    burns_from_s: float


@dataclass(frozen=True, slots=True)
class Decision:
    """A decision on the flying direction, made at one cell of the front.

    ``importance_back`` and ``importance_front`` are the importances of turning back and of going
    on, in the planner's own unit (Islam & Hu: eqs. 5 and 6).
    """

    clockwise: bool
    reversed: bool
    importance_back: float
    importance_front: float
    front_cells: int


class Steered(Protocol):
    """Receives the observations, corrections, wind and positions for one vehicle."""

    def observe(self, observed: Observed) -> None:
        """Process an observation of this vehicle's camera."""

    def correct(self, told: Observed) -> None:
        """Process an operator's correction of a window; it overrides observations there."""

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Process the wind measured by this vehicle's autopilot; from true north."""

    def at(self, row: float, col: float, at_s: float) -> Decision | None:
        """Process the vehicle's position; returns a decision if one is made."""

    def left(self, at_s: float) -> None:
        """The vehicle is lost, recalled or on the ground: others take over its part."""


class Planner(Steered, Protocol):
    """Decides in which direction one vehicle flies along the front."""

    @property
    def phase(self) -> Phase:
        """Its phase: on the way to the fire, on the first lap, or monitoring."""

    @property
    def clockwise(self) -> bool:
        """The flying direction around the fire."""

    @property
    def reversals(self) -> int:
        """The number of its turns back."""

    def path(self, row: float, col: float) -> Floats:
        """The path ahead: (n, 2) float (row, col) along the front, in flying direction."""

    def shape(self, row: float, col: float) -> Floats:
        """The estimated fire: its front in cells on 360 bearings."""


def decided(name: str, planner: Planner, decision: Decision) -> DirectionDecision:
    """The command that announces and records a vehicle's decision."""
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
    """The importances that a planner compares at its vehicle's position, for display.

    Rows, columns and values are (n,) float, from the vehicle backwards; the sums are of the window
    behind and of the window ahead.
    """

    rows: Floats
    cols: Floats
    values: Floats
    back: float
    front: float


class Awaited(NamedTuple):
    """Required inputs: an approval of this plan ("": none), and answers to the GO list."""

    plan_hash: str
    answers: bool


class Guidance(ABC):
    """Guides vehicles in the air while they are available; ``planners`` steer them, by name.

    The default implementations of optional methods do nothing.
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
        """Announcements at a position."""
        return []

    @abstractmethod
    def lead(self, vehicle: Vehicle, here: PositionFix) -> list[AnyCommand]:
        """Commands to a vehicle that flies and has time left."""

    def way_home(self, vehicle: Vehicle, here: PositionFix) -> list[AnyCommand] | None:
        """Commands to a vehicle that must fly home; None: its autopilot flies home from here."""
        return None

    @abstractmethod
    def first_path(self, vehicle: Vehicle, here: PositionFix) -> Floats | None:
        """The path of its first mission: (n, 2) x, y in metres; None: no mission yet."""

    @abstractmethod
    def items(self, vehicle: Vehicle, path_m: Floats, here: PositionFix) -> tuple[MissionItem, ...]:
        """The mission that flies a path and loiters at its end."""

    def in_mission(self, name: str) -> bool:
        """Whether the vehicle, in the air, flies the mission on board."""
        return True

    def after(
        self, event: AnyEvent, leaving: list[AnyCommand], vehicles: Mapping[str, Vehicle]
    ) -> list[AnyCommand]:
        """Announcements after an event; ``leaving`` are the other commands sent for it."""
        return []

    # For interfaces ---------------------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """Its status; ``complete``: the run may end now without loss."""
        return {"complete": True}

    def preview(self, vehicle: Vehicle, here: PositionFix) -> tuple[MissionItem, ...] | None:
        """The mission that would be sent now, or None; changes no state."""
        return None

    def compared(self, name: str, here: PositionFix) -> Compared | None:
        """The importances its planner compares at a position; None if it compares none."""
        return None

    def settings(self) -> dict[str, float]:
        """The current values of the settings that may be changed in flight."""
        return {}

    def awaited(self) -> Awaited:
        """The operators' inputs required before it goes on."""
        return Awaited("", False)

    @property
    def estimated_fire(self) -> "EstimatedFire | None":
        """The estimated fire used for planning, if it differs from the run's fire."""
        return None


class Lock(Protocol):
    """The last check before a command is sent to a vehicle, independent of the guidance."""

    def apply(self, event: AnyEvent) -> None:
        """Apply an event."""

    def on_commands(self, commands: Iterable[AnyCommand]) -> None:
        """Apply the commands of the core."""

    def refuses(self, drop: Drop, at_us: int) -> str | None:
        """The reason why a drop must not be ordered now; None: it may."""

    def may_drop(self, items: Iterable[MissionItem]) -> bool:
        """Whether anything in a mission may switch an output."""

    def status(self) -> dict[str, Any]:
        """Its state, for interfaces."""
