"""The table of requests: each request is available over each interface, with its role."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import msgspec
import pytest
from click.testing import CliRunner, Result
from msgspec import inspect

from benchmarks.mqtt_schemas import command_file, documents
from mission_service.cli.main import main
from mission_service.cli.request_commands import request as group
from mission_service.config.sections import PlannerSection
from mission_service.core.autopilot_reports import taken_over
from mission_service.core.request_events import (
    ABORT,
    ALL_REQUESTS,
    REPLAY,
    REQUESTS,
    accepted_in,
    event_of,
)
from mission_service.errors import RequestError
from mission_service.events import TUNED, SettingsChanged
from mission_service.interfaces.api.access.auth import ROLES
from mission_service.interfaces.mqtt.command_gate import CommandGate
from mission_service.interfaces.mqtt.payloads import Command
from mission_service.live.interface_setup import request_handler_of
from mission_service.replay.verification import verify
from mission_service.requests import HASH, PATTERNS, PLACE
from tests.api.worlds import SMALL, World, scenario_of, served, world_in

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
    app.api.context.close()


def station_in(world: World) -> str:
    burn = world.context.scenario.burn
    return OPERATOR_FIELDS["station"] if burn is None else burn.stations[0].name


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
    if name != ABORT:  # its body is not read
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
    line = {"do": name, **OPERATOR_FIELDS, "station": station_in(world), **REQUESTS[name].example}
    answer = world.context.request_handler.answer(json.dumps(line).encode())
    assert isinstance(answer, dict)
    assert isinstance(answer, dict)
    accepted = name in accepted_in(world.context.scenario)
    of_run = "available only in a burn" if scenario == "demo" else "not available in a burn"
    assert (f"{name}: {of_run}" not in answer.get("error", "")) == accepted


@pytest.mark.parametrize("name", ALL_REQUESTS)
def test_each_is_a_command_of_the_command_line_with_its_keys(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command is not None
    assert command.help
    there = {each.name for each in command.params}
    if "place" in there:
        there |= {"lat_deg", "lon_deg"}
    if "hash_" in there:  # belongs to approve, which has a separate command
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


class Direct:
    """A client of a run's request handler, in place of a client of a control socket."""

    def __init__(self, world: World) -> None:
        self.world = world

    def __enter__(self) -> "Direct":
        return self

    def __exit__(self, *exception: object) -> None:
        pass

    def ask(self, **request: Any) -> dict[str, Any]:
        answer = self.world.context.request_handler.answer(msgspec.json.encode(request))
        assert isinstance(answer, dict)  # no thread folds the estimate
        if not answer["ok"]:
            raise RequestError(answer["error"])
        return dict(json.loads(msgspec.json.encode(answer)))


Call = Callable[..., Result]


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch) -> Call:
    def request(world: World, *arguments: str) -> Result:
        client = "mission_service.interfaces.control.control_client.ControlClient"
        monkeypatch.setattr(client, lambda out: Direct(world))
        return CliRunner().invoke(main, ["request", *arguments, "--by", "ann"])

    return request


def refused_in_one_line(result: Result, words: str) -> None:
    assert result.exit_code == 1, result.output
    assert words in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("approval", ["each", "none"])
@pytest.mark.parametrize("name", ["accept", "refuse"])
def test_a_decision_on_a_mission_that_is_not_proposed_fails(
    tmp_path: Path, call: Call, name: str, approval: str
) -> None:
    world = world_in(tmp_path, scenario_of(changes=(*SMALL, f"mission.approval={approval}")))
    why = (
        "this mission is no longer proposed"
        if approval == "each"
        else "the missions of this run do not need approval"
    )
    refused_in_one_line(call(world, name, "hawk", "a" * 64), f"{name}: {why}")
    ask = world.context.request_handler.ask
    body = json.dumps({**SENT, "vehicle": "hawk", "hash": "a" * 64}).encode()
    reply = CommandGate(ask).accept(name, body, False, 0, 0.0, 0)
    assert reply is not None
    assert (reply.ok, why in reply.error) == (False, True)


@pytest.mark.parametrize("name", ["approve", "reject"])
def test_a_decision_on_a_plan_that_is_not_proposed_is_refused(tmp_path: Path, name: str) -> None:
    world = world_in(tmp_path, scenario_of("burn", ()))
    station = station_in(world)
    request = {"do": name, "by": "ann", "station": station, "hash": "a" * 64}
    answer = world.context.request_handler.ask(request)
    assert answer["ok"] is False
    assert answer["error"].startswith(f"{name}: ")


