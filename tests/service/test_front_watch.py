"""The part of a front that a vehicle no longer observes."""

import numpy as np
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import Observed
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.front.informative.way import INFORMATIVE
from mission_service.guidance.front.planners import ground_of
from mission_service.guidance.front.unmonitored import (
    describe_sector,
    front_map_of,
    nearest_bearings,
)
from mission_service.guidance.front.way import PLANNERS
from mission_service.guidance.team.way import RULES

REACH_CELLS = 28


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("team"))


@pytest.mark.parametrize(
    ("own_deg", "others_deg", "first", "last", "count"),
    [
        (90.0, [], 0, 359, 360),
        (90.0, [270.0], 0, 180, 181),
        (0.0, [90.0, 270.0], 315, 45, 91),
        (90.0, [90.0], 0, 359, 360),  # another vehicle is at the same bearing
        (10.4, [10.3, 10.5], 10, 10, 1),  # other vehicles are nearer to every whole degree
        (359.7, [359.6, 359.8], 0, 0, 1),
    ],
)
def test_a_vehicle_leaves_the_bearings_to_which_no_other_is_nearer(
    own_deg: float, others_deg: list[float], first: int, last: int, count: int
) -> None:
    found = nearest_bearings(own_deg, others_deg)
    assert (found[0], found[-1], found.size) == (first, last, count)


def whole_view(radius_cells: float) -> tuple[str, ...]:
    """Return a view of a whole round fire."""
    rows, cols = np.mgrid[-REACH_CELLS : REACH_CELLS + 1, -REACH_CELLS : REACH_CELLS + 1]
    burned = np.hypot(rows, cols) <= radius_cells
    return tuple("".join("b" if cell else "u" for cell in row) for row in burned)


@pytest.mark.parametrize("rule", [*PLANNERS, *INFORMATIVE.rules, *RULES])
def test_the_length_in_the_alarm_is_that_of_the_front_last_seen(land: Landscape, rule: str) -> None:
    scenario = load_scenario("team", (f"planner.rule={rule}",))
    name, planner = next(iter(Core(scenario, land).guidance.planners.items()))
    row, col = map(int, ground_of(scenario, land).centre)
    for turn in range(170):  # a lap around a small fire, and then around one that grows
        radius_cells = 5.0 + 0.5 * max(turn - 130, 0)
        at_s, angle = 4000.0 + 10.0 * turn, np.deg2rad(3.0 * turn)
        corner = row - REACH_CELLS, col - REACH_CELLS
        planner.observe(Observed(round(at_s * 1e6), name, *corner, whole_view(radius_cells)))
        away_cells = radius_cells + 3.0
        planner.at(row - away_cells * np.cos(angle), col + away_cells * np.sin(angle), at_s)
    fire = front_map_of(planner)
    assert fire is not None
    words = describe_sector(fire, np.arange(360), land.cell_size_m)
    length_km = float(words.removeprefix("the whole front, ").removesuffix(" km"))
    assert length_km == pytest.approx(2.0 * np.pi * 24.5 * land.cell_size_m / 1e3, rel=0.2)
