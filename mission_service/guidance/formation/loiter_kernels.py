"""Computes a loiter around a virtual agent: control law, motion in one step, predicted path.

The kernels work on scalars. Positions are in metres with x east and y north; angles are in radians,
anticlockwise from east. A radius is signed as in MAVLink: a negative radius means an anticlockwise
orbit, as in the paper.

The control law (eqs. 14 and 15) sets the course over the ground; in wind, heading and course differ
by the drift angle. The law uses the position at the end of the step, so that the circle flown has
the commanded radius.

Eq. 14 (turn right until the agent is on the left) is omitted, because eq. 15 leads to the same
orbit. With eq. 14 a vehicle would turn right indefinitely if the agent were inside its turning
circle. Instead, a vehicle that must reverse its course turns in the direction of the orbit. The
vehicle therefore does not alternate between left and right, and other vehicles can predict its
path.
"""

import math

from firemodel.compiled import kernel

GRAVITY_M_S2 = 9.80665
ACCELERATION_M_S2 = 1.5  # maximum acceleration and deceleration
ABOUT = -0.7  # cosine of the smallest course change that counts as a reversal
# If the cosine of a course change is this close to ABOUT, the turn may be to either side.
FORK = 0.15


@kernel
def sense_of(radius_m):  # type: ignore[no-untyped-def]
    """Return 1 for an anticlockwise orbit, and -1 for a clockwise orbit."""
    return -1.0 if radius_m > 0.0 else 1.0


@kernel
def max_turn_rad(airspeed_m_s, bank_rad, step_s):  # type: ignore[no-untyped-def]
    """Return the largest angle of a level turn in one step, which is at most half a turn."""
    return min(GRAVITY_M_S2 * math.tan(bank_rad) / airspeed_m_s * step_s, math.pi)


@kernel
def next_airspeed_m_s(airspeed_m_s, desired_m_s, step_s):  # type: ignore[no-untyped-def]
    """Return the airspeed at the end of a step."""
    max_change_m_s = ACCELERATION_M_S2 * step_s
    return airspeed_m_s + min(max(desired_m_s - airspeed_m_s, -max_change_m_s), max_change_m_s)


@kernel
def _aim(  # type: ignore[no-untyped-def]
    x_m, y_m, head_x, head_y, airspeed_m_s, orbit_x_m, orbit_y_m, radius_m,
    wind_x_m_s, wind_y_m_s, step_s,
):  # fmt: skip
    """Return the desired heading at the end of a step, as a unit vector.

    The heading follows from a corrected form of eq. 15: the desired course is the polar angle of
    the vehicle around the agent, plus 2 atan(d / r). Here d is the distance from the agent, and r
    is the radius of the orbit. Far from the agent the course points towards the agent, on the orbit
    it points along the orbit, and near the agent it points outwards. The course is computed without
    angles: with q = d / r, the cosine of 2 atan(q) is (1 - q²) / (1 + q²), and the sine is 2 q / (1
    + q²).
    """
    sense = sense_of(radius_m)
    radius_m = abs(radius_m)
    over_x = airspeed_m_s * head_x + wind_x_m_s
    over_y = airspeed_m_s * head_y + wind_y_m_s
    away_x = x_m + over_x * step_s - orbit_x_m
    away_y = y_m + over_y * step_s - orbit_y_m
    distance2 = away_x * away_x + away_y * away_y
    distance_m = math.sqrt(distance2)
    if distance_m > 1e-6:
        # The step is an arc: its part along the circle does not change the distance to the agent.
        round_m = (away_x * over_y - away_y * over_x) * step_s / distance_m
        arc2 = max(distance2 - round_m * round_m, 0.0)
        share = 1.0 / ((radius_m * radius_m + arc2) * distance_m)
        along = (radius_m * radius_m - arc2) * share
        across = sense * 2.0 * radius_m * math.sqrt(arc2) * share
        course_x = along * away_x - across * away_y
        course_y = along * away_y + across * away_x
    else:
        course_x, course_y = head_x, head_y
    if wind_x_m_s == 0.0 and wind_y_m_s == 0.0:
        return course_x, course_y
    drift = (wind_y_m_s * course_x - wind_x_m_s * course_y) / airspeed_m_s
    drift = min(max(drift, -1.0), 1.0)
    ahead = math.sqrt(1.0 - drift * drift)
    return ahead * course_x + drift * course_y, ahead * course_y - drift * course_x


@kernel
def _turned(head_x, head_y, aim_x, aim_y, sense, cos, sin):  # type: ignore[no-untyped-def]
    """Return the heading, as a unit vector, after a turn towards the heading ``aim``.

    The turn is at most the angle that has the given ``cos`` and ``sin``. A reversal turns in the
    direction ``sense``; if ``sense`` is 0, every turn takes the shorter way.
    """
    along = head_x * aim_x + head_y * aim_y
    if along >= cos:
        return aim_x, aim_y
    left = head_x * aim_y - head_y * aim_x >= 0.0
    if along < ABOUT and sense != 0.0:
        left = sense > 0.0
    if not left:
        sin = -sin
    return cos * head_x - sin * head_y, cos * head_y + sin * head_x


@kernel
def _moved(  # type: ignore[no-untyped-def]
    x_m, y_m, head_x, head_y, new_x, new_y, airspeed_m_s, wind_x_m_s, wind_y_m_s, step_s
):
    """Return the position at the end of a step, flown at the mean of the two headings."""
    mid_x, mid_y = head_x + new_x, head_y + new_y
    size2 = mid_x * mid_x + mid_y * mid_y
    if size2 < 1e-12:
        mid_x, mid_y, size2 = -head_y, head_x, 1.0
    scale_m = airspeed_m_s * step_s / math.sqrt(size2)
    x_m += scale_m * mid_x + wind_x_m_s * step_s
    y_m += scale_m * mid_y + wind_y_m_s * step_s
    return x_m, y_m


