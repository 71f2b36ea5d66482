"""Moves the play head of a replay along the log's clock. Pure."""

from typing import Literal

import msgspec

from mission_service.errors import RequestError
from mission_service.requests import MAX_SPEED, MIN_SPEED

Speed = float | Literal["max"]


class ReplayState(msgspec.Struct, tag="replay/1", tag_field="schema"):
    """The state of a replay. All times except ``at_us`` (mission time) are on the log's clock.

    ``jumps`` counts changes to another time, after which clients must read all states again.
    """

    at_us: int
    logs: tuple[str, ...]
    log_begin_us: int
    log_end_us: int
    log_at_us: int  # during a seek, the destination of the seek
    begin_us: int  # the mission time of ``log_begin_us``
    speed: Speed
    paused: bool
    seeking: bool
    ended: bool  # all entries were played
    jumps: int


def checked_speed(speed: Speed) -> Speed:
    """Return the speed unchanged. Raises RequestError for a speed out of range."""
    if speed != "max" and not MIN_SPEED <= speed <= MAX_SPEED:
        raise RequestError(f"speed: must be from {MIN_SPEED:g} to {MAX_SPEED:g}, or max")
    return speed


class PlayHead:
    """A play head that advances on the log's clock at ``speed`` times real time.

    The position of the play head is the time up to which all entries were played. ``due_us``
    returns the time up to which entries are due, and ``reached`` sets the position, so that the
    play head never runs ahead of a slow machine. ``now_us`` is the time on the machine's clock.
    """

    def __init__(self, begin_us: int, end_us: int, speed: Speed = 1.0) -> None:
        self.begin_us = begin_us
        self.end_us = end_us
        self.at_us = begin_us
        self.speed: Speed = checked_speed(speed)
        self.paused = False
        self.seek_to_us: int | None = None
        self._since_us: int | None = None  # machine's clock at ``at_us``; None: not started

    @property
    def ended(self) -> bool:
        """Whether the play head is at the end, where it pauses automatically."""
        return self.at_us >= self.end_us

    def due_us(self, now_us: int) -> int:
        """Return the log time up to which entries are due."""
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
        """Set the position to a time up to which all entries were played; pause at the end."""
        self.at_us = min(max(at_us, self.begin_us), self.end_us)
        self._since_us = now_us
        if self.seek_to_us is not None and self.at_us == self.seek_to_us:
            self.seek_to_us = None
        if self.ended and self.seek_to_us is None:
            self.paused = True

    def pause(self) -> None:
        """Stop at the current position."""
        self.paused = True

    def resume(self, now_us: int) -> None:
        """Continue; at the end, start again from the beginning."""
        if not self.paused:
            return
        self.paused = False
        self._since_us = now_us
        if self.ended and self.seek_to_us is None:
            self.seek(self.begin_us)

    def go_at(self, speed: Speed) -> None:
        """Change the speed. Raises RequestError for a speed out of range."""
        self.speed = checked_speed(speed)

    def seek(self, to_us: int) -> None:
        """Move to a log time: all entries up to that time are due at once."""
        self.seek_to_us = min(max(to_us, self.begin_us), self.end_us)
