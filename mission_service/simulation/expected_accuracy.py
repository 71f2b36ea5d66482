"""Computes the expected error of the estimated front with different numbers of aircraft. Pure.

No true fire is simulated. The fire is computed from the scenario's inputs, and aircraft circle the
fronts of at least 200 m, one front after another, at equal time intervals. The aircraft fly at
their airspeed in the scenario's wind (copters: at that speed over the ground), and observe the
cells within half the width of their camera's footprint. Parts of the front at the edge of the
landscape are left out. Whenever a part of the front is observed, the filter that learns wind and
spread rates (``learned_inputs``) is updated as in a run. The covariance of this filter, computed
for the scenario's inputs, depends on when and where the front is observed, not on the result. The
position of a part of the front last observed τ seconds ago has the standard deviation s given by

    s² = s₀² + (σ τ)²,

where σ is the standard deviation of the speed of that part, and s₀ that of the position of a front
just observed. With normal errors the mean distance from the true front is s √(2/π).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from firemodel.arrays import Floats, Mask, bounds_of, lengths_along
from firemodel.assimilation.front_lines import FrontLine, front_distances, front_lines
from firemodel.assimilation.learned_inputs import FrontParts, LearnedInputs
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.landscape.landscape import Landscape
from firemodel.spread.edge import at_edge
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import OptionError, ScenarioError
from mission_service.fire.camera import camera_of
from mission_service.fire.scenario_fire import reported_fire, require_fire

STEP_S = 30.0  # interval between images in the estimate
AVERAGED_S = 600.0  # the results are means over the last ten minutes
MIN_FRONT_M = 200.0  # shorter fronts are not circled
LIKELY_SHARE = 0.9
MAX_COUNT = 50
EDGE_CELLS = 1.0  # parts of the front this close to the landscape's edge are left out
SPACING = 0.3  # between camera positions along the path, relative to the camera's reach
MAX_WIND = 0.95  # maximum wind speed as a fraction of the airspeed
# Standard deviation of the position of a front just observed, in cells (uniform within a cell).
CELL_SD = 1.0 / math.sqrt(12.0)
MEAN_OF_SD = math.sqrt(2.0 / math.pi)


class FrontErrors(NamedTuple):
    """One front at the end: points (n), and the expected distance of each from the true front."""

    inner: bool
    row: Floats
    col: Floats
    error_m: Floats


class Accuracy(NamedTuple):
    """The expected accuracy of the estimate with ``aircraft`` aircraft.

    Attributes:
        aircraft: The number of aircraft.
        error_m: The mean distance between the estimated and the true front.
        within_90_m: The distance from the true front that 90 % of the front does not exceed.
        as_last_seen_m: The mean distance if each part stays where it was last observed.
        unseen_s: The mean time since each part was last observed; the start of the fire counts as
            the first observation. None if the aircraft have observed nothing.
        fronts: The fronts at the end; all other values are those of the last ten minutes.
    """

    aircraft: int
    error_m: float
    within_90_m: float
    as_last_seen_m: float
    unseen_s: float | None
    fronts: list[FrontErrors]


class _Team:
    """Aircraft on a tour of the fronts, and the time at which each cell was last observed."""

    def __init__(self, count: int, learned: LearnedInputs, fire: Fire) -> None:
        """Begin with the takeoff at the fire's current time."""
        self.learned = learned
        self.takeoff_s = fire.time_s
        self.seen_s = np.full(fire.landscape.shape, -np.inf)
        # The slots of the aircraft on the tour, as fractions of the duration of a whole tour.
        self.slots = np.arange(count) / max(count, 1)
        self.in_slot = np.zeros(count, dtype=bool)  # whether each aircraft has reached its slot
        # For each of the last steps and all points: standard deviation (m), advance since the last
        # observation (m), and time since then (s).
        self.errors: list[tuple[Floats, Floats, Floats]] = []


