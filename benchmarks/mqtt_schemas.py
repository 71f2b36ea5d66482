"""Writes docs/schemas: a JSON Schema with an example for every message over MQTT.

    .venv/bin/python -m benchmarks.mqtt_schemas [FOLDER]

They are made of the types that are sent, so a test can tell whether a file is missing or stale.
"""

import json
import sys
from pathlib import Path
from typing import Any

import msgspec

from mission_service.core.requests import ABORT, ALL_REQUESTS
from mission_service.interfaces.mqtt.commands import TAKEN
from mission_service.interfaces.mqtt.messages import Alarms, Command, Reply, ServiceStatus
from mission_service.interfaces.mqtt.topics import (
    ALARM,
    EVENT,
    FRONT,
    MISSION,
    REPLAY,
    REPLY,
    STATUS,
    TELEMETRY,
)
from mission_service.interfaces.mqtt.topics import VEHICLE as STATE
from mission_service.requests import HASH
from mission_service.runtime.picture import (
    Alarm,
    ItemState,
    Mission,
    MissionState,
    NewsLine,
    OrbitState,
    TelemetryState,
    VehicleState,
)
from mission_service.runtime.play_head import ReplayState

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"
DRAFT = "https://json-schema.org/draft/2020-12/schema"
AT_US, UNIX_US = 4_215_300_000, 1_795_304_000_000_000
WHO = ("do", "by", "station")  # of the request; a command has its own
ALARM_EXAMPLE = Alarm("link/hawk", AT_US, "hawk", "severe", "hawk: link lost")
EXAMPLES: dict[str, msgspec.Struct] = {
    STATUS.schema: ServiceStatus(AT_US, UNIX_US, True, "default", "damped", ("hawk",)),
    TELEMETRY.schema: TelemetryState(
        AT_US, "hawk", 36.364232, -84.140907, 561.2, 250.1, 149.8, 41.5, 17.9, 43.2
    ),
    STATE.schema: VehicleState(
        AT_US,
        "hawk",
        "plane",
        "px4",
        1,
        36.370784,
        -84.132309,
        link="online",
        heard_stack="px4 plane",
        mode="mission",
        armed=True,
        current_seq=3,
        battery_pct=71.0,
        direction="clockwise",
        decisions=312,
        reversals=2,
        importance_back=11.25,
        importance_front=14.5,
        front_cells=188,
        orbit=OrbitState(36.364232, -84.140907, 560.0, -90.0, 173.2),
        wind_speed_m_s=4.2,
        wind_from_deg=47.0,
        uploads_accepted=41,
    ),
    MISSION.schema: MissionState(
        AT_US,
        "hawk",
        on_board=Mission(
            41,
            4_212_000_000,
            "follow the front",
            "accepted",
            "",
            HASH,
            (ItemState(16, "WAYPOINT", 5, 36.3651, -84.1402, 560.0, (0.0, 0.0, 0.0, 0.0)),),
        ),
    ),
    ALARM.schema: Alarms(AT_US, (ALARM_EXAMPLE,)),
    EVENT.schema: NewsLine(17, AT_US, "hawk", "info", "turns back: what is behind matters more"),
    REPLAY.schema: ReplayState(
        AT_US,
        ("flight.tlog",),
        UNIX_US,
        UNIX_US + 900_000_000,
        UNIX_US + 120_000_000,
        AT_US - 120_000_000,
        10.0,
        False,
        False,
        False,
        0,
    ),
    REPLY.schema: Reply("7f3a", "hold", AT_US, True, event="Ordered", said=("hawk: holds",)),
}
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
    """``telemetry/1`` → ``telemetry-1.json``."""
    return schema.replace("/", "-") + ".json"


def command_file(name: str) -> str:
    """The schema of one command."""
    return f"command-{name}-1.json"


def schema_of(struct: type[msgspec.Struct]) -> dict[str, Any]:
    """The JSON Schema of a type, itself on top and what it is made of in ``$defs``."""
    found = msgspec.json.schema(struct)
    top: dict[str, Any] = found["$defs"].pop(found.pop("$ref").rpartition("/")[2])
    return top | ({"$defs": found["$defs"]} if found["$defs"] else {})


def documents() -> dict[str, dict[str, Any]]:
    """All schemas, each with an example, by the names of their files."""
    found = {file_of(FRONT.schema): {"$schema": DRAFT, **FRONT_SCHEMA}}
    for schema, example in EXAMPLES.items():
        examples = {"examples": [msgspec.to_builtins(example)]}
        found[file_of(schema)] = {"$schema": DRAFT, **schema_of(type(example)), **examples}
    for name in TAKEN:
        found[command_file(name)] = {"$schema": DRAFT, **command_schema(name)}
    return found


def command_schema(name: str) -> dict[str, Any]:
    """What every command says and what this one asks for; nothing else is taken."""
    base = schema_of(Command)
    properties, required = dict(base["properties"]), list(base["required"])
    required.remove("schema")
    asked = schema_of(ALL_REQUESTS[name])
    if name == ABORT:
        required = []
    else:
        own = {key: each for key, each in asked["properties"].items() if key not in WHO}
        properties |= own
        required += [key for key in asked["required"] if key in own]
    example = {"id": "7f3a", "by": "anna", "sent_at_unix_us": UNIX_US, **ALL_REQUESTS[name].example}
    return {
        "title": f"Command {name}",
        "description": asked["description"],
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": name == ABORT,
        "examples": [{"schema": "command/1", **example}],
    }


def texts() -> dict[str, str]:
    """The files of docs/schemas."""
    return {
        name: json.dumps(document, indent=2, ensure_ascii=False) + "\n"
        for name, document in documents().items()
    }


def write(folder: Path) -> None:
    """Write all, and remove what is no more."""
    folder.mkdir(exist_ok=True)
    found = texts()
    for path in set(folder.glob("*.json")) - {folder / name for name in found}:
        path.unlink()
    for name, text in found.items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
