"""Faults of the mock on request: their syntax, and their effects on a link."""

from dataclasses import replace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.mock.fault_injection import GROUND, SECOND_GROUND, FaultyMock
from autopilot_bridge.mock.fault_kinds import Faults, parse_faults
from autopilot_bridge.mock.serving import MockGroup
from tests.bridge.helpers import line_of, mock_of
from tests.bridge.mock_exchange import PLANE, PX4, count, each_stack, item, listing

SECOND = 1_000_000


def test_faults_are_read() -> None:
    words = (
        *("loss=0.1", "duplication=0.2", "delay=0.3", "jitter=0.4", "late-ack=2", "refuse=3:13"),
        *("refuse=5:1", "silent-after=4", "silence@5..6", "silence@9", "gps-loss@10..20"),
        *("reboot@30", "reboot@40", "battery-low@50", "stray-ack@1", "second-upload@2"),
        *("second-download@3.5", "fence-breach@60..70", "battery-emergency@80"),
        "engine-failure@90",
    )
    assert parse_faults(words) == Faults(
        {(0, 3): 13, (0, 5): 1},
        *(4, 0.1, 0.2, 0.3, 0.4, 2.0),
        [(5.0, 6.0), (9.0, float("inf"))],
        [(10.0, 20.0)],
        *([30.0, 40.0], [50.0], [1.0], [2.0], [3.5]),
        fence_breach=[(60.0, 70.0)],
        battery_emergency=[80.0],
        engine_failure=[(90.0, float("inf"))],
    )


@pytest.mark.parametrize(
    "word",
    [
        *("", "reboot", "rebot@3", "reboot@", "reboot@-1", "reboot@nan", "loss=1.1", "loss=x"),
        *("refuse=3", "refuse=3:0", "refuse=3:99", "refuse=x:1", "silence@6..5", "silence@..5"),
        *("gps-loss@1..x", "silent-after=1.5", "delay=inf", "refuse=\u0663:1"),
    ],
)
def test_bad_faults_are_reported_in_one_line(word: str) -> None:
    with pytest.raises(BridgeError) as failure:
        parse_faults(["reboot@3", word])
    assert str(failure.value).startswith(f"--fault {word!r}: ")
    assert "\n" not in str(failure.value)


class Listener:
    """A ground station that receives all messages and sends the given ones."""

    def __init__(self, faults: Faults, stack: Any = PLANE, seed: int = 0) -> None:
        self.peer = FaultyMock(mock_of(stack), faults, seed)
        self.now_us = 0
        self.received: list[tuple[float, Any]] = []
        self._codec = Codec(*GROUND)
        self._decoder = Codec(*GROUND)
        self.run(0.0)

    def send(self, message: Any) -> None:
        self.peer.receive_data(self._codec.encode(message), self.now_us)
        self._listen()

    def run(self, until_s: float) -> None:
        while (due_us := max(self.peer.next_timer(), self.now_us)) <= until_s * SECOND:
            self.now_us = due_us
            self.peer.handle_timer(due_us)
            self._listen()
        self.now_us = round(until_s * SECOND)

    def _listen(self) -> None:
        for datagram in self.peer.data_to_send():
            for message in self._decoder.decode(datagram):
                self.received.append((self.now_us / SECOND, message))

    def of(self, name: str) -> list[tuple[float, Any]]:
        return [(at_s, m) for at_s, m in self.received if m.get_type() == name]

    def upload(self, items: tuple[Any, ...]) -> None:
        """Upload items as requested; repeat an unanswered message."""
        self.send(count(len(items)))
        answered: set[int] = set()
        for _ in range(1000):
            self.run(self.now_us / SECOND + 0.02)
            for at_s, message in [
                x for x in self.received if x[1].get_type().startswith("MISSION_R")
            ]:
                if message.target_system == GROUND[0] and round(at_s * SECOND) not in answered:
                    answered.add(round(at_s * SECOND))
                    self.send(item(message.seq, items[message.seq]))
            if any(m.target_system == GROUND[0] for _, m in self.of("MISSION_ACK")):
                return


def test_a_silence_has_a_beginning_and_an_end() -> None:
    link = Listener(Faults(silence=[(5.0, 12.0)]))
    link.run(8.0)
    link.send(count(3))  # the mock did not receive the message
    link.run(20.0)
    times = [at_s for at_s, _ in link.received]
    assert [at_s for at_s in times if 5.0 <= at_s < 12.0] == []
    assert len([at_s for at_s in times if at_s < 5.0]) > 10
    assert len([at_s for at_s in times if at_s >= 12.0]) > 10
    assert link.of("MISSION_REQUEST") == []


def test_without_gps_no_position_is_reported_for_a_while() -> None:
    link = Listener(Faults(gps_loss=[(4.0, 8.0)]))
    link.run(12.0)
    times = [at_s for at_s, _ in link.of("GLOBAL_POSITION_INT")]
    assert [at_s for at_s in times if 4.125 < at_s < 8.0] == []
    assert min(times) < 4.0
    assert max(times) > 8.0
    assert len([1 for at_s, _ in link.of("HEARTBEAT") if 4.0 < at_s < 8.0]) == 4


def test_a_reboot_resets_the_boot_clock() -> None:
    link = Listener(Faults(reboot=[6.0]))
    link.peer.mock.flight.armed = True
    link.run(10.0)
    boot_ms = [(at_s, m.time_boot_ms) for at_s, m in link.of("GLOBAL_POSITION_INT")]
    assert max(ms for at_s, ms in boot_ms if at_s < 6.0) >= 5000
    assert max(ms for at_s, ms in boot_ms if at_s > 6.0) <= 4000
    assert not link.peer.mock.flight.armed


