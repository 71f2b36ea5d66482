"""Pre-flight checks of a vehicle on the ground, and the sign-off of its takeoff."""

import pickle
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    Announce,
    AnyCommand,
    ClearAlarm,
    RaiseAlarm,
    ReportChecks,
    StartMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.events import (
    Aborted,
    AircraftReported,
    AircraftState,
    AirspaceClosed,
    AnyEvent,
    BatteryUpdated,
    CommandFinished,
    EstimatorStatusChanged,
    FenceStatusChanged,
    GpsFixChanged,
    LinkLost,
    MissionReadBack,
    ModeChanged,
    Order,
    OrderGiven,
    ParametersReported,
    Resumed,
    SystemStateChanged,
    Telemetry,
    UploadFinished,
    VehicleConnected,
    VehicleRebooted,
)
from mission_service.fire.scenario_fire import landscape_of
from tests.service.people_flights import ANN, Fly, flights_in
from tests.service.test_lost_link import NONE

EACH = 'preflight.signoff="each"'
WAITS = "vehicles.0.autostart=false"
REASON = "the battery monitor is not calibrated"


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("default"))


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


class Ground:
    """The vehicle of the scenario ``default`` on the ground at home."""

    def __init__(self, land: Landscape, *overrides: str) -> None:
        scenario = load_scenario("default", overrides)
        self.core, self.section = Core(scenario, land), scenario.vehicles[0]
        self.vehicle = self.core.vehicles["hawk"]
        self.home_amsl_m = float(land.elevation_at(*self.vehicle.home_m))
        self.at_s = scenario.deploy_at_s
        self.sent: list[AnyCommand] = []
        self.handle(VehicleConnected(self.at_us, "hawk", f"{self.section.stack} plane", True))
        self.mode("hold", armed=False)

    @property
    def at_us(self) -> int:
        return round(self.at_s * 1e6)

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = self.core.handle(event)
        self.core.validate_state()
        self.sent += commands
        return commands

    def at(self, height_m: float = 0.0, later_s: float = 1.0, off_deg: float = 0.0) -> None:
        self.at_s += later_s
        place = (self.section.home_lat_deg, self.section.home_lon_deg + off_deg)
        height = (self.home_amsl_m + height_m, height_m)
        self.handle(Telemetry(self.at_us, "hawk", *place, *height, 0.0, 0.0, 0.0))

    def mode(self, mode: str, armed: bool = True) -> None:
        self.handle(ModeChanged(self.at_us, "hawk", 0, armed, mode))

    def stands(self, seconds: int = 30) -> list[AnyCommand]:
        """Report positions on the ground and accept missions; return all commands."""
        begun = len(self.sent)
        for _ in range(seconds):
            self.at()
            self.accept()
        return self.sent[begun:]

    def accept(self) -> None:
        pending = self.vehicle.pending
        if pending is not None:
            self.handle(UploadFinished(self.at_us, "hawk", pending.mission_id, "accepted", ""))

    def battery(self, percent: float) -> None:
        self.handle(BatteryUpdated(self.at_us, "hawk", percent, 12.0))

    def order(self, order: Order, by: str = "ann", override: str = "") -> list[AnyCommand]:
        return self.handle(OrderGiven(self.at_us, by, "", "hawk", order, override=override))

    def lands(self) -> None:
        """Take off, fly, return and land."""
        self.mode("mission")
        self.at(100.0, later_s=20.0)
        self.mode("return")
        self.at(0.0, later_s=60.0)
        self.mode("return", armed=False)

    def check(self, name: str) -> tuple[str, str]:
        """Return the state and the text of a check, as last reported."""
        self.at(later_s=11.0)
        reported = [each for each in self.sent if isinstance(each, ReportChecks)]
        (found,) = (each for each in reported[-1].checks if each.name == name)
        return found.state, found.text


def starts(commands: list[AnyCommand]) -> bool:
    return any(isinstance(each, StartMission) for each in commands)


