"""Estimate a fire with an ensemble of simulated fires, corrected with observations.

The method depends on the kind of observation:

- A camera image shows a small part of the fire, in a window of cells. Each member has its own wind,
  spread rates and fire. First, wind and spread rates are updated (``member_inputs``) from the
  differences between observed and simulated burned areas in blocks of the window. Then the observed
  cells replace the member's fire in the window. Cells that stay unburned although fire reaches them
  in most members are treated as barriers in forecasts (``held_cells``).
- A mapped perimeter shows the whole fire, which all members then share. The spread observed since
  the previous perimeter gives a rate for each part of the front (``perimeter_rates``), because wind
  and fuel do not explain where a real fire stops. Members then differ only in their inputs.

``python -m benchmarks.estimate_twins`` and ``benchmarks.perimeter_twins`` compare both methods with
persistence (an unchanged fire) and with the model alone, on simulated fires that differ from the
model.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from firemodel.arrays import Floats, Mask, Place
from firemodel.assimilation.camera_window import block_excess
from firemodel.assimilation.estimate_forecast import Forecast, LearnedFront, arrivals_of
from firemodel.assimilation.held_cells import HeldCells
from firemodel.assimilation.member_fire import MemberFire
from firemodel.assimilation.member_inputs import members_of, updated, walked, with_some_wind
from firemodel.assimilation.observation import BURNED, UNSEEN, Observation, despeckled
from firemodel.assimilation.perimeter_rates import FrontRates, RatePrior, segments_of
from firemodel.assimilation.written_image import with_image
from firemodel.ensemble.draws import latin_draws
from firemodel.ensemble.member_fires import Each
from firemodel.ensemble.uncertainty import UNMEASURED, Uncertainty
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival, burning_from_perimeter
from firemodel.spread.fire_scheme import Burning, Closing, Ignition

BARRIER = 99  # fuel code of held cells
MODEL_ERROR_M = 25.0  # standard deviation of distances caused by local errors in the fuel map
MODEL_ERROR_SHARE = 0.25  # further standard deviation, as a fraction of the distance
REPEATED = 2.0  # factor of the variance, because neighbouring blocks share errors
SHRUNK_ERRORS = 6.0  # burned ground more than this many sd outside a later perimeter stays burned
MIN_KEPT = 0.5  # fraction of the burned area that a later perimeter must contain
# Travel times are simulated up to these multiples of the length of the forecast, the second if the
# forecast is longer than ``LONG_S``.
MAX_REACH, MAX_REACH_LONG, LONG_S = 5.0, 1.5, 4 * 3600.0
REACH_CAMERA = 2.0


@dataclass(frozen=True, slots=True)
class EstimateSettings:
    """The ensemble of an estimate; identical settings and observations give identical estimates."""

    members: int = 40
    seed: int = 0
    uncertainty: Uncertainty = UNMEASURED
    rate_prior: RatePrior = field(default_factory=RatePrior)


class FireEstimate:
    """An ensemble of fires that is corrected with observations in chronological order."""

    def __init__(
        self,
        landscape: Landscape,
        weather: WeatherStream,
        ignitions: Sequence[Ignition] = (),
        settings: EstimateSettings | None = None,
        *,
        burning: Burning | None = None,
        closings: Sequence[Closing] = (),
        **scheme_settings: Any,
    ) -> None:
        """Begin an estimate.

        Args:
            landscape: Terrain and fuel.
            weather: The reported weather.
            ignitions: (row, column, time in s) of reported ignitions. Without an ignition, the
                estimate begins with the first mapped perimeter.
            settings: The ensemble.
            burning: A known initial fire, if there is one.
            closings: Cells that cannot burn from a given time on (``control_lines``).
            scheme_settings: Settings of AnyAngleFire, such as ``wind_limit`` or ``crown``.

        Raises:
            FireModelError: There are fewer than two members, or an ignition's cell is not burnable.
        """
        own = settings or EstimateSettings()
        if own.members < 2:
            raise FireModelError(f"members = {own.members}: an estimate needs at least 2")
        self.landscape, self.weather, self.time_s = landscape, weather, 0.0
        self._scheme_settings, self._closings = scheme_settings, tuple(closings)
        self.model = self._unlit(landscape)  # the members start from this fire
        self._unburnable = np.isin(landscape.fuel_model, list(NON_BURNABLE))
        self._rng = np.random.default_rng((own.seed, 1))
        fuels = len(landscape.burnable_codes)
        draws = latin_draws(own.uncertainty, own.seed, own.members, fuels)
        self.members = members_of(draws, weather.weather_at(0.0).wind_from_deg)
        self._prior = own.rate_prior
        self._rates: FrontRates | None = None
        self._held = HeldCells(landscape.shape)
        self._shared = burning  # the state of all members after a mapped perimeter
        if burning is not None:
            self.time_s = burning.at_s
        self._fires: list[MemberFire] | None = None  # the members' states, if they differ
        self._observed = np.full(landscape.shape, UNSEEN, dtype=np.uint8)
        self._forecast: Forecast | None = None
        if ignitions:
            self._begin_at(ignitions)

    def _unlit(self, landscape: Landscape) -> AnyAngleFire:
        """Return a fire without burned cells, in the reported weather."""
        weather = with_some_wind(self.weather)
        found = AnyAngleFire(landscape, weather, [], **self._scheme_settings)
        found.add_closings(self._closings)
        return found

    def _begin_at(self, ignitions: Sequence[Ignition]) -> None:
        """Begin with ignitions, at the time of the last one."""
        fire = self.model.copy()
        for row, col, at_s in ignitions:
            fire.light(row, col, at_s)
        fire.advance(max(at_s for _, _, at_s in ignitions))
        self.time_s = fire.time_s
        self._shared = burning_from_arrival(fire.expected_s(), self.landscape, self.time_s)

    def copy(self) -> "FireEstimate":
        """Return an independent copy; data that never changes is shared."""
        found = copy.copy(self)
        found._rng = copy.deepcopy(self._rng)
        found._rates = None if self._rates is None else self._rates.copy()
        found._held = self._held.copy()
        found._observed = self._observed.copy()
        return found

    def light(self, cells: Sequence[tuple[int, int]], at_s: float, each: Each = map) -> None:
        """Light cells (row, column) in all members at a given time, which may be in the past.

        Raises FireModelError if there is no fire yet and a cell cannot burn.
        """
        if not self.begun:
            self._begin_at([(*cell, at_s) for cell in cells])
            return
        self.advance(max(at_s, self.time_s), each)
        assert self._fires is not None
        lit = np.zeros(self.landscape.shape, dtype=bool)
        lit[tuple(np.array(cells).T)] = True
        self._fires = [
            fire.with_times(np.where(lit, np.minimum(fire.arrival_s, at_s), fire.arrival_s), lit)
            for fire in self._fires
        ]

    def set_weather(self, weather: WeatherStream, at_s: float, each: Each = map) -> None:
        """Use a new weather report from a given time on.

        The mean of the estimated errors in the earlier wind is discarded; the differences between
        the members' winds are kept.
        """
        if self.begun:
            self.advance(max(at_s, self.time_s), each)
        self.weather = weather
        self.model = self._unlit(self.landscape)
        error = self.members.wind_error
        self.members = self.members._replace(wind_error=error - error.mean(axis=0))

    @property
    def begun(self) -> bool:
        """True if there is a fire: an ignition or a mapped perimeter."""
        return self._shared is not None or self._fires is not None

    def burned(self) -> Mask:
        """Return the cells (y, x) that have burned in at least half of the members by ``time_s``.

        Cells that were observed as burned are included.
        """
        if self._fires is None:
            assert self._shared is not None
            return np.asarray(self._shared.arrival_s <= self.time_s)
        share = np.mean([fire.arrival_s <= self.time_s for fire in self._fires], axis=0)
        return np.asarray(share >= 0.5)

    def advance(self, to_time_s: float, each: Each = map) -> None:
        """Advance all members to the given time.

        After a mapped perimeter, members are advanced only when a camera observation requires it.
        """
        if to_time_s < self.time_s:
            raise FireModelError(
                f"the estimate is at {self.time_s} s and cannot go back to {to_time_s} s"
            )
        self._fires = self._burned_until(to_time_s, self.model, each)
        reported = self.weather.weather_at(self.time_s)
        self.members = walked(self.members, to_time_s - self.time_s, reported, self._rng)
        self._shared, self._rates = None, None
        self.time_s, self._forecast = to_time_s, None

    def assimilate(self, observation: Observation, each: Each = map) -> None:
        """Process an observation, which must not be earlier than the previous one.

        Raises FireModelError for an observation that cannot show this fire; the estimate is then
        unchanged.
        """
        if observation.area is not None:
            self._map(observation, each)
            return
        if not self.begun:
            raise FireModelError(
                f"{observation.source}: there is no fire yet; start with an ignition or a perimeter"
            )
        if observation.at_s > self.time_s or self._fires is None:
            self.advance(max(observation.at_s, self.time_s), each)
        self._see(observation, each)

    def forecast(self, until_s: float, each: Each = map) -> Forecast:
        """Return the forecast from ``time_s`` to ``until_s``; the estimate does not change."""
        known = self._forecast
        if known is None or known.until_s < until_s:
            self._forecast = self._new_forecast(max(until_s, self.time_s), each)
        assert self._forecast is not None
        return self._forecast

    def _new_forecast(self, until_s: float, each: Each) -> Forecast:
        burned, for_s = self.burned(), until_s - self.time_s
        held = self._held.held()
        model = self.model
        if held.any():
            fuel = np.where(held, BARRIER, self.landscape.fuel_model)
            ground = replace(self.landscape, fuel_model=fuel.astype(np.int16))
            model = self._unlit(ground)
        front, reach = None, REACH_CAMERA
        if self._rates is not None:
            segments = segments_of(burned, self.landscape.cell_size_m)
            # A copy, because later perimeters must not change the forecast.
            front = LearnedFront(segments, self._rates.copy())
            reach = MAX_REACH if for_s <= LONG_S else MAX_REACH_LONG
        simulated_until_s = self.time_s + reach * for_s
        fires = self._burned_until(simulated_until_s, model, each)
        members = [arrivals_of(fire.arrival_s) for fire in fires]
        span = (self.time_s, until_s, simulated_until_s)
        return Forecast(*span, burned, members, front)

    def _burned_until(self, to_time_s: float, model: AnyAngleFire, each: Each) -> list[MemberFire]:
        """Return each member's fire, simulated until the given time.

        The fuels of ``model`` may differ from those of the landscape.
        """
        reported = model.weather.since(self.time_s).changes()
        known = self.landscape.burnable_codes
        place = [known.index(code) for code in model.landscape.burnable_codes]

        def burned(number: int) -> MemberFire:
            rates = np.exp(self.members.log_rate[number, place])
            inputs = (*self.members.wind_changes(number, reported), rates)
            if self._shared is not None:
                fire = model.restarted(self._shared, *inputs)
            else:
                assert self._fires is not None
                member = self._fires[number]
                if not member.burns(self.time_s):
                    return member
                if model.landscape is self.landscape:
                    fire = member.current().continued(model, *inputs)
                else:
                    state = burning_from_arrival(member.arrival_s, model.landscape, self.time_s)
                    fire = model.restarted(state, *inputs)
            fire.advance(to_time_s)
            return MemberFire(fire, fire.expected_s())

        return list(each(burned, range(self.members.size)))

    # Mapped perimeters

    def _map(self, observation: Observation, each: Each) -> None:
        """Process a mapped perimeter."""
        area, at_s = observation.area, observation.at_s
        where = observation.source or "perimeter"
        if not (observation.state == BURNED).any():
            raise FireModelError(f"{where}: contains no cell of the landscape; check its position")
        if self.begun:
            self._refuse_implausible(observation)
            if self._shared is not None and self._shared.area is not None:
                error_m = SHRUNK_ERRORS * observation.position_sd_m
                area = area.union(self._shared.area.difference(area.buffer(error_m)))
        try:
            burning = burning_from_perimeter([area], self.landscape, at_s)
        except FireModelError as error:
            raise FireModelError(f"{where}: {error}") from None
        if self.begun:
            self._learn(observation, each)
        self._shared = burning
        self._fires, self.time_s, self._forecast = None, at_s, None
        if self._rates is None:
            self._rates = FrontRates(at_s, self._prior)
        self._observed = observation.state.copy()

    def _refuse_implausible(self, observation: Observation) -> None:
        where = observation.source or "perimeter"
        if observation.at_s <= self.time_s:
            raise FireModelError(
                f"{where}: its time, {observation.at_s:g} s, is not later than that of the last "
                f"observation, {self.time_s:g} s; check its time and time zone"
            )
        burned = self.burned()
        kept = np.count_nonzero(burned & (observation.state == BURNED))
        if kept < MIN_KEPT * np.count_nonzero(burned):
            raise FireModelError(
                f"{where}: contains only {kept / np.count_nonzero(burned):.0%} of the area that "
                "had burned before; check its position and CRS, and whether it maps only a part "
                "of the fire"
            )

    def _learn(self, observation: Observation, each: Each) -> None:
        if self._rates is None:
            return
        forecast = self.forecast(observation.at_s, each)
        assert forecast.front is not None
        self._rates.learn(
            forecast.front.segments,
            forecast.travel_s(),
            (observation.state == BURNED) & ~forecast.burned,
            (self.time_s, observation.at_s),
            observation.position_sd_m,
            self.landscape.cell_size_m,
        )

    # Cameras

    def _see(self, observation: Observation, each: Each) -> None:
        """Process the window of a camera image."""
        fires, here, at_s = self._fires, observation.where, observation.at_s
        assert fires is not None
        state = despeckled(observation)
        windows = np.array([fire.arrival_s[here] <= at_s for fire in fires])
        self._held.add_observation(here, state, at_s, windows.mean(axis=0))
        self._update_members(state, windows, observation.position_sd_m)
        seen = self._observed[here]
        seen[state != UNSEEN] = np.maximum(seen, state)[state != UNSEEN]
        self._fires = list(each(lambda fire: self._rewritten(fire, here, state, at_s), fires))
        self._forecast = None

    def _update_members(
        self, state: NDArray[np.uint8], windows: Mask, position_sd_m: float
    ) -> None:
        """Update the members' inputs by comparing burned areas in blocks of a window."""
        excess, front = block_excess(state, windows)
        if not excess.shape[1]:
            return
        excess_m = excess / front * self.landscape.cell_size_m
        mean_m = excess_m.mean(axis=0)
        variance = MODEL_ERROR_M**2 + position_sd_m**2 + (MODEL_ERROR_SHARE * mean_m) ** 2
        self.members = updated(self.members, excess_m, np.sqrt(REPEATED * variance), self._rng)

    def _rewritten(
        self, fire: MemberFire, here: Place, state: NDArray[np.uint8], at_s: float
    ) -> MemberFire:
        """Return a member's fire in which an observation replaces the cells in a window."""
        cell_m = self.landscape.cell_size_m
        found = with_image(fire.arrival_s, here, state, at_s, cell_m, self._unburnable)
        if found is None:
            return fire
        arrival_s, changed = found
        changed |= self._remove_unseen_islands(arrival_s)
        return fire.with_times(arrival_s, changed)

    def _remove_unseen_islands(self, arrival_s: Floats) -> Mask:
        """Remove burned areas without an observed burned cell, unless no area has such a cell.

        ``arrival_s`` (y, x) is modified in place. Returns the mask (y, x) of the removed cells.
        """
        burned = arrival_s <= self.time_s
        removed = np.zeros_like(burned)
        labels, count = label(burned)
        if count < 2:
            return removed
        known = np.zeros(count + 1, dtype=bool)
        known[np.unique(labels[burned & (self._observed == BURNED)])] = True
        if known.any():
            removed = burned & ~known[labels]
            arrival_s[removed] = np.inf
        return removed
