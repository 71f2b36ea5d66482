"""A fire map replicated on all UAVs, which converges although messages are lost.

Every cell has a version, the time it was seen; the later version wins, and of equal ones a burning
cell. So a cell is one number, ``2 * seen_at_us + burning`` (0: unknown), and a merge takes the
larger one, independent of order, repetition and sender.

A UAV sends each view once, as a ``FireUpdate``, which may be lost. So every UAV sends now and then
a checksum of each tile of the map (``Digest``): the sum of a hash of each cell. A receiver with
another sum tests whether the difference is the hash of a cell or two of its own: then the sender
lacks these, and the receiver sends them (``Difference``). If not, the receiver may lack something
itself, and requests the tile by a digest of its own. If no UAV finds the missing cells from that,
one sends the whole tile, and the others what is newer.

Answers wait a few slots that depend on the name, and leave out what others have sent meanwhile.
The size of messages is bounded, and so is their rate.
"""

import zlib

import numpy as np
from numpy.typing import NDArray

from mission_service.errors import MissionServiceError
from mission_service.guidance.formation.shared_map_kernels import (
    TILE,
    cells_of_runs,
    differing_tiles,
    expand_runs,
    known_cells,
    merge,
    missing_cells,
    newer_cells,
    record_view,
)
from mission_service.peer_messages import Difference, Digest, FireUpdate

Cells = NDArray[np.int64]
MapMessage = FireUpdate | Digest | Difference

DIGEST_EVERY_US = 4_000_000  # up to TEAM UAVs; more UAVs send at the same total rate
TEAM = 8
PEER_FOR_US = 120_000_000  # a UAV without messages for longer is not counted
SLOT_US = 250_000
MAX_SLOTS = 16
AGAIN_US = 500_000  # at most one request and one difference in this time
DIGEST_TILES = 128  # at most in a message
DIFFERENCE_RUNS = 96  # no further tile after so many; one tile has TILE**2 at most

NONE: Cells = np.empty(0, dtype=np.int64)


