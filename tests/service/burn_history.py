"""A burn in which a drop is allowed, as a history of events and commands."""

from dataclasses import dataclass

import msgspec

from mission_service.commands import AnyCommand, Drop, ProposePlan
from mission_service.config.sections import BurnSection
from mission_service.events import (
    AnyEvent,
    Approved,
    BatteryUpdated,
    ChecklistAnswered,
    GpsFixChanged,
    HostTime,
    ModeChanged,
    Telemetry,
    VehicleConnected,
)
from mission_service.ignition_plan import IgnitionPlan, PathPoint, PlannedDrop, plan_hash

LAT, LON = 36.4, -84.2
GROUND_M, HEIGHT_M = 300.0, 15.0
DEG_PER_M = 1.0 / 111_195.0
NAME = "ignis"
SIDE_DEG = 200.0 * DEG_PER_M
CORNERS = (
    (LAT - SIDE_DEG, LON - SIDE_DEG),
    (LAT - SIDE_DEG, LON + SIDE_DEG),
    (LAT + SIDE_DEG, LON + SIDE_DEG),
    (LAT + SIDE_DEG, LON - SIDE_DEG),
)
AT_US = 100_000_000  # time of the drop


def burn(**changes: object) -> BurnSection:
    """Return a square burn unit of 400 m with two stations and two checklist items."""
    table = {
        "unit": CORNERS,
        "stations": (
            {"name": "alpha", "lat_deg": LAT, "lon_deg": LON - 0.01},
            {"name": "bravo", "lat_deg": LAT, "lon_deg": LON + 0.01},
        ),
        "go_items": ("weather", "payload"),
        **changes,
    }
    return BurnSection.model_validate(table)


def plan(line: int = 1, **changes: object) -> IgnitionPlan:
    """Return a plan of a line to the east with three drops 10 m apart, flown at 5 m/s."""
    path = tuple(
        PathPoint(LAT, LON + east_m * DEG_PER_M, GROUND_M + HEIGHT_M, HEIGHT_M, after_s)
        for east_m, after_s in ((-20.0, 0.0), (40.0, 12.0))
    )
    drops = tuple(
        PlannedDrop(number, LAT, LON + 10.0 * number * DEG_PER_M, 4.0 + 2.0 * number)
        for number in range(3)
    )
    made = IgnitionPlan(
        NAME, line, 0, 90_000_000, 400_000_000, path, drops, (), 12.0, 5.0, HEIGHT_M, 60.0,
        3.0, 270.0, 60.0, 10.0, 90.0, 100, "digest",
    )  # fmt: skip
    return msgspec.structs.replace(made, **changes)


PLAN = plan()
HASH = plan_hash(PLAN)


def drop(number: int, vehicle: str = NAME, plan_hash: str = HASH, off_m: float = 0.0) -> Drop:
    """Return a drop of the line that falls this far north of its place."""
    lon_deg = LON + 10.0 * number * DEG_PER_M
    return Drop(vehicle, plan_hash, number, LAT + off_m * DEG_PER_M, lon_deg)


DROP = drop(0)


def fix(at_us: int, east_m: float = -5.0, height_m: float = HEIGHT_M) -> Telemetry:
    """Return the position of the vehicle above the line."""
    lon_deg = LON + east_m * DEG_PER_M
    return Telemetry(at_us, NAME, LAT, lon_deg, GROUND_M + height_m, height_m, 0.0, 5.0, 90.0)


@dataclass(frozen=True)
class Sent:
    """Commands, with the time of the event before them."""

    commands: tuple[AnyCommand, ...]


Happening = AnyEvent | Sent

GOOD: tuple[Happening, ...] = (
    HostTime(0, NAME, 0),
    VehicleConnected(1_000_000, NAME, "ardupilot copter", False),
    GpsFixChanged(1_000_000, NAME, True, "3D"),
    BatteryUpdated(1_000_000, NAME, 90.0),
    ChecklistAnswered(60_000_000, "ann", "alpha", "weather", True),
    ChecklistAnswered(61_000_000, "ann", "alpha", "payload", True),
    Sent((ProposePlan(NAME, PLAN, HASH),)),
    Approved(90_000_000, "ann", "alpha", HASH),
    ModeChanged(91_000_000, NAME, 3, True, "mission"),
    fix(99_900_000),
)
