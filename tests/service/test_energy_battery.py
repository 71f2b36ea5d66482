"""The time that a battery lasts, learned from its reports, some of which are wrong."""

import math

import pytest

from mission_service.config.scenario import load_scenario
from mission_service.config.sections import VehicleSection
from mission_service.events import BatteryUpdated
from mission_service.vehicles.battery_reports import BatteryReports
from mission_service.vehicles.energy import (
    EnergyEstimate,
    TimeLeft,
    estimate,
    times_left,
)

SECTION = load_scenario("default").vehicles[0]
LANDS_S = 220.0


def report(at_s: float, percent: float | None, *values: float | None) -> BatteryUpdated:
    """Values: voltage, current, consumed charge, the autopilot's estimate; by default a voltage."""
    return BatteryUpdated(round(at_s * 1e6), "hawk", percent, *(values or (12.0,)))


def flown(
    battery: BatteryReports, endurance_s: float, until_s: float, from_pct: float = 100.0
) -> BatteryReports:
    """Report a battery of this endurance from takeoff on, in whole per cent, every ten seconds."""
    for number in range(int(until_s / 10.0) + 1):
        percent = math.ceil(from_pct - 100.0 * number * 10.0 / endurance_s)
        battery.apply(report(number * 10.0, float(percent)), True, None)
    return battery


def least(battery: BatteryReports, at_s: float, section: VehicleSection = SECTION) -> TimeLeft:
    found = estimate(times_left(section, battery, at_s, LANDS_S, at_s), 0.0, LANDS_S, at_s)
    assert found is not None
    return TimeLeft(found.source, found.time_on_task_s, found.until_empty_s)


@pytest.mark.parametrize("endurance_s", [900.0, 1500.0, 3600.0])
def test_the_rate_of_discharge_is_learned(endurance_s: float) -> None:
    battery = flown(BatteryReports(), endurance_s, 0.4 * endurance_s)
    left = least(battery, 0.4 * endurance_s)
    assert left.source == "battery"
    assert left.until_empty_s == pytest.approx(0.6 * endurance_s, rel=0.08)
    expected_s = 0.4 * endurance_s - LANDS_S  # 20 % and the landing are kept
    assert left.until_home_s == pytest.approx(expected_s, abs=0.06 * endurance_s)


def test_no_time_is_estimated_before_a_rate_is_learned() -> None:
    battery = flown(BatteryReports(), 1500.0, 60.0)
    assert times_left(SECTION, battery, 60.0, LANDS_S, 60.0) == []
    constant = BatteryReports()
    for number in range(100):
        constant.apply(report(number * 10.0, 100.0), True, None)
    assert times_left(SECTION, constant, 1000.0, LANDS_S, 1000.0) == []


def test_the_learned_rate_is_kept_when_the_battery_is_changed() -> None:
    battery = flown(BatteryReports(), 1000.0, 700.0)
    battery.end_flight()
    assert battery.level_pct(710.0) is None
    for at_s in (720.0, 745.0):
        battery.apply(report(at_s, 100.0), False, None)
    assert least(battery, 745.0).until_empty_s == pytest.approx(1000.0, rel=0.08)


def test_a_heavier_load_shortens_the_time_left() -> None:
    battery = flown(BatteryReports(), 2000.0, 400.0)
    before_s = least(battery, 400.0).until_empty_s
    for number in range(60):
        percent = math.ceil(80.0 - 100.0 * number * 10.0 / 1000.0)
        battery.apply(report(400.0 + number * 10.0, float(percent)), True, None)
    left = least(battery, 990.0)
    assert before_s == pytest.approx(1600.0, rel=0.08)
    assert left.until_empty_s == pytest.approx(210.0, rel=0.2)  # 21 % at 1 % in 10 s


