"""A plan of one ignition line as data: what a person approves, by its hash."""

import hashlib

import msgspec


class PathPoint(msgspec.Struct, frozen=True):
    """A corner of the path; flown straight and at constant speed from one to the next."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    height_m: float  # above the ground, by the plan
    after_s: float  # the plan's begin


class PlannedDrop(msgspec.Struct, frozen=True):
    """Where an ignition sphere is to lie on the ground, and when it is dropped."""

    number: int  # in the plan, from 0 in the order of dropping
    lat_deg: float
    lon_deg: float
    after_s: float  # the plan's begin


class IgnitionPlan(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """One ignition line, with all that it was planned on.

    ``digest`` is that of the burn unit, its fence and people, and of the settings.
    ``min_time_margin_s``: the least time, over path and drops, that fire is away. ``skipped``:
    places (lat, lon) on the line that are not safe to drop at.
    """

    vehicle: str
    line: int  # of the burn, from 1
    made_at_us: int
    begin_us: int
    valid_until_us: int
    path: tuple[PathPoint, ...]
    drops: tuple[PlannedDrop, ...]
    skipped: tuple[tuple[float, float], ...]
    duration_s: float
    speed_m_s: float
    drop_height_m: float
    safe_height_m: float
    wind_speed_m_s: float
    wind_from_deg: float
    time_margin_s: float
    distance_margin_m: float
    min_time_margin_s: float
    spheres_left: int  # after it
    digest: str


def plan_hash(plan: IgnitionPlan) -> str:
    """Return the hash that identifies a plan: SHA-256 of its JSON, in hexadecimal."""
    return hashlib.sha256(msgspec.json.encode(plan)).hexdigest()
