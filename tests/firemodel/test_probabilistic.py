"""The automaton: its rule, the sizes in the paper, and results independent of the steps."""

from typing import Any

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.spread.fire_scheme import BURNED, BURNING, CANNOT_BURN, UNBURNED, Burning, Ignition
from firemodel.spread.probabilistic import ProbabilisticFire
from tests.firemodel.grids import CELL_M, landscape, steady

MIDDLE = (20, 20, 0.0)
STEP_S = 1200.0 / 190.0  # the probability in the paper


def fire_of(
    p_spread: float,
    seed: int = 1,
    ignitions: tuple[Ignition, ...] = (MIDDLE,),
    fuel: Any = 1,
    **options: Any,
) -> ProbabilisticFire:
    return ProbabilisticFire(
        landscape(fuel),
        steady(),
        ignitions,
        options.pop("burning", None),
        p_spread=p_spread,
        update_s=options.pop("update_s", 10.0),
        rng=np.random.default_rng(seed),
        **options,
    )


def size(fire: ProbabilisticFire) -> int:
    return int(fire.burned().sum())


@pytest.mark.parametrize("burning_steps", [None, 1, 3])
def test_when_all_spreads_the_fire_is_a_diamond(burning_steps: int | None) -> None:
    fire = fire_of(1.0, burning_steps=burning_steps)
    fire.advance(155.0)
    assert fire.front(155.0).area == pytest.approx(2 * 15.5**2 * CELL_M**2)
    rows, cols = np.indices((41, 41))
    steps = abs(rows - 20) + abs(cols - 20)
    expected = np.where(steps <= 15, steps * 10.0, np.inf)
    np.testing.assert_array_equal(fire.arrival_time_s, expected)
    burned_out = expected + 10.0 * (burning_steps or 1)
    burned_out[burned_out > 155.0] = np.inf
    np.testing.assert_array_equal(fire.burned_out_s, burned_out)


def test_each_burning_neighbour_is_one_chance() -> None:
    """The chance is 0.3 with one burning neighbour, 1 - 0.7² with two, and 0 from a corner."""
    lit = np.zeros((5, 41))
    for seed in range(4000):
        fire = fire_of(0.3, seed, ((20, 20, 0.0), (20, 22, 0.0)))
        fire.advance(10.0)
        lit += fire.burned()[18:23]
    share = lit / 4000
    for row, col in ((1, 20), (3, 20), (2, 19), (2, 23)):
        assert share[row, col] == pytest.approx(0.3, abs=0.03)
    assert share[2, 21] == pytest.approx(0.51, abs=0.03)
    assert lit.sum() == lit[[2, 2, 2, 2, 2, 1, 3, 1, 3], [19, 20, 21, 22, 23, 20, 20, 22, 22]].sum()


def grown(first: int, p_spread: float, seed: int) -> int:
    """Return the size 190 updates after a fire from one cell has reached the first size."""
    land = landscape(shape=(150, 150))
    rng = np.random.default_rng(seed)
    fire = ProbabilisticFire(
        land, steady(), [(75, 75, 0.0)], p_spread=p_spread, update_s=STEP_S, rng=rng
    )
    updates = 0
    while size(fire) < first:
        updates += 1
        fire.advance(updates * STEP_S)
    fire.advance((updates + 190) * STEP_S)
    return size(fire)


@pytest.mark.parametrize(
    ("first", "p_spread", "paper", "within"),
    [
        (460, 0.01, 800, 0.06),
        (2600, 0.01, 3400, 0.03),
        # 2510: the difference from the paper is unexplained (see the module).
        (1000, 0.025, 3050, 0.20),
    ],
)
def test_fires_grow_about_as_in_table_2(
    first: int, p_spread: float, paper: int, within: float
) -> None:
    sizes = [grown(first, p_spread, seed) for seed in range(20)]
    assert np.mean(sizes) == pytest.approx(paper, rel=within)


def test_by_the_literal_rule_such_a_fire_is_soon_out() -> None:
    for seed in range(50):
        fire = fire_of(0.01, seed, burning_steps=1)
        fire.advance(190 * 10.0)
        assert size(fire) <= 4
        assert fire.burned_out_s[fire.burned()].max() <= 50.0


def test_a_cell_burns_until_nothing_around_it_is_left() -> None:
    fire = fire_of(0.3)
    for update in range(1, 40):
        fire.advance(10.0 * update)
        state = fire.state_at(fire.time_s)
        left = np.pad(state == UNBURNED, 1)
        next_to_burning = left[:-2, 1:-1] | left[2:, 1:-1] | left[1:-1, :-2] | left[1:-1, 2:]
        new = fire.arrival_time_s == fire.time_s
        assert np.array_equal(state == BURNING, fire.burned() & (next_to_burning | new))
    assert (state == BURNED).sum() > 100


