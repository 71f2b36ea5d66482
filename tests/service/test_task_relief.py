"""The pure parts of reliefs: roles, meeting points, the scenario's table, simulated batteries."""

import math
from typing import Any

import numpy as np
import pytest

from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.failsafe_causes import Battery
from autopilot_bridge.transitions import InvalidTransitionError
from benchmarks.watch import SectorAges
from mission_service.config.relief_section import SimulatedBatteriesSection
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.errors import ScenarioError
from mission_service.events import Observed
from mission_service.fire.observed_window import in_letters
from mission_service.fire.scenario_fire import landscape_of
from mission_service.relief.meeting import meeting_point
from mission_service.relief.task_relief import TaskPlace, TaskRole, task_of
from mission_service.simulation.battery_crew import BatteryCrew
from mission_service.simulation.sim import mock_of
from tests.service.relief_flights import relief_scenario


def test_both_vehicles_reach_the_meeting_point_at_the_same_time() -> None:
    path = [(0.0, 0.0), (1000.0, 0.0), (1000.0, 1000.0)]
    point = meeting_point(path, 15.0, (1000.0, 500.0), 15.0)
    flown_m = point[0] + point[1]
    assert abs(flown_m - math.dist(point, (1000.0, 500.0))) <= 100.0
    assert math.dist(point, (1000.0, 500.0)) <= flown_m  # the next one is not late


def test_a_vehicle_that_is_late_everywhere_is_sent_to_the_end_of_the_path() -> None:
    path = [(0.0, 0.0), (100.0, 0.0)]
    assert meeting_point(path, 15.0, (5000.0, 0.0), 15.0) == (100.0, 0.0)
    assert meeting_point([(3.0, 4.0)], 15.0, (0.0, 0.0), 15.0) == (3.0, 4.0)


def test_the_course_leads_to_the_place_of_the_task() -> None:
    place = TaskPlace(100.0, 200.0, 0.0, 1.0)
    assert place.before(150.0) == (100.0, 50.0)
    assert place.distance_m(100.0, 250.0) == 50.0


def test_the_one_that_has_stood_by_longest_is_next() -> None:
    task = task_of(("hawk", "kite", "swift"))
    assert task.next_of(("swift", "kite")) == "kite"
    kite = task.members["kite"]
    for role in (TaskRole.RELIEVES, TaskRole.ON_TASK, TaskRole.LEAVES, TaskRole.STANDS_BY):
        kite.change_role(role, 100.0)
    assert task.next_of(("kite", "swift")) == "swift"
    task.members["swift"].change_role(TaskRole.RELIEVES, 110.0)
    assert task.next_of(("kite", "swift")) == "kite"
    assert task.next_of(()) is None


def test_a_vehicle_on_task_cannot_relieve_itself() -> None:
    member = task_of(("hawk", "kite")).members["hawk"]
    member.change_role(TaskRole.RELIEVES, 1.0)
    member.change_role(TaskRole.ON_TASK, 2.0)
    with pytest.raises(InvalidTransitionError, match="relief by hawk"):
        member.change_role(TaskRole.RESUMES, 3.0)


