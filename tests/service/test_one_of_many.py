"""A process that flies one vehicle of many: the vehicle, its messages, its time."""

from pathlib import Path
from typing import cast

import pytest
from click.testing import CliRunner

from mission_service.cli.main import main
from mission_service.commands import (
    Announce,
    AnyCommand,
    BroadcastMessage,
    ChangeSpeed,
    Hold,
    Orbit,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.scenario import Scenario, load_scenario, one_of_many
from mission_service.core.core import Core
from mission_service.core.mission_starts import TAKEOFF_EVERY_S
from mission_service.errors import ScenarioError
from mission_service.events import (
    Aborted,
    AnyEvent,
    CommandFinished,
    MissionRequested,
    ModeChanged,
    OrderGiven,
    PeerLinkChanged,
    PeerMessage,
    Resumed,
    Telemetry,
    UploadFinished,
    VehicleConnected,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.guidance.formation.controller import FormationFlight
from mission_service.journal.journal_file import Journal, SegmentReader, header_of
from mission_service.peer_messages import AnyMessage, Digest, FireUpdate, Leaving, State
from mission_service.replay.verification import verify
from mission_service.runtime.gateway import Gateway, MissionClock
from tests.service.test_gateway import Client, at

S = 1_000_000


def scenario(peer_messaging: bool = True, *settings: str) -> Scenario:
    whole = load_scenario("virtual-agents", ("fire.initial_cells=50", *settings))
    return one_of_many(whole, "crane", peer_messaging)


class Flown:
    """The core of crane, with the vehicle in the air in its mission."""

    def __init__(self, peer_messaging: bool = True, *settings: str) -> None:
        self.scenario = scenario(peer_messaging, *settings)
        self.core = Core(self.scenario, landscape_of(self.scenario))
        self.home = self.scenario.flown[0]
        self.events: list[AnyEvent] = [
            VehicleConnected(0, "crane", "px4 plane", True),
            self.at(1, 0.0),
            UploadFinished(2 * S, "crane", 1, "accepted", ""),
            ModeChanged(3 * S, "crane", 0, True, "mission"),
            PeerLinkChanged(4 * S, "crane", True),
        ]
        for event in self.events:
            self.core.handle(event)

    def at(self, second: int, north_deg: float) -> Telemetry:
        height_m = 0.0 if north_deg == 0.0 else 250.0
        lat_deg, lon_deg = self.home.home_lat_deg + north_deg, self.home.home_lon_deg
        place = (lat_deg, lon_deg, 600.0 + height_m, height_m)
        return Telemetry(second * S, "crane", *place, 17.0, 0.0, 0.0)

    def flies(self, *seconds: int) -> list[AnyMessage]:
        """Fly; return the messages that were sent."""
        sent: list[AnyMessage] = []
        for second in seconds:
            commands = self.core.handle(self.at(second, 0.006 + 15e-5 * second))
            sent += [each.message for each in commands if isinstance(each, BroadcastMessage)]
        return sent

    def receive(self, second: int, message: AnyMessage) -> list[str]:
        commands = self.core.handle(PeerMessage(second * S, "crane", message))
        return [each.text for each in commands if isinstance(each, Announce)]

    @property
    def peers(self) -> int:
        guidance = cast(FormationFlight, self.core.guidance)
        assert list(guidance.formation.members) == ["crane"]
        return len(guidance.formation.members["crane"].agent.peers.rows(10 * S))


def state_of(state: State, sender: str, north_m: float) -> State:
    assert state.agent_y_m is not None
    return State(
        state.at_us, sender, state.x_m, state.y_m + north_m, state.altitude_amsl_m, 0.0, 17.0,
        state.agent_x_m, state.agent_y_m + north_m, state.orbit_x_m, state.orbit_y_m + north_m,
        -150.0, 17.5, False,
    )  # fmt: skip


def test_messages_of_its_agent_are_commands_and_those_of_others_events() -> None:
    crane = Flown()
    sent = crane.flies(9)
    states = [message for message in sent if isinstance(message, State)]
    assert {message.sender for message in sent} == {"crane"}
    assert len(states) == 1
    assert any(isinstance(message, Digest) for message in sent)
    assert crane.receive(9, state_of(states[0], "eagle", 500.0)) == []
    assert crane.peers == 1
    # Beyond the range in which states are received.
    crane.receive(9, state_of(states[0], "heron", 2500.0))
    assert crane.peers == 1
    crane.receive(9, Leaving(9 * S, "eagle", "home"))
    assert crane.peers == 0


def test_without_contact_it_circles_on_where_it_is() -> None:
    crane = Flown()
    assert crane.flies(9)
    crane.core.handle(PeerLinkChanged(9 * S, "crane", False))
    for second in range(10, 40):
        assert crane.core.handle(crane.at(second, 0.006 + 15e-5 * second)) == []
    crane.core.handle(PeerLinkChanged(40 * S, "crane", True))
    assert crane.flies(40)


def with_little_endurance() -> Flown:
    crane = Flown(True, *(f"vehicles.{number}.endurance_s=2400" for number in range(8)))
    crane.flies(9)
    return crane


def ordered_home(crane: Flown, *seconds: int) -> tuple[list[int], list[int]]:
    """Circle far from home; return when the vehicle was guided home, and when Return was sent."""
    guided_s, returns_s = [], []
    for second in seconds:
        commands = crane.core.handle(crane.at(second, 0.05))
        if any(isinstance(each, Return) for each in commands):
            returns_s.append(second)
        if any(isinstance(each, Announce) and "guided home" in each.text for each in commands):
            assert any(isinstance(each, Orbit) for each in commands)
            guided_s.append(second)
    return guided_s, returns_s


def test_without_contact_the_autopilot_returns_when_the_time_on_task_ends() -> None:
    crane = with_little_endurance()
    crane.core.handle(PeerLinkChanged(1600 * S, "crane", False))
    guided_s, (return_s,) = ordered_home(crane, *range(1600, 2000))
    assert not guided_s
    estimate = crane.core.vehicles["crane"].energy.estimate
    assert estimate is not None
    assert -estimate.time_on_task_s == pytest.approx(2000 - return_s, abs=3.0)


def test_when_contact_is_lost_the_autopilot_flies_the_rest_of_the_way_home() -> None:
    crane = with_little_endurance()
    guided_s, returns_s = ordered_home(crane, *range(1600, 2000))
    assert (len(guided_s), returns_s) == (1, [])
    crane.core.handle(PeerLinkChanged(2000 * S, "crane", False))
    assert ordered_home(crane, *range(2000, 2010)) == ([], [2000])


def test_an_orbit_that_closed_airspace_withholds_is_not_counted_as_ordered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    crane, tried_s = Flown(), []
    checked = crane.core.airspace.checked

    def withheld(commands: list[AnyCommand], at_s: float, accepted: bool) -> list[AnyCommand]:
        """Withhold the first orbit, as the airspace guard does."""
        if any(isinstance(each, Orbit) for each in commands):
            tried_s.append(at_s)
        orbits = (Orbit,) if len(tried_s) == 1 else ()
        return checked([each for each in commands if not isinstance(each, orbits)], at_s, accepted)

    monkeypatch.setattr(crane.core.airspace, "checked", withheld)
    orbits_s = []
    for second in range(9, 40):
        commands = crane.core.handle(crane.at(second, 0.02))
        orbits_s += [second for each in commands if isinstance(each, Orbit)]
        if any(isinstance(each, ChangeSpeed) for each in commands):
            crane.core.handle(CommandFinished(second * S, "crane", "change speed", True, ""))
    assert orbits_s[0] - tried_s[0] <= 5.0


def test_each_has_its_time_to_take_off() -> None:
    whole = scenario()
    core = Core(whole, landscape_of(whole))
    home = whole.flown[0]
    core.handle(VehicleConnected(0, "crane", "px4 plane", True))
    started_at_s = None
    for second in range(1, 60):
        place = (home.home_lat_deg, home.home_lon_deg, 600.0, 0.0)
        commands = core.handle(Telemetry(second * S, "crane", *place, 0.0, 0.0, 0.0))
        if any(isinstance(each, UploadMission) for each in commands):
            commands = core.handle(UploadFinished(second * S, "crane", 1, "accepted", ""))
        if started_at_s is None and any(isinstance(each, StartMission) for each in commands):
            started_at_s = second
    assert started_at_s == pytest.approx(2 * TAKEOFF_EVERY_S, abs=2.0)  # the third vehicle


def test_an_agent_without_peers_sends_nothing() -> None:
    assert Flown(peer_messaging=False).flies(9, 10, 11) == []


def test_cells_of_another_map_are_left_out_and_reported_once() -> None:
    crane = Flown()
    wrong = FireUpdate(9 * S, "eagle", (10**9,))
    (line,) = crane.receive(9, wrong)
    assert "eagle" in line
    assert "not on the map" in line
    assert crane.receive(10, wrong) == []


def test_a_journal_holds_messages_sent_and_received_and_replays(tmp_path: Path) -> None:
    crane = Flown()
    fresh = Core(crane.scenario, landscape_of(crane.scenario))
    path = tmp_path / "journal.jsonl"
    journal = Journal(path, header_of(crane.scenario, fresh.landscape.digest(), ""), durable=False)
    (state,) = [each for each in crane.flies(9) if isinstance(each, State)]
    events: list[AnyEvent] = [
        PeerMessage(9 * S, "crane", state_of(state, "eagle", 200.0)),
        PeerMessage(9 * S, "crane", FireUpdate(9 * S, "eagle", (7,))),
        PeerMessage(9 * S, "crane", FireUpdate(9 * S, "eagle", (10**9,))),
    ]
    for event in [*crane.events, crane.at(9, 0.006), *events, crane.at(10, 0.0062)]:
        journal.write_event(event)
        journal.write_commands(fresh.handle(event))
    journal.close()
    kinds = {type(entry.content).__name__ for entry in SegmentReader(path)}
    assert {"PeerMessage", "BroadcastMessage"} <= kinds
    result = verify(path)
    assert (result.difference, result.cut_at_line) == (None, None)


def test_orders_to_all_go_to_the_local_vehicle() -> None:
    crane, ann = Flown(), ("ann", "desk")
    crane.flies(9)
    for event in (
        Aborted(10 * S, *ann),
        OrderGiven(11 * S, *ann, "", "hold"),
        OrderGiven(12 * S, *ann, "heron", "hold"),
        MissionRequested(13 * S, *ann, ""),
        OrderGiven(14 * S, *ann, "", "return"),
        Resumed(15 * S, *ann, 1.0),
    ):
        commands = crane.core.handle(event)
        assert {command.vehicle for command in commands} <= {"crane"}
        if isinstance(event, Aborted):
            assert any(isinstance(command, Hold) for command in commands)


def test_only_its_own_vehicle_is_flown() -> None:
    assert [section.name for section in scenario().flown] == ["crane"]
    assert len(scenario().vehicles) == 8
    with pytest.raises(
        ScenarioError, match="--vehicle dodo: no such vehicle; virtual-agents has heron, stork"
    ):
        one_of_many(load_scenario("virtual-agents"), "dodo", peer_messaging=True)
    with pytest.raises(ScenarioError, match='--broker requires rule = "formation"'):
        one_of_many(load_scenario("team"), None, peer_messaging=True)
    with pytest.raises(ScenarioError, match="`only`: there is no vehicle dodo"):
        load_scenario("team", ('only="dodo"',))


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--broker", "mqtt://x"], "--broker mqtt://x: write it as HOST or HOST:PORT"),
        (["--broker", "x", "--prefix", "a/#"], "--prefix a/#"),
        (["--vehicle", "dodo"], "--vehicle dodo"),
    ],
)
def test_the_command_reports_what_is_wrong_with_its_flags(
    tmp_path: Path, flags: list[str], words: str
) -> None:
    result = CliRunner().invoke(main, ["run", "virtual-agents", "--out", str(tmp_path), *flags])
    assert result.exit_code == 1
    assert words in result.output
    assert not list(tmp_path.iterdir())


