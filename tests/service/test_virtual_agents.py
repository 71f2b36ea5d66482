"""Formations in the ideal simulation: the paper's experiments, and further cases."""

from dataclasses import replace

import numpy as np
import pytest

from mission_service.experiments.virtual_agents.ideal_world import (
    Flight,
    FormationWorld,
    Rules,
    fly,
)
from mission_service.experiments.virtual_agents.scenarios import EXPERIMENTS, burned
from mission_service.guidance.formation.settings import Settings

SETTINGS = Settings()
BY_NAME = {experiment.name: experiment for experiment in EXPERIMENTS}
APART_M = 2.0 * SETTINGS.safety_radius_m


def flown(name: str = "Exp2_1", uavs: int | None = None, seed: int = 1, **rules: object) -> Flight:
    """Return a flight over the fire of an experiment."""
    experiment = BY_NAME[name]
    arrival_s = burned(experiment.p_spread, experiment.first_cells, seed)
    chosen = Rules(**rules)  # type: ignore[arg-type]
    return fly(FormationWorld(arrival_s, uavs or experiment.uavs, SETTINGS, chosen, seed))


@pytest.fixture(scope="module")
def eight() -> Flight:
    """Return eleven minutes of experiment 2_1 with eight UAVs."""
    return flown(duration_s=660.0)


@pytest.mark.parametrize("experiment", EXPERIMENTS[:5], ids=lambda e: e.name)
def test_fires_have_the_sizes_of_table_2(experiment: object) -> None:
    one = BY_NAME[experiment.name]  # type: ignore[attr-defined]
    sizes = []
    for seed in (1, 2, 3):
        arrival_s = burned(one.p_spread, one.first_cells, seed)
        assert np.count_nonzero(arrival_s <= 0.0) == pytest.approx(one.first_cells, rel=0.01)
        sizes.append(np.count_nonzero(arrival_s <= 1200.0))
    assert np.mean(sizes) == pytest.approx(one.paper_final_cells, rel=0.06)


def test_eight_uavs_cover_all_and_estimate_the_fire(eight: Flight) -> None:
    assert eight.at_end("va_coverage", 60.0) >= 0.99
    assert eight.at_end("uav_coverage", 60.0) >= 0.99
    assert eight.at_end("efficiency", 60.0) >= 0.99
    assert eight.at_end("inaccuracy", 60.0) < 30.0


def test_they_keep_apart(eight: Flight) -> None:
    assert eight.series["collisions"][-1] == 0
    assert eight.closest_m >= APART_M
    assert eight.series["conflicts"][-1] > 0  # some UAVs blocked each other


@pytest.mark.long
def test_without_avoidance_they_do_not() -> None:
    flights = [flown(seed=seed, duration_s=240.0, avoidance="none") for seed in (1, 2, 3)]
    assert sum(flight.series["collisions"][-1] for flight in flights) > 0


@pytest.mark.long
def test_out_of_phase_they_see_the_same_twice(eight: Flight) -> None:
    alone = flown(duration_s=660.0, synchronises=False)
    assert alone.at_end("efficiency", 300.0) < eight.at_end("efficiency", 300.0) - 0.005
    assert alone.series["collisions"][-1] == 0


def test_a_flight_is_the_same_every_time() -> None:
    one, other = (flown(uavs=5, duration_s=150.0, loss_at=lambda at_s: 0.2) for _ in range(2))
    assert np.array_equal(one.uavs_m, other.uavs_m)
    assert np.array_equal(one.agents_m, other.agents_m)
    for name, series in one.series.items():
        assert np.array_equal(series, other.series[name])


@pytest.mark.long
def test_lost_messages_hardly_harm_the_fire_maps(eight: Flight) -> None:
    lossy = flown(duration_s=660.0, loss_at=lambda at_s: 0.3 if 240.0 <= at_s < 600.0 else 0.0)
    during = (eight.series_s >= 300.0) & (eight.series_s < 600.0)
    after = eight.series_s >= 630.0
    wrong, wrong_lossy = eight.series["inaccuracy"], lossy.series["inaccuracy"]
    assert wrong_lossy[during].mean() <= 2.0 * wrong[during].mean()
    assert wrong_lossy[after].mean() <= 1.5 * wrong[after].mean() + 1.0
    assert lossy.series["collisions"][-1] == 0


