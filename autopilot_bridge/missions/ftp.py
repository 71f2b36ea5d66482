"""Uploads and downloads ArduPilot's mission files over MAVFTP.

opening --ACK--> moving --replies to all blocks--> closing --ACK--> ended
opening: the request is repeated on timeout with the same sequence number, so that the autopilot
    repeats its reply; if another session is open, the client tries again after three and six
    seconds
moving:  up to five reads or writes are pending; each is repeated if its reply is late
closing: the autopilot applies the written data only now

If the link is lost, the mission on board is either the complete old mission or the complete new
one. Each write ends at an item boundary. If a session is closed too early (by this client or
another station), whole items are missing, and the autopilot's buffer contains zeros for them.
ArduPilot rejects a file with an item of zeros before it changes the old mission. This client closes
a session only if it has certainly opened that session itself. The caller must read back after every
upload, because the applied mission can differ from the file even if the autopilot acknowledged the
closing. The mission differs from the file if a command is rejected, or if the mission in flight was
longer (``leaves_old_tail``). ``FtpDownload`` performs the read-back; when it opens a file, the
autopilot ends an idle session that is still open.
"""

from collections import deque
from dataclasses import dataclass, replace
from typing import Literal

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.items import MissionItem
from autopilot_bridge.links.codec import Message
from autopilot_bridge.links.field_limits import list_out_of_bounds
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
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming, is_for

MAX_PENDING = 5  # the autopilot discards a sixth request without a reply
FIRST_BLOCK_BYTES = HEADER.size + 6 * ITEM.size  # 238
BLOCK_BYTES = 6 * ITEM.size  # 228 bytes; the maximum of a write is 239
# An open session can be replaced if the autopilot sent no FTP reply for 3 s.
BUSY_WAIT_US = 3_200_000
MAX_OPENINGS = 3
SHORTEST_WAIT_US = 100_000
MAX_BACK_OFF = 4


def next_session(session: int) -> int:
    """Return a new session id for the next transfer, so that late packets have no effect."""
    return session % 255 + 1


def leaves_old_tail(flying_mission: bool, held_items: int, new_items: int) -> bool:
    """Return whether old items would remain on board after the items of a new file.

    Old items may remain because ArduPilot does not clear a mission in flight. ``held_items``
    (MISSION_CURRENT.total + 1) and ``new_items`` include home.
    """
    return flying_mission and new_items < held_items


@dataclass(slots=True)
class _PendingRequest:
    """A request whose reply has not arrived."""

    packet: Packet
    sent_us: int
    due_us: int
    tries: int = 1


