"""Observe the simulated fire with the vehicles' cameras. No other module reads this fire.

In a simulation and in a live run, the fire advances with the clock; in a replay, with the events of
the journal.
"""

import msgspec

from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand
from mission_service.config.scenario import Scenario
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.fire.camera_errors import CameraErrors
from mission_service.fire.camera_views import CameraViews, arrival_at, image_of
from mission_service.fire.ignition_reports import ignition_reports_of
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.simulated_fire import SimulatedFire, simulated_fire_of


class SimulatedCameras:
    """The cameras of all vehicles, which observe a simulated fire.

    Reported ignitions, and spheres that have landed, ignite the simulated fire.
    """

    def __init__(self, scenario: Scenario, fire: SimulatedFire) -> None:
        """Set the simulated fire. Outside this class, only evaluations after a run may read it."""
        self.fire = fire
        self._errors = CameraErrors(scenario)
        self._views = CameraViews(scenario)
        self._ignitions = ignition_reports_of(scenario)

    def advance(self, at_us: int) -> None:
        """Advance the simulated fire to this mission time; an earlier time has no effect."""
        self.fire.advance(at_us)

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return a vehicle's camera image from a position if one is due, or None."""
        return self.seen_from(fix) if self._views.is_due(fix) else None

    def seen_from(self, fix: Telemetry, wider_cells: float = 0.0) -> Observed | None:
        """Return the image from a position, or None off the landscape.

        ``wider_cells`` is added to the camera footprint on each side.
        """
        self.fire.advance(fix.at_us)
        settings = self._errors.settings
        if settings.kind == "ideal":
            return self._views.seen_from(fix, self.fire.fire, wider_cells)
        shown = self._views.footprint(fix, self.fire.fire.landscape, wider_cells)
        if shown is None:
            return None
        image = self._errors.shown(self.fire.fire, fix, shown)
        return msgspec.structs.replace(
            image_of(fix, shown, image.burned, image.unseen),
            position_sd_m=round(image.position_sd_m, 2),
            missed=settings.missed,
            false_alarms=settings.false_alarms,
        )

    def arrival_s(self, row: int, col: int) -> float | None:
        """Return the simulated fire's arrival time at a cell; None if unburned or off the grid."""
        return arrival_at(self.fire.fire, row, col)

    def on_event(self, event: AnyEvent) -> None:
        """Apply an ignition, a completed drop or a change in the reliability of a position."""
        self._views.on_event(event)
        reported = self._ignitions.reported_in(event)
        if reported is not None:
            # Otherwise the fire would ignite at the time of the last observation.
            self.fire.advance(event.at_us)
            self.fire.light(*reported)

    def on_command(self, command: AnyCommand) -> None:
        """Process a drop."""
        self._ignitions.on_command(command)

    def apply_history(self, event: AnyEvent) -> None:
        """Apply an event from a journal."""
        self.fire.advance(event.at_us)
        if isinstance(event, Telemetry):
            self._views.is_due(event)
        self.on_event(event)


def cameras_of(scenario: Scenario, landscape: Landscape) -> SimulatedCameras | None:
    """Return the cameras that observe a scenario's simulated fire.

    The result is None if the scenario has no simulated fire, or if its cameras write image files.
    """
    if scenario.passes_image_files:
        return None
    fire = simulated_fire_of(scenario, landscape)
    return None if fire is None else SimulatedCameras(scenario, fire)


def fires_of_run(
    cameras: SimulatedCameras | None, estimate: RunEstimate
) -> tuple[SimulatedCameras | RunEstimate, ...]:
    """Return the fires of a run, each of which processes the same events independently."""
    return (estimate,) if cameras is None else (cameras, estimate)
