"""What one stage of a replay has found."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Stage:
    """``difference`` is the first one, in words, or None; ``details`` its fields or cells.

    ``counts`` say how much of what was looked at; ``note`` what else there is to know.
    """

    name: str
    counts: dict[str, int]
    difference: str | None = None
    details: list[dict[str, Any]] = field(default_factory=list)
    note: str = ""
    left_out: bool = False
    killed_at_line: int | None = None  # killed between two lines: the journal lacks the second
