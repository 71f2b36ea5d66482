"""The sensor of docs/write-a-sensor.md, in a package: installed, checked and used."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mission_service.config.scenario import Scenario, load_scenario
from mission_service.errors import ScenarioError
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.fire.scenario_check import check
from mission_service.fire.sensors import Sensors
from mission_service.replay.verification import verify
from tests.api.worlds import World, world_in

GUIDE = (Path(__file__).parents[2] / "docs" / "write-a-sensor.md").read_text(encoding="utf-8")
REAL_FIRE = ("deploy_at_s=600", "planner.rule=circling")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\b[^\n]*\n(.*?)^```$", GUIDE, re.DOTALL | re.MULTILINE)


@pytest.fixture(autouse=True)
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Return a folder of packages with the guide's sensor, and an empty working folder."""
    folder = tmp_path / "site"
    info = folder / "detector-1.0.dist-info"
    info.mkdir(parents=True)
    (module,) = (each for each in blocks("python") if "class Detector" in each)
    (folder / "detector.py").write_text(module, encoding="utf-8")
    (entry,) = (each for each in blocks("toml") if "mission_service.sensors" in each)
    section = entry[entry.index("[project.entry-points") : entry.index("[tool")]
    points = section.replace('"', "").replace("project.entry-points.", "")
    (info / "entry_points.txt").write_text(points, encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: detector\nVersion: 1.0\n")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.chdir(tmp_path)


def scenario_with(*changes: str) -> Scenario:
    found = load_scenario("default", (*REAL_FIRE, *changes))
    return found.model_copy(update={"simulation": type(found.simulation)()})


def flown(tmp_path: Path, image: dict[str, object]) -> World:
    """Fly without a simulated fire; after some minutes the detector writes an image."""
    world = world_in(tmp_path, scenario_with('estimate.sensors=["detector"]'))
    world.fly(700.0)
    (tmp_path / "detector.json").write_text(json.dumps(image), encoding="utf-8")
    world.fly(900.0)
    return world


def test_its_images_reach_planners_and_estimate_and_a_replay_is_equal(tmp_path: Path) -> None:
    cells = ["u" * 40] * 10 + ["u" * 15 + "b" * 10 + "u" * 15] * 10 + ["u" * 40] * 10
    world = flown(tmp_path, {"row": 20, "col": 30, "cells": cells})
    engine = world.simulation.service
    assert engine.estimate.fire.burned()[30:40, 45:55].mean() > 0.9
    planner: Any = world.simulation.core.decision_engine.planners["hawk"]
    fire_map = planner.map
    north, east = fire_map.centre_row - 35, 50 - fire_map.centre_col
    assert fire_map.outer[round(np.degrees(np.arctan2(east, north))) % 360] > 0.0
    assert not [key for key in engine.state_view.alarms if key.startswith("sensor/")]
    engine.recording.journal.close()
    assert verify(tmp_path / "journal.jsonl").difference is None


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        ({"row": 20, "col": 199, "cells": ["uub"]}, "exceeds the landscape's grid"),
        pytest.param(
            *({"row": 20, "col": 30, "cells": ["uub", "u"]}, "rows of different lengths"),
            marks=pytest.mark.long,
        ),
        pytest.param(
            *({"row": 20, "col": 30, "cells": ["..."]}, "no observed cell"), marks=pytest.mark.long
        ),
        pytest.param(*({"row": 20}, "KeyError: 'col'"), marks=pytest.mark.long),
        pytest.param(
            *({"row": 20, "col": 30, "cells": ["uüu"]}, "letters other than b, u and ."),
            marks=pytest.mark.long,
        ),
        ({"row": "20", "col": 30, "cells": ["uub"]}, "ValidationError: Expected `int`"),
    ],
)
def test_a_sensor_that_fails_is_named_and_not_used_again(
    tmp_path: Path, image: dict[str, object], reason: str
) -> None:
    world = flown(tmp_path, image)
    alarm = world.simulation.service.state_view.alarms["sensor/detector"]
    assert "sensor detector failed" in alarm.text
    assert reason in alarm.text
    assert world.simulation.service.statistics.observations  # an image of the estimate


def test_a_problem_is_an_alarm_within_seconds_also_without_telemetry(tmp_path: Path) -> None:
    class Reporting:
        problem = ""

        def observe(self, fix: Telemetry) -> Observed | None:
            return None

        def on_event(self, event: AnyEvent) -> None:
            """Do nothing."""

    engine = world_in(tmp_path, scenario_with()).simulation.service
    sensor = Reporting()
    engine.sensors = Sensors({"folder": sensor}, engine.estimate.landscape.shape)
    engine.check_estimate(0)
    sensor.problem = "a.kml is not used"
    engine.check_estimate(5_000_000)
    assert engine.state_view.alarms["sensor/folder"].text == "sensor folder: a.kml is not used"
    sensor.problem = ""
    engine.check_estimate(10_000_000)
    assert "sensor/folder" not in engine.state_view.alarms


class UnprintableError(Exception):
    """An exception without a text."""

    def __str__(self) -> str:
        raise ValueError


@pytest.mark.parametrize("error", [UnprintableError(), SystemExit(3)])
def test_any_exception_of_a_sensor_is_caught(error: BaseException) -> None:
    class Broken:
        def observe(self, fix: Telemetry) -> Observed | None:
            raise error

        def on_event(self, event: AnyEvent) -> None:
            """Do nothing."""

    sensors = Sensors({"broken": Broken()}, (10, 10))
    fix = Telemetry(0, "hawk", 36.0, -84.0, 500.0, 100.0, 0.0, 0.0, 0.0)
    assert sensors.observe(fix) == []
    assert "sensor broken failed" in sensors.failed["broken"]
    assert sensors.observe(fix) == []


def test_all_sensors_are_closed_also_after_one_that_fails() -> None:
    closed: list[str] = []

    class Closing:
        def __init__(self, name: str) -> None:
            self._name = name

        def observe(self, fix: Telemetry) -> Observed | None:
            return None

        def on_event(self, event: AnyEvent) -> None:
            raise ValueError

        def close(self) -> None:
            closed.append(self._name)
            raise SystemExit(3)

    sensors = Sensors({name: Closing(name) for name in ("one", "two")}, (10, 10))
    sensors.on_event(Telemetry(0, "hawk", 36.0, -84.0, 500.0, 100.0, 0.0, 0.0, 0.0))
    assert sorted(sensors.failed) == ["one", "two"]
    sensors.close()
    assert closed == ["one", "two"]


def test_an_unknown_sensor_and_one_that_cannot_be_created_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(
        ScenarioError,
        match=r"0 installed packages provide this sensor, not one; .* are .*\bdetector\b",
    ):
        check(scenario_with('estimate.sensors=["thermometer"]'))
    import detector  # type: ignore[import-not-found]

    monkeypatch.setattr(detector, "Detector", lambda: None)
    with pytest.raises(ScenarioError, match=r"estimate.sensors: detector: TypeError"):
        check(scenario_with('estimate.sensors=["detector"]'))
