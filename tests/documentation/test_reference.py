"""The generated reference pages are complete, and the snippets of documents run."""

import inspect
import re
import warnings
from pathlib import Path

import click
import pytest
from pydantic import BaseModel

import autopilot_bridge
import firemodel
from docs.site.field_comments import comments_of
from docs.site.reference_pages import models_of, pages
from docs.site.schema_tables import default_of, key_table, type_of, unit_of
from mission_service.cli.main import main
from mission_service.config.scenario import Scenario
from mission_service.config.scenario_schema import MEANINGS
from mission_service.config.section_base import Section
from mission_service.config.service_section import ServiceSection
from mission_service.interfaces.metrics import FIGURES, PREFIX
from tests.documentation.pages import ROOT, blocks_of
from tests.service.test_cli import call


@pytest.fixture(scope="module")
def made() -> dict[str, str]:
    return pages()


def commands(group: click.Group, path: str = "") -> list[str]:
    found = []
    for name, command in group.commands.items():
        if isinstance(command, click.Group):
            found += commands(command, f"{path}{name} ")
        elif not command.hidden:
            found.append(f"{path}{name}")
    return found


def test_each_command_has_a_section_with_its_options(made: dict[str, str]) -> None:
    page = made["command-line.md"]
    assert [name for name in commands(main) if f"\n## {name}\n" not in page] == []
    for option in ("--speedup", "--skip-unreadable", "--no-browser"):
        assert f"`{option}`" in page


def test_each_table_of_a_scenario_has_a_section_with_its_keys(made: dict[str, str]) -> None:
    page = made["configuration.md"]
    models = Scenario.model_json_schema()["$defs"]
    for name, model in models.items():
        assert f"(keys-{anchor(name)})=" in page, name
        for key in model.get("properties", {}):
            assert f"| `{key}` |" in page, f"{name}.{key}"
    assert "## `[service.http]`" in page
    assert "## `[[vehicles]]`" in page
    assert "| `airspeed_m_s` | number > 0 | m/s | `18.0` |" in page


def test_each_key_has_a_meaning_and_each_meaning_a_key() -> None:
    models: list[type[BaseModel]] = [Scenario, ServiceSection]
    found = {each.__name__: each for root in models for each, _ in models_of(root, "")}
    missing, twice = [], []
    for name, model in found.items():
        comments = {key for base in model.__mro__ for key in commented(base)}
        described = comments | set(
            re.findall(r"``(\w+)``", " ".join(each.__doc__ or "" for each in model.__mro__))
        )
        own = MEANINGS.get(name, {})
        missing += [f"{name}.{key}" for key in model.model_fields.keys() - described - own.keys()]
        twice += [f"{name}.{key}" for key in own.keys() & comments]
    assert missing == []
    assert twice == []
    unknown = [
        f"{name}.{key}"
        for name, keys in MEANINGS.items()
        for key in keys
        if name not in found or key not in found[name].model_fields
    ]
    assert unknown == []
    texts = [text for keys in MEANINGS.values() for text in keys.values()]
    assert [text for text in texts if not text.endswith(".")] == []


def commented(kind: type) -> set[str]:
    own = issubclass(kind, Section) and kind is not Section
    return set(comments_of(kind)) if own else set()


def anchor(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name.removesuffix("Section")).lower()


def test_each_operation_message_and_metric_is_listed(made: dict[str, str]) -> None:
    assert made["http.md"].count("\n## GET /api/v1/") > 20
    assert "## POST /api/v1/abort" in made["http.md"]
    schemas = (ROOT / "docs" / "schemas").glob("*.json")
    assert [s.stem for s in schemas if f"\n## {s.stem}\n" not in made["mqtt-messages.md"]] == []
    assert [name for name in FIGURES if f"`{PREFIX}{name}`" not in made["metrics.md"]] == []


def test_the_page_of_a_package_lists_all_its_names(made: dict[str, str]) -> None:
    for package in (firemodel, autopilot_bridge):
        page = made[f"python-{package.__name__.replace('_', '-')}.md"]
        assert [name for name in package.__all__ if f"\n## {name}\n" not in page] == []


def test_a_schema_becomes_a_table() -> None:
    schema = {
        "properties": {
            "speed_m_s": {"type": "number", "minimum": 0, "maximum": 9, "default": 1.5},
            "kind": {"enum": ["a", "b"]},
            "inner": {"$ref": "#/$defs/Inner"},
            "many": {"anyOf": [{"type": "array", "items": {"type": "string"}}, {"type": "null"}]},
        },
        "required": ["kind"],
    }
    table = key_table(schema, {"Inner": "there"}.get, {"kind": "One | of two."})
    assert table.splitlines()[2:] == [
        "| `speed_m_s` | number from 0 to 9 | m/s | `1.5` |  |",
        '| `kind` | `"a"`, `"b"` |  | **required** | One \\| of two. |',
        "| `inner` | [Inner](#there) |  | none |  |",
        "| `many` | list of text |  | none |  |",
    ]
    assert type_of({"type": "integer", "exclusiveMinimum": 0}, lambda _: None) == "integer > 0"
    assert default_of("a", {"default": {"b": 1}}, required=False) == "its defaults"
    assert [unit_of(key) for key in ("a_kg_m3", "size", "wind_m_s")] == ["kg/m³", "", "m/s"]


class Commented:
    """A class with comments."""

    one: int = 1  # the first
    # Two lines about
    # the second.
    two: int = 2
    three: int = 3
    four: int = 4  # in parentheses


def test_comments_belong_to_the_field_on_or_below_their_line() -> None:
    assert comments_of(Commented) == {
        "one": "The first.",
        "two": "Two lines about the second.",
        "four": "In parentheses.",
    }


def test_the_python_snippets_of_the_readme_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    call("plan", "default", "-o", "first.plan")
    snippets = [each for each in blocks_of(ROOT / "README.md") if each.language == "python"]
    assert len(snippets) == 2
    for snippet in snippets:
        exec(compile(snippet.text, "README.md", "exec"), {})
    assert (tmp_path / "fronts.geojson").is_file()
    assert (tmp_path / "first.waypoints").is_file()
    assert capsys.readouterr().out


@pytest.mark.parametrize("package", [firemodel, autopilot_bridge], ids=lambda each: each.__name__)
def test_the_example_of_a_package_runs(
    package: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    call("plan", "default", "-o", "survey.plan")
    text = inspect.getdoc(package) or ""
    lines = [line[4:] for line in text.splitlines() if line.startswith("    ") or not line]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", firemodel.FireModelWarning)
        exec(compile("\n".join(lines), package.__name__, "exec"), {})  # type: ignore[attr-defined]
    assert len(list(tmp_path.iterdir())) > 1  # it has written a file