@each_stack
def test_a_low_battery_is_reported_and_acted_on(stack: Any) -> None:
    link = Listener(Faults(battery_low=[20.0]), stack)
    flight = link.peer.mock.flight
    flight.items = (line_of(4)[0], *line_of(4))
    flight.armed = True
    flight.set_mode("mission", 0.0)
    link.peer.mock.intervals.set(mavlink.MAVLINK_MSG_ID_SYS_STATUS, 1e6)
    link.run(19.0)
    percents = {message.battery_remaining for _, message in link.of("SYS_STATUS")}
    assert (flight.mode, percents) == ("mission", {100})
    link.run(25.0)
    assert flight.mode == "rtl"
    assert link.of("SYS_STATUS")[-1][1].battery_remaining == 14
    assert any("attery" in m.text for _, m in link.of("STATUSTEXT"))


@each_stack
def test_a_late_acknowledgement_comes_so_much_later(stack: Any) -> None:
    times = []
    for late_s in (0.0, 2.0):
        link = Listener(Faults(late_ack_s=late_s), stack)
        link.run(2.0)
        link.upload(line_of(3))
        times.append(link.of("MISSION_ACK")[0][0])
        assert link.of("MISSION_ACK")[0][1].type == 0
    assert times[1] - times[0] == pytest.approx(2.0, abs=0.05)


def test_stray_acknowledgements_are_each_wrong_in_one_way() -> None:
    link = Listener(Faults(stray_ack=[3.0]))
    link.run(4.0)
    found = {
        (m.get_srcComponent(), m.target_system, m.mission_type) for _, m in link.of("MISSION_ACK")
    }
    assert found == {(1, SECOND_GROUND[0], 0), (1, GROUND[0], 1), (191, GROUND[0], 0)}
    assert all(m.type != 0 for _, m in link.of("MISSION_ACK"))


@each_stack
def test_a_second_station_uploads_and_downloads(stack: Any) -> None:
    link = Listener(Faults(second_upload=[5.0], second_download=[20.0]), stack)
    link.run(4.9)
    before = len(link.peer.mock.missions.items)
    link.run(15.0)
    assert before == 0
    assert len(link.peer.mock.missions.items) in (3, 4)  # including home
    link.run(40.0)
    counts = [(at_s, m.target_system) for at_s, m in link.of("MISSION_COUNT")]
    by_file = [at_s for at_s, _ in link.of("FILE_TRANSFER_PROTOCOL") if at_s >= 20.0]
    assert by_file or [target for at_s, target in counts if at_s >= 20.0] == [SECOND_GROUND[0]]


def test_a_second_station_is_in_the_way_of_the_first() -> None:
    link = Listener(Faults(second_upload=[5.0]), PX4)
    link.run(4.99)
    link.send(count(3))
    link.run(5.02)
    refused = [m for _, m in link.of("MISSION_ACK") if m.target_system == SECOND_GROUND[0]]
    assert [m.type for m in refused][:1] == [1]


def test_loss_delay_and_duplication_hold_both_ways() -> None:
    plain, lossy = Listener(Faults()), Listener(Faults(loss=0.5))
    doubled, delayed = Listener(Faults(duplication=1.0)), Listener(Faults(delay_s=0.4))
    for link in (plain, lossy, doubled, delayed):
        link.run(60.0)
    assert 0.4 < len(lossy.received) / len(plain.received) < 0.6
    assert len(doubled.received) == 2 * len(plain.received)
    assert delayed.received[0][0] == pytest.approx(plain.received[0][0] + 0.4)
    delayed.send(listing())
    delayed.run(62.0)
    # The loss occurs in both directions.
    assert delayed.of("MISSION_COUNT")[0][0] == pytest.approx(60.82, abs=0.03)


def test_the_same_seed_gives_the_same_faults() -> None:
    faults = Faults(loss=0.3, jitter_s=0.5, duplication=0.2)
    runs = []
    for seed in (1, 1, 2):
        link = Listener(replace(faults), seed=seed)
        link.run(30.0)
        runs.append([(at_s, m.get_type()) for at_s, m in link.received])
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_the_client_lives_through_all_of_it() -> None:
    words = ("loss=0.1", "delay=0.1", "jitter=0.1", "duplication=0.1", "stray-ack@9", "late-ack=1")
    more = ("reboot@30", "silence@40..50", "gps-loss@20..25", "second-download@12", "refuse=2:13")
    fleet = MockGroup([FaultyMock(mock_of(PX4), parse_faults((*words, *more)), 3)])
    client = NativeClient()
    for now_us in range(0, 60 * SECOND, 20_000):
        if now_us == 8 * SECOND:
            client.upload(line_of(5), now_us)
        fleet.handle_timer(now_us)
        for datagram in fleet.data_to_send():
            client.receive_data(datagram, now_us)
        client.handle_timer(now_us)
        for datagram in client.data_to_send():
            fleet.receive_data(datagram, now_us)
    names = []
    while (event := client.next_event()) is not None:
        names.append(type(event).__name__)
    assert {"Connected", "TransferFinished", "LinkLost", "LinkRestored", "Rebooted"} <= set(names)
    assert fleet.mocks[0].missions.items == []  # refused
