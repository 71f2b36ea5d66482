"""A refused value is reported with key, value, allowed range and remedy."""

import asyncio
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest
from msgspec import Meta
from pydantic import BaseModel, Field

from mission_service.config.scenario import load_scenario
from mission_service.core.request_events import event_of
from mission_service.errors import RequestError, ScenarioError
from mission_service.value_errors import got, in_words, remedy, schema_at
from tests.api.worlds import client, scenario_of, served, world_in

VALIDATOR = re.compile(r"Expected|Input should|Object (missing|contains)|\$\.|`|valid (tuple|dict)")
USER = {"by": "ann", "station": "desk"}


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (
            {"do": "wind", "speed_m_s": -3, "from_deg": 0},
            "speed_m_s: must be a number from 0 to 100",
        ),
        ({"do": "wind", "speed_m_s": "4", "from_deg": 0}, "from 0 to 100 (got '4')"),
        ({"do": "wind", "from_deg": 0}, "speed_m_s: is missing; specify a number from 0 to 100"),
        ({"do": "go", "item": ""}, "item: must be a string of 1 to 200 characters (got '')"),
        ({"do": "lit", "points": []}, "points: must be a list of 1 to 1000 entries"),
        (
            {"do": "lit", "points": [[1, 2], [3, 400]]},
            "points.1.1: must be a number from -180 to 180",
        ),
        ({"do": "lit", "points": [[1]]}, "points.0: must be a list of 2 entries"),
        ({"do": "hold", "vehicle": "", "confirmed": 3}, "confirmed: must be true or false (got 3)"),
        (
            {"do": "hold", "vehicle": "a b"},
            "must be the name of a vehicle: letters, digits, - and _",
        ),
        (
            {"do": "plan", "line_spacing_m": 0},
            "line_spacing_m: must be a number from 1 to 1000 (got",
        ),
        ({"do": "wind", "speed": 3}, "speed: unknown key; the keys are by, station, speed_m_s"),
        (
            {"do": "correct", "state": "wet", "shape": "point", "points": [[1, 2]]},
            "state: must be one of burned, burning, unburned (got 'wet')",
        ),
        ({"do": "lit", "points": [[0, 10**400]]}, "points.0.1: must be a number from -180 to 180"),
        ({"do": "wind", "\ud800": 1}, "not valid Unicode"),
    ],
)
def test_a_request(request_: dict[str, Any], text: str) -> None:
    with pytest.raises(RequestError) as caught:
        event_of({**USER, **request_}, 0)
    words = str(caught.value)
    assert words.startswith(f"{request_['do']}: ")
    assert text in words
    assert not VALIDATOR.search(words)


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("weather.0.wind_speed_m_s=-3", "weather.0.wind_speed_m_s: must be a number from 0 to 100"),
        ("duration_s=0", "duration_s: must be a number, above 0 and at most 3.2e+08"),
        ("link.loss=1", "link.loss: must be a number, at least 0 and below 1 (got 1)"),
        ("seed=1.5", "seed: must be a whole number, at least 0 (got 1.5)"),
        ('vehicles.0.name="a b"', "vehicles.0.name: must be letters, digits, - and _, at most 40"),
        ('clock="sundial"', "clock: must be one of autopilot, wall (got 'sundial')"),
        ("weather=3", "weather: must be a list (got 3)"),
        ("ignition.0=4", "ignition.0: must be a table of keys and values (got 4)"),
        ('time_zero="noon"', "time_zero: must be a date and time, such as 2026-"),
        ("planner.alpha=-1", "planner.alpha: must be a number, at least 0 (got -1)"),
        (
            "weather.0={at_s=0,wind_from_deg=0}",
            "weather.0.wind_speed_m_s: is missing; specify a num",
        ),
        ("weather_file={path=3}", "weather_file.path: must be the path of a file (got 3)"),
        (
            "duration_s=1e300",
            "duration_s: must be a number, above 0 and at most 3.2e+08 (got 1e+300)",
        ),
        ("duration_s=true", "duration_s: must be a number, above 0 and at most 3.2e+08 (got True)"),
        ("seed=false", "seed: must be a whole number, at least 0 (got False)"),
        ("landscape.bands={fuel=true}", "landscape.bands: contains true or false instead of a"),
        (
            "service.journal.keep_mb=true",
            "service.journal.keep_mb: must be a number, above 0 (got True)",
        ),
        ("time_zero=2026-08-01T12:00:00", "time_zero: has no UTC offset; add it, as in 2026-08-01"),
        ("landscape.lat_deg=89", "landscape.lat_deg: must be a number from -80 to 84 (got 89)"),
    ],
)
def test_a_setting(setting: str, text: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("default", (setting,))
    words = str(caught.value)
    assert text in words
    assert not VALIDATOR.search(words)


def test_a_query_parameter(tmp_path: Path) -> None:
    service = served(world_in(tmp_path, scenario_of()))
    asked = {
        "journal?limit=0": "query.limit: must be a whole number from 1 to",
        "journal?after=x": "query.after: must be a whole number from 0 to",
        "fire/contours?in_min=-1": "query.in_min.0: must be a number from 0 to",
    }

    async def ask() -> None:
        async with client(service.app, headers=service.headers()) as http:
            for path, text in asked.items():
                answer = await http.get(f"/api/v1/{path}")
                assert answer.status_code == 422
                assert text in answer.json()["error"]
                assert "(got '" in answer.json()["error"]
        service.app.api.context.close()

    asyncio.run(ask())


class Parts(BaseModel):
    one: Annotated[int, Field(gt=3)] | None = None
    two: tuple[Annotated[str, Field(min_length=2)], ...] = ()
    three: Literal["a"] = "a"
    four: tuple[float, float] = (0.0, 0.0)
    five: Annotated[str, Field(pattern="^a*$")] = ""


def test_each_kind_of_schema() -> None:
    schema = Parts.model_json_schema()

    def words(*path: str | int) -> str:
        found = schema_at(schema, path)
        assert found is not None
        return remedy(found, schema)

    assert words("one") == "must be a whole number, above 3"
    assert words("two", 4) == "must be a string of at least 2 characters"
    assert words("three") == "must be a"
    assert words("four") == "must be a list of 2 entries"
    assert words("five") == "must be a string that matches ^a*$"
    assert schema_at(schema, ("one", "deeper")) is None
    assert schema_at(schema, ("none",)) is None


def test_a_value_is_shown_in_part_or_not_at_all() -> None:
    assert got("x" * 100).endswith("x…)")
    assert len(got("x" * 100)) < 80
    assert got([1, 2]) == got({"a": 1}) == got(10**5000) == ""
    few = Annotated[list[int], Meta(max_length=1)]
    with pytest.raises(msgspec.ValidationError) as caught:
        msgspec.convert([1, 2], few)
    assert in_words(caught.value, few)
