"""Defines the progress of the vehicles while the airspace is being cleared. Pure."""

from dataclasses import dataclass, field

from mission_service.commands import ClearingOutcome, ClearingPhase
from mission_service.events import Order


@dataclass
class ClearingProgress:
    """The progress of one vehicle."""

    phase: ClearingPhase = "ordered"
    why: str = ""  # why the vehicle cannot be commanded
    ordered_at_s: float | None = None  # time of the clearing's last order
    acknowledged: bool = False  # whether the autopilot has answered since that order
    silent: bool = False  # whether an order was not answered in time, nor since
    order_under_way: Order | None = None  # given by the clearing, not yet received as an event
    other_order: str = ""  # an operator's later order, in words; it takes precedence
    flies_until_s: float | None = None  # predicted end of the current flight
    expected_at_s: float | None = None
    out_by_s: float | None = None  # the time stated to the operators
    alarm: str = ""

    def restate(self) -> None:
        """Discard the predictions made for an earlier order."""
        self.flies_until_s = self.expected_at_s = self.out_by_s = None


@dataclass
class ClearingState:
    """The request being carried out, and the progress of each vehicle by name."""

    volume: str = ""  # empty: all vehicles land
    closed_here: bool = False  # whether the request has closed the volume
    by: str = ""
    ordered_at_us: int = 0
    outcome: ClearingOutcome = "complete"
    vehicles: dict[str, ClearingProgress] = field(default_factory=dict)

    @property
    def in_force(self) -> bool:
        """Whether the request is still being carried out."""
        return self.outcome == "in force"

    @property
    def lands(self) -> bool:
        """Whether the request is for the vehicles to land."""
        return not self.volume