def expected_accuracy(
    scenario: Scenario,
    landscape: Landscape,
    section: VehicleSection,
    counts: Sequence[int],
    minutes: float,
    warn: Callable[[str], None] = lambda text: None,
) -> list[Accuracy]:
    """Return the expected accuracy some time after takeoff for each number of aircraft.

    Args:
        scenario: The fire, its weather, and the time of takeoff.
        landscape: The landscape of the scenario.
        section: The aircraft: home, airspeed, altitude and camera.
        counts: The numbers of aircraft; 0 is the fire model alone.
        minutes: The time after takeoff.
        warn: A function that is called with each warning about the results.

    Raises:
        OptionError: No number is given, a number is negative or above ``MAX_COUNT``, or the time is
            not from 10 to 1440 minutes.
        ScenarioError: Nothing burns at takeoff, or the fire has no front of four cells or more
            within the landscape at the end.
    """
    if not counts or min(counts) < 0 or max(counts) > MAX_COUNT:
        raise OptionError(f"the numbers of aircraft must be from 0 to {MAX_COUNT}")
    if not AVERAGED_S / 60.0 <= minutes <= 1440.0:
        raise OptionError(f"{minutes:g} minutes: must be from 10 to 1440 minutes")
    require_fire(scenario)
    fire = reported_fire(scenario, landscape)
    begun_s = fire.time_s
    fire.advance(scenario.first_flight_s)
    if not fire.burned().any():
        raise ScenarioError(
            f"{scenario.name}: nothing burns at the first takeoff ({scenario.first_flight_s:g} s); "
            "set deploy_at_s to a later time"
        )
    learned = LearnedInputs(landscape, begun_s, fire.rate_options)
    teams = [_Team(count, learned.copy(), fire) for count in counts]
    left = round(minutes * 60.0 / STEP_S)
    while left:
        fire.advance(fire.time_s + STEP_S)
        for team in teams:
            fronts = _fronts(team, fire)
            if left <= AVERAGED_S / STEP_S:
                team.errors.append(_errors(team.learned, fronts, fire))
            _observe(team, fronts, fire, section)
        left -= 1
    if (reached := at_edge(fire)) is not None:
        warn(f"{reached}; the parts of the front there are ignored")
    if _is_windy(fire, section):
        warn(
            f"the wind speed exceeds {MAX_WIND:.0%} of the airspeed ({section.airspeed_m_s:g} "
            "m/s): the aircraft cannot fly against the wind, and the computed errors are too small"
        )
    return [_accuracy(team, fire) for team in teams]


def _observe(team: _Team, fronts: list[FrontLine], fire: Fire, section: VehicleSection) -> None:
    """Fly for one period, then update the filter and the times of observation."""
    land, at_s = fire.landscape, fire.time_s
    seen = np.zeros(land.shape, dtype=bool)
    if team.slots.size and fronts:
        radius = camera_of(section).half_width_m(section.altitude_agl_m) / land.cell_size_m
        for row, col in _flown(team, fronts, fire, section):
            _mark_in_view(seen, row, col, radius)
    if seen.any():
        here = bounds_of(seen)
        state = np.where(fire.burned()[here], BURNED, UNBURNED).astype(np.uint8)
        state[~seen[here]] = UNSEEN
        found = front_distances(fronts, here, state, land.cell_size_m)
        # The expected difference is 0: only the covariance changes.
        expected = found._replace(ahead_cells=np.zeros_like(found.ahead_cells))
        team.learned.learn(*expected, fire.weather, at_s)
        team.seen_s[seen] = at_s


def _fronts(team: _Team, fire: Fire) -> list[FrontLine]:
    """Return the fronts of the fire without their parts at the edge of the landscape."""
    rows, cols = fire.landscape.shape
    found = []
    for front in front_lines(fire, team.seen_s, team.learned):
        row, col = front.row, front.col
        inside = (row > EDGE_CELLS) & (row < rows - 1 - EDGE_CELLS)
        inside &= (col > EDGE_CELLS) & (col < cols - 1 - EDGE_CELLS)
        if inside.any():
            at_row, at_col, north, east = front.ahead
            ahead = FrontParts(at_row[inside], at_col[inside], north[inside], east[inside])
            rest = (front.speed_m_s[inside], front.unseen_s[inside])
            found.append(FrontLine(front.inner, row[inside], col[inside], ahead, *rest))
    return found


