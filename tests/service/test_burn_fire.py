"""The estimate of a fire from reports and observations."""

from dataclasses import replace

import numpy as np

from benchmarks.burn_frames import SIDE_M, place
from firemodel.landscape.default import jacksboro
from firemodel.physics.fuels import FUEL_MODELS
from firemodel.physics.rothermel import Moisture
from firemodel.physics.weather import WeatherStream
from mission_service.events import Corrected, Erased, IgnitionReported, Place, Undone, WindSet
from mission_service.fire.estimated_fire import EstimatedFire
from mission_service.fire.scenario_fire import weather_of
from tests.service.test_burn_flight import scenario

OPERATOR_FIELDS = ("ada", "boss")


def estimated() -> EstimatedFire:
    loaded = scenario()
    assert loaded.burn is not None
    return EstimatedFire(loaded.burn, jacksboro(100, 100, 5.0), weather_of(loaded))


def times_s(fire: EstimatedFire, *places: Place) -> list[float]:
    places_m = fire._landscape.xy_of_places(places)
    found: list[float] = fire.simulation.ignition_time_s(places_m).tolist()
    return found


def burning(x_m: float, y_m: float, at_s: float) -> Corrected:
    at_us = round(at_s * 1e6)
    return Corrected(at_us, *OPERATOR_FIELDS, "burning", "point", (place(x_m, y_m),), at_us)


def test_the_fire_burns_the_fuel_of_the_landscape_with_its_own_moistures() -> None:
    loaded = scenario()
    assert loaded.burn is not None
    land, stream = jacksboro(100, 100, 5.0), weather_of(loaded)
    code, none = loaded.burn.fuel_model, np.empty((0, 3))
    slow = replace(land, custom_fuels={code: replace(FUEL_MODELS[code], rate_factor=0.5)})
    wet = Moisture(0.12, 0.12, 0.12, 1.5, 1.5)
    wetter = WeatherStream([replace(each, of_fuels=((code, wet),)) for each in stream.entries])
    head_m_s, slow_m_s, wet_m_s = (
        EstimatedFire(loaded.burn, *of).lights(none).spreads[0].head_m_s
        for of in ((land, stream), (slow, stream), (land, wetter))
    )
    assert slow_m_s == 0.5 * head_m_s
    assert 0.0 < wet_m_s < 0.8 * head_m_s


def test_a_correction_moves_the_fire_and_undo_moves_it_back() -> None:
    fire, fix = estimated(), place(60.0, 30.0)
    (before_s,) = times_s(fire, fix)
    assert fire.apply(burning(60.0, 30.0, 300.0))
    (after_s,) = times_s(fire, fix)
    assert before_s > 900.0
    assert abs(after_s - 300.0) < 0.2 * (before_s - 300.0)
    assert fire.apply(Undone(400_000_000, *OPERATOR_FIELDS))
    assert times_s(fire, fix) == [before_s]


def test_of_a_line_that_is_erased_in_part_the_rest_holds() -> None:
    fire = estimated()
    line = (place(10.0, 30.0), place(110.0, 30.0))
    fire.apply(Corrected(300_000_000, *OPERATOR_FIELDS, "burning", "line", line, 300_000_000))
    observations = len(fire._observations)
    fire.apply(Erased(310_000_000, *OPERATOR_FIELDS, *place(20.0, 30.0), 25.0))
    assert 0 < len(fire._observations) < observations


def test_it_does_not_depend_on_queries_in_between() -> None:
    rng = np.random.default_rng(3)
    asked, quiet = estimated(), estimated()
    events = [
        burning(float(x), 20.0 + 0.05 * number, 200.0 + number)
        for number, x in enumerate(rng.uniform(0.0, SIDE_M, 12))
    ]
    lit = ((place(10.0, 90.0), place(30.0, 90.0)), 206_000_000)
    events[6:6] = [IgnitionReported(206_000_000, *OPERATOR_FIELDS, *lit)]  # type: ignore[list-item]
    for event in [*events, WindSet(300_000_000, *OPERATOR_FIELDS, 3.0, 20.0), *events[:3]]:
        asked.apply(event)
        quiet.apply(event)
        times_s(asked, place(40.0, 40.0))
        asked.hold((0.0, 0.0, 1e6))
        asked.held = asked.held[:0]
    places = [place(float(x), float(y)) for x, y in rng.uniform(0.0, SIDE_M, (50, 2))]
    assert times_s(asked, *places) == times_s(quiet, *places)
