"""The quality of links by sequence numbers, and the choice of the link to use."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot_bridge.vehicle.link_selection import (
    DEGRADED_LOSS,
    SILENT_US,
    LinkQuality,
    LinkSelection,
)

SECOND = 1_000_000
HZ = 20


def feed(quality: LinkQuality, from_s: float, to_s: float, loss: float, random: Random) -> None:
    """Receive frames of a sequence that began at 0 s."""
    for number in range(round(from_s * HZ), round(to_s * HZ)):
        if random.random() >= loss:
            quality.on_frame(number % 256, number * SECOND // HZ)


@given(loss=st.sampled_from([0.0, 0.1, 0.3, 0.6]), seed=st.integers(0, 99))
def test_the_loss_is_measured_by_gaps(loss: float, seed: int) -> None:
    quality = LinkQuality(0)
    feed(quality, 0.0, 30.0, loss, Random(seed))
    assert quality.loss_share(30 * SECOND) == pytest.approx(loss, abs=0.15)


@given(seed=st.integers(0, 999))
def test_late_and_repeated_frames_are_no_loss(seed: int) -> None:
    random, quality = Random(seed), LinkQuality(0)
    sent = list(range(300))
    for at in range(0, 295, 5):
        random.shuffle(block := sent[at : at + 5])
        sent[at : at + 5] = block
    for number, seq in enumerate(sent):
        for _ in range(random.choice([1, 1, 2])):
            quality.on_frame(seq % 256, number * SECOND // HZ)
    assert quality.loss_share(300 * SECOND // HZ) == pytest.approx(0.0, abs=0.02)


def test_a_restart_of_the_sequence_and_other_components_are_no_loss() -> None:
    quality = LinkQuality(0)
    feed(quality, 0.0, 10.0, 0.0, Random(1))
    for number in range(200):  # the autopilot has restarted; every fourth frame is of its camera
        if number % 4:
            quality.on_frame(number, (12 * HZ + number) * SECOND // HZ)
        else:
            quality.on_other_component(number)
    assert quality.loss_share(22 * SECOND) == 0.0


def test_states_have_a_hysteresis() -> None:
    random, quality, states = Random(3), LinkQuality(0), []
    for second in range(60):
        loss = 0.5 if 10 <= second < 30 else 0.0
        feed(quality, second, second + 1.0, loss, random)
        if quality.renew_state((second + 1) * SECOND):
            states.append(quality.state)
    assert states == ["up", "degraded", "up"]
    assert quality.renew_state(60 * SECOND + SILENT_US)
    assert quality.state == "silent"


class Choice:
    """Two links with a state at each moment, and the switches."""

    def __init__(self) -> None:
        self.selection = LinkSelection((0, 1), 0)
        self.switches: list[tuple[float, int, str]] = []
        self.sent = {0: 0, 1: 0}

    def run(self, from_s: int, to_s: int, losses: dict[int, float], busy: bool = False) -> None:
        random = Random(from_s)
        for tick in range(from_s * HZ, to_s * HZ):
            now_us = tick * SECOND // HZ
            for link, loss in losses.items():
                self.sent[link] += 1
                if random.random() >= loss:
                    self.selection.quality[link].on_frame(self.sent[link] % 256, now_us)
            if tick % 10 == 0:
                self.selection.renew_states(now_us)
                if self.selection.switch(busy, now_us):
                    selection = self.selection
                    self.switches.append((tick / HZ, selection.in_use, selection.cause))


def test_a_silent_link_is_left_within_four_seconds_and_used_again_after_ten() -> None:
    choice = Choice()
    choice.run(0, 20, {0: 0.0, 1: 0.0})
    choice.run(20, 30, {1: 0.0})
    choice.run(30, 60, {0: 0.0, 1: 0.0})
    (left_s, link, cause), (back_s, again, why) = choice.switches
    assert (link, cause, again, why) == (1, "silent", 0, "recovered")
    assert 22.9 <= left_s <= 24.0
    assert 40.0 <= back_s <= 41.0


def test_a_link_that_fails_again_and_again_is_used_less_and_less() -> None:
    choice = Choice()
    for cycle in range(10):
        choice.run(40 * cycle, 40 * cycle + 35, {0: 0.0, 1: 0.0})
        choice.run(40 * cycle + 35, 40 * cycle + 40, {1: 0.0})
    assert len(choice.switches) < 12


def test_a_degraded_link_is_left_and_two_equal_ones_are_not_swapped() -> None:
    choice = Choice()
    choice.run(0, 30, {0: 0.5, 1: 0.0})
    assert [(link, cause) for _, link, cause in choice.switches] == [(1, "loss")]
    choice = Choice()
    choice.run(0, 120, {0: DEGRADED_LOSS + 0.15, 1: DEGRADED_LOSS + 0.15})
    assert len(choice.switches) <= 2


def test_during_a_transfer_only_a_much_better_link_is_used() -> None:
    choice = Choice()
    choice.run(0, 20, {0: 0.0, 1: 0.0}, busy=True)
    choice.run(20, 60, {0: 0.35, 1: 0.25}, busy=True)
    assert choice.switches == []
    choice.run(60, 90, {0: 0.6, 1: 0.1}, busy=True)
    assert [link for _, link, _ in choice.switches] == [1]
    choice.run(90, 150, {0: 0.0, 1: 0.0}, busy=True)
    assert len(choice.switches) == 1
    choice.run(150, 160, {0: 0.0, 1: 0.0})
    assert len(choice.switches) == 2
