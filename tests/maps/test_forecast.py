"""Forecasts: what is ahead, and that asking for it changes nothing."""

import asyncio
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.spread.anyangle import AnyAngleFire
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.probabilistic import ProbabilisticFire
from mission_service.fire import forecast
from mission_service.fire.ensemble import (
    MEMBERS,
    burned_ahead,
    ensemble_of,
    probability_at,
)
from mission_service.fire.forecast import Arrival, Forecasts
from tests.maps.fires import NOW_S, WEATHER, fire, land

HOUR_S = 3600.0


def ask(of: Fire, work: Callable[[Forecasts], Any], version: Callable[[], int] = lambda: 1) -> Any:
    """Whatever a coroutine on forecasts of a fire returns."""

    async def run() -> Any:
        forecasts = Forecasts(lambda: of, version, seed=4)
        try:
            return await work(forecasts)
        finally:
            forecasts.close()

    return asyncio.run(run())


def test_the_past_is_the_fire_and_the_future_what_it_will_do() -> None:
    burning, twin = fire(), fire()
    found = burned_ahead(burning.copy(), NOW_S + HOUR_S, 1, seed=4)
    assert (found.at_s, found.until_s) == (NOW_S, NOW_S + HOUR_S)
    assert np.array_equal(found.arrival_s <= NOW_S, burning.burned())
    assert np.array_equal(burning.arrival_time_s, twin.arrival_time_s)
    twin.advance(NOW_S + HOUR_S)  # over a change of weather
    assert np.array_equal(found.arrival_s <= found.until_s, twin.burned())
    assert np.array_equal(found.arrival_s[twin.burned()], twin.arrival_time_s[twin.burned()])
    assert np.count_nonzero(twin.burned()) > 1.5 * np.count_nonzero(burning.burned())


def test_forecasts_leave_the_fire_as_it_is() -> None:
    """To the last bit, while it burns on between two of them."""
    burning, twin = fire(), fire()

    async def watch(forecasts: Forecasts) -> None:
        for _ in range(3):
            await asyncio.gather(
                forecasts.arrival(burning.time_s + HOUR_S),
                forecasts.probability(burning.time_s + HOUR_S),
            )
            burning.advance(burning.time_s + 400.0)

    ask(burning, watch, version=lambda: int(burning.time_s))
    twin.advance(burning.time_s)
    assert np.array_equal(burning.expected_s(), twin.expected_s())
    for each in (burning, twin):
        each.advance(12_000.0)
    assert np.array_equal(burning.arrival_time_s, twin.arrival_time_s)


def test_chance_is_not_foreseen() -> None:
    """The daemon's fire draws from its seed: a forecast that did too would be exact."""

    def made() -> ProbabilisticFire:
        rng = np.random.default_rng(2)
        found = ProbabilisticFire(
            land(), WEATHER, [(50, 40, 0.0)], p_spread=0.05, update_s=60.0, rng=rng
        )
        found.advance(NOW_S)
        return found

    burning, twin = made(), made()
    found = burned_ahead(burning.copy(), NOW_S + HOUR_S, 1, seed=4)
    many = ensemble_of(burning, NOW_S + HOUR_S, 1, seed=4)
    for each in (burning, twin):
        each.advance(NOW_S + HOUR_S)
    assert np.array_equal(burning.arrival_time_s, twin.arrival_time_s)
    assert not np.array_equal(found.arrival_s <= found.until_s, burning.burned())
    share = probability_at(many, NOW_S + HOUR_S)
    assert np.count_nonzero((share > 0.0) & (share < 1.0)) > 50


def test_an_ensemble_agrees_on_the_past_and_spreads_in_the_future() -> None:
    burning = fire()
    many = ensemble_of(burning, NOW_S + 2 * HOUR_S, 1, seed=4)
    assert np.array_equal(probability_at(many, NOW_S), burning.burned().astype(float))
    before = probability_at(many, NOW_S)
    for ahead_s in (900.0, HOUR_S, 2 * HOUR_S):
        share = probability_at(many, NOW_S + ahead_s)
        assert (share >= before).all()
        assert np.isin(np.rint(share * MEMBERS) / MEMBERS, share).all()
        assert np.allclose(share * MEMBERS, np.rint(share * MEMBERS))
        assert np.count_nonzero((share > 0.0) & (share < 1.0)) > np.count_nonzero(
            (before > 0.0) & (before < 1.0)
        )
        before = share
    again = probability_at(ensemble_of(burning, NOW_S + 2 * HOUR_S, 1, seed=4), NOW_S + HOUR_S)
    assert np.array_equal(again, probability_at(many, NOW_S + HOUR_S))
    other = probability_at(ensemble_of(burning, NOW_S + 2 * HOUR_S, 1, seed=5), NOW_S + HOUR_S)
    assert not np.array_equal(again, other)