def test_two_vehicles_on_task_are_a_defect() -> None:
    task = task_of(("hawk", "kite"))
    for member in task.members.values():
        member.change_role(TaskRole.RELIEVES, 1.0)
        member.change_role(TaskRole.ON_TASK, 1.0)
    with pytest.raises(AssertionError):
        task.validate_state()


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ('relief.vehicles=["hawk"]', "relief.vehicles"),
        ('relief.vehicles=["hawk", "hawk"]', "contains a vehicle twice"),
        ('relief.vehicles=["hawk", "gull"]', "no vehicle gull"),
        ("vehicles.1.airspeed_m_s=20", "airspeed_m_s is 20.0 for kite, but 18.0 for hawk"),
        ('planner.rule="team.balanced"', "requires a rule with a separate planner"),
        ('planner.rule="informative"', "requires a rule with a separate planner"),
        ('mission.approval="each"', "reliefs do not wait"),
        ('only="hawk"', "all its vehicles in one process"),
    ],
)
def test_vehicles_that_cannot_relieve_each_other_are_refused(override: str, words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        relief_scenario(3, override)


def test_an_order_or_the_scenario_signs_the_first_takeoff_off() -> None:
    def waiting(*overrides: str, **relief: Any) -> list[bool]:
        scenario = relief_scenario(2, *overrides, **relief)
        vehicles = Core(scenario, landscape_of(scenario)).vehicles
        return [vehicle.waits_for_operator for vehicle in vehicles.values()]

    assert waiting() == [True, True]
    assert waiting("vehicles.1.autostart=true") == [True, False]
    assert waiting(standing_signoff=True) == [False, False]


def test_only_a_vehicle_whose_takeoff_is_due_is_started() -> None:
    scenario = relief_scenario(2)
    core = Core(scenario, landscape_of(scenario))
    reliefs, kite = core._reliefs, core.vehicles["kite"]
    assert reliefs is not None
    member = reliefs.task.members["kite"]
    assert reliefs.stays_on_ground(kite)
    member.change_role(TaskRole.RELIEVES, 1.0)
    assert not reliefs.stays_on_ground(kite)
    member.change_role(TaskRole.LEAVES, 2.0)  # after its landing, until its next position
    assert reliefs.stays_on_ground(kite)


def mocks_of_two() -> tuple[dict[str, MockAutopilot], BatteryCrew]:
    scenario = relief_scenario(2)
    landscape = landscape_of(scenario)
    mocks = {each.name: mock_of(each, landscape) for each in scenario.vehicles}
    section = SimulatedBatteriesSection(packs=1, charge_s=600.0, swap_s=100.0)
    return mocks, BatteryCrew(section, scenario, mocks)


def test_a_used_battery_is_replaced_by_a_full_one_and_charged() -> None:
    mocks, crew = mocks_of_two()
    hawk, kite = mocks.values()
    hawk.battery_percent = kite.battery_percent = 40.0
    crew.work(10.0)
    crew.work(100.0)
    assert (hawk.battery_percent, kite.battery_percent) == (40.0, 40.0)
    crew.work(112.0)
    assert (hawk.battery_percent, kite.battery_percent) == (100.0, 40.0)  # one spare battery
    crew.work(600.0)
    assert kite.battery_percent == 40.0
    crew.work(715.0)
    assert kite.battery_percent == 100.0


def test_no_battery_is_replaced_on_an_armed_vehicle() -> None:
    mocks, crew = mocks_of_two()
    hawk = mocks["hawk"]
    hawk.battery_percent = 40.0
    hawk.flight.armed = True
    crew.work(10.0)
    crew.work(500.0)
    assert hawk.battery_percent == 40.0
    with pytest.raises(RuntimeError, match="disarmed"):
        hawk.replace_battery()


def test_a_replaced_battery_reports_its_low_charge_again() -> None:
    battery = Battery(10.0, 1200.0)
    assert battery.drain()
    assert not battery.drain()
    battery.replace()
    assert not battery.drain()
    battery.percent = 10.0
    assert battery.drain()


def test_simulated_batteries_need_an_endurance() -> None:
    scenario = load_scenario("team")
    with pytest.raises(ScenarioError, match="requires endurance_s of hawk"):
        BatteryCrew(SimulatedBatteriesSection(packs=1), scenario, {})


def test_the_time_between_two_images_of_a_front_is_the_age_of_its_sectors() -> None:
    cells = np.full((30, 30), ord("u"), dtype=np.uint8)
    cells[10:20, 10:20] = ord("b")
    ages = SectorAges(cells.shape)
    for at_s in (10, 20, 200, 210):
        ages.add(Observed(at_s * 1_000_000, "hawk", 0, 0, in_letters(cells)))
    assert ages.oldest_s == 180.0