def test_an_order_that_must_be_confirmed_fails_on_the_command_line(
    tmp_path: Path, call: Call
) -> None:
    world = world_in(tmp_path, scenario_of())
    world.fly(4000.0)
    for rig in world.simulation.rigs:
        rig.mock.battery_percent = 10.0
    world.fly(4005.0)
    held = "not carried out: hawk: hold would end mode return"
    for option in ((), ("--json",)):
        result = call(world, "hold", "--vehicle", "hawk", *option)
        refused_in_one_line(result, held)
        assert "repeat the command with --confirmed" in result.stderr
        assert not option or json.loads(result.stdout)["confirm"] is True
    result = call(world, "hold", "--vehicle", "hawk", "--confirmed")
    assert (result.exit_code, result.output) == (0, "hold ordered by ann\n")


@pytest.mark.parametrize("scenario", ["demo", "burn"])
def test_a_correction_without_effect_is_refused(tmp_path: Path, call: Call, scenario: str) -> None:
    world = world_in(tmp_path, scenario_of(scenario, () if scenario == "burn" else SMALL))
    world.fly(world.now_s + 2.0)
    home = world.context.scenario.vehicles[0]
    place = PLACE
    if scenario == "burn":
        place = {"lat_deg": home.home_lat_deg, "lon_deg": home.home_lon_deg}
    point = {"state": "burning", "shape": "point", "points": [list(place.values())]}
    station = station_in(world)
    steps: list[tuple[str, dict[str, Any], str]] = [
        ("undo", {}, "nothing to undo"),
        ("redo", {}, "nothing to redo"),
        ("erase", {**place, "radius_m": 9.0}, "no correction to erase"),
        ("correct", point, ""),
        ("redo", {}, "nothing to redo"),
        ("undo", {}, ""),
        ("undo", {}, "nothing to undo"),
        ("redo", {}, ""),
    ]
    for do, fields, why in steps:
        request = {"do": do, "by": "ann", "station": station, **fields}
        answer = world.context.request_handler.ask(request)
        assert answer["ok"] is (why == ""), answer
        assert why in answer.get("error", "")
    if scenario == "demo":
        assert call(world, "undo").exit_code == 0
        refused_in_one_line(call(world, "undo"), "nothing to undo")
        body = json.dumps(SENT).encode()
        reply = CommandGate(world.context.request_handler.ask).accept(
            "undo", body, False, 0, 0.0, 0
        )
        assert reply is not None
        assert (reply.ok, reply.error) == (False, "nothing to undo")
    world.simulation.service.recording.journal.close()
    assert verify(tmp_path / "journal.jsonl").difference is None


def as_live(world: World) -> World:
    """Return the run with the request handler and the status of a live run."""
    context = world.context
    context.request_handler = request_handler_of(
        context.scenario, context.service, context.clock, context.links
    )
    return world


def test_corrections_print_the_burned_area_before_and_after(tmp_path: Path, call: Call) -> None:
    world = world_in(tmp_path, scenario_of())
    lat_deg, lon_deg = PLACE.values()
    corners = [f"{lat_deg + y},{lon_deg + x}" for y, x in ((0, 0), (0, 0.004), (0.004, 0.004))]
    drawn = call(world, "correct", "burned", *corners, "--shape", "polygon")
    areas = re.fullmatch(r"burned area: (.+) ha before, (.+) ha after\n", drawn.output)
    assert areas is not None, drawn.output
    before_ha, after_ha = areas.groups()
    assert float(after_ha) > float(before_ha) + 1.0
    undone = call(world, "undo")
    assert undone.output == f"burned area: {after_ha} ha before, {before_ha} ha after\n"
    redone = json.loads(call(world, "redo", "--json").output)
    assert f"{redone['burned_ha_before']:.2f}" == before_ha
    assert f"{redone['burned_ha_after']:.2f}" == after_ha


def test_requests_of_a_burn_are_refused_in_another_run(tmp_path: Path, call: Call) -> None:
    world = as_live(world_in(tmp_path, scenario_of()))
    for arguments in (
        ("go", "all"),
        ("no-go", "x"),
        ("reject", "12345678"),
        ("approve", "12345678"),
    ):
        refused_in_one_line(call(world, *arguments), "only in a burn")
    burn_status = CliRunner().invoke(main, ["burn", "status"])
    refused_in_one_line(burn_status, "this run is not a burn")


def test_an_abort_of_a_burn_is_announced(tmp_path: Path, call: Call) -> None:
    world = as_live(world_in(tmp_path, scenario_of("burn", ())))
    result = call(world, "abort")
    words = "aborted by ann: no further drops; request a plan for the next line\n"
    assert (result.exit_code, result.output) == (0, words)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_a_number_that_is_not_finite_is_refused(tmp_path: Path, call: Call, value: str) -> None:
    world = world_in(tmp_path, scenario_of())
    words = f"settings: alpha = {value}: must be a finite number"
    refused_in_one_line(call(world, "settings", f"--alpha={value}"), words)


