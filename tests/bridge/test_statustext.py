"""StatustextAssembler: complete texts, for any number of chunks."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.stacks.stacks import stack_named
from autopilot_bridge.vehicle.client_events import MissionProgress, Text
from autopilot_bridge.vehicle.monitor import VehicleMonitor
from tests.bridge.helpers import Pair, mock_of

# As sent by PX4 1.17: 50 characters, then the rest.
FIRST, LAST = b"RTL: start return at 460 m (100 m above destinatio", b"n)\t"
WHOLE = "RTL: start return at 460 m (100 m above destination)"
OTHER = (b"Takeoff detected\t", 0, 0)
Chunk = tuple[bytes, int, int]  # text, id, chunk_seq


def texts_of(*chunks: Chunk, then_s: float = 0.0) -> list[str]:
    """Return the texts that a client reports for these STATUSTEXTs."""
    pair = Pair(mock_of(stack_named("px4", "plane")))
    pair.run_for(2.0)
    pair.events.clear()
    codec = Codec(1, 1)
    for words, number, seq in chunks:
        message = mavlink.MAVLink_statustext_message(6, words, number, seq)
        pair.client.receive_data(codec.encode(message), pair.now_us)
    pair.run_for(then_s)
    while (event := pair.client.next_event()) is not None:
        pair.events.append(event)
    return [event.text for event in pair.of(Text)]


@pytest.mark.parametrize(
    ("chunks", "expected"),
    [
        ([OTHER], ["Takeoff detected"]),
        ([(FIRST, 7, 0), (LAST, 7, 1)], [WHOLE]),
        ([(FIRST, 7, 0), (FIRST, 7, 0), (LAST, 7, 1)], [WHOLE]),
        ([(FIRST, 7, 0), OTHER], [FIRST.decode(), "Takeoff detected"]),
        ([(FIRST, 7, 0), (LAST, 8, 1)], [FIRST.decode(), "n)"]),
        ([(FIRST, 7, 0), (LAST, 7, 2)], [FIRST.decode(), "n)"]),
        ([(FIRST, 7, 0), (FIRST, 7, 1), (LAST, 7, 2)], [FIRST.decode() + WHOLE]),
        ([(FIRST, 7, 0)], []),
        ([(FIRST, 0, 0), (LAST, 0, 1)], [WHOLE]),  # PX4 numbers its long texts from 0
        (
            [(FIRST, 0, 0), (FIRST, 0, 0), OTHER],
            [FIRST.decode(), FIRST.decode(), "Takeoff detected"],
        ),
    ],
    ids=[
        "one",
        "two",
        "doubled",
        "broken off",
        "two texts",
        "gap",
        "three",
        "begun",
        "id 0",
        "alike",
    ],
)
def test_chunks_become_one_text(chunks: list[Chunk], expected: list[str]) -> None:
    assert texts_of(*chunks) == expected


def test_a_text_whose_end_is_lost_is_reported_with_the_next_heartbeat() -> None:
    assert texts_of((FIRST, 7, 0), then_s=1.5) == [FIRST.decode()]


def test_home_is_no_item_that_is_flown() -> None:
    # ArduPilot reports item 0 until it has a mission.
    watch, codec = VehicleMonitor(), Codec(1, 1)
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_FIXED_WING, 3, 0, 0, 4, 3)

    def receive(message: Any) -> list[Any]:
        (decoded,) = Codec(255, 190).decode(codec.encode(message))
        return watch.receive(decoded, 0)

    receive(beat)
    assert receive(mavlink.MAVLink_mission_current_message(0)) == []
    assert receive(mavlink.MAVLink_mission_current_message(1)) == [MissionProgress(0, 0)]