def _wind_m_s(fire: Fire, section: VehicleSection) -> Floats:
    """Return the air's motion to the north and east; 0 for copters, which hold their speed."""
    weather = fire.weather.weather_at(fire.time_s)
    toward = math.radians(float(fire.landscape.grid_deg(weather.wind_from_deg + 180.0)))
    speed_m_s = 0.0 if section.kind == "copter" else weather.wind_speed_m_s
    return speed_m_s * np.array([math.cos(toward), math.sin(toward)])


def _is_windy(fire: Fire, section: VehicleSection) -> bool:
    return float(np.hypot(*_wind_m_s(fire, section))) > MAX_WIND * section.airspeed_m_s


def _flown(
    team: _Team, fronts: list[FrontLine], fire: Fire, section: VehicleSection
) -> Iterator[tuple[Floats, Floats]]:
    """Move the slots for one period; yield the positions (rows, columns) of each aircraft in one.

    An aircraft reaches its slot after a straight flight from home.
    """
    land, wind_m_s = fire.landscape, _wind_m_s(fire, section)
    row, col = _tour(fronts, MIN_FRONT_M / land.cell_size_m)
    times_s = _times_s(row, col, wind_m_s, section.airspeed_m_s, land.cell_size_m)
    total_s = float(times_s[-1])
    home = land.row_col_of(*land.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg))
    places = (np.interp(team.slots * total_s, times_s, each) for each in (row, col))
    away = np.hypot(*(place - float(at) for place, at in zip(places, home, strict=True)))
    flown_s = fire.time_s - team.takeoff_s
    team.in_slot |= away * land.cell_size_m <= section.airspeed_m_s * flown_s
    for slot in team.slots[team.in_slot].tolist():
        along_s = (slot * total_s + np.arange(STEP_S + 1.0)) % total_s
        yield np.interp(along_s, times_s, row), np.interp(along_s, times_s, col)
    team.slots = (team.slots + STEP_S / total_s) % 1.0


def _tour(fronts: list[FrontLine], min_length_cells: float) -> tuple[Floats, Floats]:
    """Return the rows and columns of a tour around all long fronts, the longest first.

    Each front begins at its northern tip, so that places on the tour remain about the same while
    the fire grows.
    """
    rows, cols = list[Floats](), list[Floats]()
    for front in fronts:
        first = int(front.row.argmin())
        row, col = (np.append(np.roll(each, -first), each[first]) for each in front[1:3])
        if not rows or lengths_along(np.column_stack([row, col]))[-1] >= min_length_cells:
            rows.append(row)
            cols.append(col)
    row, col = np.concatenate(rows), np.concatenate(cols)
    return np.append(row, row[0]), np.append(col, col[0])


def _times_s(
    row: Floats, col: Floats, wind_m_s: Floats, airspeed_m_s: float, cell_m: float
) -> Floats:
    """Return the times (n) from the start of a tour in moving air; ``wind_m_s`` is (north, east).

    Winds above 95 % of the airspeed are reduced to it, because no aircraft could complete the tour.
    """
    north, east = -np.diff(row), np.diff(col)
    length = np.hypot(north, east)
    limit = MAX_WIND * airspeed_m_s / max(float(np.hypot(*wind_m_s)), 1e-9)
    wind_m_s = wind_m_s * min(limit, 1.0)
    along = (wind_m_s[0] * north + wind_m_s[1] * east) / np.maximum(length, 1e-9)
    across = (wind_m_s[0] * east - wind_m_s[1] * north) / np.maximum(length, 1e-9)
    ground_m_s = along + np.sqrt(airspeed_m_s**2 - across**2)
    return np.concatenate([[0.0], np.cumsum(length * cell_m / ground_m_s)])