def test_who_has_left_a_burn_must_have_been_reported(tmp_path: Path, call: Call) -> None:
    world = as_live(world_in(tmp_path, scenario_of("burn", ())))
    station = ("--station", station_in(world))
    home = world.context.scenario.vehicles[0]
    place = f"{home.home_lat_deg},{home.home_lon_deg}"
    left = ("person", "bob", place, "--gone", *station)
    refused_in_one_line(call(world, *left), "person: the unit contains no person named 'bob'")
    assert call(world, "person", "bob", place, "--radius", "5", *station).exit_code == 0
    assert call(world, *left).exit_code == 0


def test_a_renewal_on_the_ground_names_what_it_waits_for(tmp_path: Path, call: Call) -> None:
    world = world_in(tmp_path, scenario_of())
    assert call(world, "return", "--vehicle", "hawk").exit_code == 0
    words = "ordered to return on the ground: a mission is sent when an operator orders its start\n"
    assert call(world, "renew", "--vehicle", "hawk").output == words


def test_a_mode_without_a_name_is_announced_by_its_number(tmp_path: Path) -> None:
    vehicle = world_in(tmp_path, scenario_of()).context.core.vehicles["hawk"]
    for mode, words in (("mode 0", "in mode 0:"), ("hold", "in mode hold:"), ("", "in an unknown")):
        vehicle.availability.mode = mode
        assert getattr(taken_over(vehicle)[0], "text").startswith(words)  # noqa: B009


def test_a_start_during_a_hold_is_refused_and_ends_neither_hold_nor_abort(
    tmp_path: Path, call: Call
) -> None:
    world = world_in(tmp_path, scenario_of())
    assert call(world, "abort").exit_code == 0
    words = "start: hawk: a hold is ordered: order resume first"
    refused_in_one_line(call(world, "start", "--vehicle", "hawk"), words)
    state_view = world.context.state_view
    assert state_view.vehicles["hawk"].order == "hold"
    assert "abort" in state_view.alarms


@pytest.mark.parametrize(
    ("scenario", "settings"),
    [("demo", (*SMALL, 'planner.rule="predictive"')), ("virtual-agents", ())],
)
def test_settings_that_the_rule_does_not_have_are_refused(
    tmp_path: Path, call: Call, scenario: str, settings: tuple[str, ...]
) -> None:
    world = world_in(tmp_path, scenario_of(scenario, settings))
    rule = world.context.scenario.planner.rule
    words = f"settings: the rule {rule} does not have these settings: none was changed"
    refused_in_one_line(call(world, "settings", "--alpha", "1"), words)


def test_a_renewal_in_a_formation_is_refused(tmp_path: Path, call: Call) -> None:
    world = world_in(tmp_path, scenario_of("virtual-agents", ()))
    refused_in_one_line(call(world, "renew"), "renew: the rule of this run does not renew missions")


@pytest.mark.parametrize(
    ("do", "fields", "words"),
    [
        ("hold", {"by": "a\nb"}, "by: must be a non-blank line of printable characters"),
        ("hold", {"station": " "}, "station: must be a non-blank line of printable characters"),
        ("hold", {"vehicle": "a b"}, "vehicle: must be the name of a vehicle: letters, digits, -"),
        ("accept", {"vehicle": "a b", "hash": HASH}, "vehicle: must be the name of a vehicle"),
        (
            "accept",
            {"vehicle": "hawk", "hash": "12345678"},
            "hash: must be all 64 digits of the hash",
        ),
        ("approve", {"hash": "12345678"}, "hash: must be all 64 digits of the hash"),
        (
            "person",
            {**PLACE, "radius_m": 1.0, "name": "\t"},
            "name: must be a non-blank line of printable",
        ),
    ],
)
def test_a_text_of_another_form_is_refused_without_a_pattern(
    do: str, fields: dict[str, Any], words: str
) -> None:
    with pytest.raises(RequestError) as caught:
        event_of({"do": do, **OPERATOR_FIELDS, **fields}, 0)
    assert str(caught.value).startswith(f"{do}: {words}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["id", "by", "station"])
def test_a_text_of_a_command_over_mqtt_is_refused_without_a_pattern(key: str) -> None:
    body = json.dumps({**SENT, key: "a\nb"}).encode()
    reply = CommandGate(lambda request: {"ok": True}).accept("undo", body, False, 0, 0.0, 0)
    assert reply is not None
    assert f"the message cannot be read: {key}: must be " in reply.error
    assert "regex" not in reply.error


def test_each_pattern_of_a_text_has_words_for_errors() -> None:
    kinds = (*ALL_REQUESTS.values(), Command)
    patterns = re.findall(r"pattern='(.*?)'", "".join(str(inspect.type_info(k)) for k in kinds))
    assert {repr(each)[1:-1] for each in PATTERNS} == set(patterns)
