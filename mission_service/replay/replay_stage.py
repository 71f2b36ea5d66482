"""Defines the result of one stage of a verification."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Stage:
    """A stage's result. ``difference`` describes the first difference in words.

    ``details`` are the fields in which the entries differ; for an observation, the cells.
    ``counts`` are the numbers of compared items by kind; ``note`` is additional information.
    """

    name: str
    counts: dict[str, int]
    difference: str | None = None
    details: list[dict[str, Any]] = field(default_factory=list)
    note: str = ""
    left_out: bool = False
    killed_at_line: int | None = None  # number of the line that was not written after a kill
