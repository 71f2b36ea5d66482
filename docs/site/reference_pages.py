"""Write the reference pages from the tables of the code. Each page is Markdown."""

import inspect
import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import click
from pydantic import BaseModel

import autopilot_bridge
import firemodel
from benchmarks.mqtt_schemas import documents
from docs.site.field_comments import comments_of
from docs.site.schema_tables import cell, key_table, type_of
from mission_service.cli.main import main
from mission_service.config.rule_lookup import own_ways
from mission_service.config.scenario import Scenario
from mission_service.config.scenario_schema import MEANINGS
from mission_service.config.section_base import Section
from mission_service.config.service_section import ServiceSection
from mission_service.interfaces.metrics import FIGURES, PREFIX

NOTE = "*This page is generated from {source} each time the site is built.*\n"

# The objects of each package that other programs use. The faces of two packages list their own.
PYTHON = {
    "firemodel": tuple(f"firemodel:{name}" for name in firemodel.__all__),
    "autopilot_bridge": tuple(f"autopilot_bridge:{name}" for name in autopilot_bridge.__all__),
    "mission_service": (
        "mission_service.guidance.front.way:front_way",
        "mission_service.guidance.protocol:Planner",
        "mission_service.guidance.protocol:Steered",
        "mission_service.guidance.protocol:Ground",
        "mission_service.guidance.protocol:Decision",
        "mission_service.config.scenario:own_table",
        "mission_service.config.scenario:load_scenario",
        "mission_service.config.section_base:Section",
        "mission_service.fire.sensors:Sensor",
        "mission_service.fire.sensors:SensorImage",
        "mission_service.events:Observed",
        "mission_service.events:FireObserved",
        "mission_service.events:Telemetry",
        "mission_service.events:FrontsEstimated",
    ),
}
PYTHON_TEXT = {
    "firemodel": "The fire model without the service. Examples: "
    "[README](../README.md#simulate-a-fire) and the "
    "[notebook](../docs/notebooks/burn-a-fire.ipynb).",
    "autopilot_bridge": "Missions, checks, clients and the mock autopilot without the service. "
    "Example: [README](../README.md#upload-and-download-missions).",
    "mission_service": "The objects that plug-ins use: [planners](../docs/write-a-planner.md) and "
    "[sensors](../docs/write-a-sensor.md). Paths are in cells of the landscape's grid; row 0 is in "
    "the north.",
}


def pages() -> dict[str, str]:
    """Return the Markdown of each page by the name of its file."""
    return {
        "command-line.md": command_line(),
        "configuration.md": configuration(),
        "http.md": http(),
        "mqtt-messages.md": mqtt_messages(),
        "metrics.md": metrics(),
        **python_pages(),
    }


def command_line() -> str:
    """Return a section for each command, with its usage, arguments and options."""
    note = NOTE.format(source="the definitions of the commands")
    intro = "Most commands accept `--json`. Exit codes: 0; 1: failure; 2: wrong command line."
    parts = [f"# Command line\n\n{note}\n{intro}\n"]
    for command, path in _commands(main, ("mission-service",)):
        parts.append(_command(command, path))
    return "\n".join(parts)


def _commands(
    command: click.Command, path: tuple[str, ...]
) -> Iterator[tuple[click.Command, tuple[str, ...]]]:
    if not isinstance(command, click.Group):
        yield command, path
        return
    context = click.Context(command)
    for name in sorted(command.list_commands(context)):
        found = command.get_command(context, name)
        if found is not None and not found.hidden:
            yield from _commands(found, (*path, name))


def _command(command: click.Command, path: tuple[str, ...]) -> str:
    context = click.Context(command, info_name=" ".join(path))
    usage = " ".join(command.collect_usage_pieces(context))
    help_text = _prose(command.help or "")
    name = " ".join(path[1:])
    lines = [f"## {name}\n", f"```text\n{' '.join(path)} {usage}\n```\n", help_text, ""]
    rows = [_option(each, context) for each in command.params if isinstance(each, click.Option)]
    if rows:
        lines += ["| option | default | meaning |", "|---|---|---|", *rows, ""]
    return "\n".join(lines)


def _option(option: click.Option, context: click.Context) -> str:
    names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
    metavar = "" if option.is_flag else option.make_metavar(context)
    default = option.get_default(context, call=False)
    shown = "required" if option.required else ""
    plain = isinstance(default, str | int | float | Path) and not isinstance(default, bool)
    if plain and str(default):
        shown = f"`{default}`"
    several = " May be repeated." if option.multiple else ""
    return f"| {names} {cell(metavar)} | {shown} | {cell(_escaped(option.help or ''))}{several} |"