@pytest.mark.parametrize(
    "wrong",
    [(0.0, None), (3.0, 12.0), (0.0, 12.0), (None, 0.0), (None, None), (100.0, 12.0)],
)
def test_a_single_wrong_report_changes_nothing(wrong: tuple[float | None, float | None]) -> None:
    section = SECTION.model_copy(update={"battery_min_voltage_v": 10.5})
    battery, undisturbed = (flown(BatteryReports(), 1500.0, 600.0) for _ in range(2))
    battery.apply(report(603.0, *wrong), True, 10.5)
    battery.settle(606.0)
    for each in (battery, undisturbed):
        each.apply(report(610.0, 60.0), True, 10.5)
    assert least(battery, 630.0, section) == least(undisturbed, 630.0, section)


def test_a_charge_that_stays_low_is_used_and_one_that_rises_in_flight_is_not() -> None:
    battery = flown(BatteryReports(), 1500.0, 600.0)
    battery.apply(report(605.0, 12.0), True, None)
    assert battery.level_pct(605.0) == 60.0
    battery.settle(626.0)  # no other report has arrived
    assert battery.level_pct(626.0) == 12.0
    assert least(battery, 626.0).until_home_s < 0.0
    for second in range(60):
        battery.apply(report(630.0 + second, 90.0), True, None)
    assert battery.level_pct(690.0) == 12.0
    battery.end_flight()
    for at_s in (700.0, 725.0):
        battery.apply(report(at_s, 90.0), False, None)
    assert battery.level_pct(725.0) == 90.0


def test_a_charge_below_the_reserve_counts_before_a_rate_is_learned() -> None:
    battery = BatteryReports()
    for at_s in (0.0, 21.0):
        battery.apply(report(at_s, 15.0), True, None)
    left = least(battery, 21.0)
    assert left.until_home_s == pytest.approx(-LANDS_S)
    assert not EnergyEstimate(
        21.0, *left[:2], 500.0, LANDS_S, left.until_empty_s
    ).runs_out  # unknown