def _mark_in_view(seen: Mask, row: Floats, col: Floats, radius: float) -> None:
    """Mark the cells within ``radius`` cells of positions along a path."""
    spacing = max(SPACING * radius, 0.5)
    along = lengths_along(np.column_stack([row, col]))
    at = np.linspace(0.0, along[-1], math.ceil(along[-1] / spacing) + 1)
    row, col = np.interp(at, along, row), np.interp(at, along, col)
    reach = math.ceil(radius)
    away = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    near = np.hypot(*away) <= radius
    rows = np.rint(row).astype(np.int64)[:, None] + away[0][near]
    cols = np.rint(col).astype(np.int64)[:, None] + away[1][near]
    inside = (rows >= 0) & (rows < seen.shape[0]) & (cols >= 0) & (cols < seen.shape[1])
    seen[rows[inside], cols[inside]] = True


def _errors(
    learned: LearnedInputs, fronts: list[FrontLine], fire: Fire
) -> tuple[Floats, Floats, Floats]:
    """Return, for all points, the standard deviation, the advance and the time unobserved."""
    sd_m, moved_m, unseen_s = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    mapped_m = CELL_SD * fire.landscape.cell_size_m
    for front in fronts:
        speed_sd_m_s = learned.speed_sds_m_s(
            front.ahead, front.speed_m_s, fire.weather, fire.time_s
        )
        sd_m.append(np.hypot(mapped_m, speed_sd_m_s * front.unseen_s))
        moved_m.append(front.speed_m_s * front.unseen_s)
        unseen_s.append(front.unseen_s)
    return np.concatenate(sd_m), np.concatenate(moved_m), np.concatenate(unseen_s)


def _accuracy(team: _Team, fire: Fire) -> Accuracy:
    """Return the means over the last steps, and the fronts at the end."""
    sd_m, moved_m, unseen_s = (np.concatenate(each) for each in zip(*team.errors, strict=True))
    fronts = _fronts(team, fire)
    if not fronts or not sd_m.size:
        raise ScenarioError(
            "the fire has no front of four cells or more within the landscape; nothing to circle"
        )
    at_end_m = _errors(team.learned, fronts, fire)[0] * MEAN_OF_SD
    ends = np.cumsum([front.row.size for front in fronts])[:-1]
    shown = [
        FrontErrors(front.inner, front.row, front.col, error_m)
        for front, error_m in zip(fronts, np.split(at_end_m, ends), strict=True)
    ]
    return Accuracy(
        team.slots.size,
        float(sd_m.mean() * MEAN_OF_SD),
        _quantile_m(sd_m, LIKELY_SHARE),
        _mean_distance_m(moved_m, CELL_SD * fire.landscape.cell_size_m),
        float(unseen_s.mean()) if np.isfinite(team.seen_s).any() else None,
        shown,
    )


def _mean_distance_m(moved_m: Floats, sd_m: float) -> float:
    """Return the mean absolute value of normal errors with means (n) and one standard deviation."""
    part = moved_m / sd_m
    folded = sd_m * MEAN_OF_SD * np.exp(-0.5 * part**2) + moved_m * (1.0 - 2.0 * ndtr(-part))
    return float(folded.mean())


def _quantile_m(sd_m: Floats, share: float) -> float:
    """Return the distance that a share of normal errors with deviations (n) does not exceed."""

    def beyond(distance_m: float) -> float:
        return share - float((2.0 * ndtr(distance_m / sd_m) - 1.0).mean())

    return float(brentq(beyond, 0.0, 6.0 * float(sd_m.max())))


def table_of(found: Sequence[Accuracy], name: str, minutes: float) -> str:
    """Return a table of the expected accuracy with aircraft like ``name``."""
    lines = [
        f"Expected accuracy of the estimated front {minutes:g} min after takeoff, with aircraft "
        f"like {name} that circle the fronts:",
        "aircraft  mean error  90 % within  as last seen  last observed",
    ]
    for each in found:
        unseen_s = each.unseen_s
        ago = f"{'never':>13}" if unseen_s is None else f"{unseen_s / 60.0:5.0f} min ago"
        lines.append(
            f"{each.aircraft or 'none':>8}  {each.error_m:8.0f} m  {each.within_90_m:9.0f} m  "
            f"{each.as_last_seen_m:10.0f} m  {ago}"
        )
    return "\n".join(lines)
