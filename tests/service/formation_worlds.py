"""Small simulations of ideal fixed wings that follow virtual agents, for tests of avoidance.

A world is data: the starts of the vehicles and the places of their virtual agents. There is no
formation: agents move straight to the given places, even through each other.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from firemodel.compiled import NUMBA, cache_folder
from mission_service.experiments.virtual_agents import rvo_kernels as rvo
from mission_service.guidance.formation import intent_avoidance as intent
from mission_service.guidance.formation import loiter_kernels as loiter
from mission_service.guidance.formation import orbit_phase_kernels as phase
from mission_service.guidance.formation import peer_table as peers
from mission_service.guidance.formation.intent_avoidance_kernels import NOTES, decide_orbit
from mission_service.guidance.formation.settings import Settings

Floats = NDArray[np.float64]
STEP_S = 0.25


def orbit_step(
    x: float, y: float, heading: float, airspeed: float, *orbit_wind_step_bank: float
) -> tuple[float, float, float, float]:
    """Fly one step to or along an orbit (x, y, radius, airspeed): x, y, heading, airspeed."""
    *orbit, new_airspeed, wind_x, wind_y, step_s, bank = orbit_wind_step_bank
    after = (wind_x, wind_y, step_s, bank)
    aim = loiter.wanted_heading_rad(x, y, heading, airspeed, *orbit, *after)
    state: tuple[float, float, float, float] = loiter.heading_step(
        x, y, heading, airspeed, aim, new_airspeed, *after
    )
    return state


SETTINGS = Settings()
RADIUS_M = -SETTINGS.loiter_radius_m


@dataclass
class World:
    """The starts of vehicles (n), and new places of their agents at given times."""

    start: Floats  # (n, 3): x, y, heading
    places: list[tuple[float, Floats]]  # start times, and places (n, 2)
    agent_m_s: float = 25.0
    seed: int = 0
    jumps_s: float = 0.0  # mean time between jumps of an agent to its vehicle; 0 means never
    drift_m_s: float = 0.0  # speed at which places move outwards
    wind_m_s: tuple[float, float] = (0.0, 0.0)
    delay_s: float = 0.0
    lost: float = 0.0
    altitude_m: Floats | None = None
    wide: float = 1.0  # factor by which flown circles are wider than planned, as with autopilots


@dataclass
class Outcome:
    """The results of a simulation."""

    conflicts: int  # number of times a desired velocity entered another's obstacle
    collisions: int  # number of times a pair came closer than 2 r_s
    nearest_m: float
    # (n) time since when on the orbit around the given place; inf if not at the end.
    settled_s: Floats
    on_orbit: float  # share of vehicles on their agents' orbits in the last tenth of the time
    changes_per_s: float  # changes of planned orbits, per vehicle, in the last tenth of the time
    spread_rad: float  # largest difference of phases from their mean at the end
    thoughts: int


NONE, RVO, INTENT = range(3)
AVOIDANCES = {"none": NONE, "rvo": RVO, "intent": INTENT}


def cached(function: Callable[..., Any]) -> Any:
    """Compile a function; it is compiled again when the kernels of the formation change."""
    given = NUMBA.CACHE_DIR
    NUMBA.CACHE_DIR = str(cache_folder(Path(loiter.__file__).parent))
    try:
        return njit(cache=True, error_model="numpy")(function)
    finally:
        NUMBA.CACHE_DIR = given


@cached
def _episodes(seen, last, tick):  # type: ignore[no-untyped-def]
    """Count an episode for each pair that is close and was not close in the last 5 s."""
    begun = 0
    for one in range(seen.shape[0]):
        for other in range(one):
            if seen[one, other] or seen[other, one]:
                begun += tick - last[one, other] > 5.0 / STEP_S
                last[one, other] = tick
    return begun


@cached
def _fly(  # type: ignore[no-untyped-def]
    start, begins_s, all_places, agent_m_s, jumps_s, drift_m_s, wind_x, wind_y, delay_s, lost,
    altitude_m, kind, rule, frame, every_s, horizon_s, keys, until_s, rng, settled_s, wide, trace,
):  # fmt: skip
    count = start.shape[0]
    min_m_s, max_m_s, bank_rad = frame
    wind = math.hypot(wind_x, wind_y)
    x, y, heading = start[:, 0].copy(), start[:, 1].copy(), start[:, 2].copy()
    airspeed = np.full(count, 0.7 * max_m_s)
    agent = np.stack((x + 150.0 * np.cos(heading), y + 150.0 * np.sin(heading)), axis=1)
    orbit = np.empty((count, 4))
    orbit[:, :2], orbit[:, 2], orbit[:, 3] = agent, RADIUS_M, airspeed
    delay = int(delay_s / STEP_S)
    posted = np.full((delay + 1, count, peers.COLUMNS), np.nan)
    reported = np.full((count, count, peers.COLUMNS), -1e9)
    others = np.empty((count, peers.COLUMNS))
    peer_messaging = rng.integers(0, 2, count)
    collided, met = np.full((count, count), -10_000), np.full((count, count), -10_000)
    seen = np.zeros((count, count), np.bool_)
    rows = int(horizon_s) + 1
    path, paths = np.empty((rows, 2)), np.empty((count, rows, 2))
    notes, own, adopted = np.empty((count, NOTES)), np.empty(9), np.empty(4)
    places = all_places[0].copy()
    settled_s[:] = np.inf
    collisions, conflicts, nearest_m, changes, thoughts = 0, 0, np.inf, 0, 0
    last_tenth, on_orbit = 0, 0.0
    for tick in range(int(until_s / STEP_S)):
        at_s = tick * STEP_S
        for number in range(begins_s.size):
            if begins_s[number] == at_s:
                places = all_places[number].copy()
                settled_s[:] = np.inf
        middle_x, middle_y = places[:, 0].mean(), places[:, 1].mean()
        for uav in range(count):
            out_x, out_y = places[uav, 0] - middle_x, places[uav, 1] - middle_y
            out_m = max(math.hypot(out_x, out_y), 1.0)
            places[uav, 0] += drift_m_s * STEP_S * out_x / out_m
            places[uav, 1] += drift_m_s * STEP_S * out_y / out_m
            way_x, way_y = places[uav, 0] - agent[uav, 0], places[uav, 1] - agent[uav, 1]
            part = min(1.0, agent_m_s * STEP_S / max(math.hypot(way_x, way_y), 1e-9))
            agent[uav, 0] += part * way_x
            agent[uav, 1] += part * way_y
            far_m = math.hypot(agent[uav, 0] - x[uav], agent[uav, 1] - y[uav])
            if far_m > 600.0 or (jumps_s > 0.0 and rng.random() < STEP_S / jumps_s):
                agent[uav, 0] = x[uav] + 150.0 * math.cos(heading[uav])
                agent[uav, 1] = y[uav] + 150.0 * math.sin(heading[uav])
        # Messages.
        now = tick % (delay + 1)
        for uav in range(count):
            posted[now, uav, 0] = np.nan
            if (tick + peer_messaging[uav]) % 2 == 0:
                row = posted[now, uav]
                row[peers.X], row[peers.Y], row[peers.ALTITUDE] = x[uav], y[uav], altitude_m[uav]
                row[peers.VX] = airspeed[uav] * math.cos(heading[uav]) + wind_x
                row[peers.VY] = airspeed[uav] * math.sin(heading[uav]) + wind_y
                row[peers.ORBIT_X], row[peers.ORBIT_Y] = orbit[uav, 0], orbit[uav, 1]
                row[peers.RADIUS], row[peers.AIRSPEED] = orbit[uav, 2], orbit[uav, 3]
                row[peers.PLANNED] = altitude_m[uav]
                row[peers.AGE_S], row[peers.KEY] = at_s, keys[uav]
        then = (tick + 1) % (delay + 1)
        for uav in range(count):
            if not np.isnan(posted[then, uav, 0]):
                for to in range(count):
                    if to != uav and rng.random() >= lost:
                        reported[to, uav] = posted[then, uav]
        # The desired and the flown orbit of each vehicle.
        seen[:] = False
        for uav in range(count):
            thinks = kind == RVO or (tick + uav) % int(every_s / STEP_S) == 0
            if thinks:
                received = 0
                for other in range(count):
                    if at_s - reported[uav, other, peers.AGE_S] < 10.0:
                        others[received] = reported[uav, other]
                        others[received, peers.AGE_S] = at_s - others[received, peers.AGE_S]
                        received += 1
                desired = np.array([agent[uav, 0], agent[uav, 1], RADIUS_M, 0.0])
                desired[3] = phase.airspeed_in_phase_m_s(
                    x[uav], y[uav], agent[uav, 0], agent[uav, 1], RADIUS_M, keys[uav],
                    others[:received], 2000.0, min_m_s, max_m_s, wind,
                )  # fmt: skip
                if kind == INTENT:
                    own[:] = (
                        keys[uav], x[uav], y[uav], altitude_m[uav], altitude_m[uav],
                        heading[uav], airspeed[uav], wind_x, wind_y,
                    )  # fmt: skip
                    changed, _, clear_s = decide_orbit(
                        at_s, own, desired, orbit[uav], False, others[:received], rule, frame,
                        path, paths, notes, adopted,
                    )  # fmt: skip
                    thoughts += 1
                    if trace.size:
                        trace[tick, uav, 9] = clear_s
                        trace[tick, uav, 10] = changed
                    if changed:
                        orbit[uav] = adopted
                        changes += at_s > 0.9 * until_s
                else:
                    orbit[uav] = desired
            if kind != INTENT:
                orbit[uav, :2] = agent[uav]
            aim = loiter.wanted_heading_rad(
                x[uav], y[uav], heading[uav], airspeed[uav], orbit[uav, 0], orbit[uav, 1],
                orbit[uav, 2] * wide, wind_x, wind_y, STEP_S, bank_rad,
            )  # fmt: skip
            over_x = airspeed[uav] * math.cos(heading[uav]) + wind_x
            over_y = airspeed[uav] * math.sin(heading[uav]) + wind_y
            new_x = airspeed[uav] * math.cos(aim) + wind_x
            new_y = airspeed[uav] * math.sin(aim) + wind_y
            for other in range(count):
                away_x, away_y = x[other] - x[uav], y[other] - y[uav]
                if other != uav and away_x * away_x + away_y * away_y < 250_000.0:
                    seen[uav, other] = rvo.meets_after_s(
                        away_x, away_y,
                        2.0 * new_x - over_x - airspeed[other] * math.cos(heading[other]) - wind_x,
                        2.0 * new_y - over_y - airspeed[other] * math.sin(heading[other]) - wind_y,
                        60.0,
                    ) < np.inf  # fmt: skip
            if kind == RVO:
                aim, _ = rvo.clear_heading_rad(
                    x[uav], y[uav], over_x, over_y, aim, airspeed[uav],
                    wind_x, wind_y, others[:received], 60.0, 500.0,
                )  # fmt: skip
            x[uav], y[uav], heading[uav], airspeed[uav] = loiter.heading_step(
                x[uav], y[uav], heading[uav], airspeed[uav], aim, orbit[uav, 3], wind_x, wind_y,
                STEP_S, bank_rad,
            )  # fmt: skip
            if trace.size:
                trace[tick, uav, 0], trace[tick, uav, 1], trace[tick, uav, 2] = (
                    x[uav],
                    y[uav],
                    heading[uav],
                )
                trace[tick, uav, 3:7] = orbit[uav]
                trace[tick, uav, 7:9] = agent[uav]
        # Compute the results.
        conflicts += _episodes(seen, met, tick)
        for one in range(count):
            for other in range(one):
                apart_m = math.hypot(x[one] - x[other], y[one] - y[other])
                if abs(altitude_m[one] - altitude_m[other]) > 59.0:
                    apart_m = np.inf
                nearest_m = min(nearest_m, apart_m)
                seen[one, other], seen[other, one] = apart_m < 60.0, False
        collisions += _episodes(seen, collided, tick)
        for uav in range(count):
            off_m = abs(math.hypot(x[uav] - agent[uav, 0], y[uav] - agent[uav, 1]) - 150.0)
            left_m = math.hypot(places[uav, 0] - agent[uav, 0], places[uav, 1] - agent[uav, 1])
            if off_m > 60.0:
                settled_s[uav] = np.inf
            elif off_m < 20.0 and left_m < 30.0:
                settled_s[uav] = min(settled_s[uav], at_s)
            if at_s > 0.9 * until_s:
                last_tenth += 1
                on_orbit += off_m < 20.0
    angle = np.exp(1j * np.arctan2(y - agent[:, 1], x - agent[:, 0]))
    spread_rad = np.max(np.abs(np.angle(angle / angle.mean())))
    return (
        conflicts, collisions, nearest_m, on_orbit / max(last_tenth, 1),
        changes / (0.1 * until_s * count), spread_rad, thoughts,
    )  # fmt: skip


def fly(
    world: World,
    avoidance: str,
    until_s: float,
    rules: intent.AvoidanceRules | None = None,
    trace: Floats | None = None,
) -> Outcome:
    """Fly all vehicles with one of AVOIDANCES.

    If ``trace`` (steps, n, 11) is given, it is filled for inspection: x, y, heading, orbit, agent,
    how long the orbit was clear at the last decision, and whether it was new then.
    """
    rules = rules or intent.avoidance_rules(SETTINGS)
    count = len(world.start)
    settled_s = np.empty(count)
    conflicts, collisions, nearest_m, on_orbit, changes, spread_rad, thoughts = _fly(
        world.start,
        np.array([begins_s for begins_s, _ in world.places]),
        np.stack([places for _, places in world.places]),
        world.agent_m_s,
        world.jumps_s,
        world.drift_m_s,
        *world.wind_m_s,
        world.delay_s,
        world.lost,
        np.full(count, 300.0) if world.altitude_m is None else world.altitude_m,
        AVOIDANCES[avoidance],
        rules.for_kernel,
        rules.frame,
        rules.every_s,
        rules.horizon_s,
        np.array([float(peers.priority_key(f"uav{number}")) for number in range(count)]),
        until_s,
        np.random.default_rng(world.seed),
        settled_s,
        world.wide,
        np.empty((0, 0, 0)) if trace is None else trace,
    )
    return Outcome(
        conflicts, collisions, nearest_m, settled_s, on_orbit, changes, spread_rad, thoughts
    )


def ring(count: int, spacing_m: float, middle: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Return places (n, 2) on a circle, with the given spacing."""
    turn = 2.0 * np.pi / count
    radius_m = spacing_m / (2.0 * np.sin(turn / 2.0)) if count > 1 else 0.0
    angle = np.arange(count) * turn
    return np.stack(
        [middle[0] + radius_m * np.cos(angle), middle[1] + radius_m * np.sin(angle)], axis=1
    )


