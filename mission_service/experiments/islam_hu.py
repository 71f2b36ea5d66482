"""Islam & Hu, section VI: one vehicle on six fires."""

from pathlib import Path
from typing import Any


def run(out: Path | None) -> dict[str, Any]:
    """Everything the experiment tells; figures as PNG in ``out``, if given."""
    del out
    return {"alpha_sweep": [], "distance_error": []}


def in_text(found: dict[str, Any]) -> str:
    """The result as tables for people."""
    return "\n".join(found)