def test_what_cannot_burn_holds_the_fire() -> None:
    fuel = np.ones((41, 41), dtype=np.int16)
    fuel[:, 25] = 98
    fire = fire_of(0.5, fuel=fuel)
    fire.advance(10_000.0)
    assert fire.burned()[:, :25].all()
    assert not fire.burned()[:, 25:].any()
    state = fire.state_at(10_000.0)
    assert [set(state[:, cols].ravel()) for cols in (slice(25), 25, slice(26, 41))] == [
        {BURNED},
        {CANNOT_BURN},
        {UNBURNED},
    ]


@pytest.mark.parametrize("burning_steps", [None, 4])
def test_one_advance_and_many_give_the_same_bits(burning_steps: int | None) -> None:
    ignitions = ((20, 20, 0.0), (3, 3, 70.0), (38, 3, 75.5), (38, 38, 300.0))
    whole, cut, other = (
        fire_of(0.3, seed, ignitions, burning_steps=burning_steps, update_s=STEP_S)
        for seed in (5, 5, 6)
    )
    whole.advance(400.0)
    other.advance(400.0)
    for time_s in sorted({*np.linspace(0.0, 400.0, 333), 12 * STEP_S, 70.0, 75.5}):
        cut.advance(float(time_s))
    assert size(whole) > 300
    assert np.array_equal(whole.arrival_time_s, cut.arrival_time_s)
    assert np.array_equal(whole.burned_out_s, cut.burned_out_s)
    assert not np.array_equal(whole.arrival_time_s, other.arrival_time_s)


def test_states_of_the_past_stay_what_they_were() -> None:
    fire = fire_of(0.4, burning_steps=3)
    seen = []
    for time_s in range(0, 300, 7):
        fire.advance(float(time_s))
        seen.append((time_s, fire.state_at(float(time_s)), fire.front(float(time_s)).area))
    for time_s, state, area in seen:
        assert np.array_equal(fire.state_at(float(time_s)), state)
        assert fire.front(float(time_s)).area == pytest.approx(area)
    cells = (seen[-1][1] != UNBURNED).sum()
    assert cells > 300
    assert seen[-1][2] == pytest.approx(cells * CELL_M**2, rel=0.1)
    for query in (fire.state_at, fire.front):
        with pytest.raises(FireModelError, match="state at 295"):
            query(295.0)


def test_a_cell_lit_between_updates_spreads_from_the_next_one_on() -> None:
    fire = fire_of(1.0, 1, ((20, 20, 13.0), (5, 5, 20.0), (20, 21, 50.0)))
    fire.advance(12.9)
    assert size(fire) == 0
    fire.advance(60.0)  # the last cell was lit where all neighbours had burned
    assert [fire.arrival_time_s[20, col] for col in (20, 21, 22, 23)] == [13.0, 20.0, 30.0, 40.0]
    assert [fire.arrival_time_s[5, col] for col in (5, 6, 7)] == [20.0, 30.0, 40.0]


@pytest.mark.parametrize(
    ("burning_steps", "burn"), [(None, {"edge"}), (3, {"new"}), (100, {"edge", "new", "inner"})]
)
def test_a_fire_already_there_goes_on(burning_steps: int | None, burn: set[str]) -> None:
    arrival_s = np.full((41, 41), np.inf)
    arrival_s[15:26, 15:26] = 100.0
    arrival_s[18:21, 18:21] = 175.0  # a younger cell, but without unburned neighbours
    burning = Burning(200.0, arrival_s, np.empty((0, 2)))
    fire = fire_of(1.0, 1, ((2, 2, 205.0),), burning=burning, burning_steps=burning_steps)
    assert fire.time_s == 200.0
    assert np.array_equal(fire.arrival_time_s, arrival_s)
    state = fire.state_at(200.0)
    found = {"edge": state[15, 15], "new": state[19, 19], "inner": state[22, 22]}
    assert {name for name, cell in found.items() if cell == BURNING} == burn
    fire.advance(220.0)
    assert fire.arrival_time_s[14, 20] == (210.0 if "edge" in burn else np.inf)
    assert [fire.arrival_time_s[2, col] for col in (2, 3, 4)] == [205.0, 210.0, 220.0]
    if burning_steps == 3:
        assert (fire.burned_out_s[18:21, 18:21] == 210.0).all()  # two of its updates were completed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"p_spread": -0.1}, r"p_spread = -0.1 must be from 0 to 1"),
        ({"p_spread": float("nan")}, r"p_spread = nan must be"),
        ({"p_spread": 0.1, "update_s": 0.0}, r"update_s = 0.0 must be positive"),
        ({"p_spread": 0.1, "burning_steps": 0}, r"burning_steps = 0 must be 1 or more, or None"),
        ({"p_spread": 0.1, "ignitions": ((0, 41, 0.0),)}, r"row 0, column 41: outside"),
        ({"p_spread": 0.1, "ignitions": ((0, 0, -1.0),)}, r"time -1.0 s must be 0 or later"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(FireModelError, match=message):
        fire_of(**options)


def test_time_only_goes_forward() -> None:
    fire = fire_of(0.5)
    fire.advance(100.0)
    with pytest.raises(FireModelError, match=r"is at 100.0 s and cannot advance to 99.0 s"):
        fire.advance(99.0)
