"""Control lines that are built while a fire burns."""

from typing import Any

import numpy as np
import pytest
import shapely

from firemodel.ensemble.draws import latin_draws
from firemodel.ensemble.member_fires import Start
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.errors import FireModelError
from firemodel.landscape.rasterise import cells_along, cells_of, with_barriers
from firemodel.physics.weather import WeatherStream
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.control_lines import closings_along
from firemodel.spread.fire_scheme import CANNOT_BURN, Closing, Fire
from firemodel.spread.schemes import SchemeName, new_fire
from tests.firemodel.grids import CELL_M, NORTH_M, WEST_M, landscape, steady, weather

CASES: tuple[tuple[SchemeName, dict[str, Any]], ...] = (
    ("anyangle", {}),
    ("anyangle", {"precise": True}),
    ("anyangle", {"acceleration": True}),
    ("devs8", {}),
    ("probabilistic", {"p_spread": 0.7, "update_s": 60.0}),
)
SIZE = 61
LAND = landscape(1, shape=(SIZE, SIZE))
LIT = (30, 15, 0.0)
WIND = steady(6.0, 270.0)  # from the west
END_S = 6000.0


def line(*places: tuple[float, float]) -> shapely.LineString:
    """Return a line through the centres of cells (row, column)."""
    return shapely.LineString(
        [(WEST_M + (col + 0.5) * CELL_M, NORTH_M - (row + 0.5) * CELL_M) for row, col in places]
    )


WALL = line((-5, 30), (66, 30))  # from north to south across the landscape
SLOPING = line((-5, 24), (66, 41))


def burned(
    scheme: SchemeName,
    settings: dict[str, Any],
    closings: list[Closing],
    steps: int = 1,
    stream: WeatherStream = WIND,
) -> Fire:
    fire = new_fire(scheme, LAND, stream, [LIT], seed=3, closings=closings, **settings)
    for step in range(steps):
        fire.advance(END_S * (step + 1) / steps)
    return fire


@pytest.mark.parametrize(("scheme", "settings"), CASES)
def test_a_line_that_exists_is_a_barrier(scheme: SchemeName, settings: dict[str, Any]) -> None:
    found = burned(scheme, settings, closings_along([SLOPING], LAND, 0.0))
    land = with_barriers(LAND, [SLOPING])
    expected = new_fire(scheme, land, WIND, [LIT], seed=3, **settings)
    expected.advance(END_S)
    assert np.array_equal(found.arrival_time_s, expected.arrival_time_s)
    assert (found.state_at(END_S) == expected.state_at(END_S)).all()
    assert found.burned()[:, :24].sum() > 100


