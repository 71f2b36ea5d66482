"""Copies of a fire that advance independently, and fires with perturbed wind and rates."""

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.physics.weather import WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.burning import burning_from_arrival
from firemodel.spread.devs8 import Devs8Fire
from firemodel.spread.fire_scheme import Burning, Fire
from firemodel.spread.probabilistic import ProbabilisticFire
from tests.firemodel.grids import landscape, steady, weather

Make = Callable[[WeatherStream, Burning | None], Fire]

LAND = landscape(
    np.kron([[1, 2, 5], [2, 1, 2], [5, 2, 1]], np.ones((21, 21), dtype=np.int64))[:61, :61],
    np.add.outer(np.linspace(0, 300, 61), 20.0 * np.sin(np.linspace(0, 9, 61))),
)
LIT = [(30, 30, 0.0), (35, 40, 5400.0)]
NOW_S = 4000.0
CHANGING = WeatherStream(
    [weather(3.0, 200.0), weather(5.0, 260.0, 3000.0), weather(2.0, 0.0, 6000.0)]
)


def chance(stream: WeatherStream, burning: Burning | None) -> Fire:
    rng = np.random.default_rng(5)
    return ProbabilisticFire(LAND, stream, LIT, burning, p_spread=0.05, update_s=60.0, rng=rng)


SCHEMES: dict[str, Make] = {
    "anyangle": lambda stream, burning: AnyAngleFire(LAND, stream, LIT, burning),
    "devs8": lambda stream, burning: Devs8Fire(LAND, stream, LIT, burning),
    "probabilistic": chance,
}


def arrays_in(thing: Any) -> Iterator[NDArray[Any]]:
    """Return all arrays of a fire, including those in tuples."""
    values = vars(thing).values() if isinstance(thing, Fire) else thing
    for value in values:
        if isinstance(value, np.ndarray):
            yield value
        elif isinstance(value, tuple):
            yield from arrays_in(value)


@pytest.mark.parametrize("taken_over", [False, True])
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_copy_goes_on_alike_and_apart(scheme: str, taken_over: bool) -> None:
    """Weather changes and an ignition follows; only one copy is lit and perturbed."""
    burning = None
    if taken_over:
        arrival_s = np.full(LAND.shape, np.inf)
        arrival_s[28:33, 28:33] = -50.0
        burning = burning_from_arrival(arrival_s, LAND, 0.0)
    fire, twin = (SCHEMES[scheme](CHANGING, burning) for _ in range(2))
    for each in (fire, twin):
        each.advance(NOW_S)
    alike, apart, deep = fire.copy(), fire.copy(), copy.deepcopy(fire)
    before, all_before = fire.arrival_time_s.copy(), [each.copy() for each in arrays_in(fire)]
    apart.draw_from(np.random.default_rng(8))
    apart.perturb(1.5, 60.0, 1.6)
    apart.light(5, 5, NOW_S)
    apart.advance(6500.0)
    for now, then in zip(arrays_in(fire), all_before, strict=True):  # the copy has not changed
        assert np.array_equal(now, then, equal_nan=now.dtype.kind == "f")
    for at_s in (6500.0, 7000.0, 9000.0):  # alternately
        fire.advance(at_s)
        apart.advance(at_s + 500.0)
        alike.advance(at_s)
    twin.advance(9000.0)
    deep.advance(9000.0)
    for other in (alike, twin, deep):
        assert np.array_equal(fire.arrival_time_s, other.arrival_time_s)
        assert np.array_equal(fire.expected_s(), other.expected_s())
        assert fire.front(8000.0).equals(other.front(8000.0))
    assert np.count_nonzero(fire.burned()) > np.count_nonzero(before <= NOW_S)
    assert not np.array_equal(fire.arrival_time_s, apart.arrival_time_s)


