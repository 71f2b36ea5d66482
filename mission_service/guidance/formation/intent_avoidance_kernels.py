"""Compiled parts of ``intent_avoidance``: predicted paths, their conflicts, and detours.

A path is an array with one row (x, y) for each second from now. An orbit is an array (4) with x, y,
signed radius and airspeed. Vehicles take turns adopting orbits; a turn lasts one slot.
"""

import math

import numpy as np

from firemodel.compiled import kernel
from mission_service.guidance.formation.loiter_kernels import at_fork, predict_path, tightest_m
from mission_service.guidance.formation.peer_table import (
    AGE_S,
    AIRSPEED,
    ALTITUDE,
    KEY,
    ORBIT_X,
    ORBIT_Y,
    PLANNED,
    RADIUS,
    VX,
    VY,
    X,
    Y,
)

STEP_S = 1.0
REACH_M = 600.0  # maximum distance of detours from the vehicle
NEAR_M = 200.0  # vehicles take turns if they are closer than this, or will be within NEAR_S
NEAR_S = 5.0
SILENT_S = 10.0  # a vehicle silent for longer is assumed to keep its orbit
FRESH_S = 1.0  # states older than this are late
LATE_M = 45.0  # maximum additional margin for a late state
HASTE_S = 8.0  # a path that is clear for a shorter time is changed at once, out of turn
SMALL_M = 40.0  # minimum radius of waiting circles
WORTH_M = 40.0  # minimum cost saving for a change from one clear orbit to another
NOTES = 6  # number of values in ``notes`` for each peer with a predicted path

# Indices of ``own``, and of a row of ``notes`` (box around the path, minimum distances).
OWN_KEY, OWN_X, OWN_Y, OWN_ALTITUDE, OWN_PLANNED, HEADING, OWN_AIRSPEED, WIND_X, WIND_Y = range(9)
WEST, EAST, SOUTH, NORTH, APART, HELD_APART = range(6)


@kernel
def hashed(key, slot):  # type: ignore[no-untyped-def]
    """Return a pseudo-random number from 0 to 2^32 - 1, which is the same in all processes."""
    bits = (int(key) * 0x9E3779B1 + int(slot) * 0x85EBCA77) & 0xFFFFFFFF
    bits = ((bits ^ (bits >> 15)) * 0x2C1B3C6D) & 0xFFFFFFFF
    bits = ((bits ^ (bits >> 12)) * 0x297A2D39) & 0xFFFFFFFF
    return bits ^ (bits >> 15)


@kernel
def rank(key, slot):  # type: ignore[no-untyped-def]
    """Return a key's priority in a slot; the vehicle with the highest priority may adopt an orbit.

    There are 8 classes of priority, and each key is in the highest class once in 8 slots.
    """
    return (((hashed(key, 0) + slot) & 7) << 32) | hashed(key, slot)


@kernel
def in_another_layer(own, peer, layers_m):  # type: ignore[no-untyped-def]
    """Return whether a peer stays in a different altitude layer from this vehicle.

    For each vehicle, all altitudes from the current to the planned altitude count.
    """
    low_m = min(own[OWN_ALTITUDE], own[OWN_PLANNED])
    high_m = max(own[OWN_ALTITUDE], own[OWN_PLANNED])
    peer_low_m, peer_high_m = min(peer[ALTITUDE], peer[PLANNED]), max(peer[ALTITUDE], peer[PLANNED])
    return peer_low_m - high_m >= layers_m or low_m - peer_high_m >= layers_m


@kernel
def _ahead_of_peer(own, peer, bank_rad, path):  # type: ignore[no-untyped-def]
    """Fill ``path`` with a peer's path from now on, computed from its last state and orbit."""
    air_x, air_y = peer[VX] - own[WIND_X], peer[VY] - own[WIND_Y]
    predict_path(
        peer[X], peer[Y], math.atan2(air_y, air_x), max(math.hypot(air_x, air_y), 1.0),
        peer[ORBIT_X], peer[ORBIT_Y], peer[RADIUS], peer[AIRSPEED],
        own[WIND_X], own[WIND_Y], bank_rad, peer[AGE_S], STEP_S, path,
    )  # fmt: skip


