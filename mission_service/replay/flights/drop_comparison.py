"""Compares the drops planned in a mission with the outputs that were actuated. Pure."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.items import Items, place_of
from mission_service.ground_distance import distance_m

SERVO_MATCHES_US = 50.0
GRIPPER = 0  # output number of the gripper; servos have numbers from 1


class Planned(NamedTuple):
    """A drop in a mission, at the position of the preceding navigation item."""

    lat_deg: float
    lon_deg: float
    output: int  # a servo's number; 0: the gripper
    pulse_us: float


class Done(NamedTuple):
    """An actuated output."""

    at_us: int
    lat_deg: float
    lon_deg: float
    output: int
    pulse_us: float


class Compared(NamedTuple):
    """A planned drop, the actual drop and the distance between them; either drop may be missing."""

    planned: Planned | None
    done: Done | None
    off_m: float | None


def planned_in(items: Items) -> list[Planned]:
    """Return the drops of a mission, in the order of the mission items."""
    found: list[Planned] = []
    place: tuple[float, float] | None = None
    for item in items:
        place = place_of(item) or place
        if place is None:
            continue
        if item.command == mavlink.MAV_CMD_DO_SET_SERVO:
            found.append(Planned(*place, int(item.param1), item.param2))
        elif item.command == mavlink.MAV_CMD_DO_GRIPPER and item.param2 == 0.0:
            found.append(Planned(*place, GRIPPER, math.nan))
    return found


def compared(planned: Sequence[Planned], done: Sequence[Done]) -> list[Compared]:
    """Match each planned drop with the first unmatched actual drop of the same output.

    Unmatched actual drops are returned only if no drop is planned.
    """
    unmatched = list(done)
    found: list[Compared] = []
    for each in planned:
        match = next((one for one in unmatched if _same_output(one, each)), None)
        if match is None:
            found.append(Compared(each, None, None))
            continue
        unmatched.remove(match)
        off_m = distance_m((each.lat_deg, each.lon_deg), (match.lat_deg, match.lon_deg))
        found.append(Compared(each, match, off_m))
    # Without a plan, every pulse is reported, because its purpose is unknown.
    return found + [Compared(None, each, None) for each in unmatched if not planned]


def _same_output(done: Done, planned: Planned) -> bool:
    if done.output != planned.output:
        return False
    return planned.output == GRIPPER or abs(done.pulse_us - planned.pulse_us) <= SERVO_MATCHES_US