def _prose(text: str) -> str:
    """Return help text as Markdown: blocks that click does not wrap stay as they are."""
    blocks = text.replace("\f", "").split("\n\n")
    shown = [
        f"```text\n{block.removeprefix(chr(8)).strip()}\n```"
        if block.startswith("\b")
        else _escaped(block)
        for block in blocks
    ]
    return "\n\n".join(shown)


def _escaped(text: str) -> str:
    """Return plain text in which Markdown finds no markup."""
    return re.sub(r"([<>*_\[\]])", r"\\\1", text)


def configuration() -> str:
    """Return a section for each table of a scenario file, with all keys."""
    note = NOTE.format(source="the models that check scenario files")
    intro = (
        "A scenario is a TOML file. The keys before the first table are those of *Scenario*. "
        "Units are part of the names of keys. `mission-service config check FILE` reports errors "
        "in a file. Examples: [scenarios](../README.md#simulate-a-scenario), "
        "[fires](../docs/fire.md#a-scenario-for-a-fire), "
        "[service](../docs/operations.md#configuration).\n"
    )
    parts = [f"# Configuration\n\n{note}\n{intro}"]
    models: dict[str, type[BaseModel]] = {}
    paths = {"Scenario": "scenario"}
    for root, prefix in ((Scenario, ""), (ServiceSection, "service")):
        for kind, path in models_of(root, prefix):
            models.setdefault(kind.__name__, kind)
            paths.setdefault(kind.__name__, path)
    for rule, way in own_ways().items():
        if way.section is not None and way.section.__name__ not in models:
            models[way.section.__name__], paths[way.section.__name__] = way.section, f"[{rule}]"
    for name, kind in models.items():
        parts.append(_section(kind, paths[name], paths))
    return "\n".join(parts)


def models_of(kind: type[BaseModel], path: str) -> Iterator[tuple[type[BaseModel], str]]:
    """Return a model and the models of its tables, depth first, with the header of each in TOML."""
    yield kind, f"[{path}]" if path else "the keys before the first table"
    for name, field in kind.model_fields.items():
        for inner, many in _inner(field.annotation):
            header = f"{path}.{name}" if path else name
            for found, where in models_of(inner, header):
                yield found, f"[{where}]" if many and found is inner else where


