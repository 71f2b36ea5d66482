"""Ensembles: random draws, parts that members share, and common results."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from firemodel.ensemble import products
from firemodel.ensemble.draws import Draw, latin_draws, random_draws
from firemodel.ensemble.member_fires import Ensemble, Start, Window, burned_windows
from firemodel.ensemble.products import (
    arrival_quantiles_s,
    burn_probability,
    mean_flame_length_m,
)
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.fire_scheme import Closing, Fire
from firemodel.spread.schemes import SchemeName, new_fire
from tests.firemodel.grids import landscape, weather

HOUR_S = 3600.0
LIT = (30, 30, 0.0)
STATED = Draw(1.0, 0.0, 1.0, 1.0, 0.0, 0.0, (1.0, 1.0))
# The fourth entry is equal to the third: only some schemes use it.
SKY = [weather(4.0, 270.0), weather(6.0, 250.0, 1500.0), weather(6.0, 250.0, 2000.0)]


def land() -> Landscape:
    """Return a hill with grass (1) in the west, and grass with timber (2) in the east."""
    row, col = np.indices((60, 70))
    fuel = np.where(col < 36, 1, 2)
    fuel[10:12] = 98
    return landscape(fuel, (300.0 + 3.0 * np.abs(row - 30.0)).astype(np.float32))


SETTINGS: dict[str, Any] = {"probabilistic": {"p_spread": 0.1, "update_s": 60.0}}


def begun(sky: list[Weather] = SKY, scheme: SchemeName = "anyangle") -> Start:
    settings: dict[str, Any] = (
        {"p_spread": 0.1, "update_s": 60.0} if scheme == "probabilistic" else {}
    )
    return Start(new_fire(scheme, land(), WeatherStream(sky), [], **settings), [LIT])


def burned(start: Start, draw: Draw, until_s: float = HOUR_S) -> Fire:
    fire = start.member(draw, np.random.default_rng(0))
    fire.advance(until_s)
    return fire


def whole(window: Window) -> tuple[np.ndarray, np.ndarray]:
    """Return a window's arrival times and flame lengths on the whole grid."""
    after_s, flame_m = np.full((2, 60, 70), np.nan, np.float32)
    after_s[:] = np.inf
    here = np.s_[window.top :, window.left :]
    rows, cols = window.after_s.shape
    after_s[here][:rows, :cols], flame_m[here][:rows, :cols] = window.after_s, window.flame_m
    return after_s, flame_m


def test_draws_have_the_stated_sizes_and_do_not_depend_on_each_other() -> None:
    stated = Uncertainty(0.3, 20.0, 0.1, 0.25, 0.4, 60.0)
    expected = [0.3, 20.0, 0.1, 0.4, 60.0, 60.0, 0.25, 0.25]
    for draws in (
        latin_draws(stated, 4, 900, 2),
        random_draws(stated, np.random.default_rng(4), 20_000, 2),
    ):
        table = np.array([[*draw[:6], *draw.fuel_factors] for draw in draws])
        factors = [0, 2, 3, 6, 7]
        table[:, factors] = np.log(table[:, factors])
        assert np.std(table, axis=0) == pytest.approx(expected, rel=0.03)
        assert np.abs(np.mean(table / expected, axis=0)).max() < 0.03
        assert np.abs(np.corrcoef(table.T) - np.eye(8)).max() < 0.13
    assert latin_draws(stated, 4, 9, 2) == latin_draws(stated, 4, 9, 2)
    assert latin_draws(stated, 4, 9, 2) != latin_draws(stated, 5, 9, 2)
    nothing = latin_draws(Uncertainty(0, 0, 0, 0, 0, 0), 4, 9, 2)
    assert set(nothing) == {STATED}


@pytest.mark.parametrize("scheme", ["anyangle", "devs8", "probabilistic"])
def test_a_member_without_errors_is_the_plain_fire(scheme: SchemeName) -> None:
    start = begun(scheme=scheme)
    settings: dict[str, Any] = (
        {"p_spread": 0.1, "update_s": 60.0} if scheme == "probabilistic" else {}
    )
    plain = new_fire(scheme, land(), WeatherStream(SKY), [LIT], seed=0, **settings)
    plain.advance(HOUR_S)
    member = burned(start, STATED)
    if scheme == "anyangle":  # a perturbation is a change of weather, even if it changes no value
        assert np.array_equal(member.arrival_time_s, plain.arrival_time_s)
    elif scheme == "devs8":
        assert np.array_equal(member.burned(), plain.burned())
    after_s, flame_m = whole(start.window(member, STATED))
    assert np.array_equal(after_s, member.arrival_time_s.astype(np.float32))
    expected = behaviour_of(member).flame_length_m
    assert flame_m == pytest.approx(expected, rel=1e-6, nan_ok=True)
    assert np.count_nonzero(np.isfinite(flame_m)) > 100


