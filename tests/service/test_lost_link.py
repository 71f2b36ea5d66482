"""The reaction to a lost link: read from the autopilot, shown, and compared with the scenario."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.stacks.link_loss import parameters_of
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle import client_events as bridge
from autopilot_bridge.vehicle.parameters import Parameter, ParametersResult
from mission_service.commands import (
    Announce,
    AnyCommand,
    ClearAlarm,
    Hold,
    RaiseAlarm,
    ReportChecks,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.errors import ScenarioError
from mission_service.events import LinkLost, ParametersReported, VehicleConnected
from mission_service.fire.scenario_fire import landscape_of
from mission_service.runtime.state_view import StateView
from mission_service.vehicles.parameter_reports import (
    READ_AGAIN_US,
    RETRIES,
    RETRY_US,
    ParameterReports,
)
from tests.service.people_flights import Fly, flights_in
from tests.service.test_failsafes import times_s

PX4, COPTER = stack_named("px4", "plane"), stack_named("ardupilot", "copter")
NONE = {
    "NAV_DLL_ACT": 0.0,
    "COM_DL_LOSS_T": 10.0,
    "COM_DLL_EXCEPT": 0.0,
    "COM_FAIL_ACT_T": 5.0,
    "RTL_RETURN_ALT": 60.0,
    "GF_ACTION": 2.0,
}
RETURNS = {**NONE, "NAV_DLL_ACT": 2.0}


def core_of(lost_link: str | None = None, **more: Any) -> Core:
    overrides = [f"vehicles.0.{key}={value}" for key, value in more.items()]
    if lost_link is not None:
        overrides.append(f"vehicles.0.lost_link={lost_link}")
    scenario = load_scenario("default", tuple(overrides))
    return Core(scenario, landscape_of(scenario))


def report(
    core: Core, values: dict[str, float], stack: str = "px4 plane", station_id: int = 255
) -> list[AnyCommand]:
    name = core.scenario.flown[0].name
    return core.handle(ParametersReported(1_000_000, name, stack, station_id, values))


def alarms(commands: list[AnyCommand]) -> list[RaiseAlarm]:
    return [each for each in commands if isinstance(each, RaiseAlarm)]


def test_without_the_key_the_reaction_is_only_announced() -> None:
    core = core_of()
    for values, words in (
        (NONE, "if the link is lost, it continues; return height 60 m; fence: hold"),
        (RETURNS, "holds after 10 s, returns after 15 s; return height 60 m; fence: hold"),
    ):
        commands = report(core, values)
        assert not alarms(commands)
        (line,) = [each for each in commands if isinstance(each, Announce)]
        assert (line.level, line.text.endswith(words)) == ("info", True)


def test_a_difference_raises_an_alarm_with_the_command_that_ends_it() -> None:
    core = core_of("return", link="udpin:127.0.0.1:14999")
    (alarm,) = alarms(report(core, NONE))
    assert (alarm.alarm, alarm.severity) == ("lost_link", "warning")
    assert alarm.text == (
        'if the link is lost, it continues; lost_link = "return" in the scenario: stop the '
        "service, then run mission-service lost-link set return --link udpin:127.0.0.1:14999 "
        "--system-id 1 "
        "(NAV_DLL_ACT 0 -> 2)"
    )
    commands = report(core, RETURNS)
    assert not alarms(commands)
    assert ClearAlarm(core.scenario.flown[0].name, "lost_link") in commands


def test_only_announcements_and_alarms_follow_from_parameters() -> None:
    """No parameter is changed, and no mode is commanded, without an order."""
    for wanted in ("continue", "hold", "return", "land", None):
        for value in range(8):
            commands = report(core_of(wanted), {**NONE, "NAV_DLL_ACT": float(value)})
            assert commands
            shown = Announce | RaiseAlarm | ClearAlarm | ReportChecks
            assert all(isinstance(each, shown) for each in commands)


def test_a_dangerous_value_is_a_severe_alarm_without_the_key() -> None:
    (alarm,) = alarms(report(core_of(), {**NONE, "NAV_DLL_ACT": 6.0}))
    assert alarm.severity == "severe"
    assert "NAV_DLL_ACT = 6: it disarms in the air" in alarm.text


def test_an_unknown_reaction_is_an_alarm_only_with_the_key() -> None:
    values = {name: value for name, value in NONE.items() if name != "NAV_DLL_ACT"}
    assert not alarms(report(core_of(), values))
    (alarm,) = alarms(report(core_of("hold"), values))
    assert alarm.text == "its reaction to a lost link is unknown: no reply for NAV_DLL_ACT"


def test_ardupilot_that_monitors_another_station_is_named() -> None:
    values = {"FS_GCS_ENABLE": 1.0, "FS_GCS_TIMEOUT": 5.0, "FS_OPTIONS": 0.0, "SYSID_MYGCS": 255.0}
    core = core_of("return", stack="ardupilot", kind="copter")
    assert not alarms(report(core, values, "ardupilot copter"))
    (alarm,) = alarms(report(core, values, "ardupilot copter", station_id=245))
    assert "--station-id 245 (SYSID_MYGCS 255 -> 245)" in alarm.text


def test_the_announcement_of_a_lost_link_states_the_reaction() -> None:
    core = core_of()
    name = core.scenario.flown[0].name
    core.handle(VehicleConnected(0, name, "px4 plane", True))
    report(core, RETURNS)
    commands = core.handle(LinkLost(2_000_000, name, 3.0))
    (line,) = (each for each in commands if isinstance(each, Announce))
    assert line.text.endswith("by its parameters it holds after 10 s, returns after 15 s")


def test_the_state_of_a_vehicle_shows_the_reaction() -> None:
    scenario = load_scenario("default", ())
    view = StateView(scenario, landscape_of(scenario), 0)
    name = scenario.flown[0].name
    view.apply(ParametersReported(1, name, "px4 plane", 255, RETURNS), [])
    vehicle = view.vehicles[name]
    shown = (vehicle.lost_link, vehicle.return_height_m, vehicle.fence_action)
    assert shown == ("holds after 10 s, returns after 15 s", 60.0, "hold")
    view.apply(ParametersReported(2, name, "px4 plane", 255, {}), [])
    assert (vehicle.lost_link, vehicle.return_height_m) == ("", None)


@pytest.mark.parametrize("wanted", ["hold", "land"])
def test_a_reaction_that_arduplane_lacks_is_rejected(wanted: str) -> None:
    with pytest.raises(ScenarioError, match="ArduPlane has no reaction lost_link"):
        core_of(wanted, stack="ardupilot", kind="plane")


# In flight --------------------------------------------------------------------------------------


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("stack", ["px4", "ardupilot"])
def test_a_failsafe_after_a_lost_link_is_as_shown_and_left_alone(fly: Fly, stack: str) -> None:
    """Only the link to the vehicle is cut: the service still receives its telemetry."""
    flight = fly(f'vehicles.0.stack="{stack}"', 'vehicles.0.lost_link="return"')
    rig = flight.sim.rigs[0]
    flight.run(10.0)
    assert flight.state_view.vehicles["hawk"].lost_link == "continues"
    assert "lost_link/hawk" in flight.state_view.alarms
    wanted = {"px4": ("NAV_DLL_ACT", 2.0), "ardupilot": ("FS_LONG_ACTN", 1.0)}
    rig.mock.parameters.change(*wanted[stack])
    if stack == "ardupilot":
        rig.mock.parameters.change("FS_GCS_ENABL", 1.0)
    rig.gateway.read_back(lambda items, stack: 0, flight.sim.link_us)
    flight.run(390.0)
    shown = {"px4": "holds after 10 s, returns after 15 s", "ardupilot": "returns after 5 s"}
    assert flight.state_view.vehicles["hawk"].lost_link == shown[stack]
    assert "lost_link/hawk" not in flight.state_view.alarms
    assert flight.mode == "mission"
    up = rig._up
    rig._up = MemoryLink(loss=1.0)
    flight.run(4.0)
    assert flight.mode == "mission"
    if stack == "px4":
        flight.run(8.0)
        assert flight.mode == "hold"
    flight.run(6.0)
    assert flight.mode == "return"
    assert "not ordered" in flight.state_view.alarms["mode/hawk"].text
    rig._up = up
    left_s = flight.now_s
    flight.run(60.0)
    assert flight.mode == "return"
    lines = flight.over()  # also verifies a replay of the journal
    for kind in (UploadMission, StartMission, Hold):
        assert not [at_s for at_s in times_s(lines, kind) if at_s >= left_s]


# Reading ----------------------------------------------------------------------------------------


class Client:
    """A client whose autopilot replies for the parameters in ``values``."""

    def __init__(self, stack: Stack, values: dict[str, float]) -> None:
        self.stack = stack
        self.values = values
        self.asked: list[str] = []

    def read_parameter(self, name: str, now_us: int) -> int:
        self.asked.append(name)
        return len(self.asked)


class Reading:
    """Reports of a client, in the time of the link."""

    def __init__(self, values: dict[str, float]) -> None:
        self.client = Client(PX4, values)
        self.reports = ParameterReports("hawk", self.client, 255)  # type: ignore[arg-type]
        self.now_us = 0
        self._answered = 0

    def receive(self, event: Any) -> list[ParametersReported]:
        return self.reports.receive(event, 7, self.now_us)

    def answer(self) -> list[ParametersReported]:
        """Reply to all requests, one after the other; return the reports."""
        found = []
        while self._answered < len(self.client.asked):
            name = self.client.asked[self._answered]
            self._answered += 1
            result = ParametersResult("failed", "no reply")
            if name in self.client.values:
                parameter = Parameter(name, self.client.values[name], 9)
                result = ParametersResult("accepted", "accepted", (parameter,))
            found += self.receive(bridge.ParametersFinished(0, self._answered, result))
        return found

    def wait(self, us: int, armed: bool = False) -> int:
        """Let time pass; return the number of requests."""
        before, self.now_us = len(self.client.asked), self.now_us + us
        self.reports.continue_reading(armed, self.now_us)
        return len(self.client.asked) - before


CONNECTED = bridge.Connected(0, PX4)


def test_one_request_is_active_at_a_time_and_one_report_follows() -> None:
    speeds = {"FW_AIRSPD_TRIM": 15.0, "FW_T_CLMB_R_SP": 3.0, "FW_R_LIM": 50.0}
    reading = Reading({**NONE, "RTL_TYPE": 0.0, **speeds})
    reading.receive(CONNECTED)
    assert len(reading.client.asked) == 1
    (found,) = reading.answer()
    assert reading.client.asked == [*parameters_of(PX4), *speeds]
    assert (found.at_us, found.vehicle, found.stack) == (7, "hawk", "px4 plane")
    assert (found.values, found.missing) == ({**NONE, "RTL_TYPE": 0.0, **speeds}, ())


def test_parameters_are_read_again_on_the_ground_and_reported_after_a_change() -> None:
    reading = Reading(dict(NONE))
    reading.receive(CONNECTED)
    (found,) = reading.answer()
    assert found.missing == ("RTL_TYPE", "FW_AIRSPD_TRIM", "FW_T_CLMB_R_SP", "FW_R_LIM")
    assert reading.wait(READ_AGAIN_US - 1) == 0
    assert reading.wait(1) == 1
    assert reading.answer() == []
    reading.client.values["NAV_DLL_ACT"] = 2.0
    assert reading.wait(READ_AGAIN_US, armed=True) == 0
    assert reading.answer() == []
    assert reading.wait(READ_AGAIN_US) == 1
    (found,) = reading.answer()
    assert found.values["NAV_DLL_ACT"] == 2.0


def test_a_missing_value_is_requested_again_a_few_times() -> None:
    reading = Reading({name: value for name, value in NONE.items() if name != "NAV_DLL_ACT"})
    reading.receive(CONNECTED)
    (found,) = reading.answer()
    assert "NAV_DLL_ACT" in found.missing
    for _ in range(RETRIES):
        assert reading.wait(RETRY_US, armed=True) == 1
        assert reading.answer() == []
    assert reading.wait(RETRY_US, armed=True) == 0
    reading.client.values["NAV_DLL_ACT"] = 1.0
    reading.receive(bridge.Rebooted(0))
    (found,) = reading.answer()
    assert found.values["NAV_DLL_ACT"] == 1.0


def test_nothing_is_requested_on_a_lost_link() -> None:
    reading = Reading(dict(NONE))
    reading.receive(CONNECTED)
    reading.receive(bridge.LinkLost(0, 3_000_000))
    assert reading.answer() == []
    assert len(reading.client.asked) == 1
    assert reading.wait(10 * READ_AGAIN_US) == 0
    reading.receive(bridge.LinkRestored(0))
    (found,) = reading.answer()
    assert found.values == NONE


def test_a_report_is_repeated_for_a_restarted_service() -> None:
    reading = Reading(dict(NONE))
    reading.receive(CONNECTED)
    assert len(reading.answer()) == 1
    reading.reports.report_again(0)
    assert len(reading.answer()) == 1
