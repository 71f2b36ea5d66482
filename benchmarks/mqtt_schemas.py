"""Write docs/schemas and the tables of docs/mqtt.md.

    .venv/bin/python -m benchmarks.mqtt_schemas [FOLDER]

The folder contains a JSON Schema with an example for each MQTT message. The sources are the tables
of topics and of requests. A test finds missing and outdated files.
"""

import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from mission_service.core.request_events import ABORT, ALL_REQUESTS
from mission_service.interfaces.examples import AT_US, UNIX_US, example_of
from mission_service.interfaces.mqtt.command_gate import TAKEN
from mission_service.interfaces.mqtt.payloads import Command
from mission_service.interfaces.mqtt.topics import COMMAND, FRONT, TOPICS
from mission_service.requests import summary_of

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"
PAGE = FOLDER.parent / "mqtt.md"
DRAFT = "https://json-schema.org/draft/2020-12/schema"
OPERATOR_FIELDS = ("do", "by", "station")  # fields of a request; a command has other fields instead
NUMBER, TIME = {"type": "number"}, {"type": "integer"}
RING = {"type": "array", "items": {"type": "array", "prefixItems": [NUMBER, NUMBER]}}
FRONT_SCHEMA: dict[str, Any] = {
    "title": "Front",
    "description": "The area burned now: a Feature of GeoJSON (RFC 7946), WGS84, lon before lat.",
    "type": "object",
    "properties": {
        "schema": {"enum": [FRONT.schema]},
        "at_us": TIME,
        "type": {"enum": ["Feature"]},
        "properties": {
            "type": "object",
            "properties": {
                "at_s": NUMBER,
                "at_us": TIME,
                "in_s": NUMBER,
                "area_ha": NUMBER,
                "area_acres": NUMBER,
                "perimeter_m": NUMBER,
            },
            "required": ["at_s", "at_us", "area_ha", "perimeter_m"],
        },
        "geometry": {
            "type": "object",
            "properties": {
                "type": {"enum": ["MultiPolygon"]},
                "coordinates": {"type": "array", "items": {"type": "array", "items": RING}},
            },
            "required": ["type", "coordinates"],
        },
    },
    "required": ["schema", "at_us", "type", "properties", "geometry"],
    "examples": [
        {
            "schema": FRONT.schema,
            "at_us": AT_US,
            "type": "Feature",
            "properties": {
                "at_s": 4215.3,
                "at_us": AT_US,
                "in_s": 0.0,
                "area_ha": 0.405,
                "area_acres": 1.0,
                "perimeter_m": 269.0,
            },
            "geometry": {
                "type": "MultiPolygon",
                "coordinates": [
                    [
                        [
                            [-84.1409, 36.3642],
                            [-84.1401, 36.3642],
                            [-84.1405, 36.3652],
                            [-84.1409, 36.3642],
                        ]
                    ]
                ],
            },
        }
    ],
}


def file_of(schema: str) -> str:
    """Return the file name of a schema: ``telemetry/1`` → ``telemetry-1.json``."""
    return schema.replace("/", "-") + ".json"


def command_file(name: str) -> str:
    """Return the file name of the schema of a command."""
    return f"command-{name}-1.json"


def schema_of(struct: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the JSON Schema of a type, with the types of its fields in ``$defs``."""
    found = _dedented(msgspec.json.schema(struct))
    top: dict[str, Any] = found["$defs"].pop(found.pop("$ref").rpartition("/")[2])
    return top | ({"$defs": found["$defs"]} if found["$defs"] else {})


def _dedented(schema: Any) -> Any:
    """Return a schema with descriptions as msgspec 0.23 writes them, without indentation."""
    match schema:
        case dict():
            return {
                key: inspect.cleandoc(each)
                if key == "description" and isinstance(each, str)
                else _dedented(each)
                for key, each in schema.items()
            }
        case list():
            return [_dedented(each) for each in schema]
        case _:
            return schema


def documents() -> dict[str, dict[str, Any]]:
    """Return all schemas, each with an example, by file name."""
    found = {file_of(FRONT.schema): {"$schema": DRAFT, **FRONT_SCHEMA}}
    for topic in TOPICS:
        if not isinstance(topic.carries, str):
            shown = {"examples": [example_of(topic.carries)]}
            found[file_of(topic.schema)] = {"$schema": DRAFT, **schema_of(topic.carries), **shown}
    for name in TAKEN:
        found[command_file(name)] = {"$schema": DRAFT, **command_schema(name)}
    return found


def command_schema(name: str) -> dict[str, Any]:
    """Return the schema of a command: the common fields and its own, without additional fields."""
    base = schema_of(Command)
    properties, required = dict(base["properties"]), list(base["required"])
    required.remove("schema")
    request = schema_of(ALL_REQUESTS[name])
    if name == ABORT:
        required = []
    else:
        fields = request["properties"].items()
        own = {key: field for key, field in fields if key not in OPERATOR_FIELDS}
        properties |= own
        required += [key for key in request["required"] if key in own]
    example = {"id": "7f3a", "by": "anna", "sent_at_unix_us": UNIX_US, **ALL_REQUESTS[name].example}
    return {
        "title": f"Command {name}",
        "description": request["description"],
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": name == ABORT,
        "examples": [{"schema": "command/1", **example}],
    }


def texts() -> dict[str, str]:
    """Return the text of each file of docs/schemas."""
    return {
        name: json.dumps(document, indent=2, ensure_ascii=False) + "\n"
        for name, document in documents().items()
    }


def page(text: str) -> str:
    """Return the text of docs/mqtt.md with new tables of topics and commands."""
    for head, rows in (("| topic |", _topic_rows()), ("| command |", _command_rows())):
        before, found, rest = text.partition(head)
        titles, line, *_ = rest.splitlines()
        after = rest[rest.index("\n\n") :]
        text = before + "\n".join([found + titles, line, *rows]) + after
    return text


def _topic_rows() -> Iterator[str]:
    for topic in TOPICS:
        link = f"[{file_of(topic.schema)[:-5]}](schemas/{file_of(topic.schema)})"
        carries = "by command, see below" if topic is COMMAND else link
        retained = "yes" if topic.retained else "**no**" if topic is COMMAND else "no"
        path = topic.path.format("NAME")
        yield f"| `{path}` | {carries} | {topic.qos} | {retained} | {topic.when} |"


def _command_rows() -> Iterator[str]:
    for name in TAKEN:
        summary = summary_of(ALL_REQUESTS[name])
        yield f"| [{name}](schemas/{command_file(name)}) | {ALL_REQUESTS[name].role} | {summary} |"


def write(folder: Path) -> None:
    """Write all files into a folder and remove outdated files from it."""
    folder.mkdir(exist_ok=True)
    found = texts()
    for path in set(folder.glob("*.json")) - {folder / name for name in found}:
        path.unlink()
    for name, text in found.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
    PAGE.write_text(page(PAGE.read_text("utf-8")), encoding="utf-8")
