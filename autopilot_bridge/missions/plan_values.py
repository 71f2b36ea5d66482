"""Checks values of plan files; each function raises a ValueError that describes the fault."""

import math
from typing import Any


def number(value: Any, name: str) -> float:
    """Return a value of a JSON file as a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e308:
        raise ValueError(f"{name} is {repr(value)[:40]}, not a number")
    return float(value)


def whole(value: Any, name: str, maximum: int) -> int:
    """Return a value of a JSON file as a whole number from 0 to ``maximum``."""
    exact = number(value, name)
    if exact != int(exact) or not 0 <= exact <= maximum:
        raise ValueError(f"{name} is {value!r}, not a whole number up to {maximum}")
    return int(exact)


def array(value: Any, name: str, length: int | None = None) -> list[Any]:
    """Return a value of a JSON file as an array; check its length if ``length`` is given."""
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise ValueError(f"{name} is not a list" + ("" if length is None else f" of {length}"))
    return value


def null_or_number(value: float) -> float | None:
    """Return the JSON value of a parameter, which is null for NaN."""
    if math.isinf(value):
        raise ValueError(f"an item has the value {value}, which plan files cannot store")
    return None if math.isnan(value) else value
