"""Forecasts of the estimate: future fronts, and no effect on the estimate."""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from firemodel.assimilation.fire_estimate import FireEstimate
from firemodel.errors import FireModelError
from mission_service.events import Observed, WindSet
from mission_service.fire import forecast
from mission_service.fire.forecast import Arrival, Forecasts, forecast_once
from mission_service.fire.run_ensemble import processed
from mission_service.fire.run_estimate import RunEstimate
from tests.maps.fires import NOW_S, estimated

HOUR_S = 3600.0


def ask(
    of: RunEstimate, work: Callable[[Forecasts], Any], version: Callable[[], int] = lambda: 1
) -> Any:
    """Run a coroutine with forecasts of an estimate; return its result."""

    async def run() -> Any:
        forecasts = Forecasts(lambda: of, version)
        try:
            return await work(forecasts)
        finally:
            forecasts.close()

    return asyncio.run(run())


def burning_to_the_east(estimate: RunEstimate, at_s: float) -> Observed:
    """Return an image of 20 x 20 burned cells east of the ignition."""
    return Observed(round(at_s * 1e6), "hawk", 40, 46, ("b" * 20,) * 20)


def test_the_past_is_the_estimate_and_the_future_grows_from_it() -> None:
    estimate = estimated()
    before = estimate.fire.expected_s()
    found = ask(estimate, lambda forecasts: forecasts.arrival(NOW_S + HOUR_S))
    assert (found.at_s, found.until_s >= NOW_S + HOUR_S) == (NOW_S, True)
    assert np.array_equal(found.arrival_s <= NOW_S, estimate.fire.burned())
    assert np.array_equal(estimate.fire.expected_s(), before)
    later = found.arrival_s <= NOW_S + HOUR_S
    assert np.count_nonzero(later) > 1.5 * np.count_nonzero(estimate.fire.burned())


def test_forecasts_leave_the_estimate_as_it_is() -> None:
    """Bit for bit, while the estimate burns on between two forecasts."""
    estimate, twin = estimated(), estimated()

    async def watch(forecasts: Forecasts) -> None:
        for number in range(3):
            now_s = estimate.fire.time_s
            await asyncio.gather(
                forecasts.arrival(now_s + HOUR_S), forecasts.probability(now_s + HOUR_S)
            )
            estimate.on_event(burning_to_the_east(estimate, now_s + 10.0 * number))
            estimate.advance(round((now_s + 400.0) * 1e6))

    ask(estimate, watch, version=lambda: int(estimate.fire.time_s))
    for number in range(3):
        now_s = twin.fire.time_s
        twin.on_event(burning_to_the_east(twin, now_s + 10.0 * number))
        twin.advance(round((now_s + 400.0) * 1e6))
    assert np.array_equal(estimate.fire.expected_s(), twin.fire.expected_s())


def test_the_ensemble_is_the_same_however_its_inputs_are_divided() -> None:
    estimate = estimated()
    for number in range(5):
        at_s = NOW_S + 100.0 * number
        estimate.on_event(burning_to_the_east(estimate, at_s))
        estimate.advance(round(at_s * 1e6))
    estimate.apply_report(WindSet(round((NOW_S + 600.0) * 1e6), "ann", "", 8.0, 270.0))
    begun = estimate.ensemble.processed
    inputs = estimate.ensemble.inputs_until(estimate.fire.time_s)
    assert len(inputs) >= 4
    whole = processed(begun, inputs)
    parts = begun
    for each in inputs:
        parts = processed(parts, [each])
    assert np.array_equal(whole.members.wind_error, parts.members.wind_error)
    until_s = whole.time_s + HOUR_S
    shares = [each.forecast(until_s).burn_probability(until_s) for each in (whole, parts)]
    assert np.array_equal(*shares)  # type: ignore[arg-type]
    assert begun.time_s == 0.0


