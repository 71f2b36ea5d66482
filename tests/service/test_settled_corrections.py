"""Many corrections: the older half becomes part of the fire, and is no longer listed."""

from dataclasses import dataclass

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.physics.weather import Weather, WeatherStream
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.events import AnyOperatorEvent, Corrected, Erased, Undone, WindSet
from mission_service.fire import corrected_fire as corrected_fire
from mission_service.fire.correction_log import CorrectionLog
from mission_service.fire.run_estimate import RunEstimate
from mission_service.fire.scenario_fire import landscape_of

AT_US = 3_600_000_000
ANN = ("ann", "desk")
MAX_STEPS = 4


@dataclass
class Drawn:
    """A fire with corrections by operators."""

    scenario: Scenario
    world: RunEstimate

    def place(self, north: int, east: int) -> tuple[float, float]:
        """Return the place this number of cells from the ignition."""
        lit, land = self.scenario.ignition[0], self.world.landscape
        assert lit.lat_deg is not None
        assert lit.lon_deg is not None
        x_m, y_m = land.xy_of_lat_lon(lit.lat_deg, lit.lon_deg)
        cell_m = land.cell_size_m
        lat, lon = land.lat_lon_of(x_m + east * cell_m, y_m + north * cell_m)
        return float(lat), float(lon)

    def burned(self, place: tuple[float, float]) -> bool:
        """Return whether a place burns or has burned."""
        land = self.world.landscape
        row, col = (round(float(each)) for each in land.row_col_of(*land.xy_of_lat_lon(*place)))
        return bool(self.world.fire.burned()[row, col])

    def spot(self, place: tuple[float, float], state: str = "burned") -> None:
        """Return a correction of one cell."""
        self.submit(Corrected(AT_US, *ANN, state, "point", (place,), AT_US))  # type: ignore[arg-type]

    def submit(self, event: AnyOperatorEvent) -> None:
        """Submit an operator's event."""
        self.world.apply_report(event)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Drawn:
    monkeypatch.setattr(corrected_fire, "MAX_STEPS", MAX_STEPS)
    scenario = load_scenario("demo", ("landscape.rows=150", "landscape.cols=150"))
    world = RunEstimate(scenario, landscape_of(scenario))
    world.advance(AT_US)
    return Drawn(scenario, world)


def test_the_older_half_is_part_of_the_fire_and_the_newer_can_be_undone(drawn: Drawn) -> None:
    places = [drawn.place(-40 - 4 * number, -60) for number in range(MAX_STEPS + 1)]
    assert not any(drawn.burned(each) for each in places)
    for place in places:
        drawn.spot(place)
    assert all(drawn.burned(each) for each in places)
    listed = drawn.world.corrections()
    assert len(listed) == MAX_STEPS + 1 - MAX_STEPS // 2
    for _ in listed:
        drawn.submit(Undone(AT_US, *ANN))
    with pytest.raises(FireModelError, match="nothing to undo"):
        drawn.submit(Undone(AT_US, *ANN))
    assert drawn.world.corrections() == []
    assert [drawn.burned(each) for each in places] == [True, True, False, False, False]


def test_their_number_and_that_of_winds_is_bounded(drawn: Drawn) -> None:
    for number in range(5 * MAX_STEPS):
        drawn.spot(drawn.place(-40 - 2 * number, -60))
        drawn.world.advance(AT_US + 60_000_000 * (number + 1))
        at_us = round(drawn.world.fire.time_s * 1e6)
        drawn.submit(WindSet(at_us, *ANN, 1.0 + 0.1 * number, 90.0))
        assert len(drawn.world.corrections()) <= MAX_STEPS
        weather = drawn.world.fire.weather
        assert len(weather.entries) <= 1 + len(drawn.scenario.weather)
        now = weather.weather_at(drawn.world.fire.time_s)
        assert (now.wind_speed_m_s, now.wind_from_deg) == (1.0 + 0.1 * number, 90.0)


def test_what_was_erased_later_is_not_settled(drawn: Drawn) -> None:
    first, second = drawn.place(-40, -60), drawn.place(-50, -60)
    drawn.spot(first)
    drawn.spot(second)
    drawn.submit(Erased(AT_US, *ANN, *first, drawn.world.landscape.cell_size_m))
    for number in range(MAX_STEPS):
        drawn.spot(drawn.place(-60 - 4 * number, -60))
    assert not drawn.burned(first)
    assert drawn.burned(second)


def test_a_log_settles_its_first_steps() -> None:
    log = CorrectionLog()
    observations = [
        Corrected(number, *ANN, "burned", "point", ((36.0 + number, -84.0),), number)
        for number in range(3)
    ]
    for observation in observations:
        log.apply(observation)
    assert [held.correction for held in log.settle(2)] == observations[:2]
    assert log.steps == observations[2:]
    assert log.apply(Undone(9, *ANN))
    assert not log.apply(Undone(9, *ANN))


def test_weather_since_a_time_is_the_same_from_then_on() -> None:
    entries = [Weather(at_s, at_s / 100.0, 90.0, 4, 5, 6, 60, 80) for at_s in (0.0, 100.0, 200.0)]
    stream = WeatherStream(entries)
    since = stream.since(150.0)
    assert len(since.entries) == 2
    for at_s in np.linspace(150.0, 300.0, 7).tolist():
        assert since.weather_at(at_s).wind_speed_m_s == stream.weather_at(at_s).wind_speed_m_s
