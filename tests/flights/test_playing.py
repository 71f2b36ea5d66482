"""The play head: the replay's time as a function of the machine's time."""

import pytest

from mission_service.errors import RequestError
from mission_service.runtime.play_head import PlayHead

S = 1_000_000
BEGIN, END = 5_000 * S, 5_100 * S


def played(head: PlayHead, now_us: int) -> int:
    """Play all events that are due, as a player does."""
    head.reached(head.due_us(now_us), now_us)
    return head.at_us - BEGIN


@pytest.mark.parametrize(
    ("speed", "after_s"), [(0.1, 1.0), (1.0, 10.0), (7.5, 75.0), (100.0, 100.0)]
)
def test_it_goes_along_the_log_at_its_speed(speed: float, after_s: float) -> None:
    head = PlayHead(BEGIN, END, speed)
    assert played(head, 77 * S) == 0  # it starts at the first call
    for tick in range(1, 101):
        there = played(head, 77 * S + tick * S // 10)
    assert there == after_s * S
    assert head.ended == head.paused == (after_s == 100.0)


def test_as_fast_as_can_be_all_is_due_at_once() -> None:
    head = PlayHead(BEGIN, END, "max")
    assert head.due_us(0) == END
    head.reached(BEGIN + 30 * S, 20_000)  # the machine could play this number in one turn
    assert not head.ended
    assert head.due_us(20_000) == END


def test_a_player_that_is_too_slow_continues_from_its_position() -> None:
    head = PlayHead(BEGIN, END, 100.0)
    head.due_us(0)
    assert head.due_us(S // 2) == BEGIN + 50 * S
    head.reached(BEGIN + 5 * S, S // 2)
    assert head.due_us(S // 2) == BEGIN + 5 * S  # and it does not jump ahead to catch up
    assert head.due_us(S) == BEGIN + 55 * S


def test_a_pause_lasts_until_it_goes_on() -> None:
    head = PlayHead(BEGIN, END)
    head.due_us(0)
    assert played(head, 10 * S) == 10 * S
    head.pause()
    assert played(head, 60 * S) == 10 * S
    head.resume(60 * S)
    head.resume(61 * S)  # it is already playing
    assert played(head, 62 * S) == 12 * S


def test_another_speed_holds_from_now_on() -> None:
    head = PlayHead(BEGIN, END)
    head.due_us(0)
    played(head, 10 * S)
    head.go_at(4.0)
    assert played(head, 15 * S) == 30 * S


@pytest.mark.parametrize("speed", [0.0, 0.09, 101.0, -1.0, float("nan")])
def test_impossible_speeds_are_refused(speed: float) -> None:
    head = PlayHead(BEGIN, END)
    with pytest.raises(RequestError, match=r"from 0\.1 to 100, or max"):
        head.go_at(speed)
    assert head.speed == 1.0


def test_a_seek_is_due_wholly_and_time_counts_from_its_end() -> None:
    head = PlayHead(BEGIN, END)
    head.due_us(0)
    played(head, 10 * S)
    head.seek(BEGIN + 60 * S)
    assert head.due_us(11 * S) == BEGIN + 60 * S
    head.reached(head.due_us(11 * S), 15 * S)  # it took four seconds
    assert head.seek_to_us is None
    assert played(head, 16 * S) == 61 * S
    head.seek(BEGIN + 3 * S)
    assert played(head, 17 * S) == 3 * S
    for beyond, there in ((BEGIN - S, 0), (END + S, 100 * S)):
        head.seek(beyond)
        assert played(head, 18 * S) == there
    assert head.ended
    assert head.paused


def test_paused_it_stays_where_it_was_sought() -> None:
    head = PlayHead(BEGIN, END)
    head.pause()
    head.seek(BEGIN + 60 * S)
    assert played(head, S) == 60 * S
    assert played(head, 30 * S) == 60 * S


def test_at_the_end_it_starts_again() -> None:
    head = PlayHead(BEGIN, END, 100.0)
    head.due_us(0)
    assert played(head, 2 * S) == 100 * S
    head.resume(3 * S)
    assert played(head, 4 * S) == 0
    assert played(head, 5 * S) == 100 * S
