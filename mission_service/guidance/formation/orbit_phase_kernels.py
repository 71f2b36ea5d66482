"""Synchronises phases on orbits: a vehicle ahead of the others flies more slowly (section 5.3.2).

The mean phase includes all vehicles within radio range; in the paper it includes only the
neighbours. With the paper's mean, a ring of vehicles that each follow their neighbours could remain
at phases spread over a full turn. If the phases are spread so evenly that they have no mean, all
vehicles follow the vehicle with the lowest key. A vehicle off its orbit is not included. Angles are
in radians, anticlockwise.
"""

import math

from firemodel.compiled import kernel
from mission_service.guidance.formation.loiter_kernels import sense_of
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

MIN_SHARE, CRUISE_SHARE, MAX_SHARE = 0.4, 0.7, 1.0  # fractions of the maximum thrust (eq. 16)
STEEPNESS = 2.3  # steepness of the thrust, per radian (eq. 17)
ON_ORBIT = 0.25  # maximum distance from an orbit, as a fraction of its radius
NO_MEAN = 0.3  # phases have no mean if the length of their mean unit vector is smaller
WIND_MARGIN_M_S = 2.0  # minimum of airspeed minus wind speed


@kernel
def wrapped_rad(angle_rad):  # type: ignore[no-untyped-def]
    """Return the same direction as an angle from -π to π."""
    return math.atan2(math.sin(angle_rad), math.cos(angle_rad))


@kernel
def thrust_share(ahead_rad):  # type: ignore[no-untyped-def]
    """Return the fraction of the maximum thrust at an angle ahead of the mean (eqs. 16 and 17)."""
    share = CRUISE_SHARE + 0.3 * 2.0 * (1.0 / (1.0 + math.exp(STEEPNESS * ahead_rad)) - 0.5)
    return min(max(share, MIN_SHARE), MAX_SHARE)


@kernel
def airspeed_of_share_m_s(share, min_m_s, max_m_s, wind_m_s):  # type: ignore[no-untyped-def]
    """Return the airspeed that corresponds to a fraction of the maximum thrust.

    A fraction of 0.4 gives the minimum airspeed, 0.7 the cruise airspeed (see ``Airframe``), and 1
    the maximum. The airspeed exceeds the wind speed if the maximum airspeed allows this.
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
    """Return whether a position is near an orbit's circle."""
    distance_m = math.hypot(x_m - orbit_x_m, y_m - orbit_y_m)
    return abs(distance_m - abs(radius_m)) < ON_ORBIT * abs(radius_m)


@kernel
def ahead_of_others_rad(  # type: ignore[no-untyped-def]
    x_m, y_m, orbit_x_m, orbit_y_m, radius_m, key, peers, range_m
):
    """Return the angle by which a vehicle is ahead of the mean phase of the others (eq. 18).

    The mean is circular, over the vehicles in range that are on an orbit of this radius. ``peers``
    (n, COLUMNS) is the result of ``PeerTable.rows``; each peer is advanced along its orbit by the
    age of its state. The angle is positive if the vehicle is ahead, for both directions of flight.
    The angle is 0 if there are no other vehicles, or if the vehicle is not on its orbit.
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
    sense = sense_of(radius_m)
    all_x, all_y = sum_x + math.cos(own_rad), sum_y + math.sin(own_rad)
    if math.hypot(all_x, all_y) < NO_MEAN * (count + 1):
        return sense * wrapped_rad(own_rad - first_rad)
    return sense * wrapped_rad(own_rad - math.atan2(sum_y, sum_x))


@kernel
def airspeed_in_phase_m_s(  # type: ignore[no-untyped-def]
    x_m, y_m, orbit_x_m, orbit_y_m, radius_m, key, peers, range_m,
    min_m_s, max_m_s, wind_m_s,
):  # fmt: skip
    """Return the airspeed that brings a vehicle into phase with the others (eqs. 16 to 18)."""
    ahead_rad = ahead_of_others_rad(x_m, y_m, orbit_x_m, orbit_y_m, radius_m, key, peers, range_m)
    return airspeed_of_share_m_s(thrust_share(ahead_rad), min_m_s, max_m_s, wind_m_s)
