"""``plan --what-if``: the expected error of the estimate with different numbers of aircraft."""

import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from firemodel.assimilation.learned_inputs import MODEL_ERROR, PRIOR
from mission_service.cli.main import main
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_fire import landscape_of
from mission_service.simulation import expected_accuracy as accuracy
from mission_service.simulation.expected_accuracy import Accuracy, expected_accuracy

EVEN = (
    "landscape.source=flat",
    "landscape.lat_deg=36.35",
    "landscape.lon_deg=-84.15",
    "landscape.rows=120",
    "landscape.cols=120",
    "landscape.fuel_model=1",
    "weather.0.wind_speed_m_s=0",
    "deploy_at_s=3600",
)


def even(*changes: str) -> Scenario:
    """Return a circular fire in short grass, without wind, in the middle of a flat landscape."""
    found = load_scenario("default", (*EVEN, *changes))
    place = {"lat_deg": 36.35, "lon_deg": -84.15}
    ignition = (found.ignition[0].model_copy(update=place),)
    vehicle = found.vehicles[0].model_copy(
        update={f"home_{name}": value for name, value in place.items()}
    )
    weather = found.weather[:1]
    return found.model_copy(
        update={"ignition": ignition, "vehicles": (vehicle,), "weather": weather}
    )


def expected(scenario: Scenario, counts: list[int], minutes: float = 60.0) -> list[Accuracy]:
    land = landscape_of(scenario)
    return expected_accuracy(scenario, land, scenario.vehicles[0], counts, minutes)


def test_without_aircraft_the_error_follows_from_the_prior_of_the_inputs() -> None:
    (found,) = expected(even(), [0])
    (front,) = found.fronts
    radius_m = 30.0 * float(
        np.hypot(front.row - front.row.mean(), front.col - front.col.mean()).mean()
    )
    # Without wind the speed depends on the rate of all fuels, of this fuel and of the block.
    relative = math.hypot(PRIOR[0], PRIOR[3], PRIOR[4], MODEL_ERROR)
    # The error is a mean over the last ten minutes of two hours.
    assert found.error_m == pytest.approx(
        radius_m * (115.25 / 120.0) * relative * math.sqrt(2.0 / math.pi), rel=0.05
    )
    assert found.as_last_seen_m == pytest.approx(radius_m * 115.25 / 120.0, rel=0.05)


def test_the_time_since_observation_is_that_of_circling() -> None:
    slow = even()
    slow = slow.model_copy(
        update={"vehicles": (slow.vehicles[0].model_copy(update={"airspeed_m_s": 2.0}),)}
    )
    one, two = expected(slow, [1, 2], minutes=120.0)
    front = one.fronts[0]
    length_m = 30.0 * float(
        np.hypot(*(each - np.roll(each, 1) for each in (front.row, front.col))).sum()
    )
    in_view_s = 2.0 * 150.0 * math.tan(math.radians(50.0)) / 2.0  # the camera's disc passes
    for found in (one, two):
        assert found.unseen_s is not None
        lap_s = length_m / 2.0 / found.aircraft
        out_of_view_s = (lap_s - in_view_s) ** 2 / (2.0 * lap_s)
        assert found.unseen_s == pytest.approx(out_of_view_s, abs=accuracy.STEP_S / 2.0)
    assert two.error_m < one.error_m
    assert two.as_last_seen_m < one.as_last_seen_m


def test_one_aircraft_lowers_the_error_by_more_than_90_percent() -> None:
    none, one = expected(even(), [0, 1])
    assert one.error_m < 0.1 * none.error_m
    assert one.within_90_m > one.error_m


def test_in_wind_a_tour_takes_longer() -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 721)
    row, col = 100.0 * np.cos(angle), 100.0 * np.sin(angle)
    calm, wind = (
        float(accuracy._times_s(row, col, np.array([north, 0.0]), 20.0, 10.0)[-1])
        for north in (0.0, 10.0)
    )
    assert calm == pytest.approx(2.0 * math.pi * 1000.0 / 20.0, rel=1e-4)
    course = np.linspace(0.0, 2.0 * math.pi, 10_001)[:-1]
    ground_m_s = 10.0 * np.cos(course) + np.sqrt(400.0 - (10.0 * np.sin(course)) ** 2)
    assert wind == pytest.approx(
        1000.0 * 2.0 * math.pi * float((1.0 / ground_m_s).mean()), rel=1e-3
    )
    storm = accuracy._times_s(row, col, np.array([50.0, 0.0]), 20.0, 10.0)
    assert np.all(np.diff(storm) > 0.0)


def test_distances_follow_the_normal_distribution() -> None:
    assert accuracy._quantile_m(np.full(5, 10.0), 0.9) == pytest.approx(16.449, rel=1e-3)
    assert accuracy._mean_distance_m(np.zeros(3), 10.0) == pytest.approx(10.0 * accuracy.MEAN_OF_SD)
    assert accuracy._mean_distance_m(np.full(3, 200.0), 10.0) == pytest.approx(200.0)


