"""Recorded exchanges with real autopilots, sent to the mock in virtual time.

A transcript consists of JSON lines (see the README beside the transcripts). Messages of the client
are sent again at their times, and the mock's replies are compared with the autopilot's.
"""

import json
import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.px4_server import Px4Server
from tests.bridge.helpers import SECOND
from tests.bridge.transcript_diff import (
    EXCHANGE,
    FLIGHT_TEXTS,
    PROGRESS,
    Line,
    collapsed,
    compared,
    differences,
    exchange,
    once,
    progress_fault,
    texts,
)

FOLDER = Path("/work/shared/data/transcripts")
LINKS = {(255, 190): "A", (254, 190): "B"}
PAUSE_S = 10.0  # longer than any open transfer

# The cases in the order of the recording and of their initial states. True: the six items of
# upload_ok were uploaded again before the case, without a recording.
GROUND: tuple[tuple[str, bool], ...] = (
    ("upload_feasibility_rejected", False),
    ("upload_ok", False),
    ("download", False),
    ("download_old_float", False),
    ("upload_float_requests", False),
    ("set_current_ok", True),
    ("set_current_out_of_range", True),
    ("upload_rejected_item", True),
    ("upload_rejected_frame", True),
    ("upload_stalled", True),
    ("upload_wrong_seq", False),
    ("upload_duplicate_item", False),
    ("upload_recount", False),
    ("upload_count_resent_at_once", False),
    ("upload_other_mission_type_ack_ignored", False),
    ("upload_item_late_duplicate", False),
    ("upload_client_cancels", False),
    ("unsolicited_item_and_bad_requests", False),
    ("too_many", False),
    ("rally_ok", True),
    ("fence_ok", False),
    ("fence_bad", False),
    ("frame_rounding", False),
    ("upload_loiter_turns_rejected", False),
    ("frame_terrain", False),
    ("second_uploader", True),
    ("second_downloader", False),
    ("clear", True),
    ("count_zero", True),
)
FLIGHTS = ("takeoff_loiter_drop", "reupload_in_auto", "clear_and_zero_in_auto")


@dataclass
class Transcript:
    """One case of a transcript."""

    meta: dict[str, Any]
    sent: list[tuple[tuple[int, int], Line]] = field(default_factory=list)
    received: list[Line] = field(default_factory=list)
    end_s: float = 0.0


def read_transcript(path: Path) -> Transcript:
    """Return one case from its file."""
    records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    transcript = Transcript(records[0]["meta"])
    for record in records[1:]:
        line = Line(record["t"], record["link"], record["msg"], record["fields"])
        if record["dir"] == "tx":
            transcript.sent.append((tuple(record["src"]), line))
        else:
            transcript.received.append(line)
        transcript.end_s = max(transcript.end_s, record["t"])
    return transcript


def message_of(line: Line) -> Any:
    """Return the message that a client sent."""
    build = getattr(mavlink, f"MAVLink_{line.name.lower()}_message")
    fields = {k: math.nan if v is None else v for k, v in line.fields.items()}
    fields.pop("opaque_id", None)
    return build(**fields)


_EXTENDED = {
    "MISSION_ACK": ("<4xI", ("opaque_id",)),
    "MISSION_COUNT": ("<5xI", ("opaque_id",)),
    "MISSION_CURRENT": ("<6xIII", ("mission_id", "fence_id", "rally_points_id")),
}


def line_of_frame(message: Any, at_s: float) -> Line:
    """Return a message of the mock, with the fields that the dialect does not contain."""
    fields = message.to_dict()
    name = fields.pop("mavpackettype")
    if name in _EXTENDED:
        form, names = _EXTENDED[name]
        frame = bytes(message.get_msgbuf())
        payload = frame[10 : 10 + frame[1]].ljust(struct.calcsize(form), b"\0")
        fields |= dict(zip(names, struct.unpack_from(form, payload), strict=True))
    target = (fields.get("target_system"), fields.get("target_component"))
    return Line(at_s, LINKS.get(target, "A"), name, fields)


