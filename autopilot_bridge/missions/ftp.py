"""Upload and download of ArduPilot's mission files over MAVFTP, sans-IO.

opening --ACK--> moving --all pieces answered--> closing --ACK--> ended
opening: repeated on timeout with the same number, which makes the autopilot repeat its reply;
         while another session is open, requested again after three seconds of silence and after six
moving:  five reads or writes are under way, each sent again when its answer is late
closing: only now does the autopilot apply what was written

Wherever the link is lost, the mission on board is the old or the new one: writes end between items,
so that the data missing when a session is closed (by us or another station) are whole items, which
are zeros in the autopilot's buffer; a file with an item of zeros is refused before the old mission
is changed. Only a session that is surely ours is closed. The caller must read back after every
upload: the applied mission can differ from the file (a refused command, or a shorter mission while
it is being flown: ``leaves_old_tail``), although the closing is acknowledged. ``FtpDownload`` reads
back, and its opening ends a session that was left open.
"""

from collections import deque
from dataclasses import dataclass, replace
from typing import Literal

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions import ftp_packet as ftp
from autopilot_bridge.missions.ftp_packet import Packet, error_words, packet_of
from autopilot_bridge.missions.mission_file import (
    HEADER,
    ITEM,
    PATHS,
    decode_mission_file,
    encode_mission_file,
    file_length,
    first_bad_item,
)
from autopilot_bridge.missions.read_back import MISSION, with_unheld
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming
from autopilot_bridge.missions.value_bounds import list_out_of_bounds

MAX_UNDER_WAY = 5  # the autopilot drops a sixth without a reply
FIRST_PIECE_BYTES = HEADER.size + 6 * ITEM.size  # 238
PIECE_BYTES = 6 * ITEM.size  # 228; a write may have 239
# An open session can be taken over when no FTP reply was sent for 3 s.
BUSY_WAIT_US = 3_200_000
MAX_OPENINGS = 3
SHORTEST_WAIT_US = 100_000
MAX_BACK_OFF = 4


def next_session(session: int) -> int:
    """The session id for the next transfer: it differs, so that late packets have no effect."""
    return session % 255 + 1


def leaves_old_tail(flying_mission: bool, held_items: int, new_items: int) -> bool:
    """Whether old items would remain on board after the items of a new file.

    ArduPilot does not clear a mission that it is flying. Counts include home; ``held_items`` is
    MISSION_CURRENT.total + 1.
    """
    return flying_mission and new_items < held_items


@dataclass(slots=True)
class _PendingRequest:
    """A request without a reply so far."""

    packet: Packet
    sent_us: int
    due_us: int
    tries: int = 1


