"""Vehicles in phase on their orbits (section 5.3.2): a vehicle ahead of the others flies slower.

Beyond the paper: all vehicles within radio range count, not the neighbours alone, because a ring of
vehicles that each follow the next ones only may settle with phases that wind once round; and where
phases are spread so evenly that they have no mean, all follow the one with the lowest key. A
vehicle off its orbit does not count. Angles in radians anticlockwise; kernels.
"""

import math

from firemodel.compiled import kernel
from mission_service.guidance.formation.peer_table import (
    AGE_S,
    KEY,
    ORBIT_X,
    ORBIT_Y,
    RADIUS,
    VX,
    VY,
    X,
    Y,
)

MIN_SHARE, CRUISE_SHARE, MAX_SHARE = 0.4, 0.7, 1.0  # of the most thrust (eq. 16)
STEEPNESS = 2.3  # eq. 17, a radian
ON_ORBIT = 0.25  # of the radius: nearer to the circle than this is on it
NO_MEAN = 0.3  # mean of unit vectors shorter than this: phases are spread all round
WIND_MARGIN_M_S = 2.0  # airspeed over the wind, at least


@kernel
def wrapped_rad(angle_rad):  # type: ignore[no-untyped-def]
    """The same direction, from -π to π."""
    return math.atan2(math.sin(angle_rad), math.cos(angle_rad))


@kernel
def thrust_share(ahead_rad):  # type: ignore[no-untyped-def]
    """Eqs. 16 and 17: of the most thrust, for one that is ahead of the mean by an angle."""
    share = CRUISE_SHARE + 0.3 * 2.0 * (1.0 / (1.0 + math.exp(STEEPNESS * ahead_rad)) - 0.5)
    return min(max(share, MIN_SHARE), MAX_SHARE)


@kernel
def airspeed_of_share_m_s(share, min_m_s, max_m_s, wind_m_s):  # type: ignore[no-untyped-def]
    """0.4 is the least airspeed, 0.7 cruise (``Airframe.cruise_m_s``), 1 the most.

    Over the wind in any case, as far as the airframe goes.
    """
    cruise_m_s = max(CRUISE_SHARE * max_m_s, min_m_s)
    if share < CRUISE_SHARE:
        part = (share - MIN_SHARE) / (CRUISE_SHARE - MIN_SHARE)
        airspeed_m_s = min_m_s + part * (cruise_m_s - min_m_s)
    else:
        part = (share - CRUISE_SHARE) / (MAX_SHARE - CRUISE_SHARE)
        airspeed_m_s = cruise_m_s + part * (max_m_s - cruise_m_s)
    return min(max(airspeed_m_s, wind_m_s + WIND_MARGIN_M_S), max_m_s)


@kernel
def is_on_orbit(x_m, y_m, orbit_x_m, orbit_y_m, radius_m):  # type: ignore[no-untyped-def]
    """Whether a place is near a circle."""
    distance_m = math.hypot(x_m - orbit_x_m, y_m - orbit_y_m)
    return abs(distance_m - abs(radius_m)) < ON_ORBIT * abs(radius_m)


@kernel
def ahead_of_others_rad(  # type: ignore[no-untyped-def]
    x_m, y_m, orbit_x_m, orbit_y_m, radius_m, key, peers, range_m
):
    """Eq. 18 against the circular mean of all others that are on an orbit of the same radius.

    ``peers`` (n, COLUMNS) as of ``PeerTable.rows``; old states are advanced on their circles. The
    angle is positive for a vehicle ahead, in either sense of turn. 0 where there are no others, or
    the vehicle itself is not on its orbit.
    """
    if not is_on_orbit(x_m, y_m, orbit_x_m, orbit_y_m, radius_m):
        return 0.0
    own_rad = math.atan2(y_m - orbit_y_m, x_m - orbit_x_m)
    sum_x, sum_y, count = 0.0, 0.0, 0
    first_key, first_rad = key, own_rad
    for row in range(peers.shape[0]):
        away_x = peers[row, X] - peers[row, ORBIT_X]
        away_y = peers[row, Y] - peers[row, ORBIT_Y]
        if (
            abs(peers[row, RADIUS] - radius_m) > 1.0
            or math.hypot(peers[row, X] - x_m, peers[row, Y] - y_m) > range_m
            or not is_on_orbit(away_x, away_y, 0.0, 0.0, radius_m)
        ):
            continue
        turning_rad_s = (away_x * peers[row, VY] - away_y * peers[row, VX]) / (
            away_x * away_x + away_y * away_y
        )
        angle_rad = math.atan2(away_y, away_x) + turning_rad_s * peers[row, AGE_S]
        sum_x += math.cos(angle_rad)
        sum_y += math.sin(angle_rad)
        count += 1
        if peers[row, KEY] < first_key:
            first_key, first_rad = peers[row, KEY], angle_rad
    if count == 0:
        return 0.0
    sense = -1.0 if radius_m > 0.0 else 1.0
    all_x, all_y = sum_x + math.cos(own_rad), sum_y + math.sin(own_rad)
    if math.hypot(all_x, all_y) < NO_MEAN * (count + 1):
        return sense * wrapped_rad(own_rad - first_rad)
    return sense * wrapped_rad(own_rad - math.atan2(sum_y, sum_x))


@kernel
def airspeed_in_phase_m_s(  # type: ignore[no-untyped-def]
    x_m, y_m, orbit_x_m, orbit_y_m, radius_m, key, peers, range_m,
    min_m_s, max_m_s, wind_m_s,
):  # fmt: skip
    """The airspeed that brings the vehicle into phase: eqs. 16 to 18 in one."""
    ahead_rad = ahead_of_others_rad(x_m, y_m, orbit_x_m, orbit_y_m, radius_m, key, peers, range_m)
    return airspeed_of_share_m_s(thrust_share(ahead_rad), min_m_s, max_m_s, wind_m_s)
