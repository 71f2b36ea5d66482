"""Compute how accurate the estimated front will be with different numbers of aircraft.

No truth is drawn: the covariance of the filter that learns the inputs (``learned_inputs``) depends
on when and where the front is observed, but not on the observed positions. The fire burns as the
scenario reports it. Aircraft circle all fronts, at equal distances in time, at their airspeed in
the wind of the fire. Whenever a part of the front comes into view, the filter is updated as in a
run. A part of the front that was last in view τ seconds ago has the error

    s² = s₀² + (σ τ)²,

with the standard deviation σ of the speed of that part, and the error s₀ of a mapped front. The
errors of distances are normally distributed, so that the mean distance is s √(2/π). Pure.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from firemodel.arrays import Floats, Mask, bounds_of
from firemodel.assimilation.front_lines import FrontLine, front_distances, front_lines
from firemodel.assimilation.learned_inputs import LearnedInputs
from firemodel.assimilation.observation import BURNED, UNBURNED, UNSEEN
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import Scenario
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError
from mission_service.fire.camera import camera_of
from mission_service.fire.scenario_fire import reported_fire, require_fire

STEP_S = 30.0  # the period of images in the estimate
AVERAGED_S = 600.0  # the results are means over the last ten minutes
MIN_FRONT_M = 200.0  # shorter fronts are not circled
LIKELY = 0.9
MAX_COUNT = 50
# Standard deviation of the position of a mapped front in cells: the front is at an unknown place
# in its cell.
CELL_SD = 1.0 / math.sqrt(12.0)
MEAN_OF_SD = math.sqrt(2.0 / math.pi)


class FrontErrors(NamedTuple):
    """The front at the end, with the expected distance (n) of each point from the true front."""

    inner: bool
    row: Floats
    col: Floats
    error_m: Floats


class Accuracy(NamedTuple):
    """The expected accuracy of the estimate with ``aircraft`` aircraft.

    Attributes:
        aircraft: The number of aircraft.
        error_m: The mean distance between the estimated and the true front.
        likely_m: The distance within which 90 % of the front is expected.
        as_last_seen_m: The mean distance of the front as last observed, which does not move.
        unseen_s: The mean time since the parts of the front were observed.
        fronts: The fronts at the end.
    """

    aircraft: int
    error_m: float
    likely_m: float
    as_last_seen_m: float
    unseen_s: float
    fronts: list[FrontErrors]


class _Team:
    """Aircraft on a tour of all fronts, and what they have seen."""

    def __init__(self, count: int, learned: LearnedInputs, shape: tuple[int, int]) -> None:
        self.learned = learned
        self.seen_s = np.full(shape, -np.inf)
        self.share = np.arange(count) / max(count, 1)  # place on the tour as a share of its time
        self.arrives_s: Floats | None = None  # at the tour, after takeoff
        self.errors: list[tuple[Floats, Floats, Floats]] = []  # sd, movement and time out of view


def expected_accuracy(
    scenario: Scenario,
    landscape: Landscape,
    section: VehicleSection,
    counts: Sequence[int],
    minutes: float,
) -> list[Accuracy]:
    """Return the expected accuracy some time after takeoff for each number of aircraft.

    Args:
        scenario: The fire, its weather, and the time of takeoff.
        landscape: The landscape of the scenario.
        section: The aircraft: home, airspeed, altitude and camera.
        counts: The numbers of aircraft; 0 is the fire model alone.
        minutes: The time after takeoff.

    Raises:
        ScenarioError: A number is negative or above ``MAX_COUNT``, the flight is shorter than ten
            minutes, or nothing burns at takeoff.
    """
    if not counts or min(counts) < 0 or max(counts) > MAX_COUNT:
        raise ScenarioError(f"the numbers of aircraft must be from 0 to {MAX_COUNT}")
    if not AVERAGED_S / 60.0 <= minutes <= 1440.0:
        raise ScenarioError(f"{minutes:g} minutes: give 10 to 1440 minutes")
    require_fire(scenario)
    fire = reported_fire(scenario, landscape)
    begun_s = fire.time_s
    fire.advance(scenario.first_flight_s)
    if not fire.burned().any():
        raise ScenarioError(
            f"{scenario.name}: nothing burns at the first takeoff ({scenario.first_flight_s:g} s); "
            "set deploy_at_s to a later time"
        )
    learned = LearnedInputs(landscape, begun_s)
    teams = [_Team(count, learned.copy(), landscape.shape) for count in counts]
    for _ in range(round(minutes * 60.0 / STEP_S)):
        fire.advance(fire.time_s + STEP_S)
        for team in teams:
            _step(team, fire, section)
    last = round(AVERAGED_S / STEP_S)
    return [_accuracy(team, fire, last) for team in teams]


def _step(team: _Team, fire: Fire, section: VehicleSection) -> None:
    """Fly for one period, then update what has been seen and learned."""
    land, at_s = fire.landscape, fire.time_s
    fronts = front_lines(fire, team.seen_s, team.learned)
    seen = np.zeros(land.shape, dtype=bool)
    if team.share.size and fronts:
        radius = camera_of(section).half_width_m(section.altitude_agl_m) / land.cell_size_m
        for row, col in _flown(team, fronts, fire, section):
            _show(seen, row, col, radius)
    team.errors.append(_errors(team.learned, fronts, fire))
    if seen.any():
        here = bounds_of(seen)
        state = np.where(fire.burned()[here], BURNED, UNBURNED).astype(np.uint8)
        state[~seen[here]] = UNSEEN
        found = front_distances(fronts, here, state, land.cell_size_m)
        expected = found._replace(ahead_cells=np.zeros_like(found.ahead_cells))
        team.learned.learn(*expected, fire.weather, at_s)
        team.seen_s[seen] = at_s


def _flown(
    team: _Team, fronts: list[FrontLine], fire: Fire, section: VehicleSection
) -> Iterator[tuple[Floats, Floats]]:
    """Move all aircraft for one period; yield the positions (rows, columns) of each on the way."""
    land, at_s = fire.landscape, fire.time_s
    row, col = _tour(fronts, MIN_FRONT_M / land.cell_size_m)
    weather = fire.weather.weather_at(at_s)
    toward = math.radians(float(land.grid_deg(weather.wind_from_deg + 180.0)))
    wind = np.array([math.cos(toward), math.sin(toward)]) * weather.wind_speed_m_s
    times_s = _times_s(row, col, wind, section.airspeed_m_s, land.cell_size_m)
    total_s = float(times_s[-1])
    if team.arrives_s is None:
        home = land.row_col_of(*land.xy_of_lat_lon(section.home_lat_deg, section.home_lon_deg))
        places = (np.interp(team.share * total_s, times_s, each) for each in (row, col))
        away = np.hypot(*(place - float(at) for place, at in zip(places, home, strict=True)))
        team.arrives_s = at_s - STEP_S + away * land.cell_size_m / section.airspeed_m_s
    flown_s = np.clip(at_s - team.arrives_s, 0.0, STEP_S)
    for share, on_tour_s in zip(team.share.tolist(), flown_s.tolist(), strict=True):
        if on_tour_s > 0.0:
            along_s = share * total_s + np.linspace(0.0, on_tour_s, max(round(on_tour_s), 2))
            along_s %= total_s
            yield np.interp(along_s, times_s, row), np.interp(along_s, times_s, col)
    team.share = (team.share + flown_s / total_s) % 1.0


def _tour(fronts: list[FrontLine], min_length_cells: float) -> tuple[Floats, Floats]:
    """Return the rows and columns of a tour that circles all long fronts, the longest first.

    Each front begins at its northern tip, so that places on the tour remain about the same while
    the fire grows.
    """
    rows, cols = list[Floats](), list[Floats]()
    for front in fronts:
        first = int(front.row.argmin())
        row, col = (np.append(np.roll(each, -first), each[first]) for each in front[1:3])
        if not rows or np.hypot(np.diff(row), np.diff(col)).sum() >= min_length_cells:
            rows.append(row)
            cols.append(col)
    row, col = np.concatenate(rows), np.concatenate(cols)
    return np.append(row, row[0]), np.append(col, col[0])


def _times_s(
    row: Floats, col: Floats, wind_m_s: Floats, airspeed_m_s: float, cell_m: float
) -> Floats:
    """Return the times (n) from the start of a tour; ``wind_m_s`` is its motion (north, east).

    A wind faster than 95 % of the airspeed counts as this share, because no tour ends in it.
    """
    north, east = -np.diff(row), np.diff(col)
    length = np.hypot(north, east)
    limit = 0.95 * airspeed_m_s / max(float(np.hypot(*wind_m_s)), 1e-9)
    wind_m_s = wind_m_s * min(limit, 1.0)
    along = (wind_m_s[0] * north + wind_m_s[1] * east) / np.maximum(length, 1e-9)
    across = (wind_m_s[0] * east - wind_m_s[1] * north) / np.maximum(length, 1e-9)
    ground_m_s = along + np.sqrt(airspeed_m_s**2 - across**2)
    return np.concatenate([[0.0], np.cumsum(length * cell_m / ground_m_s)])


def _show(seen: Mask, row: Floats, col: Floats, radius: float) -> None:
    """Mark the cells that a camera shows within ``radius`` cells of positions."""
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
    """Return the error (m), the movement (m) and the time out of view (s) of all front points."""
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


def _accuracy(team: _Team, fire: Fire, last: int) -> Accuracy:
    """Return the means over the ``last`` steps, and the fronts at the end."""
    sd_m, moved_m, unseen_s = (
        np.concatenate([step[number] for step in team.errors[-last:]]) for number in range(3)
    )
    fronts = front_lines(fire, team.seen_s, team.learned)
    at_end_m = _errors(team.learned, fronts, fire)[0] * MEAN_OF_SD
    ends = np.cumsum([front.row.size for front in fronts])[:-1]
    shown = [
        FrontErrors(front.inner, front.row, front.col, error_m)
        for front, error_m in zip(fronts, np.split(at_end_m, ends), strict=True)
    ]
    return Accuracy(
        team.share.size,
        float(sd_m.mean() * MEAN_OF_SD),
        _quantile_m(sd_m, LIKELY),
        _mean_distance_m(moved_m, CELL_SD * fire.landscape.cell_size_m),
        float(unseen_s.mean()),
        shown,
    )


def _mean_distance_m(moved_m: Floats, sd_m: float) -> float:
    """Return the mean distance of a front that has moved (n), mapped with an error ``sd_m``."""
    part = moved_m / sd_m
    folded = sd_m * MEAN_OF_SD * np.exp(-0.5 * part**2) + moved_m * (1.0 - 2.0 * ndtr(-part))
    return float(folded.mean())


def _quantile_m(sd_m: Floats, share: float) -> float:
    """Return the distance within which a share of normal errors with these deviations is."""
    low, high = 0.0, 6.0 * float(sd_m.max())
    for _ in range(50):
        middle = 0.5 * (low + high)
        inside = float((2.0 * ndtr(middle / sd_m) - 1.0).mean())
        low, high = (middle, high) if inside < share else (low, middle)
    return high


def in_text(found: Sequence[Accuracy], name: str, minutes: float) -> str:
    """Return a table of the expected accuracy with aircraft like ``name``."""
    lines = [
        f"Expected accuracy of the estimated front {minutes:g} min after takeoff, with aircraft "
        f"like {name} that circle all fronts:",
        "aircraft  mean error  90 % within  as last seen  last observed",
    ]
    for each in found:
        lines.append(
            f"{each.aircraft or 'none':>8}  {each.error_m:8.0f} m  {each.likely_m:9.0f} m  "
            f"{each.as_last_seen_m:10.0f} m  {each.unseen_s / 60.0:5.0f} min ago"
        )
    return "\n".join(lines)
