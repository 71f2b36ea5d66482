"""Avoid other vehicles using reciprocal velocity obstacles (5.3.3; van den Berg et al. 2008).

Consider a vehicle A with velocity v_A and another vehicle B with velocity v_B. A velocity v' is
inside the reciprocal velocity obstacle of B for A if 2 v' - v_A is inside B's velocity obstacle,
which means that motion relative to B with the velocity 2 v' - v_A - v_B comes nearer to B than the
combined radius. Velocities are over the ground. ``peers`` (n, COLUMNS) is the result of
``PeerTable.rows``.
"""

import math

import numpy as np

from firemodel.compiled import kernel
from mission_service.guidance.formation.peer_table import AGE_S, VX, VY, X, Y

YAW_STEP_RAD = math.radians(2.0)


@kernel
def meets_after_s(away_x_m, away_y_m, rel_x_m_s, rel_y_m_s, radius_m):  # type: ignore[no-untyped-def]
    """Return the time until a point that moves with ``rel`` enters a circle; infinity if never.

    The circle has the radius ``radius_m`` and the centre ``away``. For a point inside the circle,
    the time is 0 if the point approaches the centre, otherwise infinity.
    """
    nearing = away_x_m * rel_x_m_s + away_y_m * rel_y_m_s
    if nearing <= 0.0:
        return np.inf
    gap = away_x_m * away_x_m + away_y_m * away_y_m - radius_m * radius_m
    if gap <= 0.0:
        return 0.0
    speed2 = rel_x_m_s * rel_x_m_s + rel_y_m_s * rel_y_m_s
    square = nearing * nearing - speed2 * gap
    if square <= 0.0:
        return np.inf
    return (nearing - math.sqrt(square)) / speed2


@kernel
def first_meeting_s(  # type: ignore[no-untyped-def]
    x_m, y_m, velocity_x, velocity_y, new_x, new_y, peers, radius_m, neighbourhood_m
):
    """Return the time until a neighbour is met at the velocity ``new`` (RVO); infinity if never."""
    soonest_s = np.inf
    for row in range(peers.shape[0]):
        away_x = peers[row, X] + peers[row, VX] * peers[row, AGE_S] - x_m
        away_y = peers[row, Y] + peers[row, VY] * peers[row, AGE_S] - y_m
        if away_x * away_x + away_y * away_y > neighbourhood_m * neighbourhood_m:
            continue
        rel_x = 2.0 * new_x - velocity_x - peers[row, VX]
        rel_y = 2.0 * new_y - velocity_y - peers[row, VY]
        soonest_s = min(soonest_s, meets_after_s(away_x, away_y, rel_x, rel_y, radius_m))
    return soonest_s


@kernel
def in_conflict(  # type: ignore[no-untyped-def]
    x_m, y_m, velocity_x, velocity_y, new_x, new_y, peers, radius_m, neighbourhood_m
):
    """Return whether a desired velocity is inside the velocity obstacle of any neighbour."""
    return (
        first_meeting_s(
            x_m, y_m, velocity_x, velocity_y, new_x, new_y, peers, radius_m, neighbourhood_m
        )
        < np.inf
    )


@kernel
def clear_heading_rad(  # type: ignore[no-untyped-def]
    x_m, y_m, velocity_x, velocity_y, desired_rad, airspeed_m_s, wind_x_m_s, wind_y_m_s,
    peers, radius_m, neighbourhood_m,
):  # fmt: skip
    """Return the heading nearest to the desired heading that is outside all velocity obstacles.

    If every heading is inside an obstacle, the heading with the latest meeting is returned. The
    second result is True if the desired heading was in conflict. ``radius_m`` is the combined
    radius (2 r_s).
    """
    best_rad, best_s = desired_rad, -1.0
    for number in range(2 * int(math.pi / YAW_STEP_RAD) + 1):
        off_rad = (number + 1) // 2 * YAW_STEP_RAD
        yaw_rad = desired_rad + (off_rad if number % 2 == 0 else -off_rad)
        meets_s = first_meeting_s(
            x_m, y_m, velocity_x, velocity_y,
            airspeed_m_s * math.cos(yaw_rad) + wind_x_m_s,
            airspeed_m_s * math.sin(yaw_rad) + wind_y_m_s,
            peers, radius_m, neighbourhood_m,
        )  # fmt: skip
        if meets_s == np.inf:
            return yaw_rad, number > 0
        if meets_s > best_s:
            best_rad, best_s = yaw_rad, meets_s
    return best_rad, True