@pytest.mark.long
def test_two_leave_for_fuel_and_come_back() -> None:
    away = {0: (300.0, 560.0), 5: (300.0, 560.0)}
    flight = flown(duration_s=900.0, away_s=away)
    six = flown(uavs=6, duration_s=560.0)
    coverage, at_s = flight.series["va_coverage"], flight.series_s
    before = coverage[(at_s >= 280.0) & (at_s < 300.0)].mean()
    without = coverage[(at_s >= 500.0) & (at_s < 560.0)].mean()
    assert before > 0.97
    assert without >= six.at_end("va_coverage", 60.0) - 0.03  # the six spread out again
    assert coverage[at_s >= 840.0].mean() > 0.98
    assert flight.series["collisions"][-1] == 0


def test_two_fall_silent_the_others_close_the_gap_and_keep_clear_of_them() -> None:
    flight = flown(duration_s=520.0, dead_from_s={2: 400.0, 6: 400.0})
    after = flight.series["va_coverage"][flight.series_s >= 500.0]
    six = flown(uavs=6, duration_s=520.0)
    assert after.mean() >= six.at_end("va_coverage", 20.0) - 0.03
    assert flight.series["collisions"][-1] == 0
    assert np.isnan(flight.agents_m[-1, [2, 6]]).any(axis=1).all()
    moved_m = np.linalg.norm(flight.agents_m[-1] - flight.agents_m[395], axis=1)
    assert np.nanmax(moved_m) > 100.0


def test_wind_is_no_matter() -> None:
    flight = flown(duration_s=400.0, wind_m_s=(6.0, -5.0))
    assert flight.at_end("va_coverage", 60.0) > 0.97
    assert flight.at_end("efficiency", 60.0) > 0.97
    assert flight.series["collisions"][-1] == 0
    late = flight.track_s > 340.0
    off_m = np.linalg.norm(flight.uavs_m[late] - flight.agents_m[late], axis=2)
    assert np.median(np.abs(off_m - SETTINGS.loiter_radius_m)) < 0.1 * SETTINGS.loiter_radius_m


@pytest.mark.parametrize("uavs", [16, pytest.param(32, marks=pytest.mark.long)])
def test_many_keep_apart(uavs: int) -> None:
    flight = flown(uavs=uavs, duration_s=240.0)
    assert flight.series["collisions"][-1] == 0
    assert flight.closest_m >= APART_M


def test_the_papers_forces_and_avoidance_fly_too() -> None:
    experiment = BY_NAME["Exp1"]
    arrival_s = burned(experiment.p_spread, experiment.first_cells, 1)
    settings = replace(SETTINGS, placement="forces")
    rules = Rules(duration_s=500.0, avoidance="rvo")
    flight = fly(FormationWorld(arrival_s, 4, settings, rules, 1))
    assert flight.at_end("va_coverage", 60.0) > 0.6
    assert flight.at_end("efficiency", 60.0) > 0.99


def test_vehicles_apart_by_their_heights_are_not_in_each_others_way() -> None:
    experiment = BY_NAME["Exp2_1"]
    arrival_s = burned(experiment.p_spread, experiment.first_cells, 1)
    settings = replace(SETTINGS, vertical_separation_m=60.0)
    in_conflict = {}
    for step_m in (0.0, 70.0):
        world = FormationWorld(arrival_s, 8, settings, Rules(), 1)
        world.layers_m[:] = step_m * np.arange(8)
        world.heights_m += world.layers_m
        in_conflict[step_m] = 0
        for _ in range(800):
            world.tick()
            in_conflict[step_m] += sum(each.in_conflict for each in world.intentions)
        assert world.safety.collisions == 0
    assert in_conflict[0.0] > 0
    assert in_conflict[70.0] == 0