def test_a_forecast_without_an_event_loop_is_the_same() -> None:
    estimate, twin = estimated(), estimated()
    arrival, probability = forecast_once(twin, HOUR_S)
    expected = ask(estimate, lambda forecasts: forecasts.arrival(NOW_S + HOUR_S))
    ahead = expected.arrival_s <= NOW_S + HOUR_S
    assert np.array_equal(arrival.arrival_s[ahead], expected.arrival_s[ahead])
    shares = ask(estimate, lambda forecasts: forecasts.probability(NOW_S + HOUR_S))
    assert probability is not None
    assert np.array_equal(probability, shares)
    now, nothing = forecast_once(twin, 0.0)
    assert nothing is None
    assert np.array_equal(now.arrival_s, twin.fire.expected_s())


def test_members_agree_on_the_present_and_spread_in_the_future() -> None:
    estimate = estimated()
    burned = estimate.fire.burned()

    async def shares(forecasts: Forecasts) -> list[Any]:
        times = (NOW_S, NOW_S + 900.0, NOW_S + HOUR_S, NOW_S + 2 * HOUR_S)
        return [await forecasts.probability(at_s) for at_s in times]

    now, *later = ask(estimate, shares)
    assert np.array_equal(now, burned.astype(float))
    before = now
    for share in later:
        assert (share[burned] == 1.0).all()
        assert (share >= before - 1e-9).all()
        before = share
    unsure = [np.count_nonzero((share > 0.1) & (share < 0.9)) for share in later]
    assert unsure[0] < unsure[1] < unsure[2]


def test_all_callers_wait_for_the_same_forecast(monkeypatch: pytest.MonkeyPatch) -> None:
    """A forecast is computed once if it is requested and is old or was corrected."""
    computed = []
    whole = forecast._forecast

    def counted(ensemble: FireEstimate, *times_s: float) -> Any:
        computed.append(ensemble)
        return whole(ensemble, *times_s)

    monkeypatch.setattr(forecast, "_forecast", counted)
    estimate, version = estimated(), [1]

    def advance(at_s: float) -> None:
        estimate.advance(round(at_s * 1e6))

    async def watch(forecasts: Forecasts) -> None:
        assert not computed
        five = await asyncio.gather(*(forecasts.arrival(NOW_S + HOUR_S) for _ in range(5)))
        assert all(each is five[0] for each in five)
        assert five[0].version == 1
        advance(NOW_S + 100.0)
        assert await forecasts.arrival(NOW_S + HOUR_S) is five[0]
        assert len(computed) == 1
        version[0] = 2  # operators have drawn
        assert (await forecasts.arrival(NOW_S + HOUR_S)).version == 2
        assert len(computed) == 2
        advance(NOW_S + 100.0 + forecast.OLD_S + 1.0)
        await forecasts.arrival(NOW_S + HOUR_S)
        assert len(computed) == 2  # it is old, but ten seconds have not passed
        monkeypatch.setattr(forecast, "REST_S", 0.0)
        assert (await forecasts.arrival(NOW_S + HOUR_S)).at_s == estimate.fire.time_s
        assert len(computed) == 3
        far = await forecasts.arrival(estimate.fire.time_s + 5 * HOUR_S)
        assert far.until_s >= estimate.fire.time_s + 5 * HOUR_S
        assert len(computed) == 4

    ask(estimate, watch, version=lambda: version[0])


def test_a_cancelled_caller_does_not_affect_the_others() -> None:
    async def watch(forecasts: Forecasts) -> Arrival:
        leaving = asyncio.create_task(forecasts.arrival(NOW_S + HOUR_S))
        await asyncio.sleep(0)
        staying = asyncio.create_task(forecasts.arrival(NOW_S + HOUR_S))
        await asyncio.sleep(0)
        leaving.cancel()
        return await staying

    found = ask(estimated(), watch)
    assert isinstance(found, Arrival)


