"""Plays a flight with pause and seek; keeps states from which a seek can continue.

A seek computes a second replay from the nearest earlier state, while the replay shown stays
unchanged; when the second one has arrived, it replaces the first. The work is divided into short
turns, so that it does not block the event loop. Pure: the caller passes the time.
"""

from collections.abc import Callable
from typing import NamedTuple

from mission_service.journal.journal_file import Rest
from mission_service.journal.snapshot import Frozen, Known, restore
from mission_service.replay.flights.entry_cache import EntryCache
from mission_service.replay.flights.flight_logs import VehicleLog
from mission_service.replay.flights.open_loop_replay import OpenLoopReplay, Told, told_in
from mission_service.replay.flights.scenario_pairing import Replaying
from mission_service.replay.flights.write_once_journal import WriteOnceJournal
from mission_service.runtime.play_head import PlayHead, ReplayState
from mission_service.runtime.state_view import StateView

MAX_KEPT = 20
KEPT_EVERY_US = 30_000_000
MAX_KEPT_BYTES = 200_000_000


class _Kept(NamedTuple):
    """A kept state: index of the next entry, time of the last one, position in the journal."""

    number: int
    at_us: int
    rest: Rest
    frozen: Frozen

    @property
    def size(self) -> int:
        return sum(len(part) for part in self.frozen.parts)


class _Telling:
    """A replay and its position in the flight."""

    def __init__(self, replay: OpenLoopReplay, number: int, at_us: int, rest: Rest) -> None:
        self.replay = replay
        self.number = number
        self.at_us = at_us
        self.rest = rest


class Playback:
    """Plays a flight as its play head prescribes."""

    def __init__(self, what: Replaying, journal: WriteOnceJournal, head: PlayHead) -> None:
        self.what = what
        self.head = head
        self.jumps = 0
        self.complete = False  # whether the flight was ever played to its end
        self._journal = journal
        self._known = Known(what.scenario, what.landscape)
        self._cache: EntryCache[Told] = EntryCache(told_in(what))
        self._cache.get(0)  # first of all: a journal is read once for its operators' requests
        state_view = StateView(what.scenario, what.landscape, what.mission.start_us)
        replay = OpenLoopReplay(what, journal, state_view)
        self._shown = _Telling(replay, 0, head.begin_us, journal.rest)
        self._every_us = max(KEPT_EVERY_US, (head.end_us - head.begin_us) // MAX_KEPT)
        self._kept = [self._state_of(self._shown)]
        if 4 * self._kept[0].size > MAX_KEPT_BYTES:  # too large: seek from the beginning
            self._every_us = 1 << 62
        self._work = self._shown  # the replay that is played or sought in
        self._seeks_us: int | None = None

    @property
    def replay(self) -> OpenLoopReplay:
        """The replay that is shown."""
        return self._shown.replay

    @property
    def state_view(self) -> StateView:
        """The state view of the replay that is shown."""
        state_view = self.replay.service.state_view
        assert state_view is not None
        return state_view

    def state(self) -> ReplayState:
        """Return the state of the playback, for interfaces."""
        head, mission = self.head, self.what.mission
        sought = head.seek_to_us
        at_us = head.at_us if sought is None else sought
        return ReplayState(
            mission.of(head.at_us),
            self.what.logs,
            head.begin_us,
            head.end_us,
            at_us,
            mission.of(head.begin_us),
            head.speed,
            head.paused,
            sought is not None,
            head.ended,
            self.jumps,
        )

    def close(self) -> None:
        """Return the end."""
        self._journal.finish(self.complete)
        self._cache.close()

    def turn(self, now_us: int, is_over: Callable[[], bool]) -> bool:
        """Play the entries that are due until the turn is over; returns whether more are due."""
        head = self.head
        due_us = head.due_us(now_us)
        if head.seek_to_us is None:
            self._seeks_us = None
            if due_us == head.at_us and head.paused:
                return False
            done = self._play(self._shown, due_us, is_over)
            head.reached(due_us if done else max(self._shown.at_us, head.at_us), now_us)
            self.complete |= done and head.ended
            return not done
        if self._seeks_us != due_us:
            self._seeks_us, self._work = due_us, self._nearest(due_us)
        done = self._play(self._work, due_us, is_over)
        if done:
            self._arrived()
            head.reached(due_us, now_us)
            self.complete |= head.ended
        return not done

    def _arrived(self) -> None:
        if self._work is not self._shown:
            before, self._shown = self.state_view, self._work
            self.state_view.take_the_place_of(before)
            # published before, or skipped by the seek
            self.replay.service.record.announcements.clear()
        else:
            self.state_view.replay_changed()
        self.jumps += 1
        self._seeks_us = None

    def _nearest(self, to_us: int) -> _Telling:
        """Return the start of a seek: a current replay, or else a kept state."""
        kept = max(
            (each for each in self._kept if each.at_us <= to_us),
            key=lambda each: each.number,
            default=self._kept[0],
        )
        there = [each for each in (self._work, self._shown) if each.at_us <= to_us]
        best = max(there, key=lambda each: each.number, default=None)
        if best is not None and best.number >= kept.number:
            return best
        what = self.what
        replay = OpenLoopReplay(what, self._journal, kept=restore(kept.frozen))
        return _Telling(replay, kept.number, kept.at_us, kept.rest)

    def _play(self, telling: _Telling, until_us: int, is_over: Callable[[], bool]) -> bool:
        """Play up to a time; returns whether it was reached before the turn was over."""
        self._journal.rest = telling.rest
        try:
            while True:
                told = self._cache.get(telling.number)
                if told is None or self._log_us(told) > until_us:
                    return True
                telling.replay.apply(told)
                telling.number += 1
                telling.at_us = max(telling.at_us, self._log_us(told))
                telling.rest = self._journal.rest
                self._keep(telling)
                if is_over():
                    return False
        finally:
            telling.rest = self._journal.rest

    def _log_us(self, told: Told) -> int:
        return told.at_us if isinstance(told, VehicleLog) else self.what.mission.log_us(told.at_us)

    def _keep(self, telling: _Telling) -> None:
        """Keep a state if the last one is old enough; number and total size are limited."""
        if telling.at_us < self._kept[-1].at_us + self._every_us:
            return
        self._kept.append(self._state_of(telling))
        if sum(each.size for each in self._kept) > MAX_KEPT_BYTES:
            self._kept = self._kept[::2]  # the first one stays
            self._every_us *= 2

    def _state_of(self, telling: _Telling) -> _Kept:
        frozen = Frozen(telling.replay.snapshot_fields(), self._known)
        return _Kept(telling.number, telling.at_us, telling.rest, frozen)
