"""A vehicle is sent home by its energy; alarms and confirmations when an order keeps it away."""

import math
import pickle

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    ClearAlarm,
    Hold,
    RaiseAlarm,
    ReportEnergy,
    StartMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.events import BatteryUpdated, OrderGiven, Resumed, WindMeasured
from mission_service.fire.scenario_fire import landscape_of
from tests.service.test_recall import LONG, Flight, returns


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


def battery(flight: Flight, percent: float | None, voltage_v: float | None = 12.0) -> None:
    flight.handle(BatteryUpdated(flight.at_us, "hawk", percent, voltage_v))


def drain(flight: Flight, endurance_s: float, to_pct: float, from_pct: float = 100.0) -> None:
    """Fly until the charge is ``to_pct``, with a report every ten seconds."""
    for number in range(int((from_pct - to_pct) / 100.0 * endurance_s / 10.0) + 1):
        battery(flight, math.ceil(from_pct - number * 1000.0 / endurance_s))
        assert not returns(flight.at(150.0, later_s=10.0))


def order(flight: Flight, name: str, confirmed: bool = False) -> list[AnyCommand]:
    return flight.handle(OrderGiven(flight.at_us, "ann", "", "hawk", name, confirmed))  # type: ignore[arg-type]


def alarms(commands: list[AnyCommand]) -> dict[str, str]:
    """Return the severities of the alarms that the commands raise."""
    return {each.alarm: each.severity for each in commands if isinstance(each, RaiseAlarm)}


def fly(flight: Flight, duration_s: float) -> list[AnyCommand]:
    return [each for _ in range(int(duration_s / 5.0)) for each in flight.at(150.0, later_s=5.0)]


def questions(commands: list[AnyCommand]) -> list[str]:
    lines = [each.text for each in commands if isinstance(each, Announce)]
    return [line for line in lines if line.startswith("confirm:")]


def test_it_returns_when_the_charge_takes_it_home_and_leaves_the_reserve(land: Landscape) -> None:
    flight = Flight(land, "weather.0.wind_speed_m_s=0", "vehicles.0.landing=false")
    drain(flight, 3000.0, 40.0)
    # 20 % are 600 s: 100 s for the flight home, 199 s for the landing, 301 s left on task.
    found = [each for each in fly(flight, 10.0) if isinstance(each, ReportEnergy)]
    assert found[-1].source == "battery"
    assert found[-1].time_home_s == pytest.approx(100, abs=2)
    assert found[-1].time_on_task_s == pytest.approx(301, abs=40)
    flown_s = 0
    raised: dict[str, str] = {}
    while not flight.core.vehicles["hawk"].sent_home:
        flown_s += 10
        battery(flight, math.ceil(40.0 - (10 + flown_s) / 30.0))
        raised |= alarms(flight.at(150.0, later_s=10.0))
    assert flown_s == pytest.approx(285, abs=40)
    assert raised == {"energy": "warning"}


def test_a_reserve_of_its_own(land: Landscape) -> None:
    flight = Flight(land, "weather.0.wind_speed_m_s=0", "vehicles.0.battery_reserve_pct=5")
    drain(flight, 3000.0, 22.0)


def test_a_wrong_charge_orders_no_return(land: Landscape) -> None:
    flight = Flight(land)
    drain(flight, 3000.0, 70.0)
    for percent, voltage_v in ((0.0, None), (2.0, 12.0), (None, 0.0)):
        battery(flight, percent, voltage_v)
        assert not returns(fly(flight, 15.0))
        battery(flight, 68.0)
        assert not returns(fly(flight, 10.0))


def test_a_charge_that_stays_low_orders_a_return(land: Landscape) -> None:
    flight = Flight(land)
    drain(flight, 3000.0, 70.0)
    battery(flight, 22.0)
    commands = fly(flight, 30.0)
    assert returns(commands)


