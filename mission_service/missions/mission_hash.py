"""The hash by which an operator accepts exactly one mission."""

import hashlib
from collections.abc import Iterable

import msgspec

from autopilot_bridge.items import MissionItem


def mission_hash(items: Iterable[MissionItem]) -> str:
    """Return SHA-256 of a mission's items; an acceptance names the mission by it."""
    return hashlib.sha256(msgspec.json.encode(tuple(items))).hexdigest()
