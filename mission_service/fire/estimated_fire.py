"""Estimate the fire of a burn from ignitions, wind, corrections and cameras."""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from firemodel.assimilation.camera_front import CameraFront
from firemodel.assimilation.distance_weighting import PaperCorrected
from firemodel.ellipses.ellipse import EllipseFire, Spread, spreads_of
from firemodel.ellipses.line_ignitions import line_sources
from firemodel.ellipses.point_observations import Simulation
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from mission_service import events
from mission_service.config.sections import BurnSection
from mission_service.fire.correction_log import (
    CorrectionLog,
    observations_held,
    observations_of_correction,
)
from mission_service.fire.observed_window import without_speckles

if TYPE_CHECKING:
    from firemodel.assimilation.gaussian_process import GaussianCorrected

Floats = NDArray[np.float64]

LINE_SPACING_M = 2.0  # spacing of point sources along a line
OBSERVATION_SPACING_M = 5.0  # spacing of observations along a drawn line or polygon
PAPER_LENGTH_M = 40.0  # correlation length, the best value in benchmarks.beachly_lengths
OWN_WITHIN_M = 20.0
CAMERA_EVERY_S = 15.0  # interval of corrections from cameras; each takes 0.1 s to compute
WHOLE_AFTER = 1.25  # growth in the number of observations that triggers a fit from scratch


