"""Change the fire of a run by reports, ignitions and drops, and observe it by cameras.

The service advances it with the clock; a replay advances it by the events of a journal.
"""

import contextlib
from collections.abc import Iterable

from firemodel.errors import FireModelError
from mission_service import events
from mission_service.commands import AnyCommand, Drop
from mission_service.config.scenario import Scenario
from mission_service.fire.camera import camera_of
from mission_service.fire.simulated_fire import SimulatedFire, Window

OF_FIRE = (events.Corrected, events.Erased, events.Undone, events.Redone, events.WindSet)


class ObservedFire:
    """A ``SimulatedFire`` that events change and the vehicles' cameras observe."""

    def __init__(self, scenario: Scenario, world: SimulatedFire) -> None:
        self.world = world
        self._cameras = {section.name: camera_of(section) for section in scenario.vehicles}
        self._every_us = {
            section.name: round(1e6 / section.camera_rate_hz) for section in scenario.vehicles
        }
        self._due_us = dict.fromkeys(self._cameras, 0)
        self._faults: dict[str, set[str]] = {name: set() for name in self._cameras}
        self._falling: dict[tuple[str, int], tuple[float, float]] = {}
        self._ignition_delay_s = scenario.burn.ignition_delay_s if scenario.burn else 0.0

    def camera_observation(self, fix: events.Telemetry) -> events.Observed | None:
        """Return the observation of a vehicle's camera from a position if an image is due, or None.

        The result is also None while the vehicle's position is unreliable, because the image would
        be misplaced.
        """
        return self.seen_from(fix) if self._is_due(fix) else None

    def _is_due(self, fix: events.Telemetry) -> bool:
        """Return whether an image is due; if so, the next image becomes due one period later."""
        if self._faults[fix.vehicle] or fix.at_us < self._due_us[fix.vehicle]:
            return False
        self._due_us[fix.vehicle] = fix.at_us + self._every_us[fix.vehicle]
        return True

    def seen_from(self, fix: events.Telemetry, wider_cells: float = 0.0) -> events.Observed | None:
        """Return the observation from a position, with a footprint widened by ``wider_cells``."""
        return self.world.observe(fix, self._cameras[fix.vehicle], wider_cells)

    def apply_report(self, event: events.AnyOperatorEvent) -> Window | None:
        """Apply an operator's report, and return a window around the changed cells or None.

        Raises FireModelError for an invalid report, which changes nothing.
        """
        if isinstance(event, OF_FIRE):
            self.world.advance(event.at_us)
        return self.world.apply_report(event)

    def on_event(self, event: events.AnyEvent) -> None:
        """Apply an ignition, a completed drop or a change in the reliability of a position."""
        if isinstance(event, events.GpsFixChanged):
            self._set_fault(event.vehicle, "fix", event.good)
        elif isinstance(event, events.EstimatorStatusChanged):
            self._set_fault(event.vehicle, "estimator", event.healthy)
        elif isinstance(event, events.VehicleRebooted):
            self._faults[event.vehicle].clear()
        elif isinstance(event, events.IgnitionReported):
            self.world.advance(event.at_us)  # else ignition would be at the last observation's time
            self.world.light(event.points, event.lit_at_us / 1e6)
        elif isinstance(event, events.DropFinished):
            place = self._falling.pop((event.plan_hash, event.number), None)
            if place is not None and not event.refused:
                self.world.light([place], event.at_us / 1e6 + self._ignition_delay_s)

    def _set_fault(self, vehicle: str, source: str, good: bool) -> None:
        faults = self._faults[vehicle]
        if good:
            faults.discard(source)
        else:
            faults.add(source)

    def apply_history(
        self, event: events.AnyEvent, commands: Iterable[AnyCommand] = ()
    ) -> Window | None:
        """Apply an event from a journal, and return the window around the changed cells or None."""
        found = None
        if isinstance(event, OF_FIRE):
            # An invalid report is in a journal if the run was killed before its reversal.
            with contextlib.suppress(FireModelError):
                found = self.apply_report(event)
        elif isinstance(event, events.Telemetry):
            self._is_due(event)
        self.on_event(event)
        for command in commands:
            self.on_command(command)
        return found

    def on_command(self, command: AnyCommand) -> None:
        """Store the predicted landing place of a sphere until its drop is confirmed."""
        if isinstance(command, Drop):
            place = (command.lat_deg, command.lon_deg)
            self._falling[command.plan_hash, command.number] = place