class Player:
    """A mock that receives the messages of transcripts, and its messages."""

    def __init__(self, mock: MockAutopilot) -> None:
        self.mock = mock
        self.now_us = 0
        self.received: list[Line] = []
        self._began_us = 0
        self._codecs = {source: Codec(*source) for source in LINKS}
        self._decoder = Codec(255, 190)

    def run(self, until_us: int) -> None:
        """Advance the time."""
        while (due_us := max(self.mock.next_timer(), self.now_us)) <= until_us:
            self.now_us = due_us
            self.mock.handle_timer(due_us)
            self._listen()
        self.now_us = until_us

    def play(self, transcript: Transcript) -> list[Line]:
        """Send the clients' messages; return the messages of the mock."""
        self._begin()
        for source, line in transcript.sent:
            self.run(self._began_us + round(line.at_s * SECOND))
            self._send(source, message_of(line))
        self.run(self._began_us + round(transcript.end_s * SECOND) + 25_000)
        return self.received

    def fly(self, transcript: Transcript) -> list[Line]:
        """Send the clients' messages when the recorded progress is reached; return the replies."""
        (first, *_) = (line for line in transcript.received if line.name == "MISSION_CURRENT")
        give_up_us = self.now_us + 200 * SECOND
        while self.mock.stack.item_0_is_home and self.now_us < give_up_us:
            if self.mock.flight.current == first.fields["seq"]:
                break  # ArduPilot's item number remains after the end of the previous case
            self.run(self.now_us + SECOND)
        self.received = []
        self._began_us = self.now_us
        late_us = 0
        so_far: list[Line] = []
        lines: list[tuple[tuple[int, int] | None, Line]] = [*transcript.sent]
        lines += [(None, line) for line in transcript.received if line.name in PROGRESS]
        for source, line in sorted(lines, key=lambda entry: entry[1].at_s):
            due_us = self._began_us + round(line.at_s * SECOND) + late_us
            if source is not None:
                self.run(max(due_us, self.now_us))
                self._send(source, message_of(line))
                continue
            so_far.append(line)
            give_up_us = self.now_us + 200 * SECOND
            while progress_fault(so_far, self.received) and self.now_us < give_up_us:
                self.run(self.now_us + 50_000)
            late_us = max(self.now_us - self._began_us - round(line.at_s * SECOND), 0)
        end_us = self._began_us + round(transcript.end_s * SECOND) + late_us
        self.run(max(end_us, self.now_us) + SECOND)
        return self.received

    def upload(self, items: list[Any]) -> None:
        """Upload MISSION_ITEM_INT messages by the protocol."""
        self._begin()
        self._send((255, 190), mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        for _ in range(200 * len(items)):
            asked = [line for line in self.received if line.name.startswith("MISSION_REQUEST")]
            self.received.clear()
            for line in asked:
                self._send((255, 190), items[line.fields["seq"]])
            self.run(self.now_us + 1000)

    def send(self, message: Any, source: tuple[int, int] = (255, 190)) -> list[Line]:
        """Send a message; return the replies within 25 ms."""
        self.received = []
        self._send(source, message)
        self.run(self.now_us + 25_000)
        return self.received

    def listen(self, seconds: float) -> list[Line]:
        """Return the messages of a period."""
        self.received = []
        self.run(self.now_us + round(seconds * SECOND))
        return self.received

    def _begin(self) -> None:
        self.run(self.now_us + round(PAUSE_S * SECOND))
        self._began_us = self.now_us
        self.received = []

    def _send(self, source: tuple[int, int], message: Any) -> None:
        self.mock.receive_data(self._codecs[source].encode(message), self.now_us)
        self._listen()

    def _listen(self) -> None:
        at_s = (self.now_us - self._began_us) / SECOND
        for datagram in self.mock.data_to_send():
            for message in self._decoder.decode(datagram):
                if message.get_type() in (*EXCHANGE, *PROGRESS, "STATUSTEXT"):
                    self.received.append(line_of_frame(message, at_s))


def play_ground(mock: MockAutopilot, folder: Path) -> dict[str, list[str]]:
    """Run all ground cases of a stack on one mock; return the differences of each."""
    player = Player(mock)
    found: dict[str, list[str]] = {}
    standard = [
        message_of(line)
        for _, line in read_transcript(folder / "upload_ok.jsonl").sent
        if line.name == "MISSION_ITEM_INT"
    ]
    for case, prepared in GROUND:
        path = folder / f"{case}.jsonl"
        if not path.exists():
            continue
        if prepared:
            player.upload(standard)
        transcript = read_transcript(path)
        _set_parameters(mock, transcript)
        found[case] = differences(transcript.received, player.play(transcript), mock)
    return found


def _set_parameters(mock: MockAutopilot, transcript: Transcript) -> None:
    if isinstance(mock.missions, Px4Server):
        required = transcript.meta.get("params", {}).get("MIS_TKO_LAND_REQ", 0)
        by_default = 2 if mock.stack.vehicle == "plane" else 0
        mock.parameters.change(
            "MIS_TKO_LAND_REQ", by_default if required == "default" else required
        )


def play_flights(mock: MockAutopilot, folder: Path) -> dict[str, list[str]]:
    """Run the flights of a stack on one mock; return the differences of each."""
    player = Player(mock)
    player.run(2 * SECOND)
    found: dict[str, list[str]] = {}
    for case in FLIGHTS:
        transcript = read_transcript(folder / f"{case}.jsonl")
        received = player.fly(transcript)
        expected, given = (
            list(collapsed(exchange(lines, "A"))) for lines in (transcript.received, received)
        )
        found[case] = compared(once(expected), once(given), mock)
        expected, given = (
            [(line, 1) for line in texts(lines) if line.fields["text"].startswith(FLIGHT_TEXTS)]
            for lines in (transcript.received, received)
        )
        found[case] += compared(expected, given, mock)
        fault = progress_fault(transcript.received, received)
        found[case] += [fault] if fault else []
    return found
