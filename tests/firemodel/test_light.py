"""A cell that is lit during a fire gives the same fire as an ignition from the start."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.devs8 import Devs8Fire
from firemodel.spread.fire_scheme import Fire, Ignition
from firemodel.spread.probabilistic import ProbabilisticFire
from tests.firemodel.grids import landscape, weather

FUEL = np.ones((41, 41), np.int16)
FUEL[:, 30] = 98  # a river, which does not burn
CHANGE_S = 700.0
WEATHER = WeatherStream([weather(2.0, 270.0), weather(3.0, 180.0, CHANGE_S)])
FIRST: Ignition = (20, 8, 0.0)
END_S = 1900.0


def by_chance(ignitions: Sequence[Ignition]) -> Fire:
    rng = np.random.default_rng(3)
    return ProbabilisticFire(
        landscape(FUEL), WEATHER, ignitions, p_spread=0.2, update_s=100.0, rng=rng
    )


SCHEMES: dict[str, Callable[[Sequence[Ignition]], Fire]] = {
    "anyangle": lambda ignitions: AnyAngleFire(landscape(FUEL), WEATHER, ignitions),
    "devs8": lambda ignitions: Devs8Fire(landscape(FUEL), WEATHER, ignitions),
    "probabilistic": by_chance,
}
of_each_scheme = pytest.mark.parametrize("scheme", SCHEMES)


@of_each_scheme
@pytest.mark.parametrize(
    ("lit_at_s", "lit_s"),
    [(0.0, 600.0), (600.0, 600.0), (350.0, CHANGE_S), (CHANGE_S, CHANGE_S), (699.0, 810.0)],
)
def test_it_is_the_same_as_an_ignition_from_the_start(
    scheme: str, lit_at_s: float, lit_s: float
) -> None:
    # Cells that are lit at the same time draw random numbers in this order.
    later: list[Ignition] = [(6, 20, lit_s), (30, 25, lit_s), (5, 35, lit_s + 150.0)]
    from_start, lit_later = SCHEMES[scheme]([FIRST, *later]), SCHEMES[scheme]([FIRST])
    lit_later.advance(lit_at_s)
    for ignition in later:
        lit_later.light(*ignition)
    for fire in (from_start, lit_later):
        fire.advance(END_S)
    np.testing.assert_allclose(lit_later.arrival_time_s, from_start.arrival_time_s, rtol=1e-12)
    assert [lit_later.arrival_time_s[row, col] for row, col, _ in later] == [
        at for _, _, at in later
    ]
    assert lit_later.arrival_time_s[4, 35] < np.inf  # beyond the river


@of_each_scheme
def test_lit_now_it_burns_now(scheme: str) -> None:
    fire = SCHEMES[scheme]([])
    fire.advance(CHANGE_S)
    fire.light(20, 20, CHANGE_S)
    assert fire.burned().sum() == 1
    assert fire.arrival_time_s[20, 20] == CHANGE_S


@of_each_scheme
def test_what_has_burned_by_then_does_not_burn_again(scheme: str) -> None:
    alone, twice = SCHEMES[scheme]([FIRST]), SCHEMES[scheme]([FIRST])
    twice.advance(100.0)
    twice.light(*FIRST[:2], 100.0)
    twice.light(*FIRST[:2], 1000.0)
    for fire in (alone, twice):
        fire.advance(END_S)
    assert np.array_equal(alone.arrival_time_s, twice.arrival_time_s)


@of_each_scheme
@pytest.mark.parametrize(
    ("ignition", "message"),
    [
        ((20, 20, 99.0), "row 20, column 20: time 99.0 s must be 100 or later"),
        ((20, 20, np.nan), "time nan s must be 100 or later"),
        ((41, 20, 200.0), "row 41, column 20: outside the landscape"),
        ((-1, 20, 200.0), "row -1, column 20: outside the landscape"),
        ((20, 30, 200.0), "row 20, column 30: fuel code 98 does not burn"),
    ],
)
def test_wrong_places_and_times_are_refused(scheme: str, ignition: Ignition, message: str) -> None:
    fire = SCHEMES[scheme]([FIRST])
    fire.advance(100.0)
    with pytest.raises(FireModelError, match=message):
        fire.light(*ignition)
    assert fire.time_s == 100.0