def test_dead_moisture_changes_rates_and_flames_as_the_stated_moisture_would() -> None:
    wetter = [
        replace(
            each,
            dead_1h_pct=1.4 * each.dead_1h_pct,
            dead_10h_pct=1.4 * each.dead_10h_pct,
            dead_100h_pct=1.4 * each.dead_100h_pct,
        )
        for each in SKY
    ]
    draw = STATED._replace(moisture_factor=1.4)
    drawn, stated = begun(), begun(wetter)
    first, second = burned(drawn, draw), burned(stated, STATED)
    assert first.arrival_time_s == pytest.approx(second.arrival_time_s, rel=1e-9)
    found = whole(drawn.window(first, draw))[1]
    assert found == pytest.approx(behaviour_of(second).flame_length_m, rel=1e-5, nan_ok=True)
    assert first.burned().sum() < burned(drawn, STATED).burned().sum()


def test_wind_factor_and_turn_change_the_stated_wind() -> None:
    draw = STATED._replace(wind_factor=1.5, turn_deg=40.0)
    other = [
        replace(
            each, wind_speed_m_s=1.5 * each.wind_speed_m_s, wind_from_deg=each.wind_from_deg + 40.0
        )
        for each in SKY
    ]
    drawn, stated = begun(), begun(other)
    first, second = burned(drawn, draw), burned(stated, STATED)
    assert np.array_equal(first.burned(), second.burned())
    # Rounding of the direction selects between paths of equal time.
    assert first.arrival_time_s == pytest.approx(second.arrival_time_s, rel=0.02)
    found = whole(drawn.window(first, draw))[1]
    expected = behaviour_of(second).flame_length_m
    assert np.nanmedian(np.abs(found / expected - 1.0)) < 1e-5


def test_each_fuel_has_a_factor_of_its_own() -> None:
    start = begun()
    plain = burned(start, STATED).arrival_time_s
    slow = burned(start, STATED._replace(fuel_factors=(1.0, 0.5))).arrival_time_s
    west = np.s_[20:40, 31:35]
    assert np.array_equal(plain[west], slow[west])
    assert slow[30, 45] > plain[30, 45] + 100.0


def test_ignitions_move_unless_nothing_burns_there() -> None:
    start = begun()
    for north_m, east_m, cell in [
        (-65.0, 30.0, (32, 31)),
        (570.0, 0.0, (30, 30)),
        (0.0, 3000.0, (30, 30)),
    ]:
        fire = burned(start, STATED._replace(north_m=north_m, east_m=east_m), 0.0)
        assert np.argwhere(fire.burned()).tolist() == [list(cell)]


def test_a_start_that_burns_is_kept_and_has_no_flame() -> None:
    fire = new_fire("anyangle", land(), WeatherStream(SKY), [LIT])
    fire.advance(1800.0)  # after the second entry has begun
    before = fire.burned()
    start = Start(fire)
    draw = STATED._replace(wind_factor=1.3, moisture_factor=0.8)
    after_s, flame_m = whole(start.window(burned(start, draw), draw))
    assert np.array_equal(after_s <= 0.0, before)
    assert np.array_equal(np.isfinite(flame_m), (after_s > 0.0) & np.isfinite(after_s))
    assert np.array_equal(fire.burned(), before)


def test_threads_give_the_same_bytes() -> None:
    start, draws = begun(), latin_draws(Uncertainty(), 1, 12, 2)
    one = list(burned_windows(start, draws, range(12), HOUR_S, 1))
    with ThreadPoolExecutor(3) as pool:
        many = list(burned_windows(begun(), draws, range(12), HOUR_S, 1, pool.map))
    for first, second in zip(one, many, strict=True):
        assert first[:2] == second[:2]
        assert first.after_s.tobytes() == second.after_s.tobytes()
        assert first.flame_m.tobytes() == second.flame_m.tobytes()
    assert len({window.after_s.tobytes() for window in one}) == 12


WALL = Closing(900.0, np.arange(20, 40) * 70 + 45)  # a control line east of the ignition


@pytest.mark.parametrize("precise", [False, True])
@pytest.mark.parametrize("begins", [False, True])
def test_a_copy_over_a_used_copy_is_the_same_as_a_new_copy(precise: bool, begins: bool) -> None:
    fire = new_fire("anyangle", land(), WeatherStream(SKY), [LIT], closings=[WALL], precise=precise)
    fire.advance(700.0 if begins else 0.0)
    assert isinstance(fire, AnyAngleFire)
    used = fire.copy()
    for number in range(3):
        used = fire.copy_over(used)
        used.perturb(2.0, 90.0 * number, 4.0)
        used.advance(used.time_s + (60.0, 300.0, 900.0)[number])
        new, again = fire.copy(), fire.copy_over(used)
        assert np.array_equal(again._labels.best_s, new._labels.best_s)
        assert np.array_equal(again._labels.source, new._labels.source)
        for each in (new, again):
            each.perturb(1.2, 10.0 * number, np.array([1.1, 0.9]))
            each.light(50, 20 + number, 1000.0)
        for time_s in (800.0, 1300.0, HOUR_S):
            for each in (new, again):
                each.advance(time_s)
            assert np.array_equal(again.arrival_time_s, new.arrival_time_s)
            assert np.array_equal(again.expected_s(), new.expected_s())
            assert np.array_equal(again.arrival_vectors(), new.arrival_vectors())
        assert again.burned().sum() > 500
        used = again
    here = np.s_[20:40, 25:60]
    assert np.array_equal(new.arrival_vectors(here), new.arrival_vectors()[:, *here])