class EstimatedFire:
    """A simulation that uses all reports and observations; ``version`` counts its changes."""

    def __init__(self, burn: BurnSection, landscape: Landscape, weather: WeatherStream) -> None:
        self.log = CorrectionLog()
        self.version = 0
        self._burn = burn
        self._landscape = landscape
        self._entries = list(weather.entries)
        self._sources = np.empty((0, 3))
        # Spheres of the current line. The flight plan along this line includes their fire.
        self.held = np.empty((0, 3))
        self._seen = CameraFront(landscape)
        self._looked_s = -math.inf
        self._observations = np.empty((0, 4))
        self._spreads: tuple[Spread, ...] | None = None
        self._base: EllipseFire | None = None
        self._simulation: Simulation | None = None
        self._fitted: GaussianCorrected | None = None
        self._whole_fit_count = 0  # observations at the last fit from scratch
        for line in burn.lit:
            lit = _sources(landscape.xy_of_places(line.points), line.at_s)
            self._sources = np.vstack([self._sources, lit])

    @property
    def simulation(self) -> Simulation:
        """The current estimate of the corrected fire, without the spheres in ``held``."""
        if self._simulation is None:
            self._simulation = self._corrected(self.base)
        return self._simulation

    def burns_s(self, x_m: float, y_m: float) -> float:
        """Return the arrival time of fire at a position in s, including spheres in ``held``."""
        place_m = np.array([(x_m, y_m)])
        both = (self.simulation, self.lights(self.held))
        return min(float(fire.ignition_time_s(place_m)[0]) for fire in both)

    @property
    def base(self) -> EllipseFire:
        """The estimated fire without corrections."""
        if self._base is None:
            self._base = self.lights(self._sources)
        return self._base

    def lights(self, sources: Floats) -> EllipseFire:
        """Return a fire with only the given sources (n, 3), in the burn's fuel and weather.

        A source consists of x, y and at_s.
        """
        if self._spreads is None:
            stream = WeatherStream(tuple(self._entries))
            land = self._landscape
            self._spreads = spreads_of(self._burn.fuel_model, stream, land.grid_deg, land.fuels)
        return EllipseFire(self._spreads, sources)

    def _corrected(self, base: EllipseFire) -> Simulation:
        if not len(self._observations):
            return base
        if self._burn.corrections == "paper":
            return PaperCorrected(base, self._observations, PAPER_LENGTH_M)
        from firemodel.assimilation.gaussian_process import (
            GaussianCorrected,  # importing SciPy is slow
        )

        count = len(self._observations)
        near = (
            self._fitted
            if self._whole_fit_count <= count <= WHOLE_AFTER * self._whole_fit_count
            else None
        )
        if near is None:
            self._whole_fit_count = count
        self._fitted = GaussianCorrected(base, self._observations, near=near)
        return self._fitted

    def apply(self, event: object) -> bool:
        """Apply an event; return whether the estimate changed.

        Raises FireModelError for a correction with an invalid shape, and if there is nothing to
        undo, redo or erase. The estimate is then unchanged.
        """
        before = self.version
        match event:
            case events.IgnitionReported():
                points_m = self._landscape.xy_of_places(event.points)
                self.ignite(_sources(points_m, event.lit_at_us / 1e6))
            case events.Corrected() | events.Erased() | events.Undone() | events.Redone():
                if isinstance(event, events.Corrected):
                    # This raises for an invalid shape before the log is modified.
                    observations_of_correction(event, self._landscape, OBSERVATION_SPACING_M)
                self.log.refuse_no_effect(event)
                self.log.apply(event)
                self._collect_observations()
            case events.Observed(distrusted=False) if self._burn.camera_corrects:
                at_s, fire = event.at_us / 1e6, self.base.lit(self.held)
                self._seen.fold(event.row, event.col, without_speckles(event).cells, at_s, fire)
                if at_s - self._looked_s >= CAMERA_EVERY_S:
                    self._looked_s = at_s
                    self._collect_observations()
            case events.WindSet():
                self.blow(event.speed_m_s, event.from_deg, event.at_us / 1e6)
            case _:
                pass
        return self.version != before

    def hold(self, source: tuple[float, float, float]) -> None:
        """Add a sphere of the current line: x, y in metres and its ignition time in seconds."""
        self.held = np.vstack([self.held, source])

    def let_go(self) -> None:
        """Complete the current line: its spheres become sources of the estimate."""
        if len(self.held):
            held, self.held = self.held, np.empty((0, 3))
            self.ignite(held)
            self._collect_observations()

    def ignite(self, sources: Floats) -> None:
        """Add sources (n, 3), each x, y and at_s, to the estimate."""
        self._sources = np.vstack([self._sources, sources])
        if self._base is not None:
            self._base = self._base.lit(sources)
        self._changed()

    def blow(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        """Set the wind (at 20 ft) from ``at_s`` on, and remove all later weather entries."""
        stream = WeatherStream(tuple(self._entries))
        self._entries = list(stream.blown(speed_m_s, from_deg, at_s).entries)
        self._spreads = self._base = self._fitted = None
        self._whole_fit_count = 0
        self._changed()

    def weather_at(self, at_s: float) -> Weather:
        """Return the weather entry in effect at a time."""
        return WeatherStream(tuple(self._entries)).weather_at(at_s)

    def _collect_observations(self) -> None:
        """Collect the observations from corrections and cameras."""
        drawn = observations_held(self.log.held(), self._landscape, OBSERVATION_SPACING_M)
        seen = self._seen.observations()
        if len(self.held):  # a camera cannot distinguish the spheres' fires from other fires
            apart = seen[:, None, :2] - self.held[None, :, :2]
            seen = seen[np.hypot(apart[..., 0], apart[..., 1]).min(axis=1) > OWN_WITHIN_M]
        observations = np.vstack([drawn, seen])
        if not np.array_equal(observations, self._observations):
            self._observations = observations
            self._changed()

    def _changed(self) -> None:
        """Fit at once and count the change.

        A fit depends on the previous one, so the times of fits must not depend on reads.
        """
        self._simulation = self._corrected(self.base) if len(self._observations) else None
        self.version += 1


def _sources(points_m: Floats, at_s: float) -> Floats:
    if len(points_m) == 1:
        return np.array([[points_m[0, 0], points_m[0, 1], at_s]])
    return line_sources(points_m, at_s, LINE_SPACING_M)


def toward(landscape: Landscape, speed_m_s: float, from_deg: float) -> tuple[float, float]:
    """Return the grid velocity (x, y) in m/s of a wind from a direction (true north: 0)."""
    from_rad = math.radians(landscape.grid_deg(from_deg))
    return -speed_m_s * math.sin(from_rad), -speed_m_s * math.cos(from_rad)
