"""Write JSON Schemas as Markdown: a table of keys with type, unit, default and meaning. Pure."""

import json
from collections.abc import Callable, Mapping
from typing import Any

# Units of keys, by the end of the key; the longest end that fits is used.
UNITS = {
    "_m": "m", "_s": "s", "_us": "µs", "_ms": "ms", "_min": "min", "_hz": "Hz", "_v": "V",
    "_deg": "°", "_pct": "%", "_c": "°C", "_k": "K", "_m_s": "m/s", "_m_h": "m/h", "_ha": "ha",
    "_per_ha": "1/ha", "_kw_m": "kW/m", "_kg_m3": "kg/m³", "_cells": "cells", "_m2": "m²",
    "_km": "km", "_bytes": "bytes", "_per_min": "1/min", "_mb": "MB", "_h": "h",
    "_acres": "acres", "_per_count": "K/count", "_mah": "mAh", "_ft": "ft", "_wh": "Wh",
}  # fmt: skip
Link = Callable[[str], str | None]  # the anchor of a named schema, or None


def unit_of(key: str) -> str:
    """Return the unit that the name of a key states, or an empty text."""
    ends = [end for end in UNITS if key.endswith(end)]
    return UNITS[max(ends, key=len)] if ends else ""


def type_of(schema: Mapping[str, Any], link: Link) -> str:
    """Return the type of a value in words, as Markdown in a cell of a table."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        anchor = link(name)
        return name if anchor is None else f"[{name.removesuffix('Section')}](#{anchor})"
    for several in ("anyOf", "oneOf", "allOf"):
        if several in schema:
            kinds = [each for each in schema[several] if each.get("type") != "null"]
            return " or ".join(dict.fromkeys(type_of(each, link) for each in kinds))
    if "enum" in schema or "const" in schema:
        return ", ".join(code(each) for each in schema.get("enum", [schema.get("const")]))
    kind = schema.get("type", "any")
    if kind == "array":
        parts = schema.get("prefixItems")
        if parts:
            return f"({', '.join(type_of(each, link) for each in parts)})"
        return f"list of {type_of(schema.get('items') or {}, link)}"
    if kind == "object" and isinstance(schema.get("additionalProperties"), Mapping):
        return f"table of {type_of(schema['additionalProperties'], link)}"
    words = {"string": "text", "object": "table", "boolean": "true or false"}
    if kind == "string" and "format" in schema:
        return {"path": "file", "date-time": "date and time"}.get(schema["format"], "text")
    return f"{words.get(kind, kind)}{bounds_of(schema)}"


def bounds_of(schema: Mapping[str, Any]) -> str:
    """Return the limits of a number in words, with a leading space, or an empty text."""
    at_least, above = schema.get("minimum"), schema.get("exclusiveMinimum")
    at_most, below = schema.get("maximum"), schema.get("exclusiveMaximum")
    if at_least is not None and at_most is not None:
        return f" from {at_least:g} to {at_most:g}"
    pairs = ((at_least, "≥"), (above, ">"), (at_most, "≤"), (below, "<"))
    found = [f"{sign} {limit:g}" for limit, sign in pairs if limit is not None]
    return f" {' and '.join(found)}" if found else ""


def code(value: Any) -> str:
    """Return a value as code in JSON, safe in a cell of a table."""
    return f"`{json.dumps(value, ensure_ascii=False)}`".replace("|", "\\|")


def default_of(key: str, schema: Mapping[str, Any], required: bool) -> str:
    """Return the default of a key in words: required, none, a value, or the defaults of a table."""
    if required:
        return "**required**"
    value = schema.get("default")
    if value is None:
        return "none"
    if value == {} or isinstance(value, Mapping):
        return "its defaults" if value else "empty"
    if value == []:
        return "empty"
    text = code(value)
    return text if len(text) < 60 else "see below"


def cell(text: str) -> str:
    """Return a text for a cell of a table: one line, with single quotes of code."""
    return " ".join(text.replace("``", "`").replace("|", "\\|").split())


def key_table(
    schema: Mapping[str, Any], link: Link, meanings: Mapping[str, str] | None = None
) -> str:
    """Return a Markdown table of the properties of an object.

    Args:
        schema: A JSON Schema of type object.
        link: Returns the anchor of the section with a named schema, or None.
        meanings: Meanings of the keys that have no description in the schema.

    Returns:
        The table, or one line for an object without properties.
    """
    required = schema.get("required", ())
    properties: Mapping[str, Any] = schema.get("properties", {})
    if not properties:
        return "No keys.\n"
    lines = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for key, value in properties.items():
        meaning = value.get("description") or (meanings or {}).get(key, "")
        row = (
            f"`{key}`",
            type_of(value, link),
            unit_of(key),
            default_of(key, value, key in required),
            cell(meaning),
        )
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines) + "\n"
