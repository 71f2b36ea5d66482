"""A fire map with a copy on each UAV; the copies converge despite lost messages.

Every cell has a version, the time of its observation. A later version replaces an earlier version;
between equal versions, burning replaces unburned. A cell is therefore stored as one number, its
stamp: ``2 * seen_at_us + burning``, or 0 if unknown. A merge takes the larger stamp, so the order,
repetition and sender of messages do not matter.

A UAV sends each view once, as a ``FireUpdate``, which may be lost. Therefore every UAV regularly
sends a ``Digest`` with a checksum of each tile of the map. The checksum is the sum of the hashes of
the tile's cells. If the receiver's checksum of a tile differs, the receiver tests whether the
difference is the sum of the hashes of one or two of its own cells. If so, the sender lacks these
cells, and the receiver sends the cells (``Difference``). Otherwise the receiver itself may lack
cells, and sends its own digest of the tile as a request. If no UAV can derive the missing cells
from that digest, one UAV sends the whole tile, and the others send the cells that are newer on
their maps.

Replies are delayed by a pseudo-random number of slots (``SLOT_US``), and omit cells that other UAVs
have sent in the meantime. The size and the rate of messages are bounded.
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

# Interval between digests for up to TEAM UAVs; larger teams send at the same total rate.
DIGEST_EVERY_US = 4_000_000
TEAM = 8
PEER_FOR_US = 120_000_000  # a UAV counts as present for this time after its last message
SLOT_US = 250_000
MAX_SLOTS = 16
REPEAT_US = 500_000  # minimum interval between requests, and between differences
MAX_DIGEST_TILES = 128  # maximum number of tiles in a message
MAX_DIFFERENCE_RUNS = 96  # no tile is added beyond this number; one tile has up to TILE**2 runs

NONE: Cells = np.empty(0, dtype=np.int64)


class SharedMap:
    """The map of the UAV ``name``; ``fire`` (y, x) is true for burning and burned cells."""

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
        self._cells_due: dict[int, int] = {}  # cell: time to send it
        self._requests_due: dict[int, tuple[int, int]] = {}  # tile: time, checksum at the sender
        self._tiles_due: dict[int, tuple[int, int]] = {}  # tile to send as a whole: time, checksum
        # Earliest times of the next messages.
        self._digest_at_us = self._request_at_us = self._difference_at_us = 0
        self._next_tile = 0
        self._map = f"the map of {shape[0]} x {shape[1]} cells; use one landscape for all vehicles"
        # Arrays that kernels fill.
        self._found: Cells = np.empty(max(tiles, TILE * TILE), dtype=np.int64)
        self._shares: Cells = np.empty(TILE * TILE, dtype=np.int64)
        self._theirs: Cells = np.empty(tiles, dtype=np.int64)

    def set_initial(self, cells_burning: Cells, at_us: int) -> None:
        """Set the fire that all UAVs have on their maps before the mission, without sending it."""
        self.add_view(cells_burning, NONE, at_us)
        self._unsent.clear()

    def add_view(
        self, cells_burning: Cells, cells_unburned: Cells, at_us: int
    ) -> tuple[Cells, Cells]:
        """Apply a camera view, which is newer than all received cells.

        Returns the cells that have begun to burn on this map, and the cells that have ceased to
        burn.
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
        self._check(cells, off_map, "camera view")
        changed = changed[:count]
        if count:
            self._unsent.append(changed)
        return changed

    def on_message(self, message: MapMessage) -> tuple[Cells, Cells]:
        """Apply a message from another UAV; return the changed cells as ``add_view`` does.

        Raises MissionServiceError, and changes no cell, if a cell is not on the map.
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
                self._schedule_newer(tile, cells, stamps)
        return changed

    def messages(self, at_us: int) -> list[MapMessage]:
        """Return the messages to send now: views since the last call, due replies, and a digest."""
        self._now_us = max(self._now_us, at_us)
        messages: list[MapMessage] = list(self._updates())
        if at_us >= self._difference_at_us and (self._cells_due or self._tiles_due):
            messages += self._difference(at_us)
        if at_us >= self._request_at_us and self._requests_due:
            messages += self._request(at_us)
        if at_us >= self._digest_at_us:
            messages.append(self._digest(at_us))
        return messages

    def _updates(self) -> list[FireUpdate]:
        found = []
        for cells in self._unsent:
            stamps = self.stamps.ravel()[cells]
            for stamp in np.unique(stamps).tolist():
                seen = tuple(cells[stamps == stamp].tolist())
                parts = (seen, ()) if stamp & 1 else ((), seen)
                found.append(FireUpdate(stamp >> 1, self.name, *parts))
        self._unsent.clear()
        return found

    def _digest(self, at_us: int) -> Digest:
        for peer in [p for p, at in self._peers.items() if at < at_us - PEER_FOR_US]:
            del self._peers[peer]
        every_us = DIGEST_EVERY_US * max(1 + len(self._peers), TEAM) // TEAM
        # Pseudo-random intervals: the UAVs send at different times and in changing order.
        self._digest_at_us = at_us + every_us * (12 + self._draw(8)) // 16
        first = self._next_tile
        tiles = first + np.flatnonzero(self._sums[first:])
        end = len(self._sums)
        if len(tiles) > MAX_DIGEST_TILES:
            end = int(tiles[MAX_DIGEST_TILES])
            tiles = tiles[:MAX_DIGEST_TILES]
        self._next_tile = end % len(self._sums)
        return Digest(at_us, self.name, self._with_sums(tiles), first, end)

    def _with_sums(self, tiles: Cells) -> tuple[tuple[int, int], ...]:
        return tuple(zip(tiles.tolist(), self._sums[tiles].tolist(), strict=True))

    def _compare(self, digest: Digest) -> None:
        """Schedule replies to another UAV's checksums, for the cells that either UAV lacks."""
        listed = np.array(digest.tiles, dtype=np.int64).reshape(-1, 2)
        count = differing_tiles(
            listed, digest.first, digest.end, self._sums, self._theirs, self._found
        )
        if count < 0:
            raise MissionServiceError(
                f"digest of {digest.sender}: has tiles that are not on {self._map}"
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
        """Schedule the first ``count`` cells of ``_found`` to be sent at ``due_us``."""
        for cell in self._found[:count].tolist():
            self._cells_due.setdefault(cell, due_us)

    def _cells_of(self, difference: Difference) -> tuple[Cells, Cells]:
        """Return all cells in the runs of a difference, and the stamps of these cells."""
        if difference.whole and max(difference.whole) >= len(self._sums):
            raise MissionServiceError(
                f"difference of {difference.sender}: tile {max(difference.whole)} is not on "
                f"{self._map}"
            )
        runs = np.array(difference.cells, dtype=np.int64).reshape(-1, 4)
        count = cells_of_runs(runs, self.fire.size)
        if count < 0:
            first, length, *_ = runs[-1 - count].tolist()
            raise MissionServiceError(
                f"difference of {difference.sender}: {length} cells from {first} on are not on "
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

    def _schedule_newer(self, tile: int, cells: Cells, stamps: Cells) -> None:
        """Schedule those cells of a tile that are newer on this map than in the received tile."""
        self._tiles_due.pop(tile, None)
        self._shares[:] = 0
        count = newer_cells(tile, cells, stamps, self.stamps, self._shares, self._found)
        self._schedule_cells(count, self._slot_us())

    def _difference(self, at_us: int) -> list[MapMessage]:
        due = [cell for cell, due_us in self._cells_due.items() if due_us <= at_us]
        due.sort(key=self._cells_due.__getitem__)
        stamps = self.stamps.ravel()
        runs = _runs(np.array(due, dtype=np.int64), stamps)[:MAX_DIFFERENCE_RUNS]
        for first, count, _, _ in runs:
            for cell in range(first, first + count):
                del self._cells_due[cell]
        whole: list[int] = []
        for tile, (due_us, checksum) in list(self._tiles_due.items()):
            if due_us > at_us:
                continue
            cells = self._found[: known_cells(tile, self.stamps, self._found)]
            more = _runs(cells, stamps)
            if runs and len(runs) + len(more) > MAX_DIFFERENCE_RUNS:
                break
            del self._tiles_due[tile]
            if checksum != self._sums[tile]:
                runs += more
                whole.append(tile)
                self._requests_due.pop(tile, None)  # UAVs with newer cells reply to the tile
        if not runs and not whole:
            return []
        self._difference_at_us = at_us + REPEAT_US
        return [Difference(at_us, self.name, tuple(runs), tuple(whole))]

    def _request(self, at_us: int) -> list[MapMessage]:
        tiles: list[int] = []
        for tile, (due_us, checksum) in list(self._requests_due.items()):
            if due_us <= at_us and len(tiles) < MAX_DIGEST_TILES:
                del self._requests_due[tile]
                if checksum != self._sums[tile]:
                    tiles.append(tile)
        if not tiles:
            return []
        self._request_at_us = at_us + REPEAT_US
        return [Digest(at_us, self.name, self._with_sums(np.array(sorted(tiles))))]

    def _slot_us(self) -> int:
        """Return the time of a reply: the current time plus a pseudo-random number of slots.

        The larger the team, the more slots there are.
        """
        slots = min(max(len(self._peers) // 2, 2), MAX_SLOTS)
        return self._now_us + SLOT_US * self._draw(slots)

    def _draw(self, values: int) -> int:
        """Return the next pseudo-random number from 0 to ``values`` - 1; the name is the seed."""
        self._draws += 1
        x = (self._seed + self._draws * 0x9E3779B97F4A7C15) % 2**64
        x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        return (x >> 33) % values


def _runs(cells: Cells, stamps: Cells) -> list[tuple[int, int, int, bool]]:
    """Return cells as the runs of a ``Difference``; ``stamps`` are the map's stamps, flattened."""
    if not len(cells):
        return []
    cell_stamps = stamps[cells]
    begins = np.ones(len(cells), dtype=np.bool_)
    begins[1:] = (np.diff(cells) != 1) | (np.diff(cell_stamps) != 0)
    first = np.flatnonzero(begins)
    count = np.diff(np.append(first, len(cells)))
    return [
        (cell, n, stamp >> 1, bool(stamp & 1))
        for cell, n, stamp in zip(
            cells[first].tolist(), count.tolist(), cell_stamps[first].tolist(), strict=True
        )
    ]