def test_an_error_reaches_its_callers_and_the_next_request_starts_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    advance = FireEstimate.advance

    def broken(self: FireEstimate, to_time_s: float) -> None:
        raise FireModelError("no")

    async def watch(forecasts: Forecasts) -> Arrival:
        monkeypatch.setattr(FireEstimate, "advance", broken)
        with pytest.raises(FireModelError, match="no"):
            await forecasts.arrival(NOW_S + HOUR_S)
        monkeypatch.setattr(FireEstimate, "advance", advance)
        return await forecasts.arrival(NOW_S + HOUR_S)

    assert isinstance(ask(estimated(), watch), Arrival)


def test_without_any_fire_nothing_is_forecast() -> None:
    place = ("ignition_known=false", "reported_lat_deg=36.35", "reported_lon_deg=-84.16")
    estimate = estimated(NOW_S, "ignition=[]", *(f"planner.{each}" for each in place))
    found = ask(estimate, lambda forecasts: forecasts.arrival(NOW_S + HOUR_S))
    assert np.isinf(found.arrival_s).all()
    share = ask(estimate, lambda forecasts: forecasts.probability(NOW_S + HOUR_S))
    assert not share.any()


@pytest.mark.parametrize("ahead_s", [0.0, -1000.0])
def test_of_the_past_the_observed_state_is_given(ahead_s: float) -> None:
    estimate = estimated()
    found = ask(estimate, lambda forecasts: forecasts.arrival(NOW_S + ahead_s))
    assert isinstance(found, Arrival)
    assert found.until_s == found.at_s == NOW_S
    assert np.array_equal(found.arrival_s, estimate.fire.expected_s())
    share = ask(estimate, lambda forecasts: forecasts.probability(NOW_S + ahead_s))
    assert np.array_equal(share, estimate.fire.arrival_time_s <= NOW_S + ahead_s)


@pytest.mark.parametrize(
    ("at_s", "message"),
    [
        (NOW_S + 7 * HOUR_S, r"30600 s is 7\.0 h from now; the limit is 6 h"),
        (float("nan"), "nan s is not a time"),
        (float("inf"), "inf s is not a time"),
    ],
)
def test_times_that_cannot_be_are_refused(at_s: float, message: str) -> None:
    for work in (lambda f: f.arrival(at_s), lambda f: f.probability(at_s)):
        with pytest.raises(FireModelError, match=message):
            ask(estimated(), work)


def test_arrivals_at_places_are_past_now_and_ahead() -> None:
    estimate = estimated()
    shares = (0.1, 0.5, 0.9)
    burned = np.flatnonzero(estimate.fire.burned())
    row, col = np.unravel_index(burned[len(burned) // 2], estimate.fire.burned().shape)

    async def watch(forecasts: Forecasts) -> Any:
        arrival = await forecasts.arrival(NOW_S + HOUR_S)
        ahead = np.flatnonzero(
            (arrival.arrival_s > NOW_S + 600.0) & (arrival.arrival_s < NOW_S + 1200.0)
        )
        places = [burned[:1], ahead[:1], np.array([0])]
        until_s, times_s = await forecasts.arrival_quantiles_s(places, shares, HOUR_S)
        return ahead[0], arrival.arrival_s, until_s, times_s

    cell, arrival_s, until_s, times_s = ask(estimate, watch)
    assert until_s == NOW_S + HOUR_S
    assert (times_s[:, 0] == arrival_s.flat[burned[0]]).all()
    early_s, median_s, late_s = times_s[:, 1]
    assert NOW_S <= early_s < median_s <= late_s
    assert abs(median_s - arrival_s.flat[cell]) < 1200.0
    assert np.isinf(times_s[:, 2]).all()
    assert arrival_s[row, col] <= NOW_S


def test_a_forecast_of_places_is_not_too_long() -> None:
    with pytest.raises(FireModelError, match="the limit is 6 h"):
        ask(
            estimated(),
            lambda forecasts: forecasts.arrival_quantiles_s([np.array([0])], (0.5,), 7 * HOUR_S),
        )