class _FtpTransfer:
    """One session for one file; ``result`` is set when the session has ended."""

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
        self._pending: dict[int, _PendingRequest] = {}
        self._waiting: deque[Packet] = deque()
        self._openings = 0
        self._open_again_us: int | None = None
        self._abort_reason: str | None = None  # set if the session is closed early
        self._progress_us = 0
        self._round_trip_us: float | None = None
        self._deviation_us = 0.0

    # The differences between uploads and downloads ------------------------------------------------

    def _opened(self) -> None:
        """Queue the first requests in ``_waiting``."""
        raise NotImplementedError

    def _answered(self, request: Packet, reply: Packet) -> None:
        """Process the reply to a read or a write. Raises BridgeError for an invalid reply."""
        raise NotImplementedError

    def _ended(self, closed: bool) -> TransferResult:
        """Return the result after all blocks were acknowledged.

        ``closed`` is True if the closing was acknowledged too.
        """
        raise NotImplementedError

    def _aborted(self, reason: str) -> TransferResult:
        """Return the result of an aborted session."""
        raise NotImplementedError

    # Requests, replies and timeouts ---------------------------------------------------------------

    def start(self, now_us: int) -> list[Message]:
        """Open the file."""
        self._progress_us = now_us
        if self.result is not None:
            return []
        # The sequence number differs from those of an earlier run of the program, because the
        # autopilot may still repeat its reply to a request of that run.
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
        self._pending[packet.seq] = _PendingRequest(
            packet, now_us, now_us + self._reply_timeout_us()
        )
        return packet.message(self._address.target)

    def _reply_timeout_us(self) -> int:
        """Return the timeout for a reply in microseconds, from the round-trip times (RFC 6298)."""
        if self._round_trip_us is None:
            return self._timing.timeout_us
        usual_us = round(self._round_trip_us + 4.0 * self._deviation_us)
        return min(max(usual_us, SHORTEST_WAIT_US), self._timing.timeout_us)

    def receive(self, message: Message, now_us: int) -> list[Message]:
        """Process a reply, and return the next requests."""
        if message.get_type() != "FILE_TRANSFER_PROTOCOL" or self.result is not None:
            return []
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source != self._address.target or not is_for(message, self._address.own):
            return []
        reply = packet_of(message)
        pending = self._pending.get((reply.seq - 1) % 65536)
        if (
            pending is None
            or (reply.session, reply.asked) != (pending.packet.session, pending.packet.opcode)
            or reply.opcode not in (ftp.ACK, ftp.NAK)
        ):
            return []
        del self._pending[pending.packet.seq]
        self._progress_us = now_us
        if pending.tries == 1:
            self._measure(now_us - pending.sent_us)
        if reply.opcode == ftp.NAK:
            return self._refused(pending.packet, reply, now_us)
        return self._acknowledged(pending.packet, reply, now_us)

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
        return self._send_waiting(now_us)

    def _send_waiting(self, now_us: int) -> list[Message]:
        messages = []
        while self._waiting and len(self._pending) < MAX_PENDING:
            messages.append(self._send_request(self._waiting.popleft(), now_us))
        return messages if self._pending else self._close(None, now_us)

    def _close(self, abort_reason: str | None, now_us: int) -> list[Message]:
        self._state = "closing"
        self._abort_reason = abort_reason
        self._pending.clear()
        return [self._send_request(Packet(0, 0, ftp.TERMINATE), now_us)]

    def _after_closing(self, closed: bool) -> TransferResult:
        if self._abort_reason is not None:
            return self._aborted(self._abort_reason)
        return self._ended(closed)

    def _refused(self, request: Packet, reply: Packet, now_us: int) -> list[Message]:
        code = reply.data[0] if reply.data else 0
        words = error_words(reply)
        if self._state == "closing":
            self.result = self._after_closing(closed=False)
        elif self._state == "opening":
            busy = code in (ftp.FAIL, ftp.INVALID_SESSION, ftp.NO_SESSIONS)
            if busy and self._openings < MAX_OPENINGS:
                # Another station has a session, active or idle. ArduPilot closes an idle session
                # only for a new id. The client does not close the session of another station,
                # because that session may be in use.
                self.session = next_session(self.session)
                # The delay increases, because two stations with equal delays would block each
                # other.
                self._open_again_us = now_us + BUSY_WAIT_US * self._openings
                return []
            path = PATHS[self._address.mission_type]
            self.result = TransferResult("rejected", f"the autopilot did not open {path}: {words}")
        elif code in (ftp.INVALID_SESSION, ftp.NOT_FOUND):
            # The session is no longer ours: closing it could abort another station's transfer.
            self.result = self._aborted(f"the autopilot closed the file: {words}")
        else:
            return self._close(
                f"the autopilot rejected the request at byte {request.offset}: {words}", now_us
            )
        return []

    def cancel(self, cancels_after_us: int, now_us: int) -> list[Message]:
        """Close the session before all items are written, so that the autopilot applies none."""
        if self._state == "closing" or self.result is not None:
            return []
        return self._close("it was cancelled", now_us)

    def next_timer(self) -> int:
        """Return the time of the next ``handle_timer`` call."""
        if self.result is not None:
            return self._progress_us
        if self._open_again_us is not None:
            return self._open_again_us
        due_us = min(pending.due_us for pending in self._pending.values())
        return min(due_us, self._given_up_us())

    def _given_up_us(self) -> int:
        return self._progress_us + (self._timing.retries + 1) * self._timing.timeout_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Repeat the requests whose reply is late, or fail after the last retry."""
        if self.result is not None or now_us < self.next_timer():
            return []
        if self._open_again_us is not None:
            return self._open(now_us)
        if now_us >= self._given_up_us():
            return self._give_up(now_us)
        messages = []
        for pending in self._pending.values():
            if now_us >= pending.due_us:
                wait_us = self._reply_timeout_us() * min(2**pending.tries, MAX_BACK_OFF)
                pending.tries += 1
                pending.due_us = now_us + min(wait_us, self._timing.timeout_us)
                messages.append(pending.packet.message(self._address.target))
        return messages

    def _give_up(self, now_us: int) -> list[Message]:
        if self._state == "closing":
            self.result = self._after_closing(closed=False)
            return []
        if self._state == "opening":
            self.result = TransferResult("failed", "the autopilot did not reply to FTP requests")
            return []
        messages = self._close(None, now_us)  # if this request arrives, the session becomes free
        self.result = self._aborted("the autopilot stopped replying")
        return messages


class FtpUpload(_FtpTransfer):
    """The upload of a whole list of items; the caller must read back after every result.

    ``accepted``: the file was closed. ``unknown``: all data was sent, and the autopilot applies the
    data now or when a station next opens a file. ``failed``: the old mission is on board.
    ``rejected``: no data was sent; an upload over the mission protocol (item by item) may still
    succeed.
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
        """Create the upload of ``items``, home first; ``session`` must be a new session id."""
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
        for begin in (0, *range(FIRST_BLOCK_BYTES, len(self._data), BLOCK_BYTES)):
            block = self._data[begin : begin + BLOCK_BYTES if begin else FIRST_BLOCK_BYTES]
            self._waiting.append(Packet(0, 0, ftp.WRITE, len(block), offset=begin, data=block))

    def _answered(self, request: Packet, reply: Packet) -> None:
        pass  # an ACK means that the whole block is in the autopilot's buffer

    def _ended(self, closed: bool) -> TransferResult:
        if closed:
            return TransferResult("accepted", "written and closed", items=self.items)
        return TransferResult(
            "unknown", "all data was written, but the closing of the file was not acknowledged"
        )

    def _aborted(self, reason: str) -> TransferResult:
        if self._waiting:
            return TransferResult("failed", reason)
        return TransferResult("unknown", f"all data was sent, but then {reason}")


