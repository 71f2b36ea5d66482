"""Vehicles that fail, are recalled or return in time are reported and leave their team."""

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    RaiseAlarm,
    ReportChecks,
    ReportEnergy,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    AnyEvent,
    CommandFinished,
    LinkLost,
    LinkRestored,
    ModeChanged,
    OrderGiven,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
    WindMeasured,
)
from mission_service.fire.scenario_fire import landscape_of

NAV_TAKEOFF = 22
HOME_AMSL_M = 348.0
LONG = (
    *("vehicles.0.endurance_s=1200", "vehicles.0.endurance_reserve_s=300"),
    "weather.0.wind_speed_m_s=0",
)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


class Watched:
    """A planner that records departures."""

    phase, clockwise, reversals = "approach", True, 0

    def __init__(self) -> None:
        self.left_at_s: list[float] = []
        self.winds: list[tuple[float, float, float]] = []
        self.places = 0

    def wind(self, speed_m_s: float, from_deg: float, at_s: float) -> None:
        self.winds.append((speed_m_s, from_deg, at_s))

    def at(self, row: float, col: float, at_s: float) -> None:
        self.places += 1

    def left(self, at_s: float) -> None:
        self.left_at_s.append(at_s)


class Flight:
    """One vehicle, in the air 1,200 m west of its home, 150 m above it; the events of a test."""

    def __init__(self, land: Landscape, *overrides: str) -> None:
        scenario = load_scenario("default", overrides)
        self.core, self.home = Core(scenario, land), scenario.vehicles[0]
        self.planner = Watched()
        self.core.decision_engine.planners["hawk"] = self.planner  # type: ignore[index]
        self.at_s = scenario.deploy_at_s
        self.finishes_uploads = True
        self.handle(VehicleConnected(self.at_us, "hawk", "a stack", True))
        self.at(0.0)
        self.mode("mission")
        self.at(150.0)

    @property
    def at_us(self) -> int:
        return round(self.at_s * 1e6)

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = self.core.handle(event)
        for command in commands:
            if isinstance(command, UploadMission) and self.finishes_uploads:
                done = UploadFinished(self.at_us, "hawk", command.mission_id, "accepted", "")
                commands = [*commands, *self.core.handle(done)]
        return commands

    def at(self, height_m: float, later_s: float = 1.0) -> list[AnyCommand]:
        self.at_s += later_s
        away_deg = 0.0134 if height_m > 0.0 else 0.0
        lat, lon = self.home.home_lat_deg, self.home.home_lon_deg - away_deg
        height = (HOME_AMSL_M + height_m, height_m)
        report = Telemetry(self.at_us, "hawk", lat, lon, *height, 0.0, 12.0, 0.0)
        return self.handle(report)

    def mode(self, name: str, armed: bool = True) -> list[AnyCommand]:
        return self.handle(ModeChanged(self.at_us, "hawk", 0, armed, name))


def returns(commands: list[AnyCommand]) -> bool:
    return any(isinstance(command, Return) for command in commands)


def acts(commands: list[AnyCommand]) -> list[AnyCommand]:
    """Return the commands without reports, announcements and alarms."""
    reports = (ReportEnergy, ReportChecks, RaiseAlarm, Announce)
    return [command for command in commands if not isinstance(command, reports)]