def _inner(annotation: Any, many: bool = False) -> Iterator[tuple[type[BaseModel], bool]]:
    """Return the models in an annotation, and whether the value is a list or table of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, many
        return
    origin = getattr(annotation, "__origin__", None)
    for argument in getattr(annotation, "__args__", ()):
        yield from _inner(argument, many or origin in (tuple, list))


def _section(kind: type[BaseModel], path: str, paths: Mapping[str, str]) -> str:
    schema = kind.model_json_schema()
    comments = dict(MEANINGS.get(kind.__name__, {}))
    for base in reversed(kind.__mro__):
        if issubclass(base, Section) and base is not Section:
            comments |= comments_of(base)
    title = "Scenario" if kind is Scenario else f"`{path}`"
    text = cell(schema.get("description", "")).replace("\\|", "|")
    table = key_table(schema, lambda name: _anchor(name) if name in paths else None, comments)
    return f"({_anchor(kind.__name__)})=\n## {title}\n\n{text}\n\n{table}"


def _anchor(name: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", name.removesuffix("Section"))
    return f"keys-{words.lower()}"


def http() -> str:
    """Return a section for each operation of the HTTP interface, and the schemas of responses."""
    described = _openapi()
    schemas: dict[str, Any] = described["components"]["schemas"]
    named = {name: f"http-{_anchor(name)}" for name in schemas}
    note = NOTE.format(
        source="the OpenAPI description, which a run serves at `/api/v1/openapi.json`"
    )
    intro = "Tokens, errors and conventions: [HTTP interface](../docs/api.md).\n"
    parts = [f"# HTTP\n\n{note}\n{intro}"]
    for path, operations in sorted(described["paths"].items()):
        for method, operation in operations.items():
            parts.append(_operation(method.upper(), path, operation, named.get))
    parts.append("## Schemas\n")
    for name, schema in sorted(schemas.items()):
        text = cell(schema.get("description", ""))
        parts.append(f"({named[name]})=\n### {name}\n\n{text}\n\n{key_table(schema, named.get)}")
    return "\n".join(parts)


def _openapi() -> dict[str, Any]:
    from tests.api.worlds import scenario_of, served, world_in

    with tempfile.TemporaryDirectory() as out:
        world = world_in(Path(out), scenario_of())
        described: dict[str, Any] = served(world).app.routes.openapi()
        return json.loads(json.dumps(described))  # type: ignore[no-any-return]


def _operation(method: str, path: str, operation: Mapping[str, Any], link: Any) -> str:
    role = operation.get("x-role", "nobody")
    needs = "no token" if role == "nobody" else f"the role `{role}`"
    lines = [f"## {method} {path}\n", f"{operation['summary']} Requires {needs}.\n"]
    if parameters := operation.get("parameters"):
        lines += ["| parameter | in | type | default | meaning |", "|---|---|---|---|---|"]
        for each in parameters:
            schema = each["schema"]
            default = "**required**" if each.get("required") else _shown(schema.get("default"))
            row = (f"`{each['name']}`", each["in"], type_of(schema, link), default)
            lines.append(f"| {' | '.join(row)} | {cell(each.get('description', ''))} |")
        lines.append("")
    for media, content in operation.get("requestBody", {}).get("content", {}).items():
        schema = content.get("schema", {})
        lines += [f"Body (`{media}`): {cell(schema.get('description', ''))}\n"]
        if schema.get("properties"):
            lines.append(key_table(schema, link))
        lines += _example(content)
    for media, content in operation["responses"].get("200", {}).get("content", {}).items():
        schema = content.get("schema", {})
        kind = type_of(schema, link)
        text = cell(schema.get("description", ""))
        lines += [
            f"Response (`{media}`): {kind if '#' in kind or not text else text}\n",
            *_example(content),
        ]
    return "\n".join(lines)


def _shown(value: Any) -> str:
    return "none" if value is None else f"`{value}`"


def _example(content: Mapping[str, Any]) -> list[str]:
    if content.get("example") in (None, {}):
        return []
    text = json.dumps(content["example"], indent=1, ensure_ascii=False)
    return [f"<details><summary>Example</summary>\n\n```json\n{text}\n```\n\n</details>\n"]


def mqtt_messages() -> str:
    """Return a section for each MQTT message, with its keys and an example."""
    note = NOTE.format(source="the schemas of the messages (docs/schemas)")
    parts = [
        f"# MQTT messages\n\n{note}\nTopics, commands and access rights: [MQTT](../docs/mqtt.md).\n"
    ]
    for name, schema in sorted(documents().items()):
        title = name.removesuffix(".json")
        local = {each: f"{title}-{_anchor(each)}" for each in schema.get("$defs", {})}
        text = cell(schema.get("description", ""))
        lines = [
            f"## {title}\n",
            f"{text} Schema: [{name}](../docs/schemas/{name}).\n",
            key_table(schema, local.get),
        ]
        lines += _example({"example": schema["examples"][0]})
        for each, inner in schema.get("$defs", {}).items():
            lines.append(f"({local[each]})=\n### {each}\n\n{cell(inner.get('description', ''))}\n")
            lines.append(key_table(inner, local.get))
        parts.append("\n".join(lines))
    return "\n".join(parts)


def metrics() -> str:
    """Return the table of the metrics that the service exports."""
    note = NOTE.format(source="the table in `mission_service/interfaces/metrics.py`")
    intro = "Scraping, the dashboard and alerts: [operations](../docs/operations.md#metrics).\n"
    lines = [
        f"# Metrics\n\n{note}\n{intro}",
        "| metric | type | labels | meaning |",
        "|---|---|---|---|",
    ]
    for name, (text, labels) in FIGURES.items():
        kind = "counter" if name.endswith("_total") else "gauge"
        lines.append(f"| `{PREFIX}{name}` | {kind} | {', '.join(labels)} | {cell(text)} |")
    return "\n".join(lines) + "\n"


def python_pages() -> dict[str, str]:
    """Return a page for each package, with the objects that other programs use."""
    return {
        f"python-{package.replace('_', '-')}.md": _python_page(package, names)
        for package, names in PYTHON.items()
    }


def _python_page(package: str, names: Sequence[str]) -> str:
    note = NOTE.format(source="the docstrings")
    parts = [f"# {package}\n\n{note}\n{PYTHON_TEXT[package]}\n"]
    parts += [_python_object(name) for name in names]
    return "\n".join(parts)


def _python_object(name: str) -> str:
    found, short = resolve_name(name), name.rpartition(":")[2]
    if isinstance(found, Mapping):
        keys = ", ".join(f"`{key!r}`" for key in found)
        return f"## {short}\n\nA mapping with these keys: {keys}.\n"
    kind = "class" if inspect.isclass(found) else "function"
    directive = f"```{{eval-rst}}\n.. auto{kind}:: {name.replace(':', '.')}\n```"
    return f"## {short}\n\n{directive}\n"
