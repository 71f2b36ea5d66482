"""Completion in shells, manual pages, the JSON Schema of scenarios, settings by environment."""

import json
import shutil
import subprocess
import sys
import tomllib
from datetime import datetime
from pathlib import Path
from typing import Any

import click
import jsonschema
import pytest
from click.testing import CliRunner

from mission_service.cli.help.help_commands import PROGRAM, VARIABLE
from mission_service.cli.main import main
from mission_service.cli.output_folder import new_folder
from mission_service.config.rule_lookup import rules
from mission_service.config.scenario import SHIPPED
from mission_service.config.scenario_schema import scenario_schema
from tests.patience import PATIENCE_S

CREATED = "2026-11-28T22:40:05+00:00"


def call(*arguments: str, **variables: str) -> str:
    result = CliRunner().invoke(main, arguments, env=dict(variables))
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_is_valid_and_names_the_variable(shell: str) -> None:
    script = call("completion", shell)
    assert VARIABLE in script
    program = shutil.which(shell)
    if program is not None:
        subprocess.run([program, "-n"], input=script, text=True, check=True, timeout=PATIENCE_S)


@pytest.mark.parametrize(
    ("typed", "found"),
    [("mission-service si", "sim"), ("mission-service request ab", "abort")],
)
def test_the_shell_is_given_the_commands(typed: str, found: str) -> None:
    start = f"import sys; from {main.callback.__module__} import main; main(prog_name='{PROGRAM}')"
    done = subprocess.run(
        [sys.executable, "-c", start],
        env={VARIABLE: "bash_complete", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))},
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE_S,
    )
    assert f"plain,{found}" in done.stdout.splitlines(), done.stderr


def paths(command: click.Command, context: click.Context) -> list[str]:
    """Return the paths of a command and of all its commands."""
    found = [context.command_path.replace(" ", "-")]
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            found += paths(inner, click.Context(inner, context, info_name=name))
    return found


def test_each_command_has_a_manual_page(tmp_path: Path) -> None:
    call("man", "-o", str(tmp_path))
    expected = paths(main, click.Context(main, info_name=PROGRAM))
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted(expected)
    page = (tmp_path / "mission-service-request.1").read_text(encoding="utf-8")
    assert "abort" in page  # a command from the table of requests
    assert "\\-\\-vehicle" in (tmp_path / "mission-service-run.1").read_text(encoding="utf-8")


def as_json(value: Any) -> Any:
    """Return a value of TOML as editors pass it to a JSON Schema: times are texts."""
    if isinstance(value, dict):
        return {key: as_json(each) for key, each in value.items()}
    if isinstance(value, list):
        return [as_json(each) for each in value]
    return value.isoformat() if isinstance(value, datetime) else value


def faults(scenario: dict[str, Any]) -> list[str]:
    validator = jsonschema.Draft202012Validator(json.loads(call("config", "schema")))
    return [error.json_path for error in validator.iter_errors(as_json(scenario))]


def test_the_schema_is_a_valid_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(scenario_schema())


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.toml")), ids=lambda path: path.stem)
def test_the_schema_accepts_the_shipped_scenarios(path: Path) -> None:
    assert faults(tomllib.loads(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    ("table", "change", "place"),
    [
        (None, {"planer": {}}, "$"),
        (None, {"only": "hawk"}, "$"),
        ("planner", {"rule": "predictve"}, "$.planner.rule"),
        ("planner", {"alfa": 1}, "$.planner"),
        ("planner", {"alpha": -1}, "$.planner.alpha"),
        ("service", {"htp": {}}, "$.service"),
    ],
)
def test_the_schema_refuses_what_the_service_refuses(
    table: str | None, change: dict[str, Any], place: str
) -> None:
    scenario = tomllib.loads((SHIPPED / "demo.toml").read_text(encoding="utf-8"))
    (scenario if table is None else scenario.setdefault(table, {})).update(change)
    assert [fault for fault in faults(scenario) if fault.startswith(place)] != []


def test_the_schema_lists_all_rules() -> None:
    assert scenario_schema()["$defs"]["PlannerSection"]["properties"]["rule"]["enum"] == rules()


def test_the_schema_states_the_meaning_of_keys() -> None:
    schema = scenario_schema()
    assert schema["properties"]["seed"]["description"].startswith("Seed of all random numbers")
    described = [
        key
        for part in schema["$defs"].values()
        for key, value in part.get("properties", {}).items()
        if "description" in value
    ]
    assert len(described) > 100


def test_variables_of_the_environment_are_settings(tmp_path: Path) -> None:
    seed = "seed=7 duration_s=3700"
    journal = tmp_path / "journal.jsonl"
    call("sim", "default", "--out", str(tmp_path), MISSION_SERVICE_SET=f"start_s=3600 {seed}")
    header = json.loads(journal.read_text(encoding="utf-8").partition("\n")[0])
    text = json.dumps(header)
    assert '"seed": 7' in text
    assert '"duration_s": 3700' in text


def test_options_of_run_are_variables_but_not_those_for_one_start(tmp_path: Path) -> None:
    command = main.commands["run"]
    context = click.Context(command, info_name="run", **command.context_settings)
    for name, value in {"OUT": str(tmp_path), "FRESH": "1", "SKIP_UNREADABLE": "1"}.items():
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(f"MISSION_SERVICE_{name}", value)
            option = next(each for each in command.params if each.name == name.lower())
            assert (option.value_from_envvar(context) is not None) == (name == "OUT")


def test_requests_ignore_the_environment() -> None:
    """A variable must not confirm an order."""
    result = CliRunner().invoke(
        main, ["request", "hold", "--help"], env={"MISSION_SERVICE_CONFIRMED": "1"}
    )
    assert "MISSION_SERVICE" not in result.output
    context = click.Context(main, info_name=PROGRAM)
    request = main.get_command(context, "request")
    assert isinstance(request, click.Group)
    hold = request.get_command(context, "hold")
    assert hold is not None
    assert click.Context(hold, context, info_name="hold").auto_envvar_prefix is None


def test_the_folder_of_a_simulation_has_name_and_time(tmp_path: Path) -> None:
    folder = new_folder("My fire/2", CREATED, tmp_path)
    assert folder == tmp_path / "My-fire-2-20261128T224005Z"
    folder.mkdir()
    assert new_folder("My fire/2", CREATED, tmp_path).name == f"{folder.name}-2"
    assert new_folder("..", CREATED, tmp_path).name == "scenario-20261128T224005Z"


def test_a_simulation_without_out_states_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = ("--set", "start_s=3600", "--set", "duration_s=3700")
    result = CliRunner().invoke(main, ["sim", "default", "--json", *settings])
    assert result.exit_code == 0, result.output
    (folder,) = (tmp_path / "out").iterdir()
    assert f"results: out/{folder.name}" in result.stderr
    assert (folder / "summary.json").exists()
    json.loads(result.stdout)