def test_it_is_sent_home_while_its_time_in_the_air_still_takes_it_there(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    # 1,200 m at 12 m/s, and a reserve of 300 s: after 800 s.
    assert not returns(flight.at(150.0, later_s=795.0))
    assert flight.planner.left_at_s == []
    commands = flight.at(150.0, later_s=10.0)
    assert returns(commands)
    assert flight.planner.left_at_s == [flight.at_s]
    places = flight.planner.places
    assert acts(flight.at(150.0, later_s=30.0)) == []
    assert flight.planner.places == places


def test_it_is_sent_home_during_an_upload(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    flight.finishes_uploads = False
    flight.mode("hold")
    flight.handle(OrderGiven(flight.at_us, "ann", "", "hawk", "resume", True))
    flight.handle(LinkLost(flight.at_us, "hawk", 3.0))
    flight.handle(LinkRestored(flight.at_us, "hawk"))
    flight.at(150.0, later_s=10.0)
    assert flight.core.vehicles["hawk"].pending is not None
    assert returns(flight.at(150.0, later_s=810.0))


def test_wind_makes_the_way_home_longer(land: Landscape) -> None:
    flight = Flight(land, *LONG)
    flight.at(150.0, later_s=640.0)
    flight.handle(WindMeasured(flight.at_us, "hawk", 6.0, 45.0))
    assert flight.planner.winds == [(6.0, 45.0, flight.at_s)]
    # It flies home at 7.3 m/s: 12 m/s calibrated airspeed are 12.3 m/s at 550 m AMSL.
    assert not returns(flight.at(150.0, later_s=80.0))
    assert returns(flight.at(150.0, later_s=20.0))


def test_wind_reported_on_the_ground_is_ignored(land: Landscape) -> None:
    flight = Flight(land)
    flight.mode("hold", armed=False)
    flight.handle(WindMeasured(flight.at_us, "hawk", 0.7, 0.0))
    assert flight.planner.winds == []


def test_a_refused_return_is_ordered_again(land: Landscape) -> None:
    flight = Flight(land, "vehicles.0.endurance_s=600")
    assert returns(flight.at(150.0, later_s=300.0))
    flight.handle(CommandFinished(flight.at_us, "hawk", "return", False, "not now"))
    assert acts(flight.at(150.0, later_s=5.0)) == []
    assert returns(flight.at(150.0, later_s=6.0))
    assert acts(flight.at(150.0, later_s=20.0)) == []


def test_landed_it_gets_a_mission_that_takes_off_and_waits_for_an_operator(land: Landscape) -> None:
    flight = Flight(land, "vehicles.0.endurance_s=600")
    flight.at(150.0, later_s=300.0)
    flight.mode("return")
    flight.mode("return", armed=False)
    commands = flight.at(0.0, later_s=10.0)
    (mission,) = (command for command in commands if isinstance(command, UploadMission))
    assert mission.items[0].command == NAV_TAKEOFF
    assert not any(isinstance(command, StartMission) for command in commands)
    places = flight.planner.places
    flight.mode("mission")
    flight.at(150.0, later_s=60.0)
    assert flight.planner.places == places + 1
    assert not returns(flight.at(150.0, later_s=10.0))  # its time in the air starts at zero


@pytest.mark.parametrize("mode", ["return", "land"])
def test_a_vehicle_recalled_by_its_pilot_leaves_until_it_is_sent_back(
    land: Landscape, mode: str
) -> None:
    flight = Flight(land)
    announcement, alarm = flight.mode(mode)
    assert isinstance(announcement, Announce)
    assert isinstance(alarm, RaiseAlarm)
    assert mode in announcement.text
    assert "not ordered" in announcement.text
    assert flight.planner.left_at_s == [flight.at_s]
    assert flight.at(150.0, later_s=60.0) == []
    flight.mode("mission")
    places = flight.planner.places
    flight.at(150.0)
    assert flight.planner.places == places + 1


def test_one_on_its_way_home_when_it_is_discovered_is_left_alone(land: Landscape) -> None:
    scenario = load_scenario("default")
    core, home = Core(scenario, land), scenario.vehicles[0]
    at_us = round(scenario.deploy_at_s * 1e6)
    core.handle(VehicleConnected(at_us, "hawk", "a stack", True))
    # It may be on the ground.
    assert core.handle(ModeChanged(at_us, "hawk", 0, True, "return")) == []
    place = (home.home_lat_deg, home.home_lon_deg)
    announcement, alarm, checks = core.handle(
        Telemetry(at_us, "hawk", *place, 550.0, 150.0, 0.0, 12.0, 0.0)
    )
    assert checks == ReportChecks("hawk", ())
    assert isinstance(announcement, Announce)
    assert isinstance(alarm, RaiseAlarm)
    assert "returning home" in announcement.text
    assert core.handle(Telemetry(at_us, "hawk", *place, 550.0, 150.0, 0.0, 12.0, 0.0)) == []


def test_a_lost_link_a_restart_and_disarming_leave_too(land: Landscape) -> None:
    flight = Flight(land)
    flight.handle(LinkLost(flight.at_us, "hawk", 3.0))
    assert len(flight.planner.left_at_s) == 1
    flight.handle(LinkRestored(flight.at_us, "hawk"))
    flight.handle(VehicleRebooted(flight.at_us, "hawk"))
    assert len(flight.planner.left_at_s) == 2
    flight.at(150.0)
    flight.mode("mission", armed=False)
    assert len(flight.planner.left_at_s) == 3