def texts(commands: list[AnyCommand]) -> str:
    return "\n".join(each.text for each in commands if isinstance(each, Announce))


def close_home(ground: Ground) -> None:
    lat_deg, lon_deg = ground.section.home_lat_deg, ground.section.home_lon_deg
    sides = ((-0.001, -0.001), (-0.001, 0.001), (0.001, 0.001), (0.001, -0.001))
    corners = tuple((lat_deg + north, lon_deg + east) for north, east in sides)
    ground.handle(AirspaceClosed(ground.at_us, "ann", "", "TFR", corners))


def aircraft(ground: Ground, off_deg: float) -> None:
    lat_deg, lon_deg = ground.section.home_lat_deg + off_deg, ground.section.home_lon_deg
    place = (lat_deg, lon_deg, ground.home_amsl_m + 200.0)
    other = AircraftState("a4c2f1", "N417EA", *place, 0.0, 0.0, 0.0, 1.0, "sbs")
    ground.handle(AircraftReported(ground.at_us, "hawk", (other,)))


# Checks ----------------------------------------------------------------------------------------


def test_all_checks_pass_for_a_vehicle_that_is_ready(land: Landscape) -> None:
    ground = Ground(land, WAITS, "surveillance.sources=[]")
    ground.battery(87.0)
    ground.handle(ParametersReported(ground.at_us, "hawk", "px4 plane", 255, NONE))
    ground.stands()
    last = [each for each in ground.sent if isinstance(each, ReportChecks)][-1]
    found = {each.name: each.state for each in last.checks}
    names = [
        "battery",
        "position",
        "estimator",
        "link",
        "autopilot",
        "kind",
        "home",
        "mission",
        "airspace",
        "return",
        "wind",
    ]
    assert found == dict.fromkeys([*names, "lost link", "other aircraft"], "pass")
    assert ground.check("battery")[1].startswith("87 %, the reserve is 20 %")
    assert ground.check("mission")[1] == "mission 1 accepted"
    assert ground.check("home")[1] == "0 m from the home in the scenario, 0 m above the terrain"


@pytest.mark.parametrize(
    ("name", "broken", "words"),
    [
        ("battery", lambda g: g.battery(18.0), "18 %, the reserve is 20 %: replace the battery"),
        ("position", lambda g: g.handle(GpsFixChanged(g.at_us, "hawk", False, "2D")), "no 3-D fix"),
        (
            "estimator",
            lambda g: g.handle(EstimatorStatusChanged(g.at_us, "hawk", False, ("yaw",))),
            "unhealthy",
        ),
        ("link", lambda g: g.handle(LinkLost(g.at_us, "hawk", 5.0)), "no heartbeat"),
        (
            "autopilot",
            lambda g: g.handle(SystemStateChanged(g.at_us, "hawk", "critical")),
            "the state critical",
        ),
        (
            "autopilot",
            lambda g: g.handle(FenceStatusChanged(g.at_us, "hawk", True, "boundary")),
            "a breached fence",
        ),
        ("airspace", close_home, "would enter .*TFR"),
        ("other aircraft", lambda g: aircraft(g, 0.01), r"N417EA 1\.1 km away, 200 m above"),
        (
            "lost link",
            lambda g: g.handle(
                ParametersReported(g.at_us, "hawk", "px4 plane", 255, {**NONE, "NAV_DLL_ACT": 3.0})
            ),
            "mission-service lost-link set",
        ),
    ],
)
def test_a_check_fails_and_the_takeoff_is_refused(
    land: Landscape, name: str, broken: object, words: str
) -> None:
    settings = ("surveillance.sources=[]", 'vehicles.0.lost_link="return"')
    ground = Ground(land, WAITS, *settings)
    ground.stands()
    assert ground.check(name)[0] != "fail"
    assert callable(broken)
    broken(ground)
    state, text = ground.check(name)
    assert state == "fail"
    assert re.search(words, text), text
    refused = ground.order("takeoff")
    assert not starts(refused)
    assert texts(refused).startswith(f"rejected: hawk: {name}: ")


