"""Keeps takeoffs and landings at one home apart in time. Pure."""

from bisect import bisect_left, insort


class HomeMovements:
    """The times of takeoffs and landings at one home, at least ``spacing_s`` apart."""

    def __init__(self, spacing_s: int) -> None:
        self.spacing_s = spacing_s
        self.times_s: list[int] = []

    def occupy(self, at_s: int) -> None:
        """Add a takeoff or a landing."""
        insort(self.times_s, at_s)

    def forget_before(self, at_s: int) -> None:
        """Remove the movements before a given time; no later query may concern them."""
        del self.times_s[: bisect_left(self.times_s, at_s)]

    def latest(self, until_s: int, from_s: int) -> int | None:
        """Return the latest free time from ``from_s`` to ``until_s``; None if there is none."""
        at_s = until_s
        for taken_s in reversed(self.times_s):
            if taken_s >= at_s + self.spacing_s:
                continue
            if taken_s <= at_s - self.spacing_s:
                break
            at_s = taken_s - self.spacing_s
        return at_s if at_s >= from_s else None

    def earliest(self, from_s: int) -> int:
        """Return the earliest free time at or after ``from_s``."""
        at_s = from_s
        for taken_s in self.times_s:
            if taken_s <= at_s - self.spacing_s:
                continue
            if taken_s >= at_s + self.spacing_s:
                break
            at_s = taken_s + self.spacing_s
        return at_s