@pytest.mark.parametrize(
    ("counts", "minutes", "text"),
    [
        ([-1], 60.0, "the numbers of aircraft must be from 0 to 50"),
        ([51], 60.0, "the numbers of aircraft must be from 0 to 50"),
        ([1], 5.0, "5 minutes: must be from 10 to 1440 minutes"),
        ([1], math.nan, "nan minutes"),
    ],
)
def test_invalid_counts_and_minutes_are_refused(
    counts: list[int], minutes: float, text: str
) -> None:
    with pytest.raises(ScenarioError, match=text):
        expected(even(), counts, minutes)


def test_parts_at_the_edge_are_left_out_with_a_warning() -> None:
    warnings: list[str] = []
    small = even("landscape.rows=20", "landscape.cols=20", "deploy_at_s=7200")
    land = landscape_of(small)
    (found,) = expected_accuracy(small, land, small.vehicles[0], [1], 90.0, warnings.append)
    (text,) = warnings
    assert "the parts of the front there are ignored" in text
    for front in found.fronts:
        assert np.all((front.row > 0.5) & (front.row < 18.5))
        assert np.all((front.col > 0.5) & (front.col < 18.5))
    (found,) = expected(small, [1], minutes=10.0)
    assert found.error_m < 20.0


def test_a_wind_that_stops_planes_is_a_warning_and_does_not_slow_copters() -> None:
    def with_vehicle(kind: str) -> Scenario:
        windy = even("weather.0.wind_speed_m_s=9")
        changes = {"kind": kind, "airspeed_m_s": 9.0}
        return windy.model_copy(
            update={"vehicles": (windy.vehicles[0].model_copy(update=changes),)}
        )

    found, warnings = [], []
    for kind in ("plane", "copter"):
        scenario = with_vehicle(kind)
        land, texts = landscape_of(scenario), list[str]()
        section = scenario.vehicles[0]
        found += expected_accuracy(scenario, land, section, [1], 20.0, texts.append)
        warnings.append(texts)
    assert "the aircraft cannot fly against the wind" in warnings[0][-1]
    assert not any("fly against" in text for text in warnings[1])
    assert found[1].error_m < found[0].error_m


def test_aircraft_that_arrive_too_late_have_observed_nothing() -> None:
    far = even()
    far = far.model_copy(
        update={"vehicles": (far.vehicles[0].model_copy(update={"home_lat_deg": 37.5}),)}
    )
    none, one = expected(far, [0, 1], minutes=20.0)
    assert one.unseen_s is None
    assert one.error_m == none.error_m


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["plan", *arguments])


def test_the_command_prints_a_table_and_draws_a_picture(tmp_path: Path) -> None:
    picture = tmp_path / "accuracy.png"
    changes = [word for change in EVEN[3:5] for word in ("--set", change)]
    result = call("default", "--what-if", "1,3", "--minutes", "20", "-o", str(picture), *changes)
    assert result.exit_code == 0, result.output
    first, header, *rows = result.stdout.splitlines()
    assert "20 min after takeoff, with aircraft like hawk" in first
    assert header.split()[0] == "aircraft"
    assert [row.split()[0] for row in rows] == ["none", "1", "3"]
    assert picture.read_bytes().startswith(b"\x89PNG")
    result = call("default", "--what-if", "--json", "--minutes", "20", *changes)
    report = json.loads(result.stdout)
    assert [row["aircraft"] for row in report["accuracy"]] == [0, 1, 2, 4]
    assert report["vehicle"] == "hawk"


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["default", "--what-if", "one"], 2, "specify numbers of aircraft"),
        (["--what-if", "default"], 2, "Missing argument 'SCENARIO'"),
        (["default"], 2, "specify the .plan file to write (-o), or --what-if"),
        (
            ["default", "--what-if", "--set", "ignition.0.at_s=9000"],
            1,
            "nothing burns at the first",
        ),
        (["default", "--what-if", "--vehicle", "owl"], 1, "has no vehicle 'owl'"),
        (["default", "--what-if", "99"], 2, "must be from 0 to 50"),
        (["default", "--what-if", "-o", ""], 2, "Is a directory; specify the path of a PNG file"),
        (
            ["default", "--what-if", "-o", "nowhere/a.png"],
            2,
            "nowhere/a.png: No such file or directory",
        ),
        (["default", "--what-if", "-o", "a.jpg"], 2, "use a name that ends in .png"),
        (["default", "--what-if", "-o", os.devnull], 2, "it is a device, a pipe or a socket"),
    ],
)
def test_an_invalid_command_gets_the_reason(arguments: list[str], code: int, text: str) -> None:
    result = call(*arguments)
    assert result.exit_code == code
    assert text in result.output
