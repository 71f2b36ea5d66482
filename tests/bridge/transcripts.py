"""Recorded exchanges with real autopilots, played to the mock in virtual time.

A transcript is JSON lines: see the README beside them. What the client sent is sent again at its
time; what the mock answers is compared with what the autopilot answered.
"""

import json
import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.codec import Codec
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.px4_server import Px4Server
from tests.bridge.helpers import SECOND

FOLDER = Path("/work/shared/data/transcripts")
LINKS = {(255, 190): "A", (254, 190): "B"}
PAUSE_S = 10.0  # longer than any transfer is left open

# The cases in the order of the recording, as the state each one begins with tells; True: the six
# items of upload_ok were put on board again before it, unrecorded.
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

# What differs rightly, and nothing else:
# - the order between texts, progress and answers: they wait in different queues, so each of the
#   three is compared by itself; of MISSION_CURRENT what it says, not how often;
# - how often a question is repeated while nobody answers, by one;
# - texts of the estimator and of the arming checks, and those link B is told anew when it connects;
# - the running number of a text;
# - where ArduPilot believes its home to be, centimetres off;
# - the last digit of numbers in single precision.
# In flight besides:
# - when a place is reached: the mock flies at its own speed, so what was sent after the autopilot
#   told of its progress is sent after the mock told of the same;
# - texts that are not about the mission, and how far off a waypoint was passed;
# - PX4's second acknowledgement of a change of mode, and how often it tells an item as reached.
FLIGHT_TEXTS = ("Mission:", "Flight plan", "Auto mission changed", "No valid mission")
EXCHANGE = (
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT",
    "MISSION_COUNT",
    "MISSION_ITEM",
    "MISSION_ITEM_INT",
    "MISSION_ACK",
    "COMMAND_ACK",
)
PROGRESS = ("MISSION_CURRENT", "MISSION_ITEM_REACHED")
OTHER_TEXTS = ("PreArm", "EKF")
RUNNING = ("id", "chunk_seq")
SINGLE_PRECISION = 1e-6


@dataclass(frozen=True)
class Line:
    """One message of a transcript, or of the mock."""

    at_s: float
    link: str
    name: str
    fields: dict[str, Any]

    def __str__(self) -> str:
        values = " ".join(f"{name}={value}" for name, value in self.fields.items())
        return f"{self.at_s:.3f} {self.link} {self.name} {values}"


@dataclass
class Transcript:
    """One case."""

    meta: dict[str, Any]
    sent: list[tuple[tuple[int, int], Line]] = field(default_factory=list)
    heard: list[Line] = field(default_factory=list)
    end_s: float = 0.0


def read_transcript(path: Path) -> Transcript:
    """One case from its file."""
    records = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    transcript = Transcript(records[0]["meta"])
    for record in records[1:]:
        line = Line(record["t"], record["link"], record["msg"], record["fields"])
        if record["dir"] == "tx":
            transcript.sent.append((tuple(record["src"]), line))
        else:
            transcript.heard.append(line)
        transcript.end_s = max(transcript.end_s, record["t"])
    return transcript


