"""Creates the JSON Schema of scenario files, which editors use to complete and check keys."""

import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, create_model

from mission_service.config.rule_lookup import rules, way_named
from mission_service.config.scenario import Scenario
from mission_service.config.service_section import ServiceSection

DIALECT = "https://json-schema.org/draft/2020-12/schema"
# Texts for keys that are described by neither a comment at the field nor the model's docstring, by
# model and key.
MEANINGS: dict[str, dict[str, str]] = tomllib.loads(
    Path(__file__).with_name("key_meanings.toml").read_text(encoding="utf-8")
)


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of scenario files.

    It contains the table ``[service]`` and those of all installed rules; it permits each of these
    tables with each rule, and does not contain the conditions between keys that ``config check``
    checks.

    Raises:
        ValueError: If a rule's package cannot be loaded.
    """
    tables: dict[str, type[BaseModel]] = {"service": ServiceSection}
    for rule in rules():
        section = way_named(rule).section
        if section is not None:
            tables[rule] = section
    added: dict[str, Any] = {
        name: (section | None, Field(default=None)) for name, section in tables.items()
    }
    whole = create_model("ScenarioFile", __base__=Scenario, **added)
    schema = whole.model_json_schema()
    del schema["properties"]["only"]  # set by --vehicle
    rule_key = schema["$defs"]["PlannerSection"]["properties"]["rule"]
    rule_key.update(enum=rules())
    for model, part in {**schema["$defs"], "Scenario": schema}.items():
        for key, meaning in MEANINGS.get(model, {}).items():
            if key in part["properties"]:
                part["properties"][key].setdefault("description", meaning)
    return {"$schema": DIALECT, **schema, "title": "Scenario of mission-service"}
