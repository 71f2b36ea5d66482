"""Computes the current positions of a fleet by dead reckoning along the ring."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing


@dataclass(frozen=True, slots=True)
class ReportedPosition:
    """The last report from a vehicle: its cell and direction on the ring at ``at_s``."""

    member: int
    cell: int
    clockwise: bool
    speed_m_s: float
    at_s: float


def dead_reckoned_fleet(
    reports: Sequence[ReportedPosition], ring: FrontRing, at_s: float, lost_after_s: float
) -> ActiveFleet:
    """Return the fleet at ``at_s``.

    A vehicle is omitted if its last report is older than ``lost_after_s``.
    """
    recent = sorted(
        (one for one in reports if at_s - one.at_s <= lost_after_s), key=lambda one: one.member
    )
    return ActiveFleet(
        np.array([one.member for one in recent], np.int64),
        np.array([_dead_reckoned_cell(one, ring, at_s) for one in recent], np.int64),
        np.array([one.clockwise for one in recent], np.bool_),
        np.array([one.speed_m_s for one in recent]),
    )


def _dead_reckoned_cell(one: ReportedPosition, ring: FrontRing, at_s: float) -> int:
    """Return the last cell that a vehicle reaches by ``at_s`` at its reported speed."""
    size = ring.step_m.size
    along_m = np.concatenate([[0.0], np.cumsum(ring.step_m)])
    if along_m[-1] == 0.0:  # the front is within one cell
        return one.cell
    flown_m = one.speed_m_s * max(at_s - one.at_s, 0.0) % along_m[-1]
    if one.clockwise:
        place_m = (along_m[one.cell] + flown_m) % along_m[-1]
        return int(np.searchsorted(along_m, place_m, side="right") - 1) % size
    place_m = (along_m[one.cell] - flown_m) % along_m[-1]
    return int(np.searchsorted(along_m, place_m, side="left")) % size
