"""Errors about unknown names propose the most similar known name."""

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from mission_service.cli.main import main
from mission_service.config.scenario import load_run, load_scenario, one_of_many
from mission_service.core.request_events import RequestScope, event_of
from mission_service.errors import RequestError, ScenarioError, did_you_mean

USER = {"by": "ann", "station": "desk"}


def test_the_most_similar_name_is_proposed() -> None:
    assert did_you_mean("planer", ("plan", "planner", "mission")) == "; did you mean planner?"
    assert did_you_mean("HAWK", ("hawk",)) == "; did you mean hawk?"


def test_nothing_is_proposed_without_a_similar_name() -> None:
    assert did_you_mean("xyzzy", ("plan", "mission")) == ""
    assert did_you_mean("", ("plan",)) == ""
    assert did_you_mean("plan", ()) == ""


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("sead=1", "sead: unknown key (got 1); did you mean seed?"),
        ("planer.alpha=1.5", "planer: unknown key; did you mean planner?"),
        ("planner.alfa=1.5", "planner.alfa: unknown key (got 1.5); did you mean alpha?"),
        ("vehicles.0.airspeed=9", "vehicles.0.airspeed: unknown key (got 9); did you mean airs"),
        ("service.htp.listen='a'", "service.htp: unknown key; did you mean http?"),
        ("service.http.listn='a'", "service.http.listn: unknown key (got 'a'); did you mean list"),
        ("relief.vehicle='a'", "relief.vehicle: unknown key (got 'a'); did you mean vehicles?"),
        ("formation.monitoring=1", "unknown key (got 1); did you mean monitoring_m?"),
        ("planner.rule='predictve'", "did you mean predictive? (got 'predictve')"),
    ],
)
def test_a_key_a_table_or_a_rule(setting: str, words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_run("demo", (setting,))
    assert words in str(caught.value)


def test_a_vehicle_and_a_shipped_scenario() -> None:
    vehicle = load_scenario("demo").vehicles[0].name
    with pytest.raises(ScenarioError, match=f"did you mean {vehicle}"):
        one_of_many(load_scenario("demo"), f"{vehicle}s", peer_messaging=False)
    with pytest.raises(ScenarioError, match="did you mean default"):
        load_scenario("defualt")


def test_a_vehicle_of_a_plan(tmp_path: Path) -> None:
    plan = ["plan", "demo", "--vehicle", "hakw", "-o", str(tmp_path / "x.plan")]
    result = CliRunner().invoke(main, plan)
    assert "no vehicle 'hakw' (it has: hawk, kite); did you mean hawk?" in result.stderr


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"do": "holdd", "vehicle": ""}, "did you mean hold?"),
        (
            {"do": "hold", "vehicle": "hakw"},
            "no vehicle 'hakw'; the vehicles are hawk; did you mean ha",
        ),
        ({"do": "wind", "speed": 3}, "from_deg; did you mean speed_m_s?"),
        ({"do": "hold", "vehicle": "hawk", "station": "dsk"}, "did you mean desk?"),
    ],
)
def test_a_request(request_: dict[str, Any], words: str) -> None:
    scope = RequestScope(stations=("desk",), vehicles=("hawk",))
    with pytest.raises(RequestError) as caught:
        event_of({**USER, **request_}, 0, scope)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simm",), "Did you mean 'sim'?"),
        (("fire", "ruun"), "Did you mean 'run'?"),
        (("request", "abrot"), "Did you mean 'abort'?"),  # commands from the table of requests
        (("request", "satelite-pixels"), "Did you mean 'satellite-pixels'?"),
        (("sim", "default", "--outt", "x"), "'--out'"),
    ],
)
def test_a_command_or_an_option(arguments: tuple[str, ...], words: str) -> None:
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert words in result.stderr
