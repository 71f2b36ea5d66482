"""The table of requests: each is reachable by each interface, with its role."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import msgspec
import pytest
from click.testing import CliRunner

from benchmarks.mqtt_schemas import command_file, documents
from mission_service.cli.main import main
from mission_service.cli.request_commands import request as group
from mission_service.config.sections import PlannerSection
from mission_service.core.request_events import ABORT, ALL_REQUESTS, REPLAY, REQUESTS, accepted_in
from mission_service.events import TUNED, SettingsChanged
from mission_service.interfaces.api.access.auth import ROLES
from mission_service.interfaces.mqtt.command_gate import CommandGate
from tests.api.worlds import World, scenario_of, served, world_in

API_PAGE = (Path(__file__).parents[2] / "docs" / "api.md").read_text(encoding="utf-8")
OPERATOR_FIELDS = {"by": "anna", "station": "desk"}
SENT = {"id": "1", "by": "anna", "sent_at_unix_us": 0}


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> World:
    return world_in(tmp_path_factory.mktemp("flight"), scenario_of())


@pytest.fixture(scope="module")
def described(flight: World) -> Iterator[dict[str, Any]]:
    app = served(flight).app
    yield app.routes.openapi()
    app.api.close()


def own_keys(name: str) -> set[str]:
    return set(ALL_REQUESTS[name].__struct_fields__) - set(OPERATOR_FIELDS)


@pytest.mark.parametrize("name", ALL_REQUESTS)
def test_each_is_complete(name: str) -> None:
    kind = ALL_REQUESTS[name]
    assert kind.role in ROLES
    assert kind.__doc__
    assert "\n" not in kind.__doc__.strip()
    asked = msgspec.convert({"do": name, **OPERATOR_FIELDS, **kind.example}, kind)
    if name != REPLAY:
        event = asked.event(7)
        assert (event.at_us, event.by, event.station) == (7, "anna", "desk")


@pytest.mark.parametrize("name", ALL_REQUESTS)
def test_each_has_a_route_with_its_role_and_keys(name: str, described: dict[str, Any]) -> None:
    kind = ALL_REQUESTS[name]
    operations = described["paths"]["/api/v1" + kind.path.replace("{do}", name)]
    operation = operations[kind.method.lower()]
    row = f"| `{kind.method} {kind.path.replace('{do}', name)}` | {kind.role} |"
    assert f"{row} {operation['summary']} |" in API_PAGE
    assert operation["x-role"] == kind.role
    if name != ABORT:  # whose body is not read
        body = operation["requestBody"]["content"]["application/json"]["schema"]
        in_path = {"vehicle"} if "{name}" in kind.path else set()
        assert set(body["properties"]) | in_path == own_keys(name) | in_path | set(OPERATOR_FIELDS)


@pytest.mark.parametrize("name", ALL_REQUESTS)
def test_each_is_a_command_over_mqtt_unless_drops_may_follow(name: str) -> None:
    kind = ALL_REQUESTS[name]
    asked: list[dict[str, Any]] = []

    def ask(request: dict[str, Any]) -> dict[str, Any]:
        asked.append(request)
        return {"ok": True}

    payload = json.dumps({**SENT, **kind.example}).encode()
    reply = CommandGate(ask).accept(name, payload, False, 0, 0.0, 0)
    assert reply is not None
    assert reply.ok == kind.over_mqtt
    assert [each["do"] for each in asked] == [name] * kind.over_mqtt
    assert (command_file(name) in documents()) == kind.over_mqtt
    if kind.over_mqtt:
        assert own_keys(name) <= set(documents()[command_file(name)]["properties"])


@pytest.mark.parametrize("name", REQUESTS)
@pytest.mark.parametrize("scenario", ["demo", "burn"])
def test_each_line_of_the_socket_is_answered_as_its_run_accepts_it(
    name: str, scenario: str, tmp_path: Path
) -> None:
    world = world_in(tmp_path, scenario_of(scenario, ()))
    place = {} if scenario == "demo" else {"station": world.context.scenario.burn.stations[0].name}  # type: ignore[union-attr]
    line = {"do": name, **OPERATOR_FIELDS, **place, **REQUESTS[name].example}
    answer = world.context.request_handler.answer(json.dumps(line).encode())
    accepted = name in accepted_in(world.context.scenario)
    of_run = "only in a burn" if scenario == "demo" else "not in a burn"
    assert (f"{name}: {of_run}" not in answer.get("error", "")) == accepted


@pytest.mark.parametrize("name", ALL_REQUESTS)
def test_each_is_a_command_of_the_command_line_with_its_keys(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command is not None
    assert command.help
    there = {each.name for each in command.params}
    if "place" in there:
        there |= {"lat_deg", "lon_deg"}
    if "hash_" in there:  # of approve, which has a command of its own
        there.add("hash")
    assert own_keys(name) <= there
    result = CliRunner().invoke(main, ["request", name, "--help"])
    assert result.exit_code == 0, result.output


def test_settings_are_the_keys_of_their_event_with_its_bounds() -> None:
    assert own_keys("settings") == set(TUNED)
    assert set(TUNED) <= set(PlannerSection.model_fields)
    for name in TUNED:
        for value in (-1, 1e9):
            with pytest.raises(msgspec.ValidationError):
                msgspec.convert(
                    {"do": "settings", **OPERATOR_FIELDS, name: value}, REQUESTS["settings"]
                )
            event = {"type": "SettingsChanged", "at_us": 0, **OPERATOR_FIELDS, name: value}
            with pytest.raises(msgspec.ValidationError):
                msgspec.convert(event, SettingsChanged)
