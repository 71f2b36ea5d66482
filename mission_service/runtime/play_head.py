"""The play head of a replay: where on the log's clock it is, and how fast it goes. Pure."""

from typing import Literal

import msgspec

from mission_service.errors import RequestError
from mission_service.requests import MAX_SPEED, MIN_SPEED

Speed = float | Literal["max"]


class ReplayState(msgspec.Struct, tag="replay/1", tag_field="schema"):
    """Where a replay is. Times beside ``at_us`` (mission time) are of the log's own clock.

    Whenever ``jumps`` is another, all is as of another moment: ask for the whole state again.
    """

    at_us: int
    logs: tuple[str, ...]
    log_begin_us: int
    log_end_us: int
    log_at_us: int  # while it is seeking, where it will be
    begin_us: int  # the mission time of ``log_begin_us``
    speed: Speed
    paused: bool
    seeking: bool
    ended: bool  # all is told
    jumps: int


def checked_speed(speed: Speed) -> Speed:
    """The speed itself. Raises RequestError for one that is not possible."""
    if speed != "max" and not MIN_SPEED <= speed <= MAX_SPEED:
        raise RequestError(f"speed: from {MIN_SPEED:g} to {MAX_SPEED:g} times, or max")
    return speed


class PlayHead:
    """Goes along the log's clock as the machine's clock does, ``speed`` times as fast.

    It stands where all has been told: what is due is asked for, and what was done of it is said
    with ``reached``, so it never runs ahead of a machine that is too slow. ``now_us`` is the
    machine's clock.
    """

    def __init__(self, begin_us: int, end_us: int, speed: Speed = 1.0) -> None:
        self.begin_us = begin_us
        self.end_us = end_us
        self.at_us = begin_us
        self.speed: Speed = checked_speed(speed)
        self.paused = False
        self.seek_to_us: int | None = None
        self._since_us: int | None = None  # it has been at ``at_us``; None: not begun

    @property
    def ended(self) -> bool:
        """Whether it is at the end, where it pauses by itself."""
        return self.at_us >= self.end_us

    def due_us(self, now_us: int) -> int:
        """Up to which time of the log all should have been told by now."""
        if self.seek_to_us is not None:
            return self.seek_to_us
        if self.paused:
            return self.at_us
        if self.speed == "max":
            return self.end_us
        if self._since_us is None:
            self._since_us = now_us
        passed_us = max(now_us - self._since_us, 0)
        return min(self.at_us + round(passed_us * self.speed), self.end_us)

    def reached(self, at_us: int, now_us: int) -> None:
        """All is told up to here; at the end it pauses, and where it sought it goes on."""
        self.at_us = min(max(at_us, self.begin_us), self.end_us)
        self._since_us = now_us
        if self.seek_to_us is not None and self.at_us == self.seek_to_us:
            self.seek_to_us = None
        if self.ended and self.seek_to_us is None:
            self.paused = True

    def pause(self) -> None:
        """Stay here."""
        self.paused = True

    def resume(self, now_us: int) -> None:
        """Go on; from the end, from the beginning."""
        if not self.paused:
            return
        self.paused = False
        self._since_us = now_us
        if self.ended and self.seek_to_us is None:
            self.seek(self.begin_us)

    def go_at(self, speed: Speed) -> None:
        """Another speed from now on. Raises RequestError."""
        self.speed = checked_speed(speed)

    def seek(self, to_us: int) -> None:
        """Be somewhere else as soon as all is told up to there."""
        self.seek_to_us = min(max(to_us, self.begin_us), self.end_us)