def test_a_late_peer_joins_at_the_latest_time_there_is() -> None:
    clock = MissionClock(0, wall=False)
    clock.others_passed(600 * S, 0)
    assert clock.now_us == 0  # a process uses its own time until its vehicle reports a time
    client = Client(at(5.0))
    (event,) = Gateway("crane", client, clock).events(0)
    assert event.at_us == clock.now_us == 600 * S


def test_a_peer_that_is_behind_the_others_catches_up() -> None:
    clock = MissionClock(0, wall=False)
    client = Client()
    gateway = Gateway("crane", client, clock)
    at_us = []
    for second in range(14):
        clock.others_passed((100 + second) * S if second > 2 else 0, second * S)
        client.report(at(second))
        at_us += [event.at_us for event in gateway.events(second * S)]
    assert at_us[3] == 3 * S
    assert at_us[-1] == pytest.approx(113 * S, abs=1.1 * S)
    assert at_us == sorted(at_us)


def test_with_the_wall_clock_it_joins_at_once_and_goes_on_from_there() -> None:
    clock = MissionClock(0, wall=True)
    clock.wall_passed(50 * S)
    clock.others_passed(600 * S, 51 * S)
    clock.wall_passed(52 * S)
    assert clock.now_us == 601 * S
    clock.others_passed(500 * S, 52 * S)  # a process with an earlier time has no effect
    clock.wall_passed(53 * S)
    assert clock.now_us == 602 * S
