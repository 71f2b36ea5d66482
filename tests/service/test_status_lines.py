"""The lines that ``run`` and ``sim`` print about each vehicle."""

import numpy as np

from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.schemes import new_fire
from mission_service.events import Telemetry
from mission_service.experiments.fires import flat
from mission_service.runtime.observation_sources import ObservationSources
from mission_service.runtime.progress import status_lines
from mission_service.runtime.run_statistics import RunStatistics

HAWK = "hawk"


def test_the_line_states_whether_a_vehicle_is_on_the_ground() -> None:
    ground = flat(np.full((20, 20), 1, np.int16))
    weather = WeatherStream([Weather(0.0, 2.0, 0.0, 5.0, 6.0, 7.0, 60.0, 90.0)])
    fire = new_fire("anyangle", ground, weather, [(10, 10, 0.0)])
    statistics = RunStatistics((HAWK,), 0, ObservationSources(ground, (), 0))
    (line,) = status_lines(statistics, fire)
    assert f"{HAWK}: on the ground" in line
    for at_us, height_m, expected in ((1, 100.0, "flying"), (2, 0.0, "on the ground")):
        place = 36.0, -117.0, height_m, height_m
        statistics.apply(Telemetry(at_us, HAWK, *place, 0.0, 12.0, 0.0), [])
        (line,) = status_lines(statistics, fire)
        assert f"{HAWK}: {expected} " in line
