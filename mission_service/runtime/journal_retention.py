"""Writes states periodically, divides the journal into segments and deletes old segments.

A state is a snapshot of the service (``journal/snapshot.py``). A state is pickled on the event loop
between two events; a thread then compresses and writes it. This module also handles a full disk,
and raises an alarm before the disk is full.
"""

import asyncio
import shutil
from collections.abc import Callable
from pathlib import Path

from mission_service.config.service_section import JournalSection
from mission_service.journal.journal_file import Rest
from mission_service.journal.private_files import sync
from mission_service.journal.segments import (
    begin_state,
    earlier_state,
    newest_state,
    synced,
    trim,
)
from mission_service.journal.snapshot import Frozen, Known, write
from mission_service.runtime.clocks import clock_us
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import MissionClock

LOOK_EVERY_S = 0.5
# The number of journal bytes that a restart can read in about a second.
STATE_EVERY_BYTES = 4_000_000
LOW_FREE_BYTES, ENOUGH_FREE_BYTES = 500_000_000, 600_000_000


class JournalRetention:
    """The writer of the files that a restart needs, within the limits of the settings."""

    def __init__(self, service: Engine, shared: Known, settings: JournalSection) -> None:
        self._service = service
        self._shared_references = shared
        self._settings = settings
        self._written = service.recording.journal.rest
        self._written_us = clock_us()
        self.write_s = 0.0  # time taken to write the last state, including pickling

    async def maintain(self, clock: MissionClock) -> None:
        """Maintain the journal until cancelled."""
        while True:
            self._alarm_journal()
            self._alarm_space()
            if self._service.recording.trouble:
                clock.wall_passed(clock_us())
                self._service.retry(clock.now_us, clock_us())
            else:
                await self.look()
            await asyncio.sleep(LOOK_EVERY_S)

    async def look(self) -> None:
        """Begin a segment or write a state, if either is due."""
        journal, settings = self._service.recording.journal, self._settings
        rest, now_us = journal.rest, clock_us()
        if rest.at_byte >= settings.rotate_mb * 1e6:
            await self.begin_segment()
            return
        longer = (
            rest.at_byte - self._written.at_byte if rest.segment == self._written.segment else 0
        )
        late = now_us - self._written_us >= settings.state_every_s * 1e6
        if rest != self._written and (late or longer >= STATE_EVERY_BYTES):
            await self.write_state()

    async def write_state(self) -> None:
        """Write the newest state, after renaming the previous state (``earlier_state``)."""
        path, rest = self._service.recording.journal.path, self._service.recording.journal.rest
        await self._write(lambda frozen: _write_newest(path, frozen, rest), rest)

    async def begin_segment(self) -> None:
        """Close the journal's segment, begin the next one, and write the state at this point."""
        journal = self._service.recording.journal
        try:
            await asyncio.to_thread(sync, journal.path)  # the event loop then flushes little
            if self._service.recording.trouble:  # since then
                return
            frozen = Frozen(self._service.snapshot_fields(), self._shared_references)
            journal.begin_segment()
        except OSError as error:
            self._alarm_state(error)
            return
        path, rest = journal.path, journal.rest
        keep_mb = self._settings.keep_mb
        await self._write(lambda frozen: _write_begin(path, frozen, rest, keep_mb), rest, frozen)

    async def _write(
        self, write_it: Callable[[Frozen], None], rest: Rest, frozen: Frozen | None = None
    ) -> None:
        began_us = clock_us()
        frozen = frozen or Frozen(self._service.snapshot_fields(), self._shared_references)
        self._written, self._written_us = rest, began_us
        try:
            await asyncio.to_thread(write_it, frozen)
        except OSError as error:
            self._alarm_state(error)
        else:
            self.write_s = (clock_us() - began_us) / 1e6
            self._service.state_view.clear_alarm("state")

    def _alarm_state(self, error: OSError) -> None:
        """Raise the alarm for a state that was not written."""
        text = f"the state cannot be written ({error.strerror}): a restart will take longer"
        self._service.state_view.alarm("state", text)

    def _alarm_journal(self) -> None:
        state_view, trouble = self._service.state_view, self._service.recording.trouble
        if trouble:
            text = f"the journal cannot be written, so only aborts are executed: {trouble}"
            state_view.alarm("journal", text, "severe")
        else:
            state_view.clear_alarm("journal")

    def _alarm_space(self) -> None:
        """Raise the alarm for a disk that is almost full, until it has enough free space."""
        state_view, folder = self._service.state_view, self._service.recording.journal.path.parent
        try:
            free_bytes = shutil.disk_usage(folder).free
        except OSError:  # the folder is gone; the alarm of the journal reports it
            return
        is_raised = "disk" in state_view.alarms
        if free_bytes >= (ENOUGH_FREE_BYTES if is_raised else LOW_FREE_BYTES):
            state_view.clear_alarm("disk")
            return
        free_mb = round(free_bytes / 1e6, -1 if free_bytes >= 1e8 else 0)
        text = (
            f"only {free_mb:.0f} MB are free on the disk of {folder}; when the disk is full, the "
            "service executes only aborts: delete other files, or set service.journal.keep_mb"
        )
        state_view.alarm("disk", text)


def _write_newest(path: Path, frozen: Frozen, rest: Rest) -> None:
    synced(path)  # a state must not be ahead of its journal
    if newest_state(path).exists():
        newest_state(path).replace(earlier_state(path))
    write(newest_state(path), frozen, rest)


def _write_begin(path: Path, frozen: Frozen, rest: Rest, keep_mb: float | None) -> None:
    synced(path)
    write(begin_state(path, rest.segment), frozen, rest)
    if keep_mb is not None:
        trim(path, round(keep_mb * 1e6))