class FtpDownload(_FtpTransfer):
    """The download of a whole list of items; the result contains the items."""

    kind = "download"

    def __init__(self, address: Address, session: int, timing: TransferTiming) -> None:
        super().__init__(address, ftp.OPEN_TO_READ, session, timing)
        self._length = 0
        self._blocks: dict[int, bytes] = {}

    def _opened(self) -> None:
        # The reported length is a placeholder (1 MiB); the header of the file contains the count.
        self._waiting.append(Packet(0, 0, ftp.READ, FIRST_BLOCK_BYTES))

    def _answered(self, request: Packet, reply: Packet) -> None:
        if reply.offset != request.offset:
            raise BridgeError(f"the reply has offset {reply.offset}, the request {request.offset}")
        if request.offset == 0:
            self._length = file_length(reply.data, self._address.mission_type)
            for begin in range(FIRST_BLOCK_BYTES, self._length, BLOCK_BYTES):
                size = min(BLOCK_BYTES, self._length - begin)
                self._waiting.append(Packet(0, 0, ftp.READ, size, offset=begin))
        self._blocks[request.offset] = reply.data

    def _ended(self, closed: bool) -> TransferResult:
        data = b"".join(self._blocks[begin] for begin in sorted(self._blocks))
        try:
            items = decode_mission_file(data, self._address.mission_type)
        except BridgeError as error:
            return TransferResult("failed", str(error))
        if self._address.mission_type == MISSION:
            items = tuple(with_unheld(item) for item in items)
        if fault := list_out_of_bounds(items):
            return TransferResult("failed", f"the file contains an implausible value: {fault}")
        return TransferResult("accepted", f"{len(items)} items", items=items)

    def _aborted(self, reason: str) -> TransferResult:
        return TransferResult("failed", reason)