def test_members_that_use_arrays_again_are_those_of_new_copies() -> None:
    start, draws = begun(), latin_draws(Uncertainty(), 3, 6, 2)
    windows = list(burned_windows(start, draws, range(6), HOUR_S, 1))
    for draw, window in zip(draws, windows, strict=True):
        alone = begun()
        expected = alone.window(burned(alone, draw), draw)
        assert window.after_s.tobytes() == expected.after_s.tobytes()
        assert window.flame_m.tobytes() == expected.flame_m.tobytes()


def test_products_agree_with_a_count_of_members() -> None:
    start, draws = begun(), latin_draws(Uncertainty(), 2, 11, 2)
    windows = list(burned_windows(start, draws, range(11), HOUR_S, 1))
    times_s, flames_m = (np.stack(each) for each in zip(*map(whole, windows), strict=True))
    shape = (60, 70)
    share = burn_probability(windows, shape, HOUR_S)
    assert np.array_equal(share, np.isfinite(times_s).mean(axis=0))
    assert np.array_equal(burn_probability(windows, shape, 900.0), (times_s <= 900).mean(axis=0))
    median_s, late_s = arrival_quantiles_s(windows, shape, [0.5, 1.0])
    assert np.array_equal(median_s, np.sort(times_s, axis=0)[5])
    assert np.array_equal(late_s, times_s.max(axis=0))
    with np.errstate(invalid="ignore"):
        expected = np.nansum(flames_m, axis=0) / np.isfinite(flames_m).sum(axis=0)
    assert mean_flame_length_m(windows, shape) == pytest.approx(expected, nan_ok=True, rel=1e-6)


def test_quantiles_over_several_blocks_of_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "TIMES_AT_ONCE", 1000)  # 100 rows of 5 cells for 2 members
    times_s = np.arange(120, dtype=np.float32).reshape(120, 1)
    tall = Window(200, 3, times_s, times_s)
    none = Window(0, 0, np.empty((0, 0), np.float32), np.empty((0, 0), np.float32))
    half, all_s = arrival_quantiles_s([tall, none], (600, 5), [0.5, 0.6])
    assert np.array_equal(half[200:320, 3], np.arange(120))
    assert np.count_nonzero(np.isfinite(half)) == 120
    assert not np.isfinite(all_s).any()


def test_an_ensemble_advances_copies_perturbs_and_resamples() -> None:
    start = begun()
    many = Ensemble([start.member(STATED, np.random.default_rng(0)) for _ in range(3)])
    many.advance(600.0)
    many.perturb(1, 2.0, 0.0, 1.5)
    twin = many.copy()
    with ThreadPoolExecutor(2) as pool:
        many.advance(1800.0, pool.map)
    assert (many.time_s, twin.time_s) == (1800.0, 600.0)
    sizes = [int(fire.burned().sum()) for fire in many.fires]
    assert sizes[0] == sizes[2] < sizes[1]
    share = many.burn_probability()
    assert share.sum() == pytest.approx(sum(sizes) / 3)
    many.resample([1, 1, 0])
    assert len({id(fire) for fire in many.fires}) == 3
    assert [int(fire.burned().sum()) for fire in many.fires] == [sizes[1], sizes[1], sizes[0]]
    many.perturb(0, 0.1, 0.0, 0.1)  # an independent copy
    many.advance(3000.0)
    grown = [int(fire.burned().sum()) for fire in many.fires]
    assert grown[0] < grown[1]
    for wrong in ([], [3], [-1]):
        with pytest.raises(FireModelError, match="use numbers from 0 to 2"):
            many.resample(wrong)
    with pytest.raises(FireModelError, match="same time"):
        Ensemble([many.fires[0], twin.fires[0]])


def test_a_member_needs_at_most_90_bytes_a_cell() -> None:
    fire = begun().member(STATED, np.random.default_rng(0))
    fire.advance(600.0)
    shared = {id(part) for part in fire.copy()._ground.terrain}  # type: ignore[attr-defined]
    ground = fire._ground  # type: ignore[attr-defined]
    own = [fire.arrival_time_s, *fire._labels, ground.slowness, ground.computed]  # type: ignore[attr-defined]
    assert shared == {id(part) for part in ground.terrain}
    assert sum(part.nbytes for part in own) <= 90 * fire.arrival_time_s.size


def test_steps_between_quantiles_are_in_order() -> None:
    start, draws = begun(), latin_draws(Uncertainty(), 3, 10, 2)
    windows = list(burned_windows(start, draws, range(10), HOUR_S, 1))
    found = arrival_quantiles_s(windows, (60, 70), [0.1, 0.5, 0.9])
    assert all((a <= b).all() for a, b in pairwise(found))
