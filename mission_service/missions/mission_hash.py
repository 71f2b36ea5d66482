"""Computes the hash that identifies a mission when an operator accepts it."""

import hashlib
from collections.abc import Iterable

import msgspec

from autopilot_bridge.items import MissionItem


def mission_hash(items: Iterable[MissionItem]) -> str:
    """Return the SHA-256 of a mission's items, which an acceptance must contain."""
    return hashlib.sha256(msgspec.json.encode(tuple(items))).hexdigest()
