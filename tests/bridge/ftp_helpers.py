"""One transfer and a mock autopilot, connected by two memory links in virtual time."""

from dataclasses import dataclass, field
from typing import Any, Protocol

from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Codec, Message
from autopilot_bridge.links.memory_link import MemoryLink
from autopilot_bridge.missions import ftp_packet as ftp
from autopilot_bridge.missions.ftp import FtpDownload, FtpUpload
from autopilot_bridge.missions.ftp_packet import Packet, packet_of
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.stacks.stacks import stack_named
from tests.bridge.helpers import SECOND, line_of, mock_of

ARDUPILOT = stack_named("ardupilot", "plane")
# The mission NEW, with home, is written in 7 blocks.
OLD, NEW = line_of(30, first=1), line_of(40, first=2)
STATION, OTHER_STATION, VEHICLE = (255, 190), (254, 190), (1, 1)


class Transfer(Protocol):
    """The common methods of all transfers."""

    result: TransferResult | None

    def start(self, now_us: int) -> list[Message]: ...
    def receive(self, message: Message, now_us: int) -> list[Message]: ...
    def next_timer(self) -> int: ...
    def handle_timer(self, now_us: int) -> list[Message]: ...


def upload_of(
    items: tuple[MissionItem, ...],
    session: int = 1,
    mission_type: int = 0,
    timing: TransferTiming | None = None,
) -> FtpUpload:
    address = Address(STATION, VEHICLE, mission_type)
    return FtpUpload(address, items, 655, session, timing or TransferTiming())


def download_of(session: int = 2, mission_type: int = 0) -> FtpDownload:
    return FtpDownload(Address(STATION, VEHICLE, mission_type), session, TransferTiming())


# The request of another station to open a file.
THEIRS = Packet(5, 77, ftp.CREATE, 18, data=b"@MISSION/fence.dat")


@dataclass
class Bench:
    """A mock on two links; ``run`` executes one transfer."""

    mock: MockAutopilot = field(default_factory=lambda: mock_of(ARDUPILOT))
    up: MemoryLink = field(default_factory=MemoryLink)
    down: MemoryLink = field(default_factory=MemoryLink)
    now_us: int = 20 * SECOND
    sent: list[Packet] = field(default_factory=list)  # number of FTP requests sent on the link
    codec: Codec = field(default_factory=lambda: Codec(*STATION))

    def run(self, transfer: Transfer, within_s: float = 3000.0) -> TransferResult:
        end_us = self.now_us + round(within_s * SECOND)
        self.begin(transfer)
        while transfer.result is None:
            self.step(transfer)
            assert self.now_us < end_us, "the transfer did not end"
        return transfer.result

    def begin(self, transfer: Transfer) -> None:
        self._send(transfer.start(self.now_us))

    def step(self, transfer: Transfer | None, until_us: int | None = None) -> None:
        """Advance to the next timer."""
        own_us = until_us if transfer is None else transfer.next_timer()
        timers = (own_us, self.up.next_timer(), self.down.next_timer(), self.mock.next_timer())
        due_us = min(timer for timer in timers if timer is not None)
        self.now_us = max(due_us, self.now_us)
        for datagram in self.up.receive(self.now_us):
            self.mock.receive_data(datagram, self.now_us)
        self.mock.handle_timer(self.now_us)
        for datagram in self.mock.data_to_send():
            self.down.send(datagram, self.now_us)
        for datagram in self.down.receive(self.now_us):
            for message in self.codec.decode(datagram):
                if transfer is not None:
                    self._send(transfer.receive(message, self.now_us))
        if transfer is not None:
            self._send(transfer.handle_timer(self.now_us))

    def idle(self, seconds: float) -> None:
        """Advance the time without a request."""
        end_us = self.now_us + round(seconds * SECOND)
        while self.now_us < end_us:
            self.step(None, end_us)

    def ask(self, packet: Packet, station: tuple[int, int] = OTHER_STATION) -> list[Packet]:
        """Send a station's packet directly to the mock; return its replies within 50 ms."""
        self.push(packet, station)
        return self.replies(station)

    def push(self, packet: Packet, station: tuple[int, int] = OTHER_STATION) -> None:
        self.mock.receive_data(Codec(*station).encode(packet.message(VEHICLE)), self.now_us)

    def replies(self, station: tuple[int, int] = OTHER_STATION) -> list[Packet]:
        replies: list[Packet] = []
        end_us = self.now_us + 50_000
        while self.now_us < end_us:
            self.now_us = max(self.now_us, min(self.mock.next_timer(), end_us))
            self.mock.handle_timer(self.now_us)
            for datagram in self.mock.data_to_send():
                for message in Codec(9, 9).decode(datagram):
                    if getattr(message, "target_system", None) == station[0]:
                        replies.append(packet_of(message))
                    else:
                        self.down.send(datagram, self.now_us)
        return replies

    def _send(self, messages: list[Message]) -> None:
        for message in messages:
            if message.get_type() == "FILE_TRANSFER_PROTOCOL":
                self.sent.append(packet_of(message))
            self.up.send(self.codec.encode(message), self.now_us)

    def held(self) -> tuple[MissionItem, ...]:
        """Return the items of the mock, without home."""
        return tuple(self.mock.missions.items[1:])


def wire(items: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
    return (*items[:1], *items)


def holding(items: tuple[MissionItem, ...] = OLD) -> Bench:
    bench = Bench()
    bench.mock.missions.items = [bench.mock.missions.home, *items]
    return bench


class Cut(MemoryLink):
    """A link that fails from the n-th FTP message on (counted in both directions)."""

    def __init__(self, counter: list[int], after: int, **more: Any) -> None:
        super().__init__(**more)
        self._counter, self._after = counter, after
        self._codec = Codec(1, 1)

    def send(self, datagram: bytes, now_us: int) -> None:
        names = [message.get_type() for message in self._codec.decode(datagram)]
        if "FILE_TRANSFER_PROTOCOL" in names:
            self._counter[0] += 1
        if self._counter[0] <= self._after:
            super().send(datagram, now_us)


class Losing(MemoryLink):
    """A link that loses the packets selected by ``lost``."""

    def __init__(self, lost: Any) -> None:
        super().__init__()
        self._lost = lost
        self._codec = Codec(1, 1)

    def send(self, datagram: bytes, now_us: int) -> None:
        for message in self._codec.decode(datagram):
            if message.get_type() == "FILE_TRANSFER_PROTOCOL" and self._lost(packet_of(message)):
                return
        super().send(datagram, now_us)