class _FtpTransfer:
    """One session on one file; ``result`` is set when it has ended."""

    def __init__(
        self, address: Address, open_opcode: int, session: int, timing: TransferTiming
    ) -> None:
        self.session = session
        self.result: TransferResult | None = None
        self._address = address
        self._open_opcode = open_opcode
        self._timing = timing
        self._state: Literal["opening", "moving", "closing"] = "opening"
        self._seq = 0
        self._under_way: dict[int, _PendingRequest] = {}
        self._waiting: deque[Packet] = deque()
        self._openings = 0
        self._open_again_us: int | None = None
        self._broken: str | None = None  # why the session is being closed before its end
        self._progress_us = 0
        self._round_trip_us: float | None = None
        self._deviation_us = 0.0

    # The differences of uploads and downloads ----------------------------------------------------

    def _opened(self) -> None:
        """Put the first requests into ``_waiting``."""
        raise NotImplementedError

    def _answered(self, request: Packet, reply: Packet) -> None:
        """Process the reply to a read or write. Raises BridgeError for an invalid reply."""
        raise NotImplementedError

    def _ended(self, closed: bool) -> TransferResult:
        """The result when all pieces are acknowledged; ``closed``: the closing too."""
        raise NotImplementedError

    def _broke_off(self, reason: str) -> TransferResult:
        """The result when the session ended before its end."""
        raise NotImplementedError

    # Bytes and time -------------------------------------------------------------------------------

    def start(self, now_us: int) -> list[Message]:
        """Open the file."""
        self._progress_us = now_us
        if self.result is not None:
            return []
        # Differs from the last program's number, whose reply the autopilot may still hold.
        self._seq = now_us // 1000 % 65536
        return self._open(now_us)

    def _open(self, now_us: int) -> list[Message]:
        self._openings += 1
        self._open_again_us = None
        self._progress_us = now_us
        path = PATHS[self._address.mission_type].encode()
        return [self._send_request(Packet(0, 0, self._open_opcode, len(path), data=path), now_us)]

    def _send_request(self, request: Packet, now_us: int) -> Message:
        packet = replace(request, seq=self._seq, session=self.session)
        self._seq = (self._seq + 1) % 65536
        self._under_way[packet.seq] = _PendingRequest(packet, now_us, now_us + self._patience_us())
        return packet.message(self._address.target)

    def _patience_us(self) -> int:
        """The timeout of a reply in microseconds, from measured round trips (RFC 6298)."""
        if self._round_trip_us is None:
            return self._timing.timeout_us
        usual_us = round(self._round_trip_us + 4.0 * self._deviation_us)
        return min(max(usual_us, SHORTEST_WAIT_US), self._timing.timeout_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a reply; returns the next requests."""
        if message.get_type() != "FILE_TRANSFER_PROTOCOL" or self.result is not None:
            return []
        source = (message.get_srcSystem(), message.get_srcComponent())
        own_system, own_component = self._address.own
        if (
            source != self._address.target
            or message.target_system not in (own_system, 0)
            or message.target_component not in (own_component, 0)
        ):
            return []
        reply = packet_of(message)
        asked = self._under_way.get((reply.seq - 1) % 65536)
        if (
            asked is None
            or (reply.session, reply.asked) != (asked.packet.session, asked.packet.opcode)
            or reply.opcode not in (ftp.ACK, ftp.NAK)
        ):
            return []
        del self._under_way[asked.packet.seq]
        self._progress_us = now_us
        if asked.tries == 1:
            self._measure(now_us - asked.sent_us)
        if reply.opcode == ftp.NAK:
            return self._refused(asked.packet, reply, now_us)
        return self._acknowledged(asked.packet, reply, now_us)

    def _measure(self, round_trip_us: int) -> None:
        if self._round_trip_us is None:
            self._round_trip_us, self._deviation_us = float(round_trip_us), round_trip_us / 2.0
            return
        off_us = abs(round_trip_us - self._round_trip_us)
        self._deviation_us += 0.25 * (off_us - self._deviation_us)
        self._round_trip_us += 0.125 * (round_trip_us - self._round_trip_us)

    def _acknowledged(self, request: Packet, reply: Packet, now_us: int) -> list[Message]:
        if self._state == "closing":
            self.result = self._after_closing(closed=True)
            return []
        try:
            if self._state == "opening":
                self._state = "moving"
                self._opened()
            else:
                self._answered(request, reply)
        except BridgeError as error:
            return self._close(str(error), now_us)
        return self._go_on(now_us)

    def _go_on(self, now_us: int) -> list[Message]:
        messages = []
        while self._waiting and len(self._under_way) < MAX_UNDER_WAY:
            messages.append(self._send_request(self._waiting.popleft(), now_us))
        return messages if self._under_way else self._close(None, now_us)

    def _close(self, broken: str | None, now_us: int) -> list[Message]:
        self._state = "closing"
        self._broken = broken
        self._under_way.clear()
        return [self._send_request(Packet(0, 0, ftp.TERMINATE), now_us)]

    def _after_closing(self, closed: bool) -> TransferResult:
        if self._broken is not None:
            return self._broke_off(self._broken)
        return self._ended(closed)

    def _refused(self, request: Packet, reply: Packet, now_us: int) -> list[Message]:
        code = reply.data[0] if reply.data else 0
        words = error_words(reply)
        if self._state == "closing":
            self.result = self._after_closing(closed=False)
        elif self._state == "opening":
            busy = code in (ftp.FAIL, ftp.INVALID_SESSION, ftp.NO_SESSIONS)
            if busy and self._openings < MAX_OPENINGS:
                # Another station's session, active or not. Another id, because ArduPilot closes an
                # idle session for a new one only; never closed from here: it may be in use.
                self.session = next_session(self.session)
                # Longer each time: two stations with equal delays would block each other.
                self._open_again_us = now_us + BUSY_WAIT_US * self._openings
                return []
            path = PATHS[self._address.mission_type]
            self.result = TransferResult("rejected", f"the autopilot did not open {path}: {words}")
        elif code in (ftp.INVALID_SESSION, ftp.NOT_FOUND):
            # Not ours any more: closing it could cut another station's transfer short.
            self.result = self._broke_off(f"the autopilot closed the file: {words}")
        else:
            return self._close(f"the autopilot refused at byte {request.offset}: {words}", now_us)
        return []

    def cancel(self, cancels_after_us: int, now_us: int) -> list[Message]:
        """Close the session with items missing, so that the autopilot applies nothing."""
        if self._state == "closing" or self.result is not None:
            return []
        return self._close("it was cancelled", now_us)

    def next_timer(self) -> int:
        """Time of the next ``handle_timer`` call."""
        if self.result is not None:
            return self._progress_us
        if self._open_again_us is not None:
            return self._open_again_us
        due_us = min(asked.due_us for asked in self._under_way.values())
        return min(due_us, self._given_up_us())

    def _given_up_us(self) -> int:
        return self._progress_us + (self._timing.retries + 1) * self._timing.timeout_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat requests without a timely reply, or fail after the last retry."""
        if self.result is not None or now_us < self.next_timer():
            return []
        if self._open_again_us is not None:
            return self._open(now_us)
        if now_us >= self._given_up_us():
            return self._give_up(now_us)
        messages = []
        for asked in self._under_way.values():
            if now_us >= asked.due_us:
                wait_us = self._patience_us() * min(2**asked.tries, MAX_BACK_OFF)
                asked.tries += 1
                asked.due_us = now_us + min(wait_us, self._timing.timeout_us)
                messages.append(asked.packet.message(self._address.target))
        return messages

    def _give_up(self, now_us: int) -> list[Message]:
        if self._state == "closing":
            self.result = self._after_closing(closed=False)
            return []
        if self._state == "opening":
            self.result = TransferResult("failed", "the autopilot did not answer FTP")
            return []
        farewell = self._close(None, now_us)  # may arrive and free the session
        self.result = self._broke_off("the autopilot fell silent")
        return farewell


class FtpUpload(_FtpTransfer):
    """Writes a whole list of items; must be followed by a read-back, whatever its result.

    ``accepted``: the file was closed. ``unknown``: all was sent, and it may be applied now or at
    any station's next opening of a file. ``failed``: the old mission is on board. ``rejected``:
    nothing was begun; the item protocol may serve.
    """

    kind = "upload"

    def __init__(
        self,
        address: Address,
        items: tuple[MissionItem, ...],
        max_items: int,
        session: int,
        timing: TransferTiming,
    ) -> None:
        """``items`` are sent unchanged, home first; ``session`` differs from the last one."""
        super().__init__(address, ftp.CREATE, session, timing)
        self.items = items
        self._data = b""
        bad = None if address.mission_type else first_bad_item(items, max_items)
        if bad is not None:
            self.result = TransferResult("rejected", f"item {bad[0]}: {bad[1]}", seq=bad[0])
            return
        try:
            self._data = encode_mission_file(items, address.mission_type, address.target)
        except BridgeError as error:
            self.result = TransferResult("rejected", str(error))

    def _opened(self) -> None:
        begin = 0
        while begin < len(self._data):
            end = begin + PIECE_BYTES if begin else FIRST_PIECE_BYTES
            piece = self._data[begin:end]
            self._waiting.append(Packet(0, 0, ftp.WRITE, len(piece), offset=begin, data=piece))
            begin = end

    def _answered(self, request: Packet, reply: Packet) -> None:
        pass  # an ACK is enough: the whole piece is in the autopilot's buffer

    def _ended(self, closed: bool) -> TransferResult:
        if closed:
            return TransferResult("accepted", "written and closed", items=self.items)
        return TransferResult("unknown", "all was written, the closing was not acknowledged")

    def _broke_off(self, reason: str) -> TransferResult:
        if self._waiting:
            return TransferResult("failed", reason)
        return TransferResult("unknown", f"all was sent, then {reason}")


class FtpDownload(_FtpTransfer):
    """Reads a whole list of items; the result carries them."""

    kind = "download"

    def __init__(self, address: Address, session: int, timing: TransferTiming) -> None:
        super().__init__(address, ftp.OPEN_TO_READ, session, timing)
        self._length = 0
        self._pieces: dict[int, bytes] = {}

    def _opened(self) -> None:
        # The length that the autopilot reports is a placeholder (1 MiB): the header has the count.
        self._waiting.append(Packet(0, 0, ftp.READ, FIRST_PIECE_BYTES))

    def _answered(self, request: Packet, reply: Packet) -> None:
        if reply.offset != request.offset:
            raise BridgeError(f"bytes of {reply.offset} came for those of {request.offset}")
        if request.offset == 0:
            self._length = file_length(reply.data, self._address.mission_type)
            for begin in range(FIRST_PIECE_BYTES, self._length, PIECE_BYTES):
                size = min(PIECE_BYTES, self._length - begin)
                self._waiting.append(Packet(0, 0, ftp.READ, size, offset=begin))
        self._pieces[request.offset] = reply.data

    def _ended(self, closed: bool) -> TransferResult:
        data = b"".join(self._pieces[begin] for begin in sorted(self._pieces))
        try:
            items = decode_mission_file(data, self._address.mission_type)
        except BridgeError as error:
            return TransferResult("failed", str(error))
        if self._address.mission_type == MISSION:
            items = tuple(with_unheld(item) for item in items)
        if absurd := list_out_of_bounds(items):
            return TransferResult("failed", f"implausible value in the file: {absurd}")
        return TransferResult("accepted", f"{len(items)} items", items=items)

    def _broke_off(self, reason: str) -> TransferResult:
        return TransferResult("failed", reason)