def test_a_lower_charge_counts_at_once_and_a_higher_one_when_it_has_lasted(
    land: Landscape,
) -> None:
    ground = Ground(land, WAITS)
    ground.battery(87.0)
    ground.stands()
    ground.battery(12.0)
    assert texts(ground.order("takeoff")).startswith("rejected: hawk: battery: 12 %")
    ground.stands()
    ground.battery(87.0)
    assert texts(ground.order("takeoff")).startswith("rejected: hawk: battery: 12 %")
    ground.stands()
    assert starts(ground.order("takeoff"))


def test_another_aircraft_far_away_is_no_obstacle(land: Landscape) -> None:
    ground = Ground(land, WAITS, "surveillance.sources=[]")
    aircraft(ground, 0.1)
    assert ground.check("other aircraft") == ("pass", "N417EA 11.1 km away, 200 m above")


def test_without_a_position_or_with_an_old_one_it_does_not_take_off(land: Landscape) -> None:
    ground = Ground(land, WAITS)
    assert "position: no position reported" in texts(ground.order("takeoff", override=REASON))
    ground.stands()
    ground.at_s += 30.0
    refused = ground.order("takeoff", override=REASON)
    assert "position: the last position is 30 s old" in texts(refused)
    assert "cannot be overridden" in texts(refused)
    ground.at()
    assert starts(ground.order("takeoff"))


def test_the_home_of_the_scenario_is_compared_with_position_and_terrain(land: Landscape) -> None:
    ground = Ground(land, WAITS)
    ground.stands()
    ground.home_amsl_m += 50.0
    state, text = ground.check("home")
    assert (state, text.partition(":")[0]) == (
        "fail",
        "0 m from the home in the scenario, 50 m above the terrain",
    )
    ground.home_amsl_m -= 50.0
    ground.at(off_deg=0.003)  # 270 m
    refused = texts(ground.order("takeoff"))
    assert re.search(r"home: 2\d\d m from the home in the scenario, .* move it there", refused)


def test_the_wind_is_compared_with_the_limit_of_the_airframe(land: Landscape) -> None:
    ground = Ground(land, WAITS, "vehicles.0.max_wind_m_s=3", "weather.0.wind_speed_m_s=4")
    assert ground.check("wind") == ("fail", "4 m/s; the limit is 3 m/s: wait for less wind")
    ground = Ground(land, WAITS, "weather.0.wind_speed_m_s=4")
    limit_m_s = ground.section.airspeed_m_s
    assert ground.check("wind") == ("pass", f"4 m/s; the limit is {limit_m_s:.0f} m/s")


def test_the_energy_must_suffice_for_the_flight_to_the_task_and_home(land: Landscape) -> None:
    far = ("vehicles.0.endurance_reserve_s=10", "weather.0.wind_speed_m_s=0")
    long = Ground(land, WAITS, "vehicles.0.endurance_s=3000", *far)
    long.stands()
    state, text = long.check("battery")
    assert state == "pass"
    out_min, home_min = (int(each) for each in re.findall(r"(\d+) min (?:to the task|home)", text))
    assert out_min > 0
    assert home_min > 0
    reserve_s = 3000.0 - 60.0 * int(re.findall(r"(\d+) min in the air", text)[0])
    short_s = reserve_s + 60.0 * (out_min + home_min) / 2.0
    short = Ground(land, WAITS, f"vehicles.0.endurance_s={short_s:.0f}", *far)
    short.stands()
    state, text = short.check("battery")
    assert state == "fail"
    assert text.endswith("min home: replace the battery")


# Sign-off --------------------------------------------------------------------------------------


def test_a_takeoff_starts_the_vehicle_and_is_shown(land: Landscape) -> None:
    ground = Ground(land, EACH)
    assert not starts(ground.stands())
    assert ground.vehicle.waits_for_operator
    signed = ground.order("takeoff")
    assert starts(signed)
    assert texts(signed) == "takeoff signed off by ann"
    ground.at()
    reports = [each for each in ground.sent if isinstance(each, ReportChecks)]
    assert [(each.waits, each.signed_off_by) for each in reports][-1] == (False, "ann")
    ground.mode("mission")
    ground.at(100.0)
    assert ground.sent[-1] == ReportChecks("hawk", ())
    assert ground.vehicle.signed_off is None