@kernel
def is_own_turn(at_s, own, peers, turn_s, layers_m, bank_rad, path):  # type: ignore[no-untyped-def]
    """Return whether this vehicle may adopt an orbit now.

    The vehicle must wait if any vehicle that is near, or will soon be near, has a higher priority
    or an old state. A state is old if it was sent before the end of the last slot in which the
    other vehicle had the higher priority, because an adoption in that slot may not have been
    received. ``path`` (2 or more, 2) is a work array.
    """
    slot = math.floor(at_s / turn_s)
    into_s = at_s - slot * turn_s + 1e-6
    own_rank = rank(own[OWN_KEY], slot)
    over_x = own[OWN_AIRSPEED] * math.cos(own[HEADING]) + own[WIND_X]
    over_y = own[OWN_AIRSPEED] * math.sin(own[HEADING]) + own[WIND_Y]
    for row in range(peers.shape[0]):
        if in_another_layer(own, peers[row], layers_m):
            continue
        _ahead_of_peer(own, peers[row], bank_rad, path[:2])
        away_x, away_y = path[0, 0] - own[OWN_X], path[0, 1] - own[OWN_Y]
        rel_x = (path[1, 0] - path[0, 0]) / STEP_S - over_x
        rel_y = (path[1, 1] - path[0, 1]) / STEP_S - over_y
        after_s = -(away_x * rel_x + away_y * rel_y) / max(rel_x * rel_x + rel_y * rel_y, 1e-9)
        after_s = min(max(after_s, 0.0), NEAR_S)
        away_x += rel_x * after_s
        away_y += rel_y * after_s
        if away_x * away_x + away_y * away_y >= NEAR_M * NEAR_M:
            continue
        if rank(peers[row, KEY], slot) > own_rank:
            return False
        since_s, before = into_s, slot - 1
        while since_s < peers[row, AGE_S] < SILENT_S:
            if rank(peers[row, KEY], before) > rank(own[OWN_KEY], before):
                return False
            since_s, before = since_s + turn_s, before - 1
    return True


@kernel
def _box(path, more_m):  # type: ignore[no-untyped-def]
    """Return the west, east, south and north edges of the box around a path, plus ``more_m``."""
    west, east, south, north = np.inf, -np.inf, np.inf, -np.inf
    for row in range(path.shape[0]):
        west, east = min(west, path[row, 0]), max(east, path[row, 0])
        south, north = min(south, path[row, 1]), max(north, path[row, 1])
    return west - more_m, east + more_m, south - more_m, north + more_m


@kernel
def clear_for_s(path, paths, notes, count, apart_at, max_m_s):  # type: ignore[no-untyped-def]
    """Return the time for which a path (rows, 2) is clear of the first ``count`` peers' paths.

    ``paths`` (n, rows, 2) holds the paths of the peers. ``apart_at`` (APART or HELD_APART) is the
    index of the minimum distance in ``notes``.
    """
    west, east, south, north = _box(path, 0.0)
    first = path.shape[0] - 1
    for peer in range(count):
        apart_m = notes[peer, apart_at]
        if (
            notes[peer, WEST] > east + apart_m
            or notes[peer, EAST] < west - apart_m
            or notes[peer, SOUTH] > north + apart_m
            or notes[peer, NORTH] < south - apart_m
        ):
            continue
        row = 0
        while row < first:
            away_x = paths[peer, row, 0] - path[row, 0]
            away_y = paths[peer, row, 1] - path[row, 1]
            distance2 = away_x * away_x + away_y * away_y
            # Skip the steps in which two vehicles cannot come closer than the minimum distance.
            ahead = apart_m + 2.0 * max_m_s * STEP_S
            if distance2 > ahead * ahead:
                row += int((math.sqrt(distance2) - apart_m) / (2.0 * max_m_s * STEP_S))
                continue
            rel_x = paths[peer, row + 1, 0] - path[row + 1, 0] - away_x
            rel_y = paths[peer, row + 1, 1] - path[row + 1, 1] - away_y
            part = -(away_x * rel_x + away_y * rel_y) / max(rel_x * rel_x + rel_y * rel_y, 1e-9)
            part = min(max(part, 0.0), 1.0)
            away_x += part * rel_x
            away_y += part * rel_y
            if away_x * away_x + away_y * away_y < apart_m * apart_m:
                first = row
                break
            row += 1
    return first * STEP_S


@kernel
def _may_enter(row, peers, box):  # type: ignore[no-untyped-def]
    """Return whether a peer's path to and around its orbit may enter a box (W, E, S, N)."""
    west, east, south, north = box
    span_m = abs(peers[row, RADIUS]) + peers[row, AIRSPEED] * peers[row, AGE_S]
    return (
        min(peers[row, X], peers[row, ORBIT_X]) - span_m < east
        and max(peers[row, X], peers[row, ORBIT_X]) + span_m > west
        and min(peers[row, Y], peers[row, ORBIT_Y]) - span_m < north
        and max(peers[row, Y], peers[row, ORBIT_Y]) + span_m > south
    )