def message_of(line: Line) -> Any:
    """The message a client sent."""
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
    """A message of the mock, with the fields the dialect does not know."""
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
    """A mock that is played to, and what it has said."""

    def __init__(self, mock: MockAutopilot) -> None:
        self.mock = mock
        self.now_us = 0
        self.heard: list[Line] = []
        self._began_us = 0
        self._codecs = {source: Codec(*source) for source in LINKS}
        self._decoder = Codec(255, 190)

    def run(self, until_us: int) -> None:
        """Let time pass."""
        while (due_us := max(self.mock.next_timer(), self.now_us)) <= until_us:
            self.now_us = due_us
            self.mock.handle_timer(due_us)
            self._listen()
        self.now_us = until_us

    def play(self, transcript: Transcript) -> list[Line]:
        """Send what the clients sent; returns what the mock said."""
        self._begin()
        for source, line in transcript.sent:
            self.run(self._began_us + round(line.at_s * SECOND))
            self._send(source, message_of(line))
        self.run(self._began_us + round(transcript.end_s * SECOND) + 25_000)
        return self.heard

    def fly(self, transcript: Transcript) -> list[Line]:
        """Send what the clients sent, in step with the progress told; returns what was said."""
        (first, *_) = (line for line in transcript.heard if line.name == "MISSION_CURRENT")
        give_up_us = self.now_us + 200 * SECOND
        while self.mock.stack.item_0_is_home and self.now_us < give_up_us:
            if self.mock.flight.current == first.fields["seq"]:
                break  # ArduPilot's index outlives the end of the case before
            self.run(self.now_us + SECOND)
        self.heard = []
        self._began_us = self.now_us
        late_us = 0
        so_far: list[Line] = []
        lines: list[tuple[tuple[int, int] | None, Line]] = [*transcript.sent]
        lines += [(None, line) for line in transcript.heard if line.name in PROGRESS]
        for source, line in sorted(lines, key=lambda entry: entry[1].at_s):
            due_us = self._began_us + round(line.at_s * SECOND) + late_us
            if source is not None:
                self.run(max(due_us, self.now_us))
                self._send(source, message_of(line))
                continue
            so_far.append(line)
            give_up_us = self.now_us + 200 * SECOND
            while progress_fault(so_far, self.heard) and self.now_us < give_up_us:
                self.run(self.now_us + 50_000)
            late_us = max(self.now_us - self._began_us - round(line.at_s * SECOND), 0)
        self.run(self.now_us + SECOND)
        return self.heard

    def upload(self, items: list[Any]) -> None:
        """An upload as it should be, of MISSION_ITEM_INT messages."""
        self._begin()
        self._send((255, 190), mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        for _ in range(200 * len(items)):
            asked = [line for line in self.heard if line.name.startswith("MISSION_REQUEST")]
            self.heard.clear()
            for line in asked:
                self._send((255, 190), items[line.fields["seq"]])
            self.run(self.now_us + 1000)

    def say(self, message: Any, source: tuple[int, int] = (255, 190)) -> list[Line]:
        """Send a message; returns what is said to it within 25 ms."""
        self.heard = []
        self._send(source, message)
        self.run(self.now_us + 25_000)
        return self.heard

    def listen(self, seconds: float) -> list[Line]:
        """What is said in a while."""
        self.heard = []
        self.run(self.now_us + round(seconds * SECOND))
        return self.heard

    def _begin(self) -> None:
        self.run(self.now_us + round(PAUSE_S * SECOND))
        self._began_us = self.now_us
        self.heard = []

    def _send(self, source: tuple[int, int], message: Any) -> None:
        self.mock.receive_data(self._codecs[source].encode(message), self.now_us)
        self._listen()

    def _listen(self) -> None:
        at_s = (self.now_us - self._began_us) / SECOND
        for datagram in self.mock.data_to_send():
            for message in self._decoder.decode(datagram):
                if message.get_type() in (*EXCHANGE, *PROGRESS, "STATUSTEXT"):
                    self.heard.append(line_of_frame(message, at_s))


def play_ground(mock: MockAutopilot, folder: Path) -> dict[str, list[str]]:
    """All ground cases of a stack on one mock; the differences of each."""
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
        found[case] = differences(transcript, player.play(transcript), mock)
    return found


def _set_parameters(mock: MockAutopilot, transcript: Transcript) -> None:
    if isinstance(mock.missions, Px4Server):
        required = transcript.meta.get("params", {}).get("MIS_TKO_LAND_REQ", 0)
        by_default = 2 if mock.stack.vehicle == "plane" else 0
        mock.missions.required = by_default if required == "default" else required


def differences(transcript: Transcript, heard: list[Line], mock: MockAutopilot) -> list[str]:
    """Where the mock's answers are not the autopilot's."""
    found: list[str] = []
    for link in ("A", "B"):
        wanted = list(_collapsed(_exchange(transcript.heard, link)))
        given = list(_collapsed(_exchange(heard, link)))
        found += _compared(wanted, given, mock)
    found += _compared(
        [(line, 1) for line in _texts(transcript.heard)],
        [(line, 1) for line in _texts(heard)],
        mock,
    )
    return found + list(_progress_differs(transcript.heard, heard))


def play_flights(mock: MockAutopilot, folder: Path) -> dict[str, list[str]]:
    """The flights of a stack on one mock; the differences of each."""
    player = Player(mock)
    player.run(2 * SECOND)
    found: dict[str, list[str]] = {}
    for case in FLIGHTS:
        transcript = read_transcript(folder / f"{case}.jsonl")
        heard = player.fly(transcript)
        wanted, given = (
            list(_collapsed(_exchange(lines, "A"))) for lines in (transcript.heard, heard)
        )
        found[case] = _compared(_once(wanted), _once(given), mock)
        wanted, given = (
            [(line, 1) for line in _texts(lines) if line.fields["text"].startswith(FLIGHT_TEXTS)]
            for lines in (transcript.heard, heard)
        )
        found[case] += _compared(wanted, given, mock)
        fault = progress_fault(transcript.heard, heard)
        found[case] += [fault] if fault else []
    return found


def _once(lines: list[tuple[Line, int]]) -> list[tuple[Line, int]]:
    """Without the second of two same acknowledgements of a command."""
    return [
        entry
        for index, entry in enumerate(lines)
        if index == 0
        or entry[0].name != "COMMAND_ACK"
        or entry[0].fields != lines[index - 1][0].fields
    ]


def progress_fault(wanted: list[Line], heard: list[Line]) -> str:
    """Of the progress recorded, once a second and no oftener, what the mock has not told in turn.

    An item told as reached again, and progress told again, count once.
    """
    for name in PROGRESS:
        given = iter(_changes(heard, name))
        for line in _changes(wanted, name):
            if not any(ours.fields == line.fields for ours in given):
                return f"not told in its turn: {line}"
    return ""


def _changes(lines: list[Line], name: str) -> list[Line]:
    said = [line for line in lines if line.name == name]
    return [
        line
        for before, line in zip([None, *said], said, strict=False)
        if before is None or before.fields != line.fields
    ]


def _exchange(lines: list[Line], link: str) -> list[Line]:
    return [line for line in lines if line.link == link and line.name in EXCHANGE]


def _texts(lines: list[Line]) -> list[Line]:
    return [
        line
        for line in lines
        if line.name == "STATUSTEXT"
        and line.link == "A"
        and not line.fields["text"].startswith(OTHER_TEXTS)
    ]


def _collapsed(lines: list[Line]) -> Iterator[tuple[Line, int]]:
    """Questions repeated, as one with their number."""
    before: Line | None = None
    times = 0
    for line in lines:
        repeated = (
            before is not None
            and line.name.startswith("MISSION_REQUEST")
            and (line.name, line.fields) == (before.name, before.fields)
        )
        if before is not None and not repeated:
            yield before, times
            times = 0
        before, times = line, times + 1
    if before is not None:
        yield before, times


def _compared(
    wanted: list[tuple[Line, int]], given: list[tuple[Line, int]], mock: MockAutopilot
) -> list[str]:
    for index in range(max(len(wanted), len(given))):
        if index >= len(wanted):
            return [f"more than recorded: {given[index][0]}"]
        if index >= len(given):
            return [f"missing: {wanted[index][0]}"]
        (ours, often), (theirs, times) = wanted[index], given[index]
        if not _same(ours, theirs, mock):
            return [f"recorded: {ours}\n     got: {theirs}"]
        if abs(often - times) > 1:
            return [f"recorded {often} times, got {times} times: {ours}"]
    return []


def _same(wanted: Line, given: Line, mock: MockAutopilot) -> bool:
    if wanted.name != given.name or wanted.fields.keys() != given.fields.keys():
        return False
    passed_over: tuple[str, ...] = RUNNING if wanted.name == "STATUSTEXT" else ()
    fields = wanted.fields
    is_item = wanted.name in ("MISSION_ITEM", "MISSION_ITEM_INT")
    if is_item and mock.stack.item_0_is_home and (fields["seq"], fields["mission_type"]) == (0, 0):
        passed_over = ("x", "y", "z")
    return all(
        _same_value(value, given.fields[name])
        for name, value in fields.items()
        if name not in passed_over
    )


def _same_value(wanted: Any, given: Any) -> bool:
    if wanted is None:
        return isinstance(given, float) and math.isnan(given)
    if isinstance(wanted, float):
        return math.isclose(wanted, given, rel_tol=SINGLE_PRECISION)
    return bool(wanted == given)


def _progress_differs(wanted: list[Line], heard: list[Line]) -> Iterator[str]:
    """Each MISSION_CURRENT recorded, against what the mock last said by then."""
    told = [line for line in heard if line.name == "MISSION_CURRENT"]
    for line in wanted:
        if line.name != "MISSION_CURRENT":
            continue
        by_then = [ours for ours in told if ours.at_s <= line.at_s + 1e-3]
        if by_then and by_then[-1].fields != line.fields:
            yield f"recorded: {line}\n     got: {by_then[-1]}"
            return
