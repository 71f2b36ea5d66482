"""The planner of a burn, which makes no decisions."""

from mission_service.events import (
    Observed,
)


class Undecided:
    """A planner that makes no decisions, because a burn's vehicle flies approved plans only."""

    def observe(self, observed: Observed) -> None:
        """Do nothing."""

    def correct(self, observed: Observed) -> None:
        """Do nothing: corrections apply to the burn's estimated fire."""

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Do nothing."""

    def at(self, row: float, col: float, at_s: float) -> None:
        """Do nothing."""

    def left(self, at_s: float) -> None:
        """Do nothing."""