@kernel
def _add_peers(own, peers, rule, frame, box, seen, count, paths, notes):  # type: ignore[no-untyped-def]
    """Add the paths and notes of peers that may enter a box, but not the box ``seen``.

    Returns the new number of paths.
    """
    apart_m, margin_m, margin_m_s, _, layers_m = rule
    bank_rad = frame[2]
    for row in range(peers.shape[0]):
        if (
            not _may_enter(row, peers, box)
            or _may_enter(row, peers, seen)
            or in_another_layer(own, peers[row], layers_m)
        ):
            continue
        _ahead_of_peer(own, peers[row], bank_rad, paths[count])
        notes[count, WEST], notes[count, EAST], notes[count, SOUTH], notes[count, NORTH] = _box(
            paths[count], 0.0
        )
        # A peer that is already too close must not come closer.
        now_m = math.hypot(paths[count, 0, 0] - own[OWN_X], paths[count, 0, 1] - own[OWN_Y])
        late_m = min(margin_m_s * max(peers[row, AGE_S] - FRESH_S, 0.0), LATE_M)
        clear_m = max(apart_m + 1.0, now_m - 2.0)
        notes[count, APART] = min(apart_m + margin_m + late_m, clear_m)
        notes[count, HELD_APART] = min(apart_m + margin_m / 3.0, clear_m)
        count += 1
    return count


@kernel
def _union(one, other):  # type: ignore[no-untyped-def]
    """Return the smallest box that contains two boxes."""
    return (
        min(one[0], other[0]),
        max(one[1], other[1]),
        min(one[2], other[2]),
        max(one[3], other[3]),
    )


@kernel
def _ahead(own, orbit, frame, path):  # type: ignore[no-untyped-def]
    """Fill ``path`` with the vehicle's own path to and around an orbit."""
    predict_path(
        own[OWN_X], own[OWN_Y], own[HEADING], own[OWN_AIRSPEED],
        orbit[0], orbit[1], orbit[2], orbit[3],
        own[WIND_X], own[WIND_Y], frame[2], 0.0, STEP_S, path,
    )  # fmt: skip


@kernel
def _clear_s(own, orbit, frame, path, paths, notes, count, apart_at):  # type: ignore[no-untyped-def]
    """Return the time for which the path to an orbit is clear; 0 if the path is unpredictable."""
    if apart_at == APART and at_fork(
        own[OWN_X], own[OWN_Y], own[HEADING], own[OWN_AIRSPEED], orbit[0], orbit[1], orbit[2],
        own[WIND_X], own[WIND_Y],
    ):  # fmt: skip
        return 0.0
    _ahead(own, orbit, frame, path)
    return clear_for_s(path, paths, notes, count, apart_at, frame[1])


@kernel
def _copy(orbit, to):  # type: ignore[no-untyped-def]
    for i in range(4):
        to[i] = orbit[i]


@kernel
def _cost_m(orbit, desired):  # type: ignore[no-untyped-def]
    """Return the cost, in metres, of an orbit's deviation from the desired orbit."""
    return (
        math.hypot(orbit[0] - desired[0], orbit[1] - desired[1])
        + 0.5 * abs(abs(orbit[2]) - abs(desired[2]))
        + 5.0 * abs(orbit[3] - desired[3])
    )


AIRSPEEDS = 5
ROUND = 12  # number of detour directions
KINDS = AIRSPEEDS + AIRSPEEDS + 3 + 2 * ROUND + 8


@kernel
def slow_of(own, frame):  # type: ignore[no-untyped-def]
    """Return the airspeed for waiting circles.

    This airspeed is midway between the minimum and the cruise airspeed, or higher to exceed the
    wind speed.
    """
    min_m_s, max_m_s, _ = frame
    slow_m_s = 0.5 * (min_m_s + max(0.7 * max_m_s, min_m_s))
    return min(max(slow_m_s, math.hypot(own[WIND_X], own[WIND_Y]) + 2.0), max_m_s)