class SharedMap:
    """The map of the UAV ``name``. ``fire`` (y, x) is true where it burns or has burned."""

    def __init__(self, name: str, shape: tuple[int, int]) -> None:
        self.name = name
        self.fire: NDArray[np.bool_] = np.zeros(shape, dtype=np.bool_)
        self.stamps: Cells = np.zeros(shape, dtype=np.int64)
        tiles = -(-shape[0] // TILE) * -(-shape[1] // TILE)
        self._sums: Cells = np.zeros(tiles, dtype=np.int64)
        self._seed = zlib.crc32(name.encode())
        self._draws = 0
        self._now_us = 0
        self._unsent: list[Cells] = []
        self._peers: dict[str, int] = {}  # name: time of the last message
        self._cells_due: dict[int, int] = {}  # cell: when to send it
        self._requests_due: dict[int, tuple[int, int]] = {}  # tile: when; the other's checksum
        self._tiles_due: dict[int, tuple[int, int]] = {}  # tile to send whole: likewise
        self._digest_at_us = self._ask_at_us = self._difference_at_us = 0  # not before
        self._next_tile = 0
        self._map = f"the map of {shape[0]} x {shape[1]} cells; all must have the same landscape"
        # Arrays that kernels write in.
        self._found: Cells = np.empty(max(tiles, TILE * TILE), dtype=np.int64)
        self._shares: Cells = np.empty(TILE * TILE, dtype=np.int64)
        self._theirs: Cells = np.empty(tiles, dtype=np.int64)

    def set_initial(self, cells_burning: Cells, at_us: int) -> None:
        """Set the map that all UAVs have before the mission; it is not sent."""
        self.add_view(cells_burning, NONE, at_us)
        self._unsent.clear()

    def add_view(
        self, cells_burning: Cells, cells_unburned: Cells, at_us: int
    ) -> tuple[Cells, Cells]:
        """Apply a camera view, which is newer than all received before.

        Returns the cells that burn now and did not on this map, and the other way round.
        """
        self._now_us = max(self._now_us, at_us)
        return self._record(cells_burning, True, at_us), self._record(cells_unburned, False, at_us)

    def _record(self, cells: Cells, burns: bool, at_us: int) -> Cells:
        if not len(cells):
            return NONE
        changed: Cells = np.empty(len(cells), dtype=np.int64)
        count, off_map = record_view(
            cells, burns, at_us, self.stamps, self.fire, self._sums, changed
        )
        self._check(cells, off_map, "sight")
        changed = changed[:count]
        if count:
            self._unsent.append(changed)
        return changed

    def on_message(self, message: MapMessage) -> tuple[Cells, Cells]:
        """Apply a message of another UAV; returns the changed cells, as ``add_view``.

        Raises MissionServiceError for cells that are not on the map: then nothing has changed.
        """
        if message.sender == self.name:
            return NONE, NONE
        self._peers[message.sender] = self._now_us
        if isinstance(message, Digest):
            self._compare(message)
            return NONE, NONE
        if isinstance(message, FireUpdate):
            cells = np.array(message.burning + message.cleared, dtype=np.int64)
            stamps = np.full(len(cells), 2 * message.at_us, dtype=np.int64)
            stamps[: len(message.burning)] += 1
        else:
            cells, stamps = self._cells_of(message)
        changed = self._merge(cells, stamps, message.sender)
        if isinstance(message, Difference):
            for tile in message.whole:
                self._answer(tile, cells, stamps)
        return changed

    def messages(self, at_us: int) -> list[MapMessage]:
        """The messages to send now: views since the last call, and what is due."""
        self._now_us = max(self._now_us, at_us)
        messages: list[MapMessage] = list(self._updates())
        if at_us >= self._difference_at_us and (self._cells_due or self._tiles_due):
            messages += self._difference(at_us)
        if at_us >= self._ask_at_us and self._requests_due:
            messages += self._question(at_us)
        if at_us >= self._digest_at_us:
            messages.append(self._digest(at_us))
        return messages

    def _updates(self) -> list[FireUpdate]:
        found = []
        for cells in self._unsent:
            stamps = self.stamps.ravel()[cells]
            for stamp in np.unique(stamps).tolist():
                of_it = tuple(cells[stamps == stamp].tolist())
                both = (of_it, ()) if stamp & 1 else ((), of_it)
                found.append(FireUpdate(stamp >> 1, self.name, *both))
        self._unsent.clear()
        return found

    def _digest(self, at_us: int) -> Digest:
        for peer in [p for p, at in self._peers.items() if at < at_us - PEER_FOR_US]:
            del self._peers[peer]
        every_us = DIGEST_EVERY_US * max(1 + len(self._peers), TEAM) // TEAM
        # At pseudo-random times, so that the UAVs send at different times and in changing order.
        self._digest_at_us = at_us + every_us * (12 + self._draw(8)) // 16
        first = self._next_tile
        tiles = first + np.flatnonzero(self._sums[first:])
        end = len(self._sums)
        if len(tiles) > DIGEST_TILES:
            end = int(tiles[DIGEST_TILES])
            tiles = tiles[:DIGEST_TILES]
        self._next_tile = end % len(self._sums)
        return Digest(at_us, self.name, self._with_sums(tiles), first, end)

    def _with_sums(self, tiles: Cells) -> tuple[tuple[int, int], ...]:
        return tuple(zip(tiles.tolist(), self._sums[tiles].tolist(), strict=True))

    def _compare(self, digest: Digest) -> None:
        """Schedule messages for the cells that either side lacks, by another UAV's checksums."""
        listed = np.array(digest.tiles, dtype=np.int64).reshape(-1, 2)
        count = differing_tiles(
            listed, digest.first, digest.end, self._sums, self._theirs, self._found
        )
        if count < 0:
            raise MissionServiceError(
                f"digest of {digest.sender}: it has tiles that are not on {self._map}"
            )
        for tile in self._found[:count].tolist():
            checksum = int(self._theirs[tile])
            due_us = self._slot_us()
            lacks = missing_cells(
                tile, checksum, self.stamps, self._sums, self._found, self._shares
            )
            if lacks:
                self._schedule_cells(lacks, due_us)
            elif digest.first == digest.end:
                self._tiles_due.setdefault(tile, (due_us, checksum))
            else:
                self._requests_due.setdefault(tile, (due_us, checksum))

    def _schedule_cells(self, count: int, due_us: int) -> None:
        """Schedule the first ``count`` cells of ``_found`` for sending."""
        for cell in self._found[:count].tolist():
            self._cells_due.setdefault(cell, due_us)

    def _cells_of(self, difference: Difference) -> tuple[Cells, Cells]:
        """All cells of the runs of a difference, and their stamps."""
        if difference.whole and max(difference.whole) >= len(self._sums):
            raise MissionServiceError(
                f"difference of {difference.sender}: tile {max(difference.whole)} is not on "
                f"{self._map}"
            )
        runs = np.array(difference.cells, dtype=np.int64).reshape(-1, 4)
        count = cells_of_runs(runs, self.fire.size)
        if count < 0:
            first, of_run, *_ = runs[-1 - count].tolist()
            raise MissionServiceError(
                f"difference of {difference.sender}: {of_run} cells from {first} on are not on "
                f"{self._map}"
            )
        cells, stamps = np.empty((2, count), dtype=np.int64)
        expand_runs(runs, cells, stamps)
        return cells, stamps

    def _merge(self, cells: Cells, stamps: Cells, sender: str) -> tuple[Cells, Cells]:
        changed: Cells = np.empty(len(cells), dtype=np.int64)
        on, off, off_map = merge(cells, stamps, self.stamps, self.fire, self._sums, changed)
        self._check(cells, off_map, f"fire map of {sender}")
        if self._cells_due:
            own = self.stamps.ravel()[cells]
            for cell in cells[own == stamps].tolist():
                self._cells_due.pop(cell, None)
        return changed[:on], changed[len(cells) - off :]

    def _check(self, cells: Cells, off_map: int, where: str) -> None:
        if off_map >= 0:
            raise MissionServiceError(f"{where}: cell {cells[off_map]} is not on {self._map}")

    def _answer(self, tile: int, cells: Cells, stamps: Cells) -> None:
        """Schedule the cells of a tile that are newer than in a whole tile received."""
        self._tiles_due.pop(tile, None)
        self._shares[:] = 0
        count = newer_cells(tile, cells, stamps, self.stamps, self._shares, self._found)
        self._schedule_cells(count, self._slot_us())

    def _difference(self, at_us: int) -> list[MapMessage]:
        due = [cell for cell, due_us in self._cells_due.items() if due_us <= at_us]
        due.sort(key=self._cells_due.__getitem__)
        stamps = self.stamps.ravel()
        runs = _runs(np.array(due, dtype=np.int64), stamps)[:DIFFERENCE_RUNS]
        for first, count, _, _ in runs:
            for cell in range(first, first + count):
                del self._cells_due[cell]
        whole: list[int] = []
        for tile, (due_us, checksum) in list(self._tiles_due.items()):
            if due_us > at_us:
                continue
            cells = self._found[: known_cells(tile, self.stamps, self._found)]
            more = _runs(cells, stamps)
            if runs and len(runs) + len(more) > DIFFERENCE_RUNS:
                break
            del self._tiles_due[tile]
            if checksum != self._sums[tile]:
                runs += more
                whole.append(tile)
                self._requests_due.pop(tile, None)  # UAVs with newer cells answer to the tile
        if not runs and not whole:
            return []
        self._difference_at_us = at_us + AGAIN_US
        return [Difference(at_us, self.name, tuple(runs), tuple(whole))]

    def _question(self, at_us: int) -> list[MapMessage]:
        tiles: list[int] = []
        for tile, (due_us, checksum) in list(self._requests_due.items()):
            if due_us <= at_us and len(tiles) < DIGEST_TILES:
                del self._requests_due[tile]
                if checksum != self._sums[tile]:
                    tiles.append(tile)
        if not tiles:
            return []
        self._ask_at_us = at_us + AGAIN_US
        return [Digest(at_us, self.name, self._with_sums(np.array(sorted(tiles))))]

    def _slot_us(self) -> int:
        """Time of an answer: a pseudo-random number of slots from now, fewer for few UAVs."""
        slots = min(max(len(self._peers) // 2, 2), MAX_SLOTS)
        return self._now_us + SLOT_US * self._draw(slots)

    def _draw(self, values: int) -> int:
        """0 to ``values`` - 1: a reproducible pseudo-random sequence of each UAV's own."""
        self._draws += 1
        x = (self._seed + self._draws * 0x9E3779B97F4A7C15) % 2**64
        x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        return (x >> 33) % values


def _runs(cells: Cells, stamps: Cells) -> list[tuple[int, int, int, bool]]:
    """Cells as the runs of a ``Difference``; ``stamps`` is the whole map's, flat."""
    if not len(cells):
        return []
    of_cells = stamps[cells]
    begins = np.ones(len(cells), dtype=np.bool_)
    begins[1:] = (np.diff(cells) != 1) | (np.diff(of_cells) != 0)
    first = np.flatnonzero(begins)
    count = np.diff(np.append(first, len(cells)))
    return [
        (cell, n, stamp >> 1, bool(stamp & 1))
        for cell, n, stamp in zip(
            cells[first].tolist(), count.tolist(), of_cells[first].tolist(), strict=True
        )
    ]