def test_by_default_the_scenario_signs_off_the_first_takeoff_but_no_other(land: Landscape) -> None:
    ground = Ground(land)
    assert starts(ground.stands())
    ground.lands()
    assert not starts(ground.stands(60))
    assert starts(ground.order("takeoff"))


def test_with_a_sign_off_of_each_takeoff_a_reboot_starts_nothing(land: Landscape) -> None:
    ground = Ground(land, EACH)
    ground.stands()
    ground.handle(VehicleRebooted(ground.at_us, "hawk"))
    ground.mode("hold", armed=False)
    assert not starts(ground.stands())


def test_an_override_starts_it_with_the_reason_announced(land: Landscape) -> None:
    ground = Ground(land, EACH)
    ground.battery(15.0)
    ground.stands()
    assert "or order takeoff with a reason" in texts(ground.order("takeoff"))
    overridden = ground.order("takeoff", override=REASON)
    assert starts(overridden)
    assert f"battery overridden by ann: {REASON}" in texts(overridden)
    ground.battery(14.0)
    assert ground.vehicle.signed_off is not None  # this check was overridden
    ground.handle(LinkLost(ground.at_us, "hawk", 4.0))
    assert ground.vehicle.signed_off is None  # this one was not


@pytest.mark.parametrize("order", ["resume", "start"])
def test_other_orders_to_start_pass_the_same_checks(land: Landscape, order: Order) -> None:
    ground = Ground(land)
    ground.stands()
    ground.lands()
    ground.stands()
    ground.battery(15.0)
    refused = ground.order(order)
    assert texts(refused).startswith("rejected: hawk: battery: 15 %")
    assert not starts([*refused, *ground.stands()])
    for _ in range(3):  # a charge that has risen much is used when it has lasted
        ground.battery(90.0)
        ground.stands(15)
    assert starts([*ground.order(order), *ground.stands()])


ENDINGS = {
    "reboot": lambda g: g.handle(VehicleRebooted(g.at_us, "hawk")),
    "service restarts": lambda g: g.handle(Resumed(g.at_us, "", "", 5.0)),
    "hold": lambda g: g.order("hold", by="bob"),
    "abort": lambda g: g.handle(Aborted(g.at_us, "bob", "")),
    "return": lambda g: g.order("return", by="bob"),
    "failsafe": lambda g: g.handle(SystemStateChanged(g.at_us, "hawk", "critical")),
    "battery": lambda g: g.battery(10.0),
    "fix": lambda g: g.handle(GpsFixChanged(g.at_us, "hawk", False, "none")),
    "link": lambda g: g.handle(LinkLost(g.at_us, "hawk", 5.0)),
}


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("refused", [False, True], ids=["before the mission", "start refused"])
def test_a_sign_off_ends_before_the_takeoff(land: Landscape, ending: str, refused: bool) -> None:
    ground = Ground(land, EACH)
    if refused:  # the autopilot refuses the start, which is then repeated
        ground.stands()
        assert starts(ground.order("takeoff"))
        done = CommandFinished(ground.at_us, "hawk", "start mission", False, "not yet")
        ground.handle(done)
    else:  # no mission is on board yet
        ground.at()
        assert not starts(ground.order("takeoff"))
    assert ground.vehicle.signed_off is not None
    ENDINGS[ending](ground)
    assert ground.vehicle.signed_off is None
    assert ground.vehicle.waits_for_operator
    # The cause ends, and nothing starts it but another order.
    ground.handle(VehicleConnected(ground.at_us, "hawk", "px4 plane", True))
    ground.handle(SystemStateChanged(ground.at_us, "hawk", "standby"))
    ground.handle(GpsFixChanged(ground.at_us, "hawk", True, "3D"))
    ground.mode("hold", armed=False)
    ground.handle(MissionReadBack(ground.at_us, "hawk", 0, 0))
    ground.battery(90.0)
    assert not starts(ground.stands(60))
    if ending in ("hold", "abort"):
        assert "a hold is ordered" in texts(ground.order("start"))
    ground.battery(90.0)
    assert starts(ground.order("takeoff"))


