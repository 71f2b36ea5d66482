"""Simulates ArduPilot's side of MAVFTP for its mission files.

All stations share one session, and up to five requests are queued. A written file is applied when
any station closes the session. PX4 has no such files.
"""

from collections import deque
from dataclasses import dataclass, replace

from pymavlink.dialects.v20.ardupilotmega import MAV_MISSION_TYPE_MISSION

from autopilot_bridge.links.codec import Message
from autopilot_bridge.missions import ftp_packet as ftp
from autopilot_bridge.missions.ftp_packet import Packet, packet_of
from autopilot_bridge.missions.mission_file import (
    HEADER,
    ITEM,
    MAGIC,
    PATHS,
    encode_mission_file,
    unpack_item,
)
from autopilot_bridge.missions.read_back import with_unheld
from autopilot_bridge.mock.mission_server import MissionServer

QUEUE = 5
WORK_US = 4_000  # observed: 109 writes in 0.46 s
IDLE_US = 3_000_000
LONG_AGO_US = -(10**15)
_PLACEHOLDER_LENGTH = 1024 * 1024


@dataclass
class Session:
    """An open file; ``written`` is None if the file is open for reading."""

    session: int
    mission_type: int
    written: bytearray | None


class FtpServer:
    """The MAVFTP server for the lists of a mission server."""

    def __init__(self, missions: MissionServer) -> None:
        self.session: Session | None = None
        self._missions = missions
        self._queue: deque[tuple[tuple[int, int], Packet]] = deque()
        self._due_us: int | None = None
        self._last_sent_us = LONG_AGO_US
        self._last: tuple[tuple[int, int], Packet] | None = None

    def receive(self, message: Message, now_us: int) -> None:
        """Queue a request; if the queue is full, discard the request without a reply."""
        if len(self._queue) < QUEUE:
            source = (message.get_srcSystem(), message.get_srcComponent())
            self._queue.append((source, packet_of(message)))
            if self._due_us is None:
                self._due_us = now_us + WORK_US

    def next_timer(self) -> int | None:
        """Return the time of the next reply."""
        return self._due_us

    def handle_timer(self, now_us: int) -> list[Message]:
        """Process the oldest request."""
        if self._due_us is None or now_us < self._due_us:
            return []
        source, request = self._queue.popleft()
        self._due_us = now_us + WORK_US if self._queue else None
        if request.opcode in (ftp.ACK, ftp.NAK):
            return []
        repeated = self._repeated(source, request)
        replies = [repeated] if repeated else self._replies(request, now_us)
        self._last = (source, replies[-1])
        # After a TERMINATE the open session is idle, even if the request had another session id.
        ended = request.opcode == ftp.TERMINATE
        self._last_sent_us = LONG_AGO_US if ended else now_us
        return [reply.message(source) for reply in replies]

    def _repeated(self, source: tuple[int, int], request: Packet) -> Packet | None:
        """Return the last reply if the request repeats the last request, otherwise None."""
        if self._last is None or self._last[0] != source:
            return None
        last = self._last[1]
        same = (last.session, last.seq) == (request.session, (request.seq + 1) % 65536)
        return last if same else None

    def _replies(self, request: Packet, now_us: int) -> list[Packet]:
        """Return one reply, or in a burst all replies up to the end of the file."""
        replies = [self._reply(request, now_us)]
        while request.opcode == ftp.BURST_READ and replies[-1].opcode == ftp.ACK:
            offset = replies[-1].offset + replies[-1].size
            following = self._reply(replace(request, offset=offset), now_us)
            replies.append(replace(following, seq=(replies[-1].seq + 1) % 65536, offset=offset))
        return replies

    def _reply(self, request: Packet, now_us: int) -> Packet:
        reply = Packet((request.seq + 1) % 65536, request.session, ftp.ACK, asked=request.opcode)
        ours = self.session is not None and self.session.session == request.session
        idle = now_us - self._last_sent_us >= IDLE_US
        if request.opcode in (ftp.TERMINATE, ftp.RESET):
            if ours:
                self._close()
            return reply
        if self.session is not None and not ours:
            if not idle:
                return _refusal(reply, ftp.INVALID_SESSION)
            self._close()
        match request.opcode:
            case ftp.OPEN_TO_READ | ftp.CREATE:
                return self._open(request, reply, idle)
            case ftp.READ | ftp.BURST_READ:
                return self._read(request, reply)
            case ftp.WRITE:
                return self._write(request, reply)
            case _:
                return _refusal(reply, ftp.FAIL)

    def _open(self, request: Packet, reply: Packet, idle: bool) -> Packet:
        reading = request.opcode == ftp.OPEN_TO_READ
        if self.session is not None and reading and idle:
            self._close()
        if self.session is not None:
            return _refusal(reply, ftp.FAIL)
        for mission_type, path in PATHS.items():
            if path.encode() == request.data and self._missions.stack.name == "ardupilot":
                written = None if reading else bytearray()
                self.session = Session(request.session, mission_type, written)
                if reading:
                    return _with(reply, 0, _PLACEHOLDER_LENGTH.to_bytes(4, "little"))
                return reply
        return _refusal(reply, ftp.NOT_FOUND)

    def _read(self, request: Packet, reply: Packet) -> Packet:
        if self.session is None:
            return _refusal(reply, ftp.NOT_FOUND)
        if self.session.written is not None:
            return _refusal(reply, ftp.FAIL)
        mission_type = self.session.mission_type
        held = tuple(self._missions.lists[mission_type])
        if mission_type == MAV_MISSION_TYPE_MISSION and held:  # the position of home, as observed
            held = tuple(with_unheld(item, held[0].x, held[0].y, held[0].z) for item in held)
        whole = encode_mission_file(held, mission_type, (1, 1))
        maximum = min(request.size, ftp.MAX_DATA_BYTES)
        if request.opcode == ftp.BURST_READ and request.size == 0:
            maximum = ftp.MAX_DATA_BYTES  # a burst of size 0 is read in blocks of maximum size
        data = whole[request.offset : request.offset + maximum]
        return _with(reply, request.offset, data) if data else _refusal(reply, ftp.END_OF_FILE)

    def _write(self, request: Packet, reply: Packet) -> Packet:
        if request.size > ftp.MAX_DATA_BYTES:
            return _refusal(reply, ftp.INVALID_SIZE)
        if self.session is None:
            return _refusal(reply, ftp.NOT_FOUND)
        buffer = self.session.written
        if buffer is None:
            return _refusal(reply, ftp.FAIL)
        end = request.offset + len(request.data)
        if request.offset == 0 and len(request.data) >= HEADER.size:
            count = HEADER.unpack_from(request.data)[4]
            end = max(end, HEADER.size + count * ITEM.size)  # space for the whole file
        buffer.extend(bytes(max(end - len(buffer), 0)))
        buffer[request.offset : request.offset + len(request.data)] = request.data
        return replace(reply, offset=request.offset)

    def _close(self) -> None:
        """End the session; a written file is applied now if it is complete."""
        session, self.session = self.session, None
        if session is None or session.written is None:
            return
        data = bytes(session.written)
        if len(data) < HEADER.size or HEADER.unpack_from(data)[0] != MAGIC:
            return
        count = (len(data) - HEADER.size) // ITEM.size
        if count != HEADER.unpack_from(data)[4]:
            return
        offsets = [HEADER.size + index * ITEM.size for index in range(count)]
        if any(not any(data[offset : offset + ITEM.size]) for offset in offsets):
            return  # an item of zeros shows that not all items were written
        items = tuple(unpack_item(data, index)[1] for index in range(count))
        self._missions.apply_file(session.mission_type, items)


def _refusal(reply: Packet, code: int) -> Packet:
    return replace(_with(reply, 0, bytes((code,))), opcode=ftp.NAK)


def _with(reply: Packet, offset: int, data: bytes) -> Packet:
    return replace(reply, offset=offset, size=len(data), data=data)