def queue(count: int, gap_m: float, from_m: float) -> Floats:
    """Return vehicles (n, 3) in a line that fly east to the origin; the first is at ``from_m``."""
    x = -from_m - gap_m * np.arange(count)
    return np.stack([x, np.zeros(count), np.zeros(count)], axis=1)


def deployment(count: int, spacing_m: float, gap_m: float, seed: int, **more: object) -> World:
    """Return a world in which vehicles fly from a launch queue to random places on a ring."""
    rng = np.random.default_rng(seed)
    places = ring(count, spacing_m)
    size_m = float(np.hypot(*places[0]))
    return World(
        queue(count, gap_m, size_m + 600.0), [(0.0, places[rng.permutation(count)])],
        seed=seed, **more,  # type: ignore[arg-type]
    )  # fmt: skip


def settled_on(places: Floats) -> Floats:
    """Return vehicles (n, 3) on their orbits around places, in phase."""
    east = np.full(len(places), np.pi / 2)
    return np.stack([places[:, 0] - RADIUS_M, places[:, 1], east], axis=1)


def shuffle(count: int, spacing_m: float, seed: int, **more: object) -> World:
    """Return a world in which agents on a square grid exchange their places four times."""
    rng = np.random.default_rng(seed)
    side = math.ceil(math.sqrt(count))
    number = np.arange(count)
    grid = spacing_m * np.stack([number % side, number // side], axis=1).astype(float)
    dealt = [(60.0 + 150.0 * time, grid[rng.permutation(count)]) for time in range(4)]
    return World(settled_on(grid), [(0.0, grid), *dealt], seed=seed, **more)  # type: ignore[arg-type]


def home_and_back(count: int, spacing_m: float, seed: int, **more: object) -> World:
    """Return a world in which half of a ring flies home through the others, waits and returns."""
    rng = np.random.default_rng(seed)
    places = ring(count, spacing_m)
    home, half = places.copy(), rng.permutation(count)[: count // 2]
    home[half, 0] = -3000.0
    home[half, 1] = 320.0 * (np.arange(len(half)) - len(half) / 2)
    return World(
        settled_on(places), [(0.0, places), (60.0, home), (260.0, places)],
        seed=seed, **more,  # type: ignore[arg-type]
    )  # fmt: skip


def swap(count: int, spacing_m: float, **more: object) -> World:
    """Return a world in which agents of a ring move to the opposite side."""
    places = ring(count, spacing_m)
    opposite = np.roll(places, count // 2, axis=0)
    return World(settled_on(places), [(0.0, places), (60.0, opposite)], **more)  # type: ignore[arg-type]
