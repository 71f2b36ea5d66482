"""Ellipses from points, compared with closed forms, Huygens' construction and all single pairs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from firemodel.ellipses.ellipse import EllipseFire, Spread, spreads_of
from firemodel.ellipses.ellipse_kernels import reach
from firemodel.ellipses.line_ignitions import line_sources
from firemodel.errors import FireModelError
from firemodel.physics.fuels import FUEL_MODELS
from firemodel.physics.rothermel import Moisture
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from tests.firemodel.grids import CELL_M, NORTH_M, WEST_M, landscape, weather
from tests.firemodel.spread_fields import spread_fields

Floats = NDArray[np.float64]
HEAD, BACK, FLANK, TOWARD = 0.3, 0.02, 0.03, 0.5
STEADY = (Spread(0.0, HEAD, BACK, FLANK, TOWARD),)
CHANGING = (
    Spread(0.0, 0.3, 0.02, 0.03, 0.5),
    Spread(400.0, 0.1, 0.03, 0.04, 2.5),
    Spread(700.0, 0.0, 0.0, 0.0, 0.0),  # rain: no spread
    Spread(800.0, 0.5, 0.02, 0.05, -1.0),
)
ALONG = np.array([math.cos(TOWARD), math.sin(TOWARD)])
ACROSS = np.array([-math.sin(TOWARD), math.cos(TOWARD)])


def support(spread: Spread, normals: Floats) -> Floats:
    """Return the reach of an ellipse in a second in each direction (k, 2), by eqs. 1 and 2."""
    wind = np.array([math.cos(spread.toward_rad), math.sin(spread.toward_rad)])
    along, across = normals @ wind, normals @ np.array([-wind[1], wind[0]])
    centre, major = (
        (spread.head_m_s - spread.back_m_s) / 2.0,
        (spread.head_m_s + spread.back_m_s) / 2.0,
    )
    return np.asarray(centre * along + np.hypot(major * along, spread.flank_m_s * across))


def by_directions(spreads: tuple[Spread, ...], way: Floats, at_s: float, count: int) -> float:
    """Return the greatest time over many directions at which Σ τ h(n) equals d·n."""
    angles = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    left, found = normals @ way, np.where(normals @ way > 0.0, np.inf, at_s)
    ends = [spread.from_s for spread in spreads[1:]] + [math.inf]
    for spread, end in zip(spreads, ends, strict=True):
        begin = max(spread.from_s, at_s) if spread is not spreads[0] else at_s
        if end <= at_s or spread.head_m_s == 0.0:
            continue
        speed = support(spread, normals)
        fix = np.isinf(found) & (left <= speed * (end - begin))
        found[fix] = begin + left[fix] / speed[fix]
        left = left - speed * min(end - begin, 1e9)
    return float(found.max())


def every_pair(fire: EllipseFire, points: Floats) -> Floats:
    """Return the times (points, sources), each pair computed separately."""
    table = fire._table
    found = np.empty((len(points), len(fire.sources)))
    for row, (x, y) in enumerate(points):
        for col, (x0, y0, at_s) in enumerate(fire.sources):
            period = max(int(np.searchsorted(table[:, 0], at_s, side="right")) - 1, 0)
            found[row, col] = reach(x - x0, y - y0, at_s, period, np.inf, 0.0, 0.0, table)[0]
    return found


@pytest.mark.parametrize(
    "spreads",
    [
        STEADY,
        (*STEADY, STEADY[0]._replace(from_s=60.0)),
        (*STEADY, STEADY[0]._replace(from_s=60.0, toward_rad=TOWARD + 2.0 * math.pi)),
    ],
)
def test_the_ellipse_spans_according_to_the_rates(spreads: tuple[Spread, ...]) -> None:
    fire = EllipseFire(spreads, np.array([[1000.0, 2000.0, 10.0]]))
    t_s = 100.0
    middle = ALONG * (HEAD - BACK) / 2.0 * t_s
    ends = [
        ALONG * HEAD,
        -ALONG * BACK,
        middle / t_s + ACROSS * FLANK,
        middle / t_s - ACROSS * FLANK,
    ]
    places = np.array(ends) * t_s + (1000.0, 2000.0)
    assert fire.ignition_time_s(places) == pytest.approx(10.0 + t_s)
    angles = np.linspace(0.0, 6.0, 40)[:, None]
    major = (HEAD + BACK) / 2.0 * t_s
    edge = middle + major * np.cos(angles) * ALONG + FLANK * t_s * np.sin(angles) * ACROSS
    assert fire.ignition_time_s(edge + fire.sources[0, :2]) == pytest.approx(10.0 + t_s)
    assert fire.ignition_time_s(fire.sources[:, :2]) == pytest.approx(10.0)


def test_without_wind_it_is_a_circle() -> None:
    fire = EllipseFire([Spread(0.0, 0.1, 0.1, 0.1, 0.0)], np.zeros((1, 3)))
    assert fire.ignition_time_s(np.array([[3.0, 4.0], [-5.0, 0.0]])) == pytest.approx(50.0)


def test_rates_are_rothermels_and_back_and_flank_those_without_wind() -> None:
    convergence_deg = 3.0
    entries = [weather(4.0, 250.0), weather(0.0, 0.0, 600.0)]
    windy, still = spreads_of(
        2, WeatherStream(entries), lambda true_deg: true_deg - convergence_deg
    )
    for spread, entry in zip((windy, still), entries, strict=True):
        rate, heading, _ = (float(f[0, 0]) for f in spread_fields(landscape(2), entry))
        assert spread.from_s == entry.at_s
        assert spread.head_m_s == pytest.approx(rate, rel=1e-6)
        assert spread.back_m_s == spread.flank_m_s == pytest.approx(still.head_m_s)
        if entry.wind_speed_m_s:
            more_deg = convergence_deg - landscape(2).grid_convergence_deg
            toward = math.pi / 2.0 - heading + math.radians(more_deg)
            assert math.cos(spread.toward_rad - toward) == pytest.approx(1.0, abs=1e-9)
    assert windy.head_m_s > 5.0 * still.head_m_s


def test_a_fuel_burns_with_its_own_moistures_and_may_be_the_landscape_s() -> None:
    dry = Moisture(0.03, 0.04, 0.05, 0.3, 0.6)
    own = replace(weather(), of_fuels=((2, dry),))
    direct = Weather(0.0, own.wind_speed_m_s, own.wind_from_deg, *(100.0 * x for x in dry.classes))
    (found,) = spreads_of(2, WeatherStream([own]))
    assert found == spreads_of(2, WeatherStream([direct]))[0]
    land = replace(landscape(2), custom_fuels={300: replace(FUEL_MODELS[2], rate_factor=0.5)})
    (half,) = spreads_of(300, WeatherStream([direct]), fuels=land.fuels)
    assert half.head_m_s == pytest.approx(0.5 * found.head_m_s)


def test_too_wet_to_burn_it_never_comes() -> None:
    wet = Weather(0.0, 3.0, 0.0, 60.0, 60.0, 60.0, 100.0, 100.0)
    fire = EllipseFire(spreads_of(1, WeatherStream([wet])), np.zeros((1, 3)))
    assert fire.ignition_time_s(np.array([[1.0, 0.0], [0.0, 0.0]])).tolist() == [math.inf, 0.0]


@pytest.mark.parametrize("at_s", [-50.0, 0.0, 380.0, 400.0, 750.0, 2000.0])
def test_a_change_of_wind_is_exact(at_s: float) -> None:
    """The greatest time over 30,000 directions is at most the result, and hardly less."""
    random = np.random.default_rng(1)
    fire = EllipseFire(CHANGING, np.array([[0.0, 0.0, at_s]]))
    points = random.uniform(-1.0, 1.0, (40, 2)) * random.choice([10.0, 100.0, 1000.0], (40, 1))
    found = fire.ignition_time_s(points)
    bound = np.array([by_directions(CHANGING, point, at_s, 30_000) for point in points])
    assert (bound <= found + 1e-6).all()
    np.testing.assert_allclose(found, bound, rtol=1e-6)


def test_it_agrees_with_huygens() -> None:
    """Points on the edge of the first ellipse, at most 0.05 m apart, are sources of the second."""
    change_s = CHANGING[1].from_s
    angles = np.linspace(0.0, 2.0 * math.pi, 8000)[:, None]
    middle, major = ALONG * (HEAD - BACK) / 2.0, (HEAD + BACK) / 2.0
    edge = change_s * (middle + major * np.cos(angles) * ALONG + FLANK * np.sin(angles) * ACROSS)
    sources = np.column_stack([edge, np.full(len(edge), change_s)])
    huygens = EllipseFire(CHANGING[1:2], sources)
    fire = EllipseFire(CHANGING[:2], np.zeros((1, 3)))
    points = np.random.default_rng(2).uniform(-150.0, 150.0, (300, 2))
    exact_s, reference_s = fire.ignition_time_s(points), huygens.ignition_time_s(points)
    outside = exact_s > change_s
    assert outside.sum() > 200
    np.testing.assert_allclose(exact_s[outside], reference_s[outside], atol=0.05)
    assert (exact_s <= reference_s + 1e-6).all()


@pytest.mark.parametrize(("turned_deg", "tolerance"), [(None, 1e-9), (60.0, 0.01)])
def test_it_agrees_with_the_cells_of_the_same_rates(
    turned_deg: float | None, tolerance: float
) -> None:
    """The ellipses are Anderson's, as in the any-angle scheme; they are wider than section IV's."""
    entries = [weather(2.0, 200.0)]
    if turned_deg is not None:
        entries.append(weather(2.0, 200.0 + turned_deg, 3000.0))
    land = landscape(1, shape=(81, 81))
    spreads = []
    for entry in entries:
        rate, heading, e = (float(field[0, 0]) for field in spread_fields(land, entry))
        back = rate * (1.0 - e) / (1.0 + e)
        flank = (rate + back) / 2.0 * math.sqrt(1.0 - e * e)
        spreads.append(Spread(entry.at_s, rate, back, flank, math.pi / 2.0 - heading))
    cells = AnyAngleFire(land, WeatherStream(entries), [(40, 40, 0.0)])
    cells.advance(9000.0)
    rows, cols = np.nonzero(cells.burned())
    points = np.column_stack([WEST_M + (cols + 0.5) * CELL_M, NORTH_M - (rows + 0.5) * CELL_M])
    source = (WEST_M + 40.5 * CELL_M, NORTH_M - 40.5 * CELL_M, 0.0)
    exact_s = EllipseFire(spreads, np.array([source])).ignition_time_s(points)
    late = cells.arrival_time_s[rows, cols] - exact_s
    assert len(late) > 500
    assert np.abs(late).max() < tolerance * 9000.0


def test_rain_holds_the_fire_and_a_rain_for_ever_ends_it() -> None:
    dry, rain = Spread(0.0, 0.1, 0.1, 0.1, 0.0), Spread(100.0, 0.0, 0.0, 0.0, 0.0)
    points = np.array([[9.0, 0.0], [10.0, 0.0], [0.0, 12.0], [1e4, 0.0]])
    again = EllipseFire([dry, rain, dry._replace(from_s=500.0)], np.zeros((1, 3)))
    assert again.ignition_time_s(points) == pytest.approx([90.0, 100.0, 520.0, 500.0 + 99_900.0])
    ended = EllipseFire([dry, rain], np.zeros((1, 3)))
    assert ended.ignition_time_s(points) == pytest.approx([90.0, 100.0, np.inf, np.inf])


rates = st.floats(0.01, 2.0)
places = st.floats(-300.0, 300.0)
periods = st.tuples(
    st.floats(1.0, 2000.0), rates, rates, rates, st.floats(-7.0, 7.0), st.booleans()
)


@st.composite
def fires(draw: st.DrawFn) -> tuple[EllipseFire, Floats]:
    """Yield fires with points: scattered, on a line, at one place, on sources, far away."""
    spreads: list[Spread] = []
    at_s = -500.0
    for length_s, head, back, flank, toward, still in draw(
        st.lists(periods, min_size=1, max_size=5)
    ):
        spread = Spread(at_s, head, back, flank, toward)
        wet = spread._replace(head_m_s=0.0, back_m_s=0.0, flank_m_s=0.0)
        spreads.append(wet if still else spread)
        at_s += length_s
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    count = draw(st.integers(0, 40))
    sources = random.uniform(-200.0, 200.0, (count, 3)) * (1.0, 1.0, 10.0)
    sources[: count // 4] = sources[:1]
    sources[count // 2 :, 1] = 20.0
    points = np.concatenate(
        [
            random.uniform(-300.0, 300.0, (draw(st.integers(0, 150)), 2)),
            np.linspace([0.0, 0.0], [100.0, 30.0], draw(st.integers(0, 50))),
            np.full((draw(st.integers(0, 30)), 2), 7.0),
            sources[:10, :2],
            random.uniform(-1e5, 1e5, (draw(st.integers(0, 5)), 2)),
        ]
    )
    return EllipseFire(spreads, sources), points


@given(fires())
@settings(max_examples=120)
def test_what_is_left_out_is_never_first(case: tuple[EllipseFire, Floats]) -> None:
    fire, points = case
    all_s = every_pair(fire, points)
    min_s = all_s.min(axis=1, initial=np.inf)
    np.testing.assert_allclose(fire.ignition_time_s(points), min_s, rtol=1e-9, atol=1e-6)
    first = fire.sources_of(points)
    assert (first >= 0).tolist() == np.isfinite(min_s).tolist()
    came = np.flatnonzero(first >= 0)
    np.testing.assert_allclose(all_s[came, first[came]], min_s[came], rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("spreads", [STEADY, CHANGING])
def test_many_points_and_sources(spreads: tuple[Spread, ...]) -> None:
    """The quadtree has several levels; each point has the same result as if computed alone."""
    random = np.random.default_rng(5)
    sources = random.uniform(0.0, 1000.0, (300, 3)) + np.array([5e5, 4e6, 0.0])
    fire = EllipseFire(spreads, sources)
    points = random.uniform(-50.0, 1050.0, (20_000, 2)) + sources[0, :2] - 500.0
    some = random.choice(len(points), 60, replace=False)
    min_s = every_pair(fire, points[some]).min(axis=1)
    np.testing.assert_allclose(fire.ignition_time_s(points)[some], min_s, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("spreads", [STEADY, CHANGING])
def test_none_lit_no_points_and_more_lit(spreads: tuple[Spread, ...]) -> None:
    points = np.array([[3.0, 1.0], [80.0, 90.0]])
    none = EllipseFire(spreads, np.empty((0, 3)))
    assert none.ignition_time_s(points).tolist() == [math.inf, math.inf]
    assert none.sources_of(points).tolist() == [-1, -1]
    sources = np.array([[0.0, 0.0, 50.0], [70.0, 95.0, 10.0], [3.0, 1.0, 9000.0]])
    one = none.lit(sources[:1])
    more = one.lit(sources[1:])
    assert more.ignition_time_s(np.empty((0, 2))).shape == (0,)
    assert more.sources_of(points).tolist() == [0, 1]
    assert (
        more.ignition_time_s(points).tolist()
        == EllipseFire(spreads, sources).ignition_time_s(points).tolist()
    )
    assert len(one.sources) == 1
    assert more.ignition_time_s(points)[0] == one.ignition_time_s(points)[0]


def test_lines_are_points() -> None:
    corners = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 3.0]])
    found = line_sources(corners, np.array([0.0, 20.0, 20.0, 26.0]), 4.0)
    expected = np.array(
        [[0, 0, 0], [10 / 3, 0, 20 / 3], [20 / 3, 0, 40 / 3], [10, 0, 20], [10, 3, 26]]
    )
    np.testing.assert_allclose(found, expected)
    assert line_sources(corners[:1], 5.0, 4.0).tolist() == [[0.0, 0.0, 5.0]]
    # Between two sources the front is late by s² / (8 r), as documented in line_sources.
    spacing_m, r_m = 4.0, 8.0
    fire = EllipseFire(
        [Spread(0.0, 0.1, 0.1, 0.1, 0.0)], line_sources(corners[:2] * 10.0, 0.0, spacing_m)
    )
    late_m = 0.1 * fire.ignition_time_s(np.array([[spacing_m * 5.5, r_m]]))[0] - r_m
    assert late_m == pytest.approx(spacing_m**2 / (8.0 * r_m), rel=0.05)


@pytest.mark.parametrize(
    ("spreads", "sources", "message"),
    [
        ((), np.empty((0, 3)), "no spreads"),
        ((Spread(0.0, 0.1, 0.0, 0.1, 0.0),), np.empty((0, 3)), "spread 0: .*positive, or all 0"),
        ((Spread(0.0, -0.1, 0.1, 0.1, 0.0),), np.empty((0, 3)), "spread 0: .*positive"),
        ((Spread(0.0, 0.1, 0.1, 0.1, math.nan),), np.empty((0, 3)), "spread 0"),
        ((*STEADY, *STEADY), np.empty((0, 3)), "spread 1: from_s = 0.0 is not later"),
        (STEADY, np.zeros((4, 2)), r"sources have the shape \(4, 2\)"),
        (STEADY, np.array([[0.0, 0.0, math.nan]]), "source 0: .*must be finite"),
    ],
)
def test_what_cannot_be_is_refused(
    spreads: tuple[Spread, ...], sources: Floats, message: str
) -> None:
    with pytest.raises(FireModelError, match=message):
        EllipseFire(spreads, sources)


def test_wrong_points_lines_and_fuels_are_refused() -> None:
    for spreads in (STEADY, CHANGING):
        fire = EllipseFire(spreads, np.zeros((1, 3)))
        for wrong in (math.nan, math.inf):
            with pytest.raises(FireModelError, match=rf"point 1: x, y = \[7.0, {wrong}\]"):
                fire.ignition_time_s(np.array([[0.0, 0.0], [7.0, wrong]]))
    with pytest.raises(FireModelError, match="line of 1 points, spacing 0"):
        line_sources(np.zeros((1, 2)), 0.0, 0.0)
    with pytest.raises(FireModelError, match="fuel model 98: unknown"):
        spreads_of(98, WeatherStream([weather()]))
