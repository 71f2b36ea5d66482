"""Plays a flight with pause and seek, and stores states from which a seek can start.

A seek computes a second replay from the nearest earlier state, while the interfaces still show the
first replay. When the second replay has reached the requested time, it replaces the first. The
computation is divided into short turns and therefore does not block the event loop. Pure: the
caller passes the time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mission_service.journal.journal_file import Rest
from mission_service.journal.snapshot import Frozen, Known, restore
from mission_service.replay.flights.entry_cache import EntryCache
from mission_service.replay.flights.flight_logs import VehicleLog
from mission_service.replay.flights.open_loop_replay import FlightEntry, OpenLoopReplay, entries_of
from mission_service.replay.flights.scenario_pairing import Pairing
from mission_service.replay.flights.write_once_journal import WriteOnceJournal
from mission_service.runtime.play_head import PlayHead, ReplayState
from mission_service.runtime.state_view import StateView

MAX_STATES = 20
STATE_EVERY_US = 30_000_000
MAX_STATES_BYTES = 200_000_000


class _SavedState(NamedTuple):
    """A saved state: index of the next entry, time of the last entry, position in the journal."""

    number: int
    at_us: int
    rest: Rest
    frozen: Frozen

    @property
    def size(self) -> int:
        return sum(len(part) for part in self.frozen.parts)


@dataclass(eq=False)
class _Progress:
    """A replay and its position in the flight, as in ``_SavedState``."""

    replay: OpenLoopReplay
    number: int
    at_us: int
    rest: Rest


class Playback:
    """The playback of a flight, controlled by its play head."""

    def __init__(self, pairing: Pairing, journal: WriteOnceJournal, head: PlayHead) -> None:
        self.pairing = pairing
        self.head = head
        self.jumps = 0
        self.complete = False  # whether the whole flight has been played
        self._journal = journal
        self._shared_references = Known(pairing.scenario, pairing.landscape)
        self._cache: EntryCache[FlightEntry] = EntryCache(entries_of(pairing))
        self._cache.get(0)  # reads a journal once for its operators' requests
        replay = OpenLoopReplay(pairing, journal)
        self._shown = _Progress(replay, 0, head.begin_us, journal.rest)
        self._every_us = max(STATE_EVERY_US, (head.end_us - head.begin_us) // MAX_STATES)
        self._states = [self._state_of(self._shown)]
        # If states are too large, only the first is saved, and seeks begin at the first entry.
        if 4 * self._states[0].size > MAX_STATES_BYTES:
            self._every_us = 1 << 62
        self._work = self._shown  # the replay that a seek computes
        self._seeks_us: int | None = None

    @property
    def replay(self) -> OpenLoopReplay:
        """The replay that the interfaces show."""
        return self._shown.replay

    @property
    def state_view(self) -> StateView:
        """The state view of the replay that the interfaces show."""
        return self.replay.service.state_view

    def state(self) -> ReplayState:
        """Return the state of the playback, for interfaces."""
        head, mission = self.head, self.pairing.mission
        seeking = head.seek_to_us is not None
        return ReplayState(
            at_us=mission.of(head.at_us),
            logs=self.pairing.logs,
            log_begin_us=head.begin_us,
            log_end_us=head.end_us,
            log_at_us=head.at_us if head.seek_to_us is None else head.seek_to_us,
            begin_us=mission.of(head.begin_us),
            speed=head.speed,
            paused=head.paused,
            seeking=seeking,
            ended=head.ended,
            jumps=self.jumps,
        )

    def close(self) -> None:
        """Close the journal and the cache."""
        self._journal.finish(self.complete)
        self._cache.close()

    def turn(self, now_us: int, is_over: Callable[[], bool]) -> bool:
        """Play due entries until ``is_over`` returns True; return whether more entries are due."""
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
        else:
            self.state_view.replay_changed()
        self.jumps += 1
        self._seeks_us = None

    def _nearest(self, to_us: int) -> _Progress:
        """Return the start of a seek: one of the two replays, or a replay from a saved state."""
        saved = max(
            (each for each in self._states if each.at_us <= to_us),
            key=lambda each: each.number,
            default=self._states[0],
        )
        earlier = [each for each in (self._work, self._shown) if each.at_us <= to_us]
        best = max(earlier, key=lambda each: each.number, default=None)
        if best is not None and best.number >= saved.number:
            return best
        replay = OpenLoopReplay(self.pairing, self._journal, saved=restore(saved.frozen))
        return _Progress(replay, saved.number, saved.at_us, saved.rest)

    def _play(self, progress: _Progress, until_us: int, is_over: Callable[[], bool]) -> bool:
        """Play up to a time; return whether it was reached before ``is_over`` returned True."""
        self._journal.rest = progress.rest
        try:
            while True:
                entry = self._cache.get(progress.number)
                if entry is None or self._log_us(entry) > until_us:
                    return True
                progress.replay.apply(entry)
                progress.number += 1
                progress.at_us = max(progress.at_us, self._log_us(entry))
                progress.rest = self._journal.rest
                self._save(progress)
                if is_over():
                    return False
        finally:
            progress.rest = self._journal.rest

    def _log_us(self, entry: FlightEntry) -> int:
        if isinstance(entry, VehicleLog):
            return entry.at_us
        return self.pairing.mission.log_us(entry.at_us)

    def _save(self, progress: _Progress) -> None:
        """Save a state if the last saved state is old enough, within a total size limit."""
        if progress.at_us < self._states[-1].at_us + self._every_us:
            return
        self._states.append(self._state_of(progress))
        if sum(each.size for each in self._states) > MAX_STATES_BYTES:
            self._states = self._states[::2]  # the first state remains
            self._every_us *= 2

    def _state_of(self, progress: _Progress) -> _SavedState:
        frozen = Frozen(progress.replay.snapshot_fields(), self._shared_references)
        return _SavedState(progress.number, progress.at_us, progress.rest, frozen)
