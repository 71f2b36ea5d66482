"""A small number of bad frames of all kinds; ``python -m benchmarks.fuzz_frames`` has a million."""

import random

import pytest

from autopilot_bridge.links.codec import Codec
from autopilot_bridge.links.framing import frames_of
from benchmarks.fuzz_frames import (
    MUTATIONS,
    Report,
    absurd,
    counted,
    datagram_part,
    stream_part,
    transfer_part,
)


@pytest.mark.parametrize("seed", [12, 20_261])
def test_a_stream_loses_good_frames_only_to_checksums_that_are_right_by_chance(seed: int) -> None:
    report = Report()
    stream_part(random.Random(seed), 10_000, report)
    assert report.good == report.bad == 10_000
    assert report.failures() == []


def test_every_good_datagram_is_decoded_at_once() -> None:
    report = Report()
    datagram_part(random.Random(3), 8_000, report)
    assert report.bad == 8_000


def test_transfers_under_fire_end() -> None:
    report = Report()
    transfer_part(random.Random(4), 12_000, report)
    assert report.transfers.total() == 48
    assert set(report.transfers) >= {"accepted", "rejected"}


def test_the_bad_frames_are_bad_and_the_absurd_ones_arrive() -> None:
    chance, frame = random.Random(5), counted(Codec(1, 1), 7)
    for mutate in MUTATIONS:
        assert any(mutate(chance, frame) != frame for _ in range(5))
    for _ in range(200):
        message = absurd(chance, (1, 1), (255, 190))
        assert frames_of(message) == [message]