@kernel
def tightest_m(airspeed_m_s, wind_m_s, bank_rad):  # type: ignore[no-untyped-def]
    """Return the radius of the smallest circle over the ground that can be flown in this wind."""
    over_m_s = airspeed_m_s + wind_m_s
    return over_m_s * over_m_s / (GRAVITY_M_S2 * math.tan(bank_rad))


@kernel
def wanted_heading_rad(  # type: ignore[no-untyped-def]
    x_m, y_m, heading_rad, airspeed_m_s, orbit_x_m, orbit_y_m, radius_m,
    wind_x_m_s, wind_y_m_s, step_s, bank_rad,
):  # fmt: skip
    """Return the heading towards and around an orbit at the end of a step, for ``heading_step``."""
    head_x, head_y = math.cos(heading_rad), math.sin(heading_rad)
    aim_x, aim_y = _aim(
        x_m, y_m, head_x, head_y, airspeed_m_s, orbit_x_m, orbit_y_m, radius_m,
        wind_x_m_s, wind_y_m_s, step_s,
    )  # fmt: skip
    if head_x * aim_x + head_y * aim_y < ABOUT:
        return heading_rad + sense_of(radius_m) * max_turn_rad(airspeed_m_s, bank_rad, step_s)
    return math.atan2(aim_y, aim_x)


@kernel
def at_fork(  # type: ignore[no-untyped-def]
    x_m, y_m, heading_rad, airspeed_m_s, orbit_x_m, orbit_y_m, radius_m, wind_x_m_s, wind_y_m_s
):
    """Return whether a small error in the state could reverse the turn towards an orbit."""
    head_x, head_y = math.cos(heading_rad), math.sin(heading_rad)
    aim_x, aim_y = _aim(
        x_m, y_m, head_x, head_y, airspeed_m_s, orbit_x_m, orbit_y_m, radius_m,
        wind_x_m_s, wind_y_m_s, 0.0,
    )  # fmt: skip
    along = head_x * aim_x + head_y * aim_y
    left = head_x * aim_y - head_y * aim_x
    return abs(along - ABOUT) < FORK and left * sense_of(radius_m) < 0.0


@kernel
def heading_step(  # type: ignore[no-untyped-def]
    x_m, y_m, heading_rad, airspeed_m_s, desired_rad, desired_m_s, wind_x_m_s, wind_y_m_s,
    step_s, bank_rad,
):  # fmt: skip
    """Compute one step of an ideal fixed-wing UAV (eq. 1) towards a heading and an airspeed.

    Returns x, y, the heading and the airspeed at the end of the step.
    """
    new_m_s = next_airspeed_m_s(airspeed_m_s, desired_m_s, step_s)
    airspeed_m_s = 0.5 * (airspeed_m_s + new_m_s)
    head_x, head_y = math.cos(heading_rad), math.sin(heading_rad)
    aim_x, aim_y = math.cos(desired_rad), math.sin(desired_rad)
    turn_rad = max_turn_rad(airspeed_m_s, bank_rad, step_s)
    new_x, new_y = _turned(
        head_x, head_y, aim_x, aim_y, 0.0, math.cos(turn_rad), math.sin(turn_rad)
    )
    x_m, y_m = _moved(
        x_m, y_m, head_x, head_y, new_x, new_y, airspeed_m_s, wind_x_m_s, wind_y_m_s, step_s
    )
    return x_m, y_m, math.atan2(new_y, new_x), new_m_s


@kernel
def predict_path(  # type: ignore[no-untyped-def]
    x_m, y_m, heading_rad, airspeed_m_s, orbit_x_m, orbit_y_m, radius_m, desired_m_s,
    wind_x_m_s, wind_y_m_s, bank_rad, first_s, step_s, path_m,
):  # fmt: skip
    """Fill ``path_m`` (n, 2) with a vehicle's positions on the way to an orbit and around it.

    Row i is the position ``first_s + i * step_s`` after the time of the given state. If ``first_s``
    is the age of the state, row 0 is the current position.
    """
    head_x, head_y = math.cos(heading_rad), math.sin(heading_rad)
    parts = math.ceil(first_s / step_s)
    part_s = first_s / parts if parts > 0 else step_s
    sense = sense_of(radius_m)
    turn_airspeed_m_s, cos, sin = 0.0, 1.0, 0.0
    for row in range(min(1 - parts, 0), path_m.shape[0]):
        if row == 1:
            part_s = step_s
        if row > 0 or parts > 0:
            new_m_s = next_airspeed_m_s(airspeed_m_s, desired_m_s, part_s)
            airspeed_m_s = 0.5 * (airspeed_m_s + new_m_s)
            if airspeed_m_s != turn_airspeed_m_s or row == 1:
                turn_airspeed_m_s = airspeed_m_s
                turn_rad = max_turn_rad(airspeed_m_s, bank_rad, part_s)
                cos, sin = math.cos(turn_rad), math.sin(turn_rad)
            aim_x, aim_y = _aim(
                x_m, y_m, head_x, head_y, airspeed_m_s, orbit_x_m, orbit_y_m, radius_m,
                wind_x_m_s, wind_y_m_s, part_s,
            )  # fmt: skip
            new_x, new_y = _turned(head_x, head_y, aim_x, aim_y, sense, cos, sin)
            x_m, y_m = _moved(
                x_m, y_m, head_x, head_y, new_x, new_y, airspeed_m_s, wind_x_m_s, wind_y_m_s, part_s
            )
            head_x, head_y, airspeed_m_s = new_x, new_y, new_m_s
        if row >= 0:
            path_m[row, 0] = x_m
            path_m[row, 1] = y_m