def test_what_is_lit_right_now_is_sure() -> None:
    many = ensemble_of(fire(0.0), 600.0, 1, seed=4)
    assert np.argwhere(probability_at(many, 0.0)).tolist() == [[50, 40]]
    assert probability_at(many, 0.0).max() == 1.0


def test_all_callers_wait_for_the_same_forecast(monkeypatch: pytest.MonkeyPatch) -> None:
    """No request: nothing. The same again: nothing. Changed by operators, or old: once."""
    copies = []
    copy = AnyAngleFire.copy

    def counted(self: AnyAngleFire) -> AnyAngleFire:
        if threading.current_thread() is threading.main_thread():  # else an ensemble's member
            copies.append(self.time_s)
        return copy(self)

    monkeypatch.setattr(AnyAngleFire, "copy", counted)
    burning, version = fire(), [1]

    async def watch(forecasts: Forecasts) -> None:
        assert not copies
        five = await asyncio.gather(*(forecasts.arrival(NOW_S + HOUR_S) for _ in range(5)))
        assert all(each is five[0] for each in five)
        assert five[0].version == 1
        burning.advance(NOW_S + 100.0)
        assert await forecasts.arrival(NOW_S + HOUR_S) is five[0]
        assert len(copies) == 1
        version[0] = 2  # people have drawn
        assert (await forecasts.arrival(NOW_S + HOUR_S)).version == 2
        assert len(copies) == 2
        burning.advance(NOW_S + 100.0 + forecast.OLD_S + 1.0)
        await forecasts.arrival(NOW_S + HOUR_S)
        assert len(copies) == 2  # old, but ten seconds have not passed
        monkeypatch.setattr(forecast, "REST_S", 0.0)
        assert (await forecasts.arrival(NOW_S + HOUR_S)).at_s == burning.time_s
        assert len(copies) == 3
        far = await forecasts.arrival(burning.time_s + 5 * HOUR_S)
        assert far.until_s >= burning.time_s + 5 * HOUR_S
        assert len(copies) == 4

    ask(burning, watch, version=lambda: version[0])


def test_a_cancelled_caller_does_not_affect_the_others() -> None:
    async def watch(forecasts: Forecasts) -> Arrival:
        leaving = asyncio.create_task(forecasts.arrival(NOW_S + HOUR_S))
        await asyncio.sleep(0)
        staying = asyncio.create_task(forecasts.arrival(NOW_S + HOUR_S))
        await asyncio.sleep(0)
        leaving.cancel()
        return await staying

    found = ask(fire(), watch)
    assert isinstance(found, Arrival)


def test_an_error_reaches_its_callers_and_the_next_request_starts_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    advance = AnyAngleFire.advance

    def broken(self: AnyAngleFire, to_time_s: float) -> None:
        raise FireModelError("no")

    async def watch(forecasts: Forecasts) -> Arrival:
        monkeypatch.setattr(AnyAngleFire, "advance", broken)
        with pytest.raises(FireModelError, match="no"):
            await forecasts.arrival(NOW_S + HOUR_S)
        monkeypatch.setattr(AnyAngleFire, "advance", advance)
        return await forecasts.arrival(NOW_S + HOUR_S)

    assert isinstance(ask(fire(), watch), Arrival)


@pytest.mark.parametrize("ahead_s", [0.0, -1000.0])
def test_of_the_past_the_observed_state_is_given(ahead_s: float) -> None:
    burning = fire()
    found = ask(burning, lambda forecasts: forecasts.arrival(NOW_S + ahead_s))
    assert isinstance(found, Arrival)
    assert found.until_s == found.at_s == NOW_S
    assert np.array_equal(found.arrival_s, burning.expected_s())
    share = ask(burning, lambda forecasts: forecasts.probability(NOW_S + ahead_s))
    assert np.array_equal(share, burning.arrival_time_s <= NOW_S + ahead_s)


@pytest.mark.parametrize(
    ("at_s", "message"),
    [
        (NOW_S + 7 * HOUR_S, r"30600 s is 7\.0 h from now; 6 h is the maximum"),
        (float("nan"), "nan s is not a time"),
        (float("inf"), "inf s is not a time"),
    ],
)
def test_times_that_cannot_be_are_refused(at_s: float, message: str) -> None:
    for work in (lambda f: f.arrival(at_s), lambda f: f.probability(at_s)):
        with pytest.raises(FireModelError, match=message):
            ask(fire(), work)
