"""Adds faults to a mock; the faulty mock replaces the mock on a link."""

from collections.abc import Callable
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.items import Items, waypoint
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.failsafe_causes import EMERGENCY_PERCENT, LOW_PERCENT
from autopilot_bridge.mock.fault_kinds import Faults, Span

GROUND = (255, 190)  # the ids of the station under test
SECOND_GROUND = (254, 190)
OTHER_COMPONENT = int(mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
SECOND = 1_000_000
REMOTE_ID_ERROR = "operator location missing"


class FaultyMock:
    """A peer that adds faults to a mock.

    Times count from the first call. The same seed and the same traffic cause the same faults.
    """

    def __init__(self, mock: MockAutopilot, faults: Faults, seed: int = 0) -> None:
        self.mock = mock
        self.faults = faults
        mock.missions.faults = faults
        if faults.remote_id_error or faults.remote_id_loss:
            mock.telemetry.remote_id_error = ""  # a module that is ready
        self._up, self._down = (
            MemoryLink(
                faults.loss,
                round(faults.delay_s * SECOND),
                round(faults.jitter_s * SECOND),
                faults.duplication,
                2 * seed + direction,
            )
            for direction in (0, 1)
        )
        self._late = MemoryLink(delay_us=round(faults.late_ack_s * SECOND))
        self._other = Codec(mock.system_id, OTHER_COMPONENT)
        self._second = NativeClient(*SECOND_GROUND, target_system=mock.system_id)
        self._second_active = bool(faults.second_upload or faults.second_download)
        self._outgoing: list[bytes] = []
        self._began_us: int | None = None
        self._due: list[tuple[float, Callable[[int], None]]] = []
        for times, change in (
            (faults.reboot, mock.reboot),
            (faults.battery_low, partial(self._battery, LOW_PERCENT)),
            (faults.battery_emergency, partial(self._battery, EMERGENCY_PERCENT)),
            (faults.stray_ack, self._stray),
            (faults.second_upload, self._upload),
            (faults.second_download, self._download),
        ):
            self._due += [(at_s, change) for at_s in times]
        for spans, switch in (
            (faults.gps_loss, self._lose_gps),
            (faults.fence_breach, self._breach_fence),
            (faults.engine_failure, self._fail_engine),
            (faults.remote_id_error, partial(self._set_remote_id, REMOTE_ID_ERROR)),
            (faults.remote_id_loss, partial(self._set_remote_id, None)),
        ):
            for start_s, end_s in spans:
                self._due += [(start_s, partial(switch, True)), (end_s, partial(switch, False))]
        self._due.sort(key=lambda due: due[0])

    def receive_data(self, data: bytes, now_us: int) -> None:
        """Process a datagram from the station under test."""
        self._begin(now_us)
        if not self._within(self.faults.silence, now_us):
            self._up.send(data, now_us)
        self._exchange(now_us)

    def data_to_send(self) -> list[bytes]:
        """Return the datagrams that were not lost."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def next_timer(self) -> int:
        """Return the time of the next due action."""
        timers = [self.mock.next_timer()]
        timers += [
            due_us
            for link in (self._up, self._down, self._late)
            if (due_us := link.next_timer()) is not None
        ]
        if self._due and self._began_us is not None and self._due[0][0] < 1e12:
            timers.append(self._began_us + round(self._due[0][0] * SECOND))
        if self._second_active and (due := self._second.next_timer()) is not None:
            timers.append(due)
        return min(timers)

    def handle_timer(self, now_us: int) -> None:
        """Run all actions due at ``now_us``."""
        began_us = self._begin(now_us)
        self.mock.handle_timer(now_us)
        while self._due and (now_us - began_us) / SECOND >= self._due[0][0]:
            self._due.pop(0)[1](now_us)
        if self._second_active:
            self._second.handle_timer(now_us)
        self._exchange(now_us)

    def _begin(self, now_us: int) -> int:
        if self._began_us is None:
            self._began_us = now_us
        return self._began_us

    def _within(self, spans: list[Span], now_us: int) -> bool:
        at_s = (now_us - self._begin(now_us)) / SECOND
        return any(start_s <= at_s < end_s for start_s, end_s in spans)

    def _exchange(self, now_us: int) -> None:
        """Exchange messages between the station and the mock."""
        for datagram in self._up.receive(now_us):
            self.mock.receive_data(datagram, now_us)
        if self._second_active:
            for datagram in self._second.data_to_send():
                self.mock.receive_data(datagram, now_us)
        for datagram in self.mock.data_to_send():
            if self._second_active:
                self._second.receive_data(datagram, now_us)
            self._send_down(datagram, now_us)
        for datagram in self._late.receive(now_us):
            self._down.send(datagram, now_us)
        self._outgoing += self._down.receive(now_us)

    def _send_down(self, datagram: bytes, now_us: int) -> None:
        if self._within(self.faults.silence, now_us):
            return
        number = int.from_bytes(datagram[7:10], "little")
        late = self.faults.late_ack_s > 0.0 and number == mavlink.MAVLINK_MSG_ID_MISSION_ACK
        (self._late if late else self._down).send(datagram, now_us)

    # Faults at a given time ---------------------------------------------------------------------

    def _lose_gps(self, lost: bool, _now_us: int) -> None:
        self.mock.positions = not lost

    def _fail_engine(self, failed: bool, _now_us: int) -> None:
        self.mock.flight.fail_engine(failed)

    def _set_remote_id(self, error: str | None, failed: bool, _now_us: int) -> None:
        self.mock.telemetry.remote_id_error = error if failed else ""

    def _breach_fence(self, breached: bool, _now_us: int) -> None:
        self.mock.breach_fence(breached)

    def _battery(self, failsafe_percent: float, _now_us: int) -> None:
        self.mock.battery_percent = failsafe_percent - 1.0

    def _stray(self, now_us: int) -> None:
        """Send error MISSION_ACKs: to another station, for another list, from another component."""
        error = int(mavlink.MAV_MISSION_ERROR)
        for target, mission_type in ((SECOND_GROUND, 0), (GROUND, 1)):
            self.mock.send_message(_ack(target, error, mission_type))
        self._send_down(self._other.encode(_ack(GROUND, error, 0)), now_us)

    def _upload(self, now_us: int) -> None:
        self._second.upload(self._detour(), now_us)

    def _download(self, now_us: int) -> None:
        self._second.download(now_us)

    def _detour(self) -> Items:
        """Return three waypoints 100 m above home and about 500 m from home."""
        frame = self.mock.flight.frame
        high_m = frame.altitude_m + 100.0
        offsets = ((0.005, 0.0), (0.005, 0.005), (0.0, 0.005))
        return tuple(
            waypoint(frame.lat_deg + north, frame.lon_deg + east, high_m) for north, east in offsets
        )


def _ack(target: tuple[int, int], code: int, mission_type: int) -> Message:
    return mavlink.MAVLink_mission_ack_message(*target, code, mission_type)
