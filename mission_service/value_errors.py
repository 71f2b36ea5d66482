"""Converts msgspec, pydantic and FastAPI validation errors to one line: key, remedy, value.

The remedy is derived from the JSON schema of the refused key. The texts are therefore the same for
requests over all interfaces, the scenario file, the tokens file and HTTP query parameters.
"""

import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import msgspec

from mission_service.errors import did_you_mean
from mission_service.requests import PATTERNS

Schema = Mapping[str, Any]
Path = Sequence[str | int]

MAX_SHOWN = 60  # maximum number of characters of a value
REQUEST_KEY = "do"  # the kind of a request; this key is never missing or unknown
UNKNOWN = object()  # stands for a value that is not shown
WORDS = PATTERNS | {
    r"^[\w-]+$": "letters, digits, - and _",
    r"^[\w .@-]{1,40}$": "1 to 40 letters, digits, spaces and . @ - _",
}
FORMATS = {
    "date-time": "a date and time, such as 2026-08-01T12:00:00-07:00",
    "path": "the path of a file",
    "file-path": "the path of a file",
}
KINDS = {
    "boolean": "true or false",
    "object": "a table of keys and values",
    "number": "a number",
    "integer": "a whole number",
    "string": "a string",
    "array": "a list",
}
_MISSING, _UNKNOWN_KEY = (
    re.compile(f"Object {text} field `(.+)`") for text in ("missing required", "contains unknown")
)


def in_words(error: Exception, kind: type, value: Any = UNKNOWN) -> str:
    """Return the text for msgspec's error about a value that should be a ``kind``.

    Args:
        error: The ValidationError, OverflowError or UnicodeError from ``msgspec.convert``.
        kind: The type that was expected.
        value: The whole value; the text shows only the refused part. By default, the text shows no
            value.

    Returns:
        One line without a type name: "speed_m_s: must be a number from 0 to 150 (got -3)".
    """
    if isinstance(error, UnicodeError):
        return "a string contains a character that is not valid Unicode; remove it"
    problem, _, place = str(error).partition(" - at `$")
    path: list[str | int] = [
        int(part) if part.isdigit() else part for part in re.findall(r"[^.\[\]`]+", place)
    ]
    schema = msgspec.json.schema(kind)
    if missing := _MISSING.match(problem):
        return missing_key([*path, missing[1]], schema)
    if unknown := _UNKNOWN_KEY.match(problem):
        known = [name for name in keys_at(schema, path) if name != REQUEST_KEY]
        meant = did_you_mean(unknown[1], known)
        return f"{_key([*path, unknown[1]])}: unknown key; the keys are {', '.join(known)}{meant}"
    found = schema_at(schema, path)
    if not place or found is None:
        return str(error)
    return f"{_key(path)}: {remedy(found, schema)}{got(_part(value, path))}"


def missing_key(path: Path, schema: Schema) -> str:
    """Return the text for a key that is missing."""
    found = schema_at(schema, path)
    words = "add it" if found is None else f"specify {_alternatives(found, schema)}"
    return f"{_key(path)}: is missing; {words}"


def schema_at(schema: Schema, path: Path) -> Schema | None:
    """Return the part of a JSON schema for a key, or None if the schema has no part for the key.

    Args:
        schema: The schema of the whole value.
        path: The keys and list indices that lead from the whole value to the part.
    """
    return _at(schema, list(path), schema)


def keys_at(schema: Schema, path: Path) -> list[str]:
    """Return the keys of all variants of the table at a path; empty for other values."""
    found = schema_at(schema, path)
    variants = [] if found is None else found.get("anyOf", [found])
    parts = (_resolved(each, schema) for each in variants)
    return list(dict.fromkeys(key for part in parts for key in part.get("properties", ())))


def _at(part: Schema, path: list[str | int], whole: Schema) -> Schema | None:
    part = _resolved(part, whole)
    if not path:
        return part
    for branch in part.get("anyOf", ()):
        found = _at(branch, path, whole)
        if found is not None:
            return found
    step, rest = path[0], path[1:]
    if isinstance(step, int):
        entries = part.get("prefixItems", ())
        inner = entries[step] if step < len(entries) else part.get("items")
    else:
        inner = part.get("properties", {}).get(step)
    return _at(inner, rest, whole) if isinstance(inner, Mapping) else None


def _resolved(part: Schema, whole: Schema) -> Schema:
    while "$ref" in part:
        part = whole["$defs"][part["$ref"].rpartition("/")[2]]
    return part


def remedy(part: Schema, whole: Schema) -> str:
    """Return the values that a JSON schema allows: "must be a number from 0 to 150".

    Args:
        part: The schema of one value.
        whole: The schema with the definitions (``$defs``) to which ``part`` refers.
    """
    return f"must be {_alternatives(part, whole)}"


def _alternatives(part: Schema, whole: Schema) -> str:
    return " or ".join(dict.fromkeys(_allowed(part, whole)))


def _allowed(part: Schema, whole: Schema) -> list[str]:
    """Return, for each branch of a schema except null, a description of the allowed values."""
    part = _resolved(part, whole)
    if "anyOf" in part:
        return [words for branch in part["anyOf"] for words in _allowed(branch, whole)]
    if "enum" in part or "const" in part:
        values = [str(each) for each in part.get("enum", [part.get("const")])]
        return [f"one of {', '.join(values)}" if len(values) > 1 else values[0]]
    kind = part.get("type")
    if kind == "null":
        return []
    if kind == "string" and "pattern" in part:
        words = WORDS.get(part["pattern"], f"a string that matches {part['pattern']}")
        return [
            f"{words}, at most {part['maxLength']} characters" if "maxLength" in part else words
        ]
    if kind == "string" and part.get("format") in FORMATS:
        return [FORMATS[part["format"]]]
    return [KINDS.get(str(kind), "another value") + _limits(part)]


def _limits(part: Schema) -> str:
    """Return the limits of a number or a length as text that begins with a separator."""
    if "minimum" in part and "maximum" in part:
        return f" from {_number(part['minimum'])} to {_number(part['maximum'])}"
    words = {
        "minimum": "at least",
        "exclusiveMinimum": "above",
        "maximum": "at most",
        "exclusiveMaximum": "below",
    }
    found = [f"{word} {_number(part[key])}" for key, word in words.items() if key in part]
    if found:
        return f", {' and '.join(found)}"
    of = {"array": ("Items", "entries"), "string": ("Length", "characters")}.get(part["type"])
    if of is None:
        return ""
    least, most = part.get(f"min{of[0]}"), part.get(f"max{of[0]}")
    if least == most:
        return "" if least is None else f" of {least} {of[1]}"
    if least is None or most is None:
        return f" of at most {most} {of[1]}" if least is None else f" of at least {least} {of[1]}"
    return f" of {least} to {most} {of[1]}"


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"


def _key(path: Path) -> str:
    return ".".join(map(str, path)) or "the value"


def _part(value: Any, path: Path) -> Any:
    """Return the part of a value at a path, or UNKNOWN if the value has no part at this path."""
    for step in path:
        try:
            value = value[step]
        except (LookupError, TypeError):
            return UNKNOWN
    return value


def got(value: Any) -> str:
    """Return text that shows a refused value; empty for UNKNOWN and for lists and tables."""
    if value is UNKNOWN or isinstance(value, Mapping | list | tuple):
        return ""
    try:
        text = value.isoformat() if isinstance(value, datetime) else repr(value)
    except ValueError:  # an integer with thousands of digits
        return ""
    return f" (got {text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 1] + '…'})"