@kernel
def _candidate(number, own, desired, held, frame, small_m, twist, orbit):  # type: ignore[no-untyped-def]
    """Fill ``orbit`` with candidate ``number``: another airspeed, a waiting circle or a detour."""
    min_m_s, max_m_s, _ = frame
    sense = 1.0 if desired[2] > 0.0 else -1.0
    min_m_s = max(min_m_s, math.hypot(own[WIND_X], own[WIND_Y]) + 2.0)
    slow_m_s = slow_of(own, frame)
    _copy(desired, orbit)
    if number < 2 * AIRSPEEDS:  # the desired or the current orbit, at another airspeed
        if number >= AIRSPEEDS:
            _copy(held, orbit)
        orbit[3] = min_m_s + (max_m_s - min_m_s) * (number % AIRSPEEDS) / (AIRSPEEDS - 1)
        return
    number -= 2 * AIRSPEEDS
    orbit[3] = slow_m_s
    if number < 3:  # a waiting circle at the centre of the desired orbit
        orbit[2] = sense * min(small_m * (1.0 + 0.5 * number), abs(desired[2]))
        return
    number -= 3
    if number < 2 * ROUND:  # a detour around a position beside the path
        angle_rad = math.atan2(desired[1] - own[OWN_Y], desired[0] - own[OWN_X])
        angle_rad += 2.0 * math.pi * (number // 2 + twist) / ROUND
        away_m = 160.0 if number % 2 == 0 else 350.0
        orbit[0] = own[OWN_X] + away_m * math.cos(angle_rad)
        orbit[1] = own[OWN_Y] + away_m * math.sin(angle_rad)
        orbit[2] = sense * small_m
        return
    number -= 2 * ROUND  # a circle from the current position, to the left or to the right
    radius_m = small_m * (1.0 + number // 4)
    left = number % 2 == 0
    orbit[3] = slow_m_s if number // 2 % 2 == 0 else min_m_s
    off_m = radius_m if left else -radius_m
    orbit[0] = own[OWN_X] - off_m * math.sin(own[HEADING])
    orbit[1] = own[OWN_Y] + off_m * math.cos(own[HEADING])
    orbit[2] = -radius_m if left else radius_m


@kernel
def _differs(orbit, other):  # type: ignore[no-untyped-def]
    """Return whether two orbits differ enough to justify a change from one to the other."""
    return (
        abs(orbit[0] - other[0]) + abs(orbit[1] - other[1]) + abs(orbit[2] - other[2]) > 2.0
        or abs(orbit[3] - other[3]) > 0.2
    )


@kernel
def decide_orbit(  # type: ignore[no-untyped-def]
    at_s, own, desired, held, listens, peers, rule, frame, path, paths, notes, adopted
):
    """Decide on the orbit to fly; fill ``adopted`` if this orbit differs from the current orbit.

    If ``listens``, the vehicle has not yet received the states of all vehicles, and keeps its orbit
    unless the path is clear for at most ``HASTE_S``. Returns whether a different orbit is adopted,
    whether a conflict prevents the desired orbit, and for how long the orbit to fly is clear.
    """
    near_m = rule[0] + rule[1] + LATE_M
    nowhere = (np.inf, -np.inf, np.inf, -np.inf)
    _ahead(own, held, frame, path)
    box = _box(path, near_m)
    count = _add_peers(own, peers, rule, frame, box, nowhere, 0, paths, notes)
    horizon_s = (path.shape[0] - 1) * STEP_S
    held_s = clear_for_s(path, paths, notes, count, HELD_APART, frame[1])
    in_conflict = _cost_m(held, desired) > WORTH_M
    slot = math.floor(at_s / rule[3])
    if held_s >= horizon_s and not _differs(desired, held):
        return False, False, held_s
    if held_s > HASTE_S and (
        listens or not is_own_turn(at_s, own, peers, rule[3], rule[4], frame[2], path)
    ):
        return False, in_conflict, held_s
    _ahead(own, desired, frame, path)
    wider = _union(_box(path, near_m), box)
    count = _add_peers(own, peers, rule, frame, wider, box, count, paths, notes)
    _copy(desired, adopted)
    clear_s = _clear_s(own, desired, frame, path, paths, notes, count, APART)
    if clear_s >= horizon_s:
        return _differs(desired, held), False, clear_s
    reach = (own[OWN_X] - REACH_M, own[OWN_X] + REACH_M, own[OWN_Y] - REACH_M, own[OWN_Y] + REACH_M)
    adopted[3] = frame[1]
    _ahead(own, adopted, frame, path)
    widest = _union(_union(_box(path, near_m), reach), wider)
    count = _add_peers(own, peers, rule, frame, widest, wider, count, paths, notes)
    wind_m_s = math.hypot(own[WIND_X], own[WIND_Y])
    small_m = max(1.2 * tightest_m(slow_of(own, frame), wind_m_s, frame[2]), SMALL_M)
    twist = hashed(own[OWN_KEY], slot) / 4294967296.0
    best_m = _cost_m(held, desired) - WORTH_M if held_s >= horizon_s else np.inf
    best, best_s, best_kind = False, clear_s, -1
    for kind in range(KINDS):
        _candidate(kind, own, desired, held, frame, small_m, twist, adopted)
        cost_m = _cost_m(adopted, desired)
        tightest = 1.05 * tightest_m(adopted[3], wind_m_s, frame[2])
        if cost_m >= best_m or abs(adopted[2]) < min(tightest, abs(desired[2])):
            continue
        clear_s = _clear_s(own, adopted, frame, path, paths, notes, count, APART)
        if clear_s >= horizon_s:
            best, best_m, best_kind, best_s = True, cost_m, kind, clear_s
        elif not best and held_s < horizon_s and clear_s > best_s:
            best_kind, best_s = kind, clear_s
    if best or best_s > held_s:
        if best_kind < 0:
            _copy(desired, adopted)
        else:
            _candidate(best_kind, own, desired, held, frame, small_m, twist, adopted)
        return True, best_kind >= 0, best_s
    return False, True, held_s