@pytest.mark.parametrize("wall", [WALL, SLOPING])
@pytest.mark.parametrize(("scheme", "settings"), CASES)
def test_a_line_holds_if_it_is_complete_before_the_fire_arrives(
    scheme: SchemeName, settings: dict[str, Any], wall: shapely.LineString
) -> None:
    free = burned(scheme, settings, [])
    cells, _ = cells_along(wall, LAND)
    across = np.ones((SIZE, SIZE), dtype=bool)
    for row in range(SIZE):
        across[row, : min(cells[cells // SIZE == row] % SIZE)] = False
    across.ravel()[cells] = False
    reached_s = free.arrival_time_s.ravel()[cells].min()
    assert free.burned()[across].sum() > 50
    held = burned(scheme, settings, closings_along([wall], LAND, 0.9 * reached_s))
    assert not held.burned()[across].any()
    assert not held.burned().ravel()[cells].any()
    before = free.arrival_time_s <= 0.9 * reached_s
    assert (held.arrival_time_s[before] == free.arrival_time_s[before]).all()
    assert held.burned()[~across].sum() > 100
    assert (held.state_at(END_S).ravel()[cells] == CANNOT_BURN).all()
    assert not (held.state_at(0.5 * reached_s).ravel()[cells] == CANNOT_BURN).any() or (
        scheme == "probabilistic"
    )
    late = burned(scheme, settings, closings_along([wall], LAND, 1.3 * reached_s))
    assert late.burned()[across].sum() > 20
    assert late.burned().ravel()[cells].any()


@pytest.mark.parametrize(("scheme", "settings"), CASES)
def test_the_front_passes_round_the_unfinished_end(
    scheme: SchemeName, settings: dict[str, Any]
) -> None:
    """The line is built from the north; the fire is at the wall when the line is half built."""
    free = burned(scheme, settings, [])
    half_s = free.arrival_time_s[30, 30]
    rate_m_h = (30 + 5) * CELL_M / (half_s / 3600.0)
    closings = closings_along([WALL], LAND, 0.0, rate_m_h)
    found = burned(scheme, settings, closings)
    arrival_s = found.arrival_time_s
    assert not np.isfinite(arrival_s[:25, 30]).any()
    first = int(np.isfinite(arrival_s[:, 30]).argmax())
    assert 25 < first < 45  # the gap
    beyond = arrival_s[:, 31:]
    assert np.isfinite(beyond).sum() > 30
    row, _ = np.unravel_index(np.argmin(beyond), beyond.shape)
    assert first - 1 <= row <= SIZE
    assert np.isfinite(beyond[: first - 3]).any()  # behind the line, from the gap
    closes_s = {int(cell): each.at_s for each in closings for cell in each.cells}
    for cell in range(30, SIZE * SIZE, SIZE):
        assert arrival_s.ravel()[cell] <= closes_s[cell] or not np.isfinite(arrival_s.ravel()[cell])


@pytest.mark.parametrize(("scheme", "settings"), CASES)
def test_steps_and_copies_do_not_change_the_fire(
    scheme: SchemeName, settings: dict[str, Any]
) -> None:
    stream = WeatherStream([weather(6.0, 270.0), weather(5.0, 300.0, at_s=1000.0)])
    closings = closings_along([SLOPING], LAND, 200.0, 3000.0)
    once = burned(scheme, settings, closings, 1, stream)
    again = burned(scheme, settings, closings, 41, stream)
    assert np.array_equal(once.arrival_time_s, again.arrival_time_s)
    half = new_fire(scheme, LAND, stream, [LIT], seed=3, **settings)
    half.add_closings(closings[: len(closings) // 2])
    half.add_closings(closings[len(closings) // 2 :])
    half.advance(1300.0)
    other = half.copy()
    for fire in (half, other):
        fire.advance(END_S)
        assert np.array_equal(once.arrival_time_s, fire.arrival_time_s)


def test_a_line_far_from_the_fire_changes_no_byte_of_it() -> None:
    """Each piece of the line must leave the rest of the front as it is."""
    far = line((2, 50), (2, 58))
    near = line((10, 40), (58, 40))
    for wall, until_s in ((far, 2000.0), (near, 1200.0)):
        fires = [
            new_fire("anyangle", LAND, WIND, [LIT], closings=closings)
            for closings in ([], closings_along([wall], LAND, 0.0, 2000.0))
        ]
        for fire in fires:
            fire.advance(until_s)
        assert np.array_equal(fires[0].arrival_time_s, fires[1].arrival_time_s)


def test_a_line_beside_the_fire_does_not_slow_the_rest() -> None:
    """A line is built along the flank; the head is as far as without the line."""
    free = burned("anyangle", {}, [])
    flank = line((24, 10), (24, 60))
    closings = closings_along([flank], LAND, 300.0, 4000.0)
    held = burned("anyangle", {}, closings)
    both = free.burned() & held.burned()
    later_s = held.arrival_time_s[both] - free.arrival_time_s[both]
    assert (held.burned() & ~free.burned()).sum() == 0
    south = both.copy()
    south[:27] = False
    south[LIT[:2]] = False
    ratio = held.arrival_time_s[south] / free.arrival_time_s[south]
    assert ratio.min() > 1.0 - 1e-9
    assert ratio.max() < 1.015
    assert later_s.max() > 300.0  # behind the line


def test_a_restart_from_a_later_state_has_the_finished_pieces() -> None:
    closings = closings_along([WALL], LAND, 0.0, 8000.0)
    model = new_fire("anyangle", LAND, WIND, [], closings=closings)
    fire = new_fire("anyangle", LAND, WIND, [LIT])
    fire.advance(600.0)
    burning = burning_from_arrival(fire.expected_s(), LAND, 600.0)
    again = model.restarted(burning)  # type: ignore[attr-defined]
    begun = new_fire("anyangle", LAND, WIND, [], burning, closings=closings)
    for each in (again, begun):
        each.advance(END_S)
        assert each.burned()[:, :30].sum() > 100
        assert not each.burned()[:, 30:].any()
    assert not model.burned().any()


def test_members_of_an_ensemble_are_held() -> None:
    start = Start(
        new_fire("anyangle", LAND, WIND, [], closings=closings_along([WALL], LAND, 300.0)), [LIT]
    )
    draw = latin_draws(Uncertainty(*[0.0] * 6), 1, 1, start.fuels)[0]
    member = start.member(draw._replace(wind_factor=1.3), np.random.default_rng(0))
    member.advance(END_S)
    assert member.burned()[:, :30].sum() > 100
    assert not member.burned()[:, 30:].any()


def test_ignitions_on_a_line_do_not_burn() -> None:
    for scheme, settings in CASES:
        fire = new_fire(
            scheme, LAND, WIND, [], closings=closings_along([WALL], LAND, 10.0), **settings
        )
        fire.light(30, 30, 20.0)
        fire.advance(600.0)
        assert not fire.burned().any()


def test_the_cells_of_a_line_and_the_lengths() -> None:
    straight = line((10, 10), (10, 20))
    cells, lengths_m = cells_along(straight, LAND)
    assert cells.tolist() == [10 * SIZE + col for col in range(10, 21)]
    assert lengths_m[-1] == pytest.approx(10 * CELL_M)
    assert np.diff(lengths_m)[:-1] == pytest.approx(CELL_M, abs=0.3 * CELL_M)
    assert 0.5 * CELL_M <= lengths_m[0] <= 1.01 * CELL_M
    for wall in (WALL, SLOPING, line((3.2, 4.7), (50.1, 44.9), (20.5, 58.0), (3.2, 4.7))):
        cells, _ = cells_along(wall, LAND)
        row_col = np.stack(np.divmod(cells, SIZE), axis=1)
        assert np.array_equal(row_col, cells_of([wall], LAND))


def test_lines_are_built_one_after_another_and_polygons_are_outlines() -> None:
    one, other = line((10, 10), (10, 20)), line((40, 10), (40, 20))
    closings = closings_along([shapely.MultiLineString([one, other])], LAND, 100.0, 300.0)
    assert closings[0].at_s == pytest.approx(100.0 + 3600.0 * CELL_M / 300.0, rel=0.3)
    assert closings[-1].at_s == pytest.approx(100.0 + 3600.0 * 20 * CELL_M / 300.0)
    at_s = {int(cell): each.at_s for each in closings for cell in each.cells}
    assert at_s[10 * SIZE + 20] < at_s[40 * SIZE + 10]
    ring = shapely.Polygon(line((10, 10), (10, 20), (20, 20), (20, 10)).coords)
    cells = np.concatenate([each.cells for each in closings_along([ring], LAND, 0.0)])
    assert len(np.unique(cells)) == 40
    for wrong, message in (
        (shapely.Point(WEST_M, NORTH_M), "Point, not a line"),
        (shapely.LineString([(0, 0), (1, 1)]), "no part of it is on the landscape"),
        (shapely.LineString([(0, 0), (1e9, 1)]), "extends far from the landscape"),
        (shapely.LineString([(0, 0), (np.inf, np.inf)]), "extends far from the landscape"),
    ):
        with pytest.raises(FireModelError, match=message):
            closings_along([wrong], LAND, 0.0)
