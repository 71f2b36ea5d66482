"""The state view that all interfaces show, the health monitor's alarms, the table [service]."""

import math
from pathlib import Path

import pytest

from mission_service.commands import (
    Announce,
    DirectionDecision,
    Orbit,
    ReportEnergy,
    UploadMission,
)
from mission_service.config.scenario import load_run, load_scenario
from mission_service.errors import ScenarioError
from mission_service.events import (
    Aborted,
    AnyEvent,
    BatteryUpdated,
    CommandFinished,
    GpsFixChanged,
    LinkLost,
    LinkRestored,
    ModeChanged,
    OrderGiven,
    RemoteIdChanged,
    Telemetry,
    VehicleConnected,
    VehicleRebooted,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.runtime.alarms.health_monitor import HealthMonitor
from mission_service.runtime.alarms.notices import MAX_ANNOUNCEMENTS
from mission_service.runtime.alarms.proximity_alarms import ProximityAlarms, near_pairs
from mission_service.runtime.published_states import TelemetryState
from mission_service.runtime.state_view import StateView


@pytest.fixture
def state_view() -> StateView:
    scenario = load_scenario("demo")
    return StateView(scenario, landscape_of(scenario), 0)


def test_what_changed_has_a_newer_version_and_nothing_else(state_view: StateView) -> None:
    before, then = state_view.version, dict(state_view.changed)
    fix = Telemetry(1, "hawk", 36.3708, -84.1323, 500.0, 150.0, 3.0, 4.0, 10.0)
    state_view.apply(fix, [])
    changed = {key for key, version in state_view.changed.items() if version > before}
    assert changed == {"telemetry/hawk"}
    assert then.keys() <= state_view.changed.keys()
    shown = state_view.telemetry["hawk"]
    assert shown.ground_speed_m_s == 5.0
    assert shown.track_deg == pytest.approx(53.1)
    assert shown.height_agl_m == pytest.approx(500.0 - 348.0, abs=2.0)


def test_alarms_are_raised_once_and_cleared(state_view: StateView) -> None:
    state_view.apply(VehicleConnected(1, "hawk", "px4 plane", True), [])
    for at_us in (2, 3):
        state_view.apply(LinkLost(at_us, "hawk", 3.0), [])
    state_view.apply(BatteryUpdated(4, "hawk", 12.0), [])
    state_view.apply(GpsFixChanged(5, "hawk", False, "none"), [])
    state_view.apply(CommandFinished(6, "hawk", "hold", False, "denied"), [])
    raised = {"link/hawk", "battery/hawk", "position/hawk", "order/hawk/hold"}
    assert set(state_view.alarms) == raised
    assert state_view.alarms["link/hawk"].at_us == 2
    state_view.apply(LinkRestored(7, "hawk"), [])
    state_view.apply(BatteryUpdated(8, "hawk", 28.0), [])
    assert "battery/hawk" in state_view.alarms, "not before it is well above the limit"
    state_view.apply(BatteryUpdated(9, "hawk", 31.0), [])
    state_view.apply(GpsFixChanged(10, "hawk", True, "3d"), [])
    state_view.apply(CommandFinished(11, "hawk", "hold", True, ""), [])
    assert not state_view.alarms
    assert state_view.cleared[0].alarm == "link/hawk"
    assert state_view.cleared[0].cleared_at_us == 7


def test_a_low_battery_stays_an_alarm_until_the_vehicle_is_on_the_ground(
    state_view: StateView,
) -> None:
    state_view.apply(ModeChanged(1, "hawk", 3, True, "mission"), [])
    state_view.apply(BatteryUpdated(2, "hawk", 12.0), [])
    for percent in (100.0, None):
        state_view.apply(BatteryUpdated(3, "hawk", percent), [])
        assert "battery/hawk" in state_view.alarms
    state_view.apply(ModeChanged(4, "hawk", 3, False, "hold"), [])
    state_view.apply(BatteryUpdated(5, "hawk", 100.0), [])
    assert "battery/hawk" not in state_view.alarms


def test_the_times_left_by_the_energy_are_shown_until_the_landing(state_view: StateView) -> None:
    state_view.apply(LinkRestored(70, "hawk"), [ReportEnergy("hawk", 720, 180, 60, "battery")])
    shown = state_view.vehicles["hawk"]
    times_s = (shown.time_on_task_s, shown.time_home_s, shown.time_landing_s)
    assert times_s == (720, 180, 60)
    assert (shown.must_land_at_us, shown.energy_source) == (960_000_070, "battery")
    against_the_wind = ReportEnergy("hawk", -1, None, 60, "battery")
    state_view.apply(LinkRestored(75, "hawk"), [against_the_wind])
    assert (shown.time_on_task_s, shown.must_land_at_us) == (-1, None)
    state_view.apply(LinkRestored(80, "hawk"), [ReportEnergy("hawk", None, None, None, "")])
    assert (shown.time_on_task_s, shown.time_home_s, shown.energy_source) == (None, None, "")
    assert (shown.time_landing_s, shown.must_land_at_us) == (None, None)


def test_the_state_of_the_remote_id_module_is_shown(state_view: StateView) -> None:
    shown = state_view.vehicles["hawk"]
    assert shown.remote_id == ""
    for event, words in (
        (RemoteIdChanged(70, "hawk", "ready", ""), "ready"),
        (RemoteIdChanged(80, "hawk", "fails", "no GPS lock"), "fails: no GPS lock"),
    ):
        state_view.apply(event, [])
        assert (shown.remote_id, shown.at_us) == (words, event.at_us)


def test_announcements_are_bounded_and_numbered(state_view: StateView) -> None:
    for _ in range(MAX_ANNOUNCEMENTS + 10):
        state_view.apply(LinkRestored(1, "hawk"), [Announce("hawk", "there")])
    assert len(state_view.announcements) == MAX_ANNOUNCEMENTS
    ids = [line.id for line in state_view.announcements]
    assert ids == sorted(set(ids))
    assert ids[-1] <= state_view.version


def test_decisions_are_shown(state_view: StateView) -> None:
    decided = DirectionDecision("hawk", "anticlockwise", True, 4, 3.25, 1.5, 99)
    state_view.apply(LinkRestored(70, "hawk"), [decided])
    shown = state_view.vehicles["hawk"]
    assert (shown.direction, shown.reversed_at_us) == ("anticlockwise", 70)
    assert (shown.importance_back, shown.importance_front) == (3.25, 1.5)
    # The planner's count includes decisions that were not published, for example during a hold.
    assert shown.reversals == state_view.statistics.vehicles["hawk"].reversal_count == 1


def at(name: str, lat_deg: float, altitude_m: float, at_us: int = 0) -> TelemetryState:
    place = (lat_deg, -84.0, altitude_m, altitude_m)
    return TelemetryState(at_us, name, *place, None, 0.0, 15.0, 0.0)


def test_pairs_too_near_are_found() -> None:
    there = {
        "a": at("a", 36.0, 100.0),
        "b": at("b", 36.0 + 20.0 / 111_195.0, 110.0),
        "c": at("c", 36.0, 5.0),  # on the ground
        "d": at("d", 36.0, 300.0),
    }
    found = near_pairs(there, 0, 30.0)
    assert list(found) == [("a", "b")]
    assert found["a", "b"] == pytest.approx((20.0**2 + 10.0**2) ** 0.5, abs=0.1)
    assert not near_pairs(there, 10_000_000, 30.0), "old places do not count"


def test_pairs_too_near_raise_an_alarm_until_they_are_apart(state_view: StateView) -> None:
    alarms = ProximityAlarms(state_view, 30.0)
    state_view.telemetry = {"a": at("a", 36.0, 100.0), "b": at("b", 36.0, 110.0)}
    alarms.check_pairs(0)
    assert set(state_view.alarms) == {"near/a/b"}
    state_view.telemetry["b"] = at("b", 36.1, 110.0)
    alarms.check_pairs(400_000)
    assert set(state_view.alarms) == {"near/a/b"}, "not due"
    alarms.check_pairs(1_200_000)
    assert not state_view.alarms


def test_a_blocked_event_loop_raises_an_alarm_until_it_is_in_time(state_view: StateView) -> None:
    health_monitor = HealthMonitor(state_view, 200_000)
    health_monitor.check_delay(0)
    assert not state_view.alarms
    health_monitor.check_delay(1_200_000)
    assert set(state_view.alarms) == {"late"}
    health_monitor.check_delay(1_400_000)
    assert not state_view.alarms


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (('service.http.listen="0.0.0.0:80"',), "is not a loopback address: set `tokens`"),
        (('service.http.listen="8765"',), "write it as HOST:PORT"),
        (
            ('service.mqtt.password="hunter2"',),
            'specify the source of the password, as "file:PATH"',
        ),
        (("service.journal.rotate_mb=0",), "service.journal.rotate_mb"),
        (("service.http.port=1",), "service.http.port: unknown key"),
        (("service.http=true",), "service.http: use false, or a table [service.http]"),
    ],
)
def test_settings_of_the_service_are_checked(overrides: tuple[str, ...], words: str) -> None:
    with pytest.raises(ScenarioError) as error:
        load_run("demo", overrides)
    assert words in str(error.value)
    assert "hunter2" not in str(error.value)


