"""docs/schemas and docs/mqtt.md describe the messages that are sent and accepted."""

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest

from benchmarks.mosquitto import MOSQUITTO, Mosquitto
from benchmarks.mqtt_schemas import FOLDER, command_file, documents, file_of, page, texts
from mission_service.core.request_events import REPLAY, RequestScope, event_of
from mission_service.events import AircraftReported, AircraftState
from mission_service.interfaces.examples import FIRE_ARRIVAL
from mission_service.interfaces.examples import REPLAY as REPLAY_STATE
from mission_service.interfaces.mqtt.command_gate import TAKEN, CommandGate
from mission_service.interfaces.mqtt.topics import COMMAND, TOPICS
from mission_service.requests import Replay
from tests.mqtt.stage import ROOT, listening, publishing
from tests.patience import until

PAGE = (FOLDER.parent / "mqtt.md").read_text("utf-8")
HOW_TO_UPDATE = "run .venv/bin/python -m benchmarks.mqtt_schemas"
UNITS = ("_us", "_s", "_m", "_m_s", "_deg", "_pct", "_ha", "_acres", "_c")
COUNTS = {"system_id", "current_seq", "mission_id", "command", "frame", "id", "alpha", "params"}
COUNTS |= {"decisions", "reversals", "importance_back", "importance_front", "front_cells"}
COUNTS |= {"uploads_accepted", "uploads_failed", "drops_done", "drops_refused", "drops_unknown"}
COUNTS |= {"points", "corners", "coordinates", "reversal_margin"}
COUNTS |= {"speed", "jumps", "vehicles_out"}


def test_no_schema_is_missing_stale_or_left_over() -> None:
    files = {path.name: path.read_text("utf-8") for path in FOLDER.glob("*")}
    made = texts()
    assert sorted(files) == sorted(made), HOW_TO_UPDATE
    for name, text in made.items():
        assert files[name] == text, f"{name}: {HOW_TO_UPDATE}"
    assert page(PAGE) == PAGE, HOW_TO_UPDATE


@pytest.mark.parametrize("name", sorted(documents()))
def test_every_schema_is_one_and_its_example_fits(name: str) -> None:
    schema = json.loads((FOLDER / name).read_text("utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    (example,) = schema["examples"]
    jsonschema.Draft202012Validator(schema).validate(example)
    properties = set(schema["properties"])
    assert set(example) <= properties
    unneeded = {"station"} | ({"item"} if name == "command-go-1.json" else set())
    if name.startswith("command-"):
        unneeded |= {"reversal_margin", "dwell_s"}
    assert set(example) >= properties - unneeded, "an example shows all there is"
    for key in ("id", "by"):
        if key in example and name.startswith("command-") and "abort" not in name:
            with pytest.raises(jsonschema.ValidationError):
                jsonschema.Draft202012Validator(schema).validate(example | {key: "a\n"})


def _numbers(schema: Any, key: str = "") -> set[str]:
    """Yield the keys of all numbers in a schema."""
    if not isinstance(schema, dict):
        return set()
    found = {key} if schema.get("type") in ("number", "integer") else set()
    for inner in ("anyOf", "prefixItems"):
        for each in schema.get(inner, []):
            found |= _numbers(each, key)
    found |= _numbers(schema.get("items"), key)
    for name, each in (*schema.get("properties", {}).items(), *schema.get("$defs", {}).items()):
        found |= _numbers(each, name)
    return found


@pytest.mark.parametrize("name", sorted(documents()))
def test_numbers_have_their_units_in_their_keys(name: str) -> None:
    found = _numbers(documents()[name]) - COUNTS
    assert [key for key in found if not key.endswith(UNITS)] == []


def test_the_page_names_all_topics_schemas_and_commands() -> None:
    for topic in TOPICS:
        assert f"| `{topic.path.format('NAME')}` |" in PAGE
        (row,) = re.findall(rf"^\| `{topic.path.format('NAME')}` \|.*$", PAGE, re.M)
        retained = "yes" if topic.retained else "**no**" if topic is COMMAND else "no"
        assert f"| {topic.qos} | {retained} |" in row
        assert topic is COMMAND or f"](schemas/{file_of(topic.schema)})" in row
    linked = set(re.findall(r"\]\(schemas/(.*?)\)", PAGE))
    assert linked == set(texts())


@pytest.mark.parametrize("name", TAKEN)
def test_the_example_of_a_command_is_one_that_is_taken(name: str) -> None:
    (example,) = documents()[command_file(name)]["examples"]
    events: list[Any] = []

    def ask(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == REPLAY:  # not an event
            events.append(msgspec.convert(request, Replay))
        else:
            events.append(event_of(request, 0, RequestScope(["west"], vehicles=["hawk"])))
        return {"ok": True}

    sent_us = example["sent_at_unix_us"]
    reply = CommandGate(ask).accept(name, json.dumps(example).encode(), False, 0, 0.0, sent_us)
    assert reply is not None
    assert reply.ok, reply
    assert events[0].by == "mqtt:anna"


@pytest.mark.skipif(MOSQUITTO is None, reason="no mosquitto: apt-get install mosquitto")
def test_what_is_really_sent_fits_and_has_a_topic_of_the_list(tmp_path: Path) -> None:
    broker = Mosquitto(tmp_path)

    async def look() -> dict[str, Any]:
        async with (
            listening(broker.port) as listener,
            publishing(broker.port, replay=REPLAY_STATE, commands=True) as stage,
        ):
            await until(lambda: stage.publisher.connected)
            stage.moves(1_000_000)
            stage.announce("a line")
            place = (36.36, -84.14, 800.0)
            other = AircraftState("a4c2f1", "N417EA", *place, 40.0, 0.0, 0.0, 0.5, "sbs")
            reported = AircraftReported(1_000_000, stage.name, (other,))
            stage.context.state_view.apply(reported, [])
            stage.context.state_view.alarm("x", "wrong")
            stage.context.arrivals = [FIRE_ARRIVAL]
            stage.context.state_view.arrivals_changed()
            stage.context.ring()
            await listener.publish("cmd/hold", b"{}")
            paths = [topic.path.format(stage.name) for topic in TOPICS if topic.path[0] != "c"]
            paths += ["cmd/hold/reply"]
            await until(
                lambda: (
                    all(listener.of(path) for path in paths) and listener.last("alarm")["alarms"]
                )
            )
            strange = {each.topic.value for each in listener.messages}
            strange -= {f"{ROOT}/{path}" for path in (*paths, "cmd/hold")}
            assert not strange
            return {path: listener.last(path) for path in paths}

    broker.start()
    try:
        sent = asyncio.run(look())
    finally:
        broker.kill()
    for path, message in sent.items():
        schema = documents()[file_of(message["schema"])]
        jsonschema.Draft202012Validator(schema).validate(message)
        assert set(message) == set(schema["properties"]), path
