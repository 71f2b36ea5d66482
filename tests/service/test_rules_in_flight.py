"""Every rule of a scenario, flown ideally by three vehicles over a real fire, without MAVLink."""

from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.core.core import Core
from mission_service.events import Observed
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.guidance.front.way import PLANNERS
from mission_service.guidance.protocol import Planner
from mission_service.guidance.team.way import RULES

FROM_S, TO_S, STEP_S = 5400.0, 7800.0, 5.0
SPEED_CELLS_S, VIEW_CELLS = 0.5, 6.0
Site = tuple[Scenario, Landscape, NDArray[np.float64]]


@pytest.fixture(scope="module")
def site() -> Site:
    """Return the shipped team scenario without its copter, its landscape, and the arrival times."""
    scenario = load_scenario("team")
    scenario = scenario.model_copy(update={"vehicles": scenario.vehicles[:3]})
    landscape = landscape_of(scenario)
    fire = fire_of(scenario, landscape)
    fire.advance(TO_S)
    return scenario, landscape, fire.arrival_time_s.copy()


def look(
    arrival_s: NDArray[np.float64], name: str, place: NDArray[np.float64], at_s: float
) -> Observed:
    row, col = place
    top, left = max(int(row) - 7, 0), max(int(col) - 7, 0)
    window = np.s_[top : top + 15, left : left + 15]
    codes = np.where(arrival_s[window] <= at_s, "b", "u")
    rows, cols = np.arange(top, top + codes.shape[0]), np.arange(left, left + codes.shape[1])
    codes[np.hypot(rows[:, None] - row, cols[None, :] - col) > VIEW_CELLS] = "."
    return Observed(round(at_s * 1e6), name, top, left, tuple("".join(line) for line in codes))


def planners_of(
    site: Site, rule: str, **settings: object
) -> tuple[dict[str, Planner], NDArray[np.float64]]:
    """Return the planners of a rule, and the position at which the fire was reported."""
    scenario, landscape, _ = site
    planner = scenario.planner.model_copy(update={"rule": rule, **settings})
    core = Core(scenario.model_copy(update={"planner": planner}), landscape)
    ignition = scenario.ignition[0]
    assert ignition.lat_deg is not None
    assert ignition.lon_deg is not None
    xy = landscape.xy_of_lat_lon(ignition.lat_deg, ignition.lon_deg)
    place = np.array(landscape.row_col_of(*xy))
    return cast(dict[str, Planner], core.guidance.planners), place


def fly(
    site: Site, rule: str
) -> tuple[dict[str, Planner], list[tuple[float, str, bool]], list[float]]:
    """Fly all vehicles on their paths; return planners, decisions, and distances to the front."""
    arrival_s = site[2]
    planners, fire_place = planners_of(site, rule)
    places = {name: fire_place + np.array([-20.0, 4.0 * n]) for n, name in enumerate(planners)}
    decisions, off_front = [], []
    for at_s in np.arange(FROM_S, TO_S, STEP_S).tolist():
        front = np.argwhere((arrival_s > at_s - 300.0) & (arrival_s <= at_s))
        for name, planner in planners.items():
            planner.observe(look(arrival_s, name, places[name], at_s))
            row, col = places[name].tolist()
            decision = planner.at(row, col, at_s)
            if decision is not None:
                decisions.append((at_s, name, decision.clockwise))
            if planner.phase == "monitor":
                off_front.append(float(np.hypot(*(front - places[name]).T).min()))
            path = planner.path(row, col) if planner.phase != "approach" else np.empty((0, 2))
            goal = path[0] if len(path) else fire_place
            step = goal - places[name]
            share = min(SPEED_CELLS_S * STEP_S / max(float(np.hypot(*step)), 1e-9), 1.0)
            places[name] = places[name] + share * step
    return planners, decisions, off_front


@pytest.mark.parametrize("rule", [*PLANNERS, *RULES])
def test_a_rule_finds_the_fire_and_follows_its_front(site: Site, rule: str) -> None:
    planners, decisions, off_front = fly(site, rule)
    assert {planner.phase for planner in planners.values()} == {"monitor"}
    assert {name for _, name, _ in decisions} == set(planners)
    assert np.mean(off_front) < 4.0
    assert np.quantile(off_front, 0.95) < 10.0


def test_a_team_decides_the_same_on_the_same(site: Site) -> None:
    assert fly(site, "team.predictive")[1] == fly(site, "team.predictive")[1]


@pytest.mark.parametrize("rule", [*PLANNERS, *RULES])
def test_a_rule_flies_around_a_single_burned_cell_of_unknown_ignition(
    site: Site, rule: str
) -> None:
    """Such a front has no area, so that the map keeps its centre."""
    ignition = site[0].ignition[0]
    reported = {"reported_lat_deg": ignition.lat_deg, "reported_lon_deg": ignition.lon_deg}
    planners, (fire_row, fire_col) = planners_of(site, rule, ignition_known=False, **reported)
    top, left = round(fire_row) - 12, round(fire_col) - 12
    cells = ("u" * 25,) * 12 + ("u" * 12 + "b" + "u" * 12,) + ("u" * 25,) * 12
    for second in range(0, 800, 5):
        at_s = FROM_S + second
        for number, (name, planner) in enumerate(planners.items()):
            angle_deg = second * (1 if planner.clockwise else -1) + 120.0 * number
            row = top + 12.0 - 8.0 * float(np.cos(np.deg2rad(angle_deg)))
            col = left + 12.0 + 8.0 * float(np.sin(np.deg2rad(angle_deg)))
            planner.observe(Observed(round(at_s * 1e6), name, top, left, cells))
            planner.at(row, col, at_s)
            if planner.phase != "approach":
                assert np.isfinite(planner.path(row, col)).all()
    assert {planner.phase for planner in planners.values()} == {"monitor"}
