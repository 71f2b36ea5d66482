"""Checked values of plan files; each function raises ValueError naming the fault."""

import math
from typing import Any


def number(value: Any, name: str) -> float:
    """A finite number of a JSON file."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e308:
        shown = repr(value)[:40]
        raise ValueError(f"{name} has {shown} where a number is needed")
    return float(value)


def whole(value: Any, name: str, most: int) -> int:
    """A whole number from 0 to ``most``."""
    exact = number(value, name)
    if exact != int(exact) or not 0 <= exact <= most:
        raise ValueError(f"{name} is {value!r}, not a whole number up to {most}")
    return int(exact)


def array(value: Any, name: str, length: int | None = None) -> list[Any]:
    """A JSON array, of a given length."""
    if not isinstance(value, list) or (length is not None and len(value) != length):
        raise ValueError(f"{name} is not a list" + ("" if length is None else f" of {length}"))
    return value


def null_or_number(value: float) -> float | None:
    """A parameter as a JSON value: null for NaN."""
    if math.isinf(value):
        raise ValueError(f"an item has the value {value}, which no plan file can hold")
    return None if math.isnan(value) else value