def test_in_a_wind_that_it_cannot_fly_against_it_returns_at_once(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    flight.at(150.0)
    flight.handle(WindMeasured(flight.at_us, "hawk", 14.0, 90.0))  # home is in the east
    commands = fly(flight, 5.0)
    assert returns(commands)
    assert alarms(commands)["energy"] == "severe"
    assert flight.core.vehicles["hawk"].energy.estimate is not None


def test_an_old_measurement_of_the_wind_is_replaced_by_the_scenarios(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    flight.handle(WindMeasured(flight.at_us, "hawk", 8.0, 90.0))
    times_s = []
    for _ in range(14):
        flight.at(150.0, later_s=10.0)
        found = flight.core.vehicles["hawk"].energy.estimate
        assert found is not None
        times_s.append(found.time_home_s)
    assert times_s[0] > 2.0 * times_s[-1]
    assert times_s[-1] == pytest.approx(1200.0 / 12.0, rel=0.05)


@pytest.mark.parametrize("reason", ["hold", "pilot", "refused"])
def test_one_that_stays_away_although_its_time_is_up_is_overdue(
    land: Landscape, reason: str
) -> None:
    flight = Flight(land, *LONG)
    flight.mode("mission")
    flight.at(150.0)
    if reason == "hold":
        order(flight, "hold")
        flight.mode("hold")
    elif reason == "pilot":
        flight.mode("loiter")
    flight.at(150.0, later_s=785.0)
    commands = fly(flight, 60.0)
    assert returns(commands) == (reason == "refused")
    assert alarms(commands)["overdue"] == "severe"
    (alarm,) = (
        each for each in commands if isinstance(each, RaiseAlarm) and each.alarm == "overdue"
    )
    words = {
        "hold": "an operator ordered a hold",
        "pilot": "its autopilot or pilot selected mode loiter",
        "refused": "it stays in mode mission",
    }
    assert words[reason] in alarm.text
    order(flight, "return", confirmed=True)
    flight.mode("return")
    assert ClearAlarm("hawk", "overdue") in fly(flight, 5.0)
    ended = flight.mode("return", armed=False)
    assert ClearAlarm("hawk", "energy") in ended
    assert ReportEnergy("hawk", None, None, None, "") in ended


def test_one_on_its_way_home_whose_energy_does_not_suffice_raises_a_severe_alarm(
    land: Landscape,
) -> None:
    flight = Flight(land, *LONG)
    assert returns(flight.at(150.0, later_s=810.0))
    flight.mode("return")
    assert "energy" not in alarms(fly(flight, 60.0))
    commands = fly(flight, 260.0)  # it has not come nearer
    assert alarms(commands) == {"energy": "severe"}


def test_the_severe_alarm_does_not_change_while_the_time_home_varies(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    flight.at(150.0, later_s=810.0)
    flight.mode("return")
    fly(flight, 300.0)
    flight.handle(WindMeasured(flight.at_us, "hawk", 14.0, 90.0))
    later = fly(flight, 5.0)
    flight.handle(WindMeasured(flight.at_us, "hawk", 14.0, 270.0))  # now the wind blows it home
    later += fly(flight, 10.0)
    assert "energy" not in alarms(later)


def test_an_order_to_fly_on_beyond_the_limit_needs_a_confirmation(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    assert returns(flight.at(150.0, later_s=810.0))
    flight.mode("return")
    (question,) = questions(order(flight, "resume"))
    assert (
        "it does not have enough energy to resume: no time left on task, 2 min home (source: "
        in question
    )
    assert flight.core.vehicles["hawk"].sent_home
    assert not questions(order(flight, "resume", confirmed=True))
    flight.mode("mission")
    commands = fly(flight, 40.0)
    assert not returns(commands)
    assert alarms(commands)["overdue"] == "severe"
    order(flight, "hold")
    assert questions(order(flight, "resume"))  # the confirmation has ended
    assert not questions(order(flight, "return"))
    assert not questions(order(flight, "hold"))


def test_one_question_states_the_energy_and_the_mode_that_an_order_would_end(
    land: Landscape,
) -> None:
    flight = Flight(land, *LONG)
    flight.mode("manual")
    flight.at(150.0, later_s=810.0)
    (question,) = questions(order(flight, "resume"))
    assert "it does not have enough energy to resume" in question
    assert "; resume would end mode manual, which its autopilot or pilot selected" in question
    assert flight.core.vehicles["hawk"].availability.taken_over


def test_an_order_before_the_limit_needs_no_confirmation(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    flight.at(150.0, later_s=300.0)
    assert any(isinstance(each, Hold) for each in order(flight, "hold"))
    assert not questions(order(flight, "resume"))


def test_a_start_with_an_empty_battery_is_refused_until_the_battery_is_replaced(
    land: Landscape,
) -> None:
    flight = Flight(land)
    flight.mode("return")
    flight.mode("return", armed=False)
    for percent, refused in ((18.0, True), (90.0, False)):
        battery(flight, percent)
        for _ in range(5):
            assert not returns(flight.at(0.0, later_s=5.0))
        commands = order(flight, "start", confirmed=True)
        lines = [each.text for each in commands if isinstance(each, Announce)]
        assert lines[0].startswith("rejected: hawk: battery: 18 %, the reserve is 20 %") == refused
        assert (StartMission("hawk") in commands) != refused


def test_a_restart_of_the_service_keeps_the_learned_rate(land: Landscape) -> None:
    flight = Flight(land)
    drain(flight, 3000.0, 50.0)
    core = pickle.loads(pickle.dumps(flight.core))
    before = flight.core.vehicles["hawk"].energy.estimate
    core.handle(Resumed(flight.at_us, "", "", 5.0))
    assert core.vehicles["hawk"].energy.estimate == before
    assert core.vehicles["hawk"].battery == flight.core.vehicles["hawk"].battery


def test_no_command_starts_a_vehicle(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    flight.at(150.0, later_s=810.0)
    flight.mode("return")
    flight.mode("return", armed=False)
    assert not any(isinstance(each, StartMission) for each in fly(flight, 300.0))
