"""Derive reported ignitions from events: crews' reports and landed spheres. Pure."""

from collections.abc import Sequence
from typing import NamedTuple

from mission_service.commands import AnyCommand, Drop
from mission_service.config.scenario import Scenario
from mission_service.events import AnyEvent, DropFinished, IgnitionReported


class ReportedIgnition(NamedTuple):
    """A point or line (lat_deg, lon_deg) that burns from ``at_s`` on."""

    points: Sequence[tuple[float, float]]
    at_s: float


class IgnitionReports:
    """The predicted landing positions of spheres until their drops are confirmed."""

    def __init__(self, ignition_delay_s: float) -> None:
        """Set the time from a sphere's drop until it burns."""
        self._falling: dict[tuple[str, int], tuple[float, float]] = {}
        self._ignition_delay_s = ignition_delay_s

    def on_command(self, command: AnyCommand) -> None:
        """Store the predicted landing position of a sphere."""
        if isinstance(command, Drop):
            place = (command.lat_deg, command.lon_deg)
            self._falling[command.plan_hash, command.number] = place

    def reported_in(self, event: AnyEvent) -> ReportedIgnition | None:
        """Return the ignition that an event reports, or None."""
        if isinstance(event, IgnitionReported):
            return ReportedIgnition(event.points, event.lit_at_us / 1e6)
        if isinstance(event, DropFinished):
            place = self._falling.pop((event.plan_hash, event.number), None)
            if place is not None and not event.refused:
                return ReportedIgnition([place], event.at_us / 1e6 + self._ignition_delay_s)
        return None


def ignition_reports_of(scenario: Scenario) -> IgnitionReports:
    """Return the ignition reports of a run at its start."""
    return IgnitionReports(scenario.burn.ignition_delay_s if scenario.burn else 0.0)
