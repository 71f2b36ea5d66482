"""Avoidance by planned orbits: no vehicles meet, and all reach their goals."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from mission_service.guidance.formation import peer_table as peers
from mission_service.guidance.formation.intent_avoidance import (
    AdoptedOrbit,
    AvoidanceRules,
    IntendedOrbit,
    OwnMotion,
    avoidance_rules,
    choose_orbit,
)
from mission_service.guidance.formation.settings import Settings
from tests.service.formation_worlds import (
    deployment,
    fly,
    home_and_back,
    shuffle,
    swap,
)

RULES = avoidance_rules(Settings())
CURRENT = IntendedOrbit(0.0, 0.0, -150.0, 17.5)
OWN = OwnMotion(7, 150.0, 0.0, 300.0, 300.0, math.pi / 2, 17.5)
NO_PEERS = np.zeros((0, peers.COLUMNS))


def on_orbit(
    x_m: float,
    y_m: float,
    angle_rad: float = 0.0,
    key: int = 3,
    age_s: float = 0.25,
    altitude_m: float = 300.0,
) -> NDArray[np.float64]:
    """Return one row: a vehicle on an orbit around a place."""
    row = np.zeros(peers.COLUMNS)
    row[peers.X], row[peers.Y] = x_m + 150 * math.cos(angle_rad), y_m + 150 * math.sin(angle_rad)
    row[peers.VX], row[peers.VY] = -17.5 * math.sin(angle_rad), 17.5 * math.cos(angle_rad)
    row[[peers.ORBIT_X, peers.ORBIT_Y, peers.RADIUS]] = x_m, y_m, -150.0
    row[[peers.AIRSPEED, peers.AGE_S, peers.KEY]] = 17.5, age_s, key
    row[[peers.ALTITUDE, peers.PLANNED]] = altitude_m
    return row[None]


def think(
    desired: IntendedOrbit,
    others: NDArray[np.float64],
    at_s: float = 101.5,
    rules: AvoidanceRules = RULES,
) -> AdoptedOrbit:
    return choose_orbit(at_s, OWN, desired, AdoptedOrbit(CURRENT), others, rules)


def test_a_single_vehicle_flies_its_desired_course() -> None:
    desired = IntendedOrbit(300.0, 0.0, -150.0, 20.0)
    choice = think(desired, NO_PEERS)
    assert choice.orbit == desired
    assert not choice.in_conflict
    assert choice.clear_s == RULES.horizon_s


def test_small_changes_are_not_adopted_and_no_vehicle_replans_all_the_time() -> None:
    assert think(IntendedOrbit(0.5, 0.5, -150.0, 17.6), NO_PEERS).orbit == CURRENT
    held = choose_orbit(100.0, OWN, CURRENT, AdoptedOrbit(CURRENT), NO_PEERS, RULES)
    desired = IntendedOrbit(300.0, 0.0, -150.0, 20.0)
    assert choose_orbit(100.25, OWN, desired, held, NO_PEERS, RULES) == held
    assert choose_orbit(100.5, OWN, desired, held, NO_PEERS, RULES).orbit == desired


def test_an_orbit_next_to_another_in_phase_is_adopted_and_out_of_phase_is_not() -> None:
    desired = IntendedOrbit(20.0, 0.0, -150.0, 17.5)
    turns = np.arange(16) * RULES.turn_s + 1.5
    in_phase = [think(desired, on_orbit(270.0, 0.0), at_s) for at_s in turns]
    assert desired in [choice.orbit for choice in in_phase]
    opposite = [think(desired, on_orbit(270.0, 0.0, math.pi), at_s) for at_s in turns]
    assert desired not in [choice.orbit for choice in opposite]
    assert any(choice.in_conflict for choice in opposite)


def test_near_ones_take_turns_and_a_turn_needs_a_new_message() -> None:
    desired = IntendedOrbit(20.0, 0.0, -150.0, 17.5)
    seconds = np.arange(64) * RULES.turn_s + 1.5
    other = on_orbit(160.0, 0.0)
    mine = [think(desired, other, at_s).orbit == desired for at_s in seconds]
    assert 8 < sum(mine) < 56
    theirs = [
        choose_orbit(
            at_s,
            OWN._replace(key=3),
            desired,
            AdoptedOrbit(CURRENT),
            on_orbit(160.0, 0.0, key=7),
            RULES,
        ).orbit
        == desired
        for at_s in seconds
    ]
    assert [not turn for turn in mine] == theirs
    late = on_orbit(160.0, 0.0, age_s=1.6)  # from the slot before
    turns = [think(desired, late, at_s).orbit == desired for at_s in seconds]
    assert turns[1:] == [now and before for before, now in pairwise(mine)]
    assert any(turns)


def test_layers_need_no_avoidance() -> None:
    desired = IntendedOrbit(20.0, 0.0, -150.0, 17.5)
    above = on_orbit(270.0, 0.0, math.pi, altitude_m=360.0)
    turns = np.arange(16) * RULES.turn_s + 1.5
    layered = dataclasses.replace(RULES, layers_m=60.0)
    # Turns are for vehicles that could meet; with altitude layers they are unnecessary but
    # harmless.
    assert desired in [think(desired, above, at_s, layered).orbit for at_s in turns]
    assert desired not in [think(desired, above, at_s).orbit for at_s in turns]


WIND = (6.0, 5.0)
WORLDS = {
    "deploy 4": (deployment(4, 250.0, 120.0, 1), 240.0),
    "deploy 8": (deployment(8, 250.0, 120.0, 1, jumps_s=150.0), 300.0),
    "deploy 16": (deployment(16, 300.0, 130.0, 1, drift_m_s=1.0), 400.0),
    "deploy 16, wind": (deployment(16, 280.0, 120.0, 1, wind_m_s=WIND), 400.0),
    "deploy 16, lost": (deployment(16, 350.0, 130.0, 1, delay_s=0.5, lost=0.3), 400.0),
    "deploy 16, wide circles": (deployment(16, 300.0, 130.0, 1, wide=1.03), 400.0),
    "deploy 32": (deployment(32, 280.0, 120.0, 1), 560.0),
    "swap 8": (swap(8, 280.0), 400.0),
    "home and back 16": (home_and_back(16, 280.0, 1, wind_m_s=WIND), 700.0),
    "shuffle 16, lost": (shuffle(16, 280.0, 1, delay_s=0.5, lost=0.3), 800.0),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", WORLDS)
def test_no_vehicles_meet_and_all_arrive(name: str) -> None:
    world, until_s = WORLDS[name]
    without = fly(world, "none", until_s)
    outcome = fly(world, "intent", until_s)
    assert outcome.collisions == 0
    assert outcome.nearest_m >= 60.0
    if world.jumps_s == 0.0:
        assert np.all(np.isfinite(outcome.settled_s))
        begun_s = world.places[-1][0]
        took_s, alone_s = outcome.settled_s.mean() - begun_s, without.settled_s.mean() - begun_s
        assert took_s < (1.3 if name.startswith(("deploy", "home")) else 2.5) * alone_s
        assert outcome.on_orbit > 0.97
        assert outcome.spread_rad < math.radians(10.0)
    assert outcome.changes_per_s < 0.6


@pytest.mark.long
def test_without_avoidance_the_same_worlds_have_collisions_and_with_the_papers_fewer() -> None:
    ends = {"none": 0, "rvo": 0}
    for name, (world, until_s) in WORLDS.items():
        if name != "deploy 4":  # one behind the other, in phase from the start
            for avoidance in ends:
                ends[avoidance] += fly(world, avoidance, until_s).collisions
    assert ends["none"] > 50
    assert 0 < ends["rvo"] < 0.6 * ends["none"]


@pytest.mark.long
def test_sixty_four_from_one_base() -> None:
    outcome = fly(deployment(64, 280.0, 130.0, 1), "intent", 500.0)
    assert outcome.collisions == 0
    assert outcome.nearest_m >= 60.0
