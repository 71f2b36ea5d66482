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
    """The ignitions predicted for spheres until their drops are confirmed.

    A sphere burns from the time of its order plus a delay: if the disk was full, the outcome of its
    drop is reported much later.
    """

    def __init__(self, ignition_delay_s: float) -> None:
        """Set the time from a sphere's drop until it burns."""
        self._falling: dict[tuple[str, int], ReportedIgnition] = {}
        self._ignition_delay_s = ignition_delay_s
        self._at_us = 0  # time of the newest event, which is the time of its commands

    def on_command(self, command: AnyCommand) -> None:
        """Store the predicted ignition by a sphere; call ``reported_in`` for its event before."""
        if isinstance(command, Drop):
            place, at_s = (command.lat_deg, command.lon_deg), self._at_us / 1e6
            ignition = ReportedIgnition([place], at_s + self._ignition_delay_s)
            self._falling[command.plan_hash, command.number] = ignition

    def reported_in(self, event: AnyEvent) -> ReportedIgnition | None:
        """Return the ignition that an event reports, or None."""
        self._at_us = event.at_us
        if isinstance(event, IgnitionReported):
            return ReportedIgnition(event.points, event.lit_at_us / 1e6)
        if isinstance(event, DropFinished):
            ignition = self._falling.pop((event.plan_hash, event.number), None)
            return None if event.refused else ignition
        return None


def ignition_reports_of(scenario: Scenario) -> IgnitionReports:
    """Return the ignition reports of a run at its start."""
    return IgnitionReports(scenario.burn.ignition_delay_s if scenario.burn else 0.0)