def test_the_map_is_on_loopback_by_default_and_can_be_disabled() -> None:
    for overrides in ((), ("service.on_shutdown=hold",), ('service.http.hosts=["fire.example"]',)):
        http = load_run("default", overrides)[1].http
        assert http is not None
        assert http.listen is None
        assert (http.host, http.port) == ("127.0.0.1", 8765)
    given = load_run("default", ('service.http.listen="127.0.0.1:8765"',))[1].http
    assert given is not None
    assert given.listen is not None
    assert load_run("default", ("service.http=false",))[1].http is None


def test_settings_are_no_part_of_the_scenario(tmp_path: Path) -> None:
    scenario, service = load_run("demo", ('service.http.listen="[::1]:9000"',))
    assert service.http is not None
    assert (service.http.host, service.http.port) == ("::1", 9000)
    assert "service" not in scenario.model_dump()
    assert load_scenario("demo") == scenario


def test_an_orbit_is_shown_with_what_its_camera_covers_until_it_is_flown_no_more() -> None:
    scenario = load_scenario("virtual-agents")
    state_view = StateView(scenario, landscape_of(scenario), 0)
    section = scenario.vehicles[0]
    name, mode = section.name, ModeChanged(2, section.name, 0, True, "guided")
    ordered = Orbit(name, 36.36, -84.14, 700.0, -90.0)
    width_m = 2.0 * section.altitude_agl_m * math.tan(math.radians(section.camera_fov_deg) / 2.0)
    no_more: list[AnyEvent] = [
        VehicleRebooted(3, name),
        ModeChanged(3, name, 0, False, "auto"),
        OrderGiven(3, "ann", "desk", name, "hold"),
        Aborted(3, "ann", "desk"),
    ]
    for event in no_more:
        state_view.apply(mode, [ordered, UploadMission(name, 1, "loiter on a circle nearby", ())])
        shown = state_view.vehicles[name].orbit
        assert shown is not None
        assert (shown.lat_deg, shown.radius_m) == (36.36, -90.0)
        assert shown.view_width_m == pytest.approx(width_m, abs=0.1)
        state_view.apply(event, [])
        assert state_view.vehicles[name].orbit is None