def test_a_fall_that_no_flight_causes_is_no_rate_of_discharge() -> None:
    """The simulated battery of PX4 falls to 50 % in half a minute, and stays there."""
    battery = BatteryReports()
    for second in range(0, 900, 2):
        percent = float(max(100 - 100 * second // 60, 50))
        battery.apply(report(float(second), percent), True, None)
    assert battery.level_pct(898.0) == 50.0
    assert times_left(SECTION, battery, 898.0, LANDS_S, 898.0) == []


def test_without_reports_the_charge_continues_to_fall() -> None:
    battery = flown(BatteryReports(), 1000.0, 500.0)
    silent_s = battery.level_pct(800.0)
    assert silent_s == pytest.approx(20.0, abs=3.0)
    unchanged = flown(BatteryReports(), 1000.0, 500.0)
    for number in range(30):
        unchanged.apply(report(510.0 + number * 10.0, 50.0), True, None)
    assert unchanged.level_pct(800.0) == 50.0


@pytest.mark.parametrize("by", ["consumed", "current"])
def test_the_used_charge_shows_a_change_sooner_than_the_percentage(by: str) -> None:
    battery, used_mah = BatteryReports(), 0.0
    for number in range(101):
        at_s = number * 10.0
        current_a = 10.0 if at_s <= 800.0 else 20.0
        used_mah += current_a * 10.0 / 3.6
        percent = float(math.ceil(100.0 - used_mah / 5000.0 * 100.0))
        values = (None, used_mah) if by == "consumed" else (current_a, None)
        battery.apply(report(at_s, percent, 12.0, *values), True, None)
    times = {each.source: each for each in times_left(SECTION, battery, 0.0, LANDS_S, 1000.0)}
    truly_s = (5000.0 - used_mah) * 3.6 / 20.0
    assert times["current"].until_empty_s == pytest.approx(truly_s, rel=0.2)
    assert times["battery"].until_empty_s > times["current"].until_empty_s
    assert least(battery, 1000.0).source == "current"


def test_the_autopilots_estimate_counts_after_it_has_lasted() -> None:
    battery = BatteryReports()
    battery.apply(report(0.0, 80.0, 12.0, None, None, 5.0), True, None)  # wrong
    for second in range(1, 40):
        battery.apply(report(float(second), 80.0, 12.0, None, None, 800.0 - second), True, None)
        left = times_left(SECTION, battery, 0.0, LANDS_S, float(second))
        assert all(each.until_home_s > 200.0 for each in left)
    left_s = least(battery, 39.0)
    assert left_s.source == "autopilot's estimate"
    assert left_s.until_empty_s == pytest.approx(761.0)
    assert left_s.until_home_s == pytest.approx(761.0 * 0.75 - LANDS_S)  # 20 of 80 % are kept


def test_a_low_voltage_counts_after_it_has_lasted() -> None:
    battery = BatteryReports()
    for second in range(10):
        battery.apply(report(float(second), None, 10.2), True, 10.5)
    battery.apply(report(10.0, None, 0.0), True, 10.5)  # a wrong value hides nothing
    assert times_left(SECTION, battery, 0.0, LANDS_S, 10.0) == []
    battery.apply(report(21.0, None, 10.2), True, 10.5)
    assert [each.source for each in times_left(SECTION, battery, 0.0, LANDS_S, 21.0)] == ["voltage"]
    battery.apply(report(22.0, None, 10.9), True, 10.5)
    assert times_left(SECTION, battery, 0.0, LANDS_S, 22.0) == []


def test_the_source_with_the_least_time_on_task_counts() -> None:
    section = SECTION.model_copy(update={"endurance_s": 3300.0, "endurance_reserve_s": 400.0})
    battery = flown(BatteryReports(), 2000.0, 600.0)
    assert least(battery, 600.0, section).source == "battery"
    shorter = section.model_copy(update={"endurance_s": 1200.0})
    assert least(battery, 600.0, shorter).source == "endurance_s"
    found = estimate(
        times_left(section, BatteryReports(), 600.0, LANDS_S, 600.0), 250.0, LANDS_S, 600.0
    )
    assert found is not None
    assert (found.source, found.time_on_task_s, found.runs_out) == ("endurance_s", 2050.0, False)
    assert found.words == "34 min on task, 4 min home (source: endurance_s)"


def test_the_reserve_of_the_endurance_is_at_least_the_time_of_the_landing() -> None:
    section = SECTION.model_copy(update={"endurance_s": 1000.0, "endurance_reserve_s": 100.0})
    for lands_s, left_s in ((250.0, 750.0), (60.0, 900.0)):
        (left,) = times_left(section, BatteryReports(), 0.0, lands_s, 0.0)
        assert left.until_home_s == left_s


@pytest.mark.parametrize("begins_s", [0.0, 7.0, 19.0, 26.0, 45.0])
def test_the_fall_of_px4s_simulated_battery_is_no_discharge(begins_s: float) -> None:
    battery = BatteryReports()
    for second in range(0, 900, 2):  # to 50 % within a minute of simulated time
        fallen_pct = min(max(second - begins_s, 0.0) / 60.0, 1.0) * 50.0
        battery.apply(report(float(second), math.ceil(100.0 - fallen_pct)), True, None)
    assert battery.level_pct(900.0) == 50.0
    assert battery.discharge_pct_s() is None
    assert times_left(SECTION, battery, 900.0, LANDS_S, 900.0) == []


def test_after_a_restart_in_flight_only_the_falls_of_a_charge_that_begins_at_100_count() -> None:
    battery = flown(BatteryReports(), 1500.0, 825.0)
    assert battery.level_pct(825.0) == pytest.approx(45.0, abs=1.0)
    for at_s in range(830, 1331, 10):
        true_pct = 100.0 - at_s / 15.0
        battery.apply(report(float(at_s), math.ceil(true_pct + 55.0)), True, None)
        assert battery.level_pct(at_s) == pytest.approx(true_pct, abs=3.0)
        left_s = least(battery, at_s).until_empty_s
        assert left_s == pytest.approx(1500.0 - at_s, rel=0.15, abs=40.0)


def test_a_reported_rise_that_ends_late_does_not_change_the_charge() -> None:
    battery = flown(BatteryReports(), 1500.0, 600.0)
    for at_s in range(610, 660, 10):
        battery.apply(report(float(at_s), 100.0), True, None)
    for at_s in range(660, 700, 10):
        battery.apply(report(float(at_s), math.ceil(100.0 - at_s / 15.0)), True, None)
    assert battery.level_pct(690.0) == 54.0