@pytest.mark.parametrize("scheme", ["anyangle", "devs8"])
def test_perturbed_is_as_if_the_weather_were_so(scheme: str) -> None:
    """Compare with a fire that was created with the changed wind in these entries."""
    fire = SCHEMES[scheme](CHANGING, None)
    fire.advance(NOW_S)
    fire.perturb(1.3, 25.0, 1.0)
    first, now, later = CHANGING.entries
    others = [
        replace(each, at_s=at_s, wind_speed_m_s=1.3 * each.wind_speed_m_s, wind_from_deg=from_deg)
        for each, at_s, from_deg in ((now, NOW_S, 285.0), (later, 6000.0, 25.0))
    ]
    with_forecast = SCHEMES[scheme](WeatherStream([first, now, *others]), None)
    for each in (fire, with_forecast):
        each.advance(9000.0)
    burned = with_forecast.burned()
    assert np.array_equal(fire.burned(), burned)
    off_s = np.abs(fire.arrival_time_s[burned] - with_forecast.arrival_time_s[burned])
    # Rounding may select between two sources that give a node equal times, but must not change the
    # next node.
    assert np.count_nonzero(off_s > 1e-6) <= (2 if scheme == "anyangle" else 0)
    as_forecast = SCHEMES[scheme](CHANGING, None)
    as_forecast.advance(9000.0)
    assert np.count_nonzero(as_forecast.burned() != burned) > 0.1 * np.count_nonzero(burned)


@pytest.mark.parametrize("scheme", ["anyangle", "devs8"])
def test_each_weather_entry_may_have_its_own_change_of_wind(scheme: str) -> None:
    """The second entry ahead keeps its wind, as if it came after the change."""
    fire, known = SCHEMES[scheme](CHANGING, None), SCHEMES[scheme](CHANGING, None)
    fire.advance(NOW_S)
    assert len(fire.weather_ahead()) == 2
    fire.perturb(np.array([1.3, 1.0]), np.array([25.0, 0.0]), 1.0)
    fire.advance(9000.0)
    known.advance(NOW_S)
    known.perturb(1.3, 25.0, 1.0)
    known.advance(6000.0)
    assert np.array_equal(fire.arrival_time_s <= 6000.0, known.burned())
    first, now, later = CHANGING.entries
    changed = replace(now, at_s=NOW_S, wind_speed_m_s=1.3 * now.wind_speed_m_s, wind_from_deg=285.0)
    expected = SCHEMES[scheme](WeatherStream([first, now, changed, later]), None)
    expected.advance(9000.0)
    assert np.array_equal(fire.burned(), expected.burned())


@pytest.mark.parametrize("scheme", ["anyangle", "devs8"])
def test_twice_the_rate_is_half_the_time(scheme: str) -> None:
    """In any fuel, on slopes and in wind, from the time of the change on."""
    steady = WeatherStream([weather(3.0, 200.0)])
    fire = SCHEMES[scheme](steady, None)
    fire.advance(2000.0)
    fast = fire.copy()
    fast.perturb(1.0, 0.0, 2.0)
    fire.advance(5000.0)
    fast.advance(3500.0)
    later = (fire.arrival_time_s > 2000.0) & (fire.arrival_time_s < 4900.0)
    assert np.count_nonzero(later) > 100
    halved = 2000.0 + (fire.arrival_time_s[later] - 2000.0) / 2.0
    # At a change, the any-angle scheme joins the active lines again.
    off_s = 20.0 if scheme == "anyangle" else 1e-6
    np.testing.assert_allclose(fast.arrival_time_s[later], halved, atol=off_s)


def test_chance_perturbed_burns_faster() -> None:
    fires = [chance(CHANGING, None) for _ in range(2)]
    fires[1].perturb(1.0, 0.0, 3.0)
    for fire in fires:
        fire.advance(9000.0)
    slow, fast = (int(np.count_nonzero(fire.burned())) for fire in fires)
    assert fast > 2 * slow


@pytest.mark.parametrize("factors", [(np.inf, 0.0, 1.0), (1.0, np.nan, 1.0), (1.0, 0.0, -1.0)])
def test_a_perturbation_without_meaning_is_refused(factors: tuple[float, float, float]) -> None:
    fire = AnyAngleFire(landscape(np.full((9, 9), 1)), steady(), [(4, 4, 0.0)])
    with pytest.raises(FireModelError, match=r"perturb: .* factors must be 0 to"):
        fire.perturb(*factors)
