"""Defines the plan of one ignition line; operators approve a plan by its hash."""

import hashlib

import msgspec


class PathPoint(msgspec.Struct, frozen=True):
    """A corner of the path; between corners the path is straight and flown at constant speed."""

    lat_deg: float
    lon_deg: float
    altitude_amsl_m: float
    height_m: float  # planned height above the ground
    after_s: float  # time after the plan's start


class PlannedDrop(msgspec.Struct, frozen=True):
    """The planned position of an ignition sphere on the ground, and the time of its drop."""

    number: int  # number in the plan, counted from 0 in drop order
    lat_deg: float
    lon_deg: float
    after_s: float  # time after the plan's start


class IgnitionPlan(msgspec.Struct, frozen=True, tag=True, tag_field="type"):
    """The plan of one ignition line, with all its inputs.

    ``digest`` is a hash of the burn unit, its fence, the people and the settings.
    ``min_time_margin_s`` is the shortest time from the vehicle's passage of a position on the path,
    or from a drop, until the fire arrives there. ``skipped`` holds the positions (lat, lon) on the
    line where a drop is not safe.
    """

    vehicle: str
    line: int  # number of the line in the burn, counted from 1
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
    spheres_left: int  # spheres left after the plan
    digest: str


def plan_hash(plan: IgnitionPlan) -> str:
    """Return the hash that identifies a plan: SHA-256 of its JSON, in hexadecimal."""
    return hashlib.sha256(msgspec.json.encode(plan)).hexdigest()
