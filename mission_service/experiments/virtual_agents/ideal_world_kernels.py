"""Count conflicts, compute headings and move all vehicles: inner loops of ``ideal_world``."""

import math

import numpy as np

from firemodel.compiled import kernel
from mission_service.experiments.virtual_agents.rvo_kernels import meets_after_s
from mission_service.guidance.formation.loiter_kernels import heading_step, wanted_heading_rad

# The paper's velocity obstacles have no time limit. Without a limit, vehicles that circle near each
# other would have a conflict at every turn, and a hundred conflicts for each collision. The paper
# reports two conflicts for each collision.
CONFLICT_WITHIN_S = 5.0
REPEATED_AFTER_S = 2.0  # a new conflict of a pair counts only after this time without one


@kernel
def count_meetings(  # type: ignore[no-untyped-def]
    at_s, places_m, velocities_m_s, desired_m_s, heights_m, apart_m, neighbourhood_m,
    in_conflict_s, together,
):  # fmt: skip
    """Return the numbers of conflicts and collisions that begin now, and the minimum distance."""
    conflicts, collisions, closest_m = 0, 0, np.inf
    for a in range(len(places_m)):
        for b in range(a):
            x, y = places_m[b, 0] - places_m[a, 0], places_m[b, 1] - places_m[a, 1]
            distance_m = math.sqrt(x * x + y * y + (heights_m[b] - heights_m[a]) ** 2)
            closest_m = min(closest_m, distance_m)
            if distance_m < apart_m and not together[a, b]:
                collisions += 1
            together[a, b] = distance_m < apart_m
            if distance_m > neighbourhood_m:
                continue
            mean_x = velocities_m_s[a, 0] + velocities_m_s[b, 0]
            mean_y = velocities_m_s[a, 1] + velocities_m_s[b, 1]
            of_a = meets_after_s(
                x, y, 2.0 * desired_m_s[a, 0] - mean_x, 2.0 * desired_m_s[a, 1] - mean_y, apart_m
            )
            of_b = meets_after_s(
                -x, -y, 2.0 * desired_m_s[b, 0] - mean_x, 2.0 * desired_m_s[b, 1] - mean_y, apart_m
            )
            if min(of_a, of_b) < CONFLICT_WITHIN_S:
                if at_s - in_conflict_s[a, b] > REPEATED_AFTER_S:
                    conflicts += 1
                in_conflict_s[a, b] = at_s
    return conflicts, collisions, closest_m


@kernel
def desired_headings(places_m, motion, orbits, wind_x, wind_y, step_s, bank_rad, headings_rad):  # type: ignore[no-untyped-def]
    """Write the headings of eqs. 14 and 15 into ``headings_rad`` (n)."""
    for k in range(headings_rad.size):
        headings_rad[k] = wanted_heading_rad(
            places_m[k, 0], places_m[k, 1], motion[k, 0], motion[k, 1],
            orbits[k, 0], orbits[k, 1], orbits[k, 2], wind_x, wind_y, step_s, bank_rad,
        )  # fmt: skip


@kernel
def fly_all(  # type: ignore[no-untyped-def]
    places_m, motion, headings_rad, airspeeds_m_s, wind_x, wind_y, step_s, bank_rad, velocities_m_s
):
    """Move all vehicles by one step; ``motion`` (n, 2) contains heading and airspeed."""
    for k in range(headings_rad.size):
        x_m, y_m, heading_rad, airspeed_m_s = heading_step(
            places_m[k, 0], places_m[k, 1], motion[k, 0], motion[k, 1],
            headings_rad[k], airspeeds_m_s[k], wind_x, wind_y, step_s, bank_rad,
        )  # fmt: skip
        places_m[k, 0], places_m[k, 1] = x_m, y_m
        motion[k, 0], motion[k, 1] = heading_rad, airspeed_m_s
        velocities_m_s[k, 0] = airspeed_m_s * math.cos(heading_rad) + wind_x
        velocities_m_s[k, 1] = airspeed_m_s * math.sin(heading_rad) + wind_y