def test_a_sign_off_lasts_while_nothing_changes(land: Landscape) -> None:
    """The counterpart of the endings: the start is repeated after a refusal."""
    ground = Ground(land, EACH)
    ground.stands()
    ground.order("takeoff")
    ground.handle(CommandFinished(ground.at_us, "hawk", "start mission", False, "not yet"))
    assert starts(ground.stands())


def test_of_two_users_the_second_is_refused(land: Landscape) -> None:
    ground = Ground(land, EACH)
    ground.at()
    ground.order("takeoff", by="ann")
    refused = ground.order("takeoff", by="bob")
    assert texts(refused) == "rejected: hawk: ann has already signed off its takeoff"
    assert starts(ground.stands())
    refused = ground.order("takeoff", by="bob")
    assert texts(refused) == "rejected: hawk: its takeoff has already begun"


def test_a_vehicle_in_the_air_is_not_signed_off(land: Landscape) -> None:
    ground = Ground(land)
    ground.stands()
    ground.mode("mission")
    ground.at(100.0)
    refused = ground.order("takeoff", override=REASON)
    assert texts(refused) == "rejected: hawk: it is in the air: order resume or start"
    assert not starts(refused)


# Automatic starts ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "broken", "mended"),
    [
        ("battery", lambda g: g.battery(15.0), lambda g: g.battery(90.0)),
        (
            "estimator",
            lambda g: g.handle(EstimatorStatusChanged(g.at_us, "hawk", False, ("yaw",))),
            lambda g: g.handle(EstimatorStatusChanged(g.at_us, "hawk", True, ())),
        ),
        ("wind", lambda g: None, None),  # the weather of the scenario
    ],
)
def test_a_start_without_an_order_is_delayed_by_a_failing_check(
    land: Landscape, name: str, broken: object, mended: object
) -> None:
    overrides = ("weather.0.wind_speed_m_s=30",) if name == "wind" else ()
    ground = Ground(land, *overrides)
    ground.at()  # the mission is sent
    assert callable(broken)
    broken(ground)
    ground.accept()
    commands = ground.stands(60)
    assert not starts(commands)
    alarms = [each for each in ground.sent if isinstance(each, RaiseAlarm)]
    (alarm,) = (each for each in alarms if each.alarm == "preflight")
    assert alarm.text.startswith(f"start delayed: {name}: ")
    if mended is None:
        return
    assert callable(mended)
    mended(ground)
    after = ground.stands(60)
    assert starts(after)
    assert ClearAlarm("hawk", "preflight") in after


def test_other_failing_checks_are_announced_at_a_start_without_an_order(land: Landscape) -> None:
    ground = Ground(land)
    ground.home_amsl_m += 50.0
    commands = ground.stands()
    assert starts(commands)
    assert "started by the scenario although a check fails: home: 0 m" in texts(commands)


# The whole service -----------------------------------------------------------------------------


def test_a_signed_off_flight_replays_bit_for_bit(fly: Fly) -> None:
    flight = fly(EACH)
    flight.run(60.0)
    state = flight.state_view.vehicles["hawk"]
    assert not state.armed
    assert state.waits_for_signoff
    assert [each.name for each in state.checks if each.state == "fail"] == []
    pickle.loads(pickle.dumps(flight.sim.core))
    flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "takeoff"))
    flight.run(60.0)
    assert flight.state_view.vehicles["hawk"].armed
    assert flight.state_view.vehicles["hawk"].checks == ()
    events = flight.over()  # fails if the replay differs
    assert any(isinstance(each, ReportChecks) for each in events)
