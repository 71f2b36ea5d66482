"""Alerts about other aircraft and their resolution, in the core and in flights with a mock."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import (
    AlertOnAircraft,
    Announce,
    AnyCommand,
    ClearAlarm,
    Command,
    Hold,
    HoldAt,
    OrderByService,
    RaiseAlarm,
    Return,
    UploadMission,
)
from mission_service.config.scenario import load_scenario
from mission_service.config.surveillance_section import AircraftSource
from mission_service.core.core import Core
from mission_service.errors import ScenarioError
from mission_service.events import (
    SERVICE,
    AircraftReported,
    AircraftState,
    AirspaceClosed,
    AnyEvent,
    CommandFinished,
    LandedStateChanged,
    ModeChanged,
    OrderGiven,
    Telemetry,
    UploadFinished,
    VehicleConnected,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.ground_distance import distance_m
from mission_service.journal.snapshot import Frozen, Known, restore
from mission_service.surveillance.aircraft_reports import AircraftReports
from tests.service.aircraft_messages import Aircraft, sbs_lines
from tests.service.intruders import fly_past, meeting
from tests.service.people_flights import ANN, Flight, Fly, flights_in

PLACE = (36.3708, -84.1323)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("demo"))


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


class Aloft:
    """A vehicle in the air over its home, with an aircraft in the north that flies south."""

    def __init__(self, land: Landscape, resolution: str, height_m: float = 150.0) -> None:
        self.scenario = load_scenario("demo", (f'surveillance.resolution="{resolution}"',))
        self.sent: list[AnyCommand] = []
        self.core, self.at_s, self.height_m = Core(self.scenario, land), 4000.0, height_m
        x_m, y_m = land.xy_of_lat_lon(*PLACE)
        self.ground_m = float(land.elevation_at(x_m, y_m))
        self.handle(VehicleConnected(self.at_us, "hawk", "px4 plane", True))
        self.handle(ModeChanged(self.at_us, "hawk", 0, False, "hold"))
        self.moved(0.0)
        self.handle(ModeChanged(self.at_us, "hawk", 0, True, "mission"))
        for _ in range(3):
            self.moved(height_m)

    @property
    def at_us(self) -> int:
        return round(self.at_s * 1e6)

    def handle(self, event: AnyEvent) -> list[AnyCommand]:
        commands = self.core.handle(event)
        for command in commands:
            if isinstance(command, UploadMission):
                done = UploadFinished(self.at_us, "hawk", command.mission_id, "accepted", "")
                commands = [*commands, *self.core.handle(done)]
        self.core.validate_state()
        self.sent += commands
        return commands

    def moved(self, height_m: float) -> list[AnyCommand]:
        self.at_s += 1.0
        altitude_m = self.ground_m + height_m
        return self.handle(
            Telemetry(self.at_us, "hawk", *PLACE, altitude_m, height_m, 0.0, 0.0, 0.0)
        )

    def report(self, *aircraft: AircraftState) -> list[AnyCommand]:
        """Report aircraft a second later."""
        self.moved(self.height_m)
        return self.handle(AircraftReported(self.at_us, "hawk", aircraft))

    def aircraft(
        self, north_m: float, name: str = "a4c2f1", up_m: float = 0.0, **changed: Any
    ) -> AircraftState:
        lat_deg = PLACE[0] + north_m / 111_195.0
        altitude_m = self.ground_m + self.height_m + up_m
        motion = (-50.0, 0.0, 0.0)
        found = AircraftState(name, "", lat_deg, PLACE[1], altitude_m, *motion, 0.5, "sbs")
        return msgspec.structs.replace(found, **changed)

    def order(self, command: AnyCommand) -> list[AnyCommand]:
        """Give an order of the service as the engine does."""
        assert isinstance(command, OrderByService)
        named = (command.vehicle, command.order)
        return self.handle(OrderGiven(self.at_us, SERVICE, "", *named, hold_at=command.hold_at))


def orders(commands: list[AnyCommand]) -> list[OrderByService]:
    return [each for each in commands if isinstance(each, OrderByService)]


def kinds(commands: list[AnyCommand], *kind: type[Command]) -> list[AnyCommand]:
    return [each for each in commands if isinstance(each, kind)]


def test_alerts_rise_and_end_with_an_alarm(land: Landscape) -> None:
    aloft = Aloft(land, "none")
    assert aloft.report(aloft.aircraft(9000.0)) == []
    near = aloft.aircraft(2500.0)  # not well clear in 38 s
    assert aloft.report(near) == [], "one of four values is not enough"
    found = aloft.report(near)
    (alarm,) = kinds(found, RaiseAlarm)
    assert isinstance(alarm, RaiseAlarm)
    assert alarm.severity == "warning"
    assert alarm.text == "aircraft a4c2f1 2.5 km at 000 deg, 0 m above: not well clear in 38 s"
    assert kinds(found, AlertOnAircraft) == [AlertOnAircraft("hawk", "a4c2f1", 2)]
    assert len(kinds(found, Announce)) == 1
    assert aloft.report(near) == [], "neither alarm nor announcement is repeated"
    closer = aloft.aircraft(1500.0)
    found = [*aloft.report(closer), *aloft.report(closer)]
    assert [each.severity for each in found if isinstance(each, RaiseAlarm)] == ["severe"]
    away = aloft.aircraft(-1500.0)
    found = [command for _ in range(8) for command in aloft.report(away)]
    assert kinds(found, ClearAlarm) == [ClearAlarm("hawk", "aircraft")]
    assert kinds(found, AlertOnAircraft)[-1] == AlertOnAircraft("hawk", "a4c2f1", 0)
    assert not orders(found)


def test_an_aircraft_that_is_no_longer_received_ends_its_alert(land: Landscape) -> None:
    aloft = Aloft(land, "none")
    near = aloft.aircraft(2500.0)
    aloft.report(near), aloft.report(near)
    found = aloft.report()
    assert kinds(found, ClearAlarm)
    assert kinds(found, AlertOnAircraft) == [AlertOnAircraft("hawk", "a4c2f1", 0)]
    (line,) = kinds(found, Announce)
    assert isinstance(line, Announce)
    assert "no longer received" in line.text


def test_on_the_ground_there_are_no_alerts(land: Landscape) -> None:
    aloft = Aloft(land, "hold", height_m=0.0)
    assert [aloft.report(aloft.aircraft(500.0)) for _ in range(4)] == [[]] * 4


def test_each_resolution_gives_its_order_once_for_a_conflict(land: Landscape) -> None:
    sent: dict[str, type[Command]] = {"hold": Hold, "descend": HoldAt, "return": Return}
    for resolution, kind in sent.items():
        aloft = Aloft(land, resolution)
        near = aloft.aircraft(2500.0)
        (order,) = orders([*aloft.report(near), *aloft.report(near)])
        assert len(kinds(aloft.order(order), kind)) == 1
        again = [each for _ in range(12) for each in aloft.report(near)]
        assert not orders(again)
        assert aloft.core.decision_engine.availability["hawk"].taken_over is False


def test_a_descent_is_to_the_height_above_the_highest_ground_around(land: Landscape) -> None:
    aloft = Aloft(land, "descend")
    near = aloft.aircraft(2500.0)
    (order,) = orders([*aloft.report(near), *aloft.report(near)])
    assert order.order == "hold"
    assert order.hold_at is not None
    lat_deg, lon_deg, altitude_m = order.hold_at
    assert (lat_deg, lon_deg) == PLACE
    x_m, y_m = land.xy_of_lat_lon(*PLACE)
    radius_m = 2.0 * aloft.scenario.vehicles[0].loiter_radius_m
    around = [
        float(land.elevation_at(x_m + east * radius_m, y_m + north * radius_m))
        for east in (-1.0, -0.5, 0.0, 0.5, 1.0)
        for north in (-1.0, -0.5, 0.0, 0.5, 1.0)
    ]
    assert altitude_m >= max(around) + 40.0 - 0.1
    assert altitude_m < aloft.ground_m + 150.0


def close_around(aloft: Aloft, west_deg: float, east_deg: float) -> None:
    """Close a volume without limits of height between two longitudes, relative to the vehicle."""
    south_deg, north_deg = PLACE[0] - 0.2, PLACE[0] + 0.2
    west_deg, east_deg = PLACE[1] + west_deg, PLACE[1] + east_deg
    corners = (
        (south_deg, west_deg),
        (north_deg, west_deg),
        (north_deg, east_deg),
        (south_deg, east_deg),
    )
    aloft.handle(AirspaceClosed(aloft.at_us, *ANN, "range", corners, None, None, None))


def test_a_descent_beside_closed_airspace_is_to_the_nearest_free_place(land: Landscape) -> None:
    aloft = Aloft(land, "descend")
    east_m = 150.0  # more than the margin, less than the margin and the loiter
    edge_deg = east_m / distance_m(PLACE, (PLACE[0], PLACE[1] + 1.0))
    close_around(aloft, edge_deg, edge_deg + 0.02)
    (order,) = orders(aloft.report(aloft.aircraft(2000.0)))
    assert order.hold_at is not None
    assert order.hold_at[:2] == PLACE
    (hold,) = kinds(aloft.order(order), HoldAt)
    assert isinstance(hold, HoldAt)
    edge = (hold.lat_deg, PLACE[1] + edge_deg)
    section = aloft.scenario.vehicles[0]
    free_m = aloft.scenario.airspace.margin_m + section.loiter_radius_m
    assert distance_m((hold.lat_deg, hold.lon_deg), edge) >= free_m
    assert distance_m((hold.lat_deg, hold.lon_deg), PLACE) < 2.0 * section.loiter_radius_m
    assert hold.altitude_amsl_m < aloft.ground_m + aloft.height_m - 10.0
    assert aloft.core.vehicles["hawk"].hold_at == (hold.lat_deg, hold.lon_deg, hold.altitude_amsl_m)


def test_without_a_free_place_a_vehicle_holds_instead_of_a_descent(land: Landscape) -> None:
    aloft = Aloft(land, "descend")
    (order,) = orders(aloft.report(aloft.aircraft(2000.0)))
    close_around(aloft, -0.2, 0.2)
    commands = aloft.order(order)
    assert kinds(commands, Hold, HoldAt) == [Hold("hawk")]
    (alarm,) = kinds(commands, RaiseAlarm)
    assert isinstance(alarm, RaiseAlarm)
    assert "every lower hold would enter" in alarm.text


def test_a_descent_never_climbs_and_stays_above_a_vehicle_below(land: Landscape) -> None:
    low = Aloft(land, "descend", height_m=45.0)
    near = low.aircraft(2500.0)
    (order,) = orders([*low.report(near), *low.report(near)])
    assert order.hold_at is None, "a hold at the present altitude"
    above = Aloft(land, "descend")
    other = above.scenario.vehicles[1].name
    altitude_m = above.ground_m + 80.0
    above.handle(Telemetry(above.at_us, other, *PLACE, altitude_m, 80.0, 0.0, 0.0, 0.0))
    near = above.aircraft(2500.0)
    (order,) = orders([*above.report(near), *above.report(near)])
    assert order.hold_at is not None
    assert order.hold_at[2] == pytest.approx(altitude_m + 30.0, abs=0.1)


@pytest.mark.parametrize(
    ("north_m", "up_m", "climb_m_s", "descends"),
    [
        (2500.0, 20.0, 0.0, True),
        (2500.0, -60.0, 0.0, False),  # level below: the vehicle would descend to it
        (2500.0, 120.0, -4.0, False),  # descends to a drop, faster than the vehicle
        (2500.0, -60.0, 2.0, True),  # climbs to the vehicle's altitude
    ],
)
def test_a_vehicle_does_not_descend_towards_another_aircraft(
    land: Landscape, north_m: float, up_m: float, climb_m_s: float, descends: bool
) -> None:
    aloft = Aloft(land, "descend")
    near = aloft.aircraft(north_m, up_m=up_m, climb_m_s=climb_m_s)
    commands = [*aloft.report(near), *aloft.report(near)]
    (order,) = orders(commands)
    assert (order.hold_at is not None) == descends
    texts = [each.text for each in commands if isinstance(each, Announce)]
    assert any("a descent would conflict" in each for each in texts) != descends


def test_a_distant_aircraft_without_an_alert_does_not_prevent_a_descent(land: Landscape) -> None:
    aloft = Aloft(land, "descend")
    near, far = aloft.aircraft(2500.0, up_m=35.0), aloft.aircraft(8000.0, "b4c2f1", up_m=-85.0)
    (order,) = orders([*aloft.report(near, far), *aloft.report(near, far)])
    assert order.hold_at is not None


def test_an_operator_who_resumes_decides_until_the_conflict_ends(land: Landscape) -> None:
    aloft = Aloft(land, "hold")
    near = aloft.aircraft(2500.0)
    (order,) = orders([*aloft.report(near), *aloft.report(near)])
    aloft.order(order)
    aloft.handle(OrderGiven(aloft.at_us, *ANN, "hawk", "resume"))
    assert not orders([each for _ in range(12) for each in aloft.report(near)])
    for _ in range(8):
        aloft.report(aloft.aircraft(-1500.0))  # the conflict ends
    found = [each for _ in range(3) for each in aloft.report(near)]
    assert len(orders(found)) == 1, "a new conflict with the same aircraft"


def test_without_the_own_position_an_alert_does_not_end(land: Landscape) -> None:
    aloft = Aloft(land, "hold")
    reports = AircraftReports(aloft.scenario.surveillance)
    sbs = reports.decoder(AircraftSource(format="sbs", address="127.0.0.1:30003"))
    craft = Aircraft(
        0xA4C2F1, PLACE[0] + 2500.0 / 111_195.0, PLACE[1], aloft.ground_m + 150.0, -50.0
    )
    fixes: dict[str, Telemetry] = {}

    def pass_time(seconds: int, own_received: bool = True) -> list[AnyCommand]:
        """Receive the aircraft and, if stated, the vehicle once a second."""
        found: list[AnyCommand] = []
        for _ in range(seconds):
            aloft.at_s += 1.0
            if own_received:
                altitudes_m = (aloft.ground_m + 150.0, 150.0)
                fixes["hawk"] = Telemetry(aloft.at_us, "hawk", *PLACE, *altitudes_m, 0.0, 0.0, 0.0)
                aloft.handle(fixes["hawk"])
            sbs.decode(sbs_lines(craft), aloft.at_us)
            for event in reports.events_due(fixes, aloft.at_us):
                found += aloft.handle(event)
        return found

    (order,) = orders(pass_time(5))
    aloft.order(order)
    aloft.handle(OrderGiven(aloft.at_us, *ANN, "hawk", "resume"))
    (line,) = pass_time(13, own_received=False)
    assert isinstance(line, Announce)
    assert line.text == "own position is too old: the alerts about other aircraft are not updated"
    assert not kinds(pass_time(8), AlertOnAircraft, ClearAlarm, Announce, OrderByService)
    craft.lat_deg = PLACE[0] - 1500.0 / 111_195.0
    assert kinds(pass_time(8), ClearAlarm) == [ClearAlarm("hawk", "aircraft")]


def test_another_aircraft_is_another_conflict_but_a_hold_is_not_repeated(land: Landscape) -> None:
    aloft = Aloft(land, "descend")
    near, second = aloft.aircraft(2500.0), aloft.aircraft(2400.0, "b00001")
    (order,) = orders([*aloft.report(near), *aloft.report(near)])
    aloft.order(order)
    assert not orders([each for _ in range(9) for each in aloft.report(near, second)])
    aloft.handle(OrderGiven(aloft.at_us, *ANN, "hawk", "resume"))
    found = orders([each for _ in range(9) for each in aloft.report(near, second)])
    assert len(found) == 2, "about the second aircraft; given again, because it was not applied"


def test_no_order_changes_a_mode_that_others_chose(land: Landscape) -> None:
    """A failsafe, a pilot's mode, a return, an operator's hold and a landing are left alone."""
    for mode in ("return", "land", "position"):
        aloft = Aloft(land, "hold")
        aloft.handle(ModeChanged(aloft.at_us, "hawk", 0, True, mode))
        near = aloft.aircraft(2500.0)
        found = [each for _ in range(8) for each in aloft.report(near)]
        assert kinds(found, RaiseAlarm)
        assert not orders(found), mode
    held = Aloft(land, "descend")
    held.handle(OrderGiven(held.at_us, *ANN, "hawk", "hold"))
    near = held.aircraft(2500.0)
    assert not orders([each for _ in range(8) for each in held.report(near)])
    landing = Aloft(land, "descend")
    landing.handle(LandedStateChanged(landing.at_us, "hawk", "landing"))
    near = landing.aircraft(2500.0)
    assert not orders([each for _ in range(8) for each in landing.report(near)])
    low = Aloft(land, "hold", height_m=18.0)
    near = low.aircraft(2500.0)
    assert not orders([each for _ in range(8) for each in low.report(near)])


def test_an_order_of_the_service_that_comes_too_late_is_not_sent(land: Landscape) -> None:
    aloft = Aloft(land, "hold")
    near = aloft.aircraft(2500.0)
    (order,) = orders([*aloft.report(near), *aloft.report(near)])
    aloft.handle(ModeChanged(aloft.at_us, "hawk", 0, True, "position"))
    assert not kinds(aloft.order(order), Hold)


def test_a_lower_hold_is_sent_again_until_the_autopilot_accepts_it(land: Landscape) -> None:
    aloft = Aloft(land, "descend")
    near = aloft.aircraft(2500.0)
    (order,) = orders([*aloft.report(near), *aloft.report(near)])
    (sent,) = kinds(aloft.order(order), HoldAt)
    aloft.at_s += 0.25  # a refusal at the same time would be that of a hold that this one replaced
    aloft.handle(
        CommandFinished(
            aloft.at_us, "hawk", "hold at another height", False, "temporarily rejected"
        )
    )
    aloft.sent.clear()
    for _ in range(6):
        aloft.report(near)
    assert kinds(aloft.sent, HoldAt) == [sent]
    aloft.handle(CommandFinished(aloft.at_us, "hawk", "hold at another height", True, ""))
    aloft.sent.clear()
    for _ in range(40):
        aloft.report(near)
    assert not kinds(aloft.sent, HoldAt, Hold)
    aloft.handle(OrderGiven(aloft.at_us, *ANN, "hawk", "hold"))
    assert aloft.core.vehicles["hawk"].hold_at is None, "an operator's hold is at the position"


def test_a_snapshot_continues_with_the_same_commands(land: Landscape) -> None:
    aloft = Aloft(land, "descend")
    near = aloft.aircraft(2500.0)
    aloft.report(aloft.aircraft(9000.0))
    aloft.report(near)
    known = Known(aloft.scenario, land)
    copy = restore(Frozen({"core": aloft.core}, known))["core"]
    aloft.moved(150.0)
    event = AircraftReported(aloft.at_us, "hawk", (near,))
    fix = Telemetry(aloft.at_us, "hawk", *PLACE, aloft.ground_m + 150.0, 150.0, 0.0, 0.0, 0.0)
    copy.handle(fix)
    expected = aloft.core.handle(event)
    assert orders(expected)
    assert copy.handle(event) == expected


def test_a_burn_has_no_resolution() -> None:
    changes = ('surveillance.resolution="hold"',)
    with pytest.raises(ScenarioError, match='must be "none" in a burn'):
        load_scenario("burn", changes)
    assert load_scenario("burn", ('surveillance.resolution="none"',)).surveillance is not None


def test_a_descent_needs_the_native_client() -> None:
    overrides = ('vehicles.0.backend="mavsdk"', "vehicles.0.link=udpin:127.0.0.1:14999")
    with pytest.raises(ScenarioError, match="cannot hold at another altitude"):
        load_scenario("default", (*overrides, 'surveillance={resolution="descend"}'))
    load_scenario("default", (*overrides, 'surveillance={resolution="hold"}'))


# Flights ---------------------------------------------------------------------------------------


def flown(fly: Fly, resolution: str) -> tuple[Flight, Any]:
    flight = fly(f'surveillance.resolution="{resolution}"')
    flight.run(120.0)
    assert flight.mode == "mission"
    return flight, fly_past(flight.sim, meeting(flight.sim, 60.0, track_deg=200.0), 100)


def test_a_plane_descends_below_an_aircraft_and_resumes_on_order(fly: Fly) -> None:
    flight, passed = flown(fly, "descend")
    view = flight.state_view
    assert (flight.mode, view.vehicles["hawk"].order) == ("hold", "hold")
    assert passed.violated_s == 0.0
    height_m = view.telemetry["hawk"].height_agl_m
    assert height_m is not None
    assert height_m < 100.0
    (shown,) = view.aircraft()
    assert (shown.aircraft, shown.callsign, shown.source) == ("a4c2f1", "N417EA", "mavlink hawk")
    flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "resume"))
    flight.run(60.0)
    assert flight.mode == "mission"
    assert "aircraft/hawk" not in view.alarms
    entries = flight.over()  # the journal is verified
    given = [each for each in entries if isinstance(each, OrderGiven) and each.by == SERVICE]
    assert len(given) == 1


@pytest.mark.parametrize(("resolution", "mode"), [("hold", "hold"), ("return", "return")])
def test_a_plane_holds_or_returns(fly: Fly, resolution: str, mode: str) -> None:
    flight, _ = flown(fly, resolution)
    assert flight.mode == mode
    flight.over()


def test_without_a_resolution_there_is_only_an_alarm(fly: Fly) -> None:
    flight = fly('surveillance.resolution="none"')
    flight.run(120.0)
    fly_past(flight.sim, meeting(flight.sim, 40.0, track_deg=90.0), 60)
    assert flight.mode == "mission"
    entries = flight.over()
    raised = [each for each in entries if isinstance(each, RaiseAlarm) and each.alarm == "aircraft"]
    assert raised
    assert not [each for each in entries if isinstance(each, OrderGiven | OrderByService)]
