"""A fire map that all UAVs share, and that becomes the same on all after messages were lost.

Every cell has a version, the time it was seen; of two the later counts, and of equal ones that it
burns. So a cell is one number, ``2 * seen_at_us + burning`` (0: never heard of), and hearing is
taking the larger one: in whatever order, however often, and from whomever it comes.

What a UAV sees it says once, as a ``FireUpdate``; of that some is lost. So everybody says now and
then a checksum for each tile of the map (``Digest``). A checksum is the sum of a mixed number for
each cell. Who hears one that is not its own looks whether the difference of the two sums is just a
cell or two of its own: then it is those that the other lacks, and it says them (``Difference``).
If not, it may lack something itself: it asks with its own checksum of that tile. If nobody knows
from that what it lacks, somebody says the whole tile, and everybody what is newer than that.

Nobody answers at once: each waits a few slots that depend on its name, and says nothing of what it
heard others say meanwhile. Messages are bounded in size, and so is how often they come.
"""

import zlib

import numpy as np
from numpy.typing import NDArray

from firemodel.compiled import kernel
from mission_service.errors import MissionServiceError
from mission_service.formation.fire_maps import check_cells
from mission_service.formation.messages import Difference, Digest, FireUpdate

Cells = NDArray[np.int64]
MapMessage = FireUpdate | Digest | Difference

TILE = 16  # cells to a side
CHECKSUM = 2**40 - 1  # so many values; less than 2**53, which is as far as JSON's numbers are safe

DIGEST_EVERY_US = 4_000_000  # up to eight UAVs; with more each speaks less, all together the same
TEAM = 8
PEER_FOR_US = 120_000_000  # who said nothing for longer is not counted
SLOT_US = 250_000
MOST_SLOTS = 16
AGAIN_US = 500_000  # at most one question and one difference in this time
DIGEST_TILES = 128  # at most in a message
DIFFERENCE_RUNS = 96  # no further tile after so many; one tile has TILE**2 at most

NONE: Cells = np.empty(0, dtype=np.int64)


class SharedMap:
    """The map of the UAV ``name``. ``fire`` (y, x) is true where it burns or has burned."""

    def __init__(self, name: str, shape: tuple[int, int]) -> None:
        self.name = name
        self.fire: NDArray[np.bool_] = np.zeros(shape, dtype=np.bool_)
        self.stamps: Cells = np.zeros(shape, dtype=np.int64)
        self._sums: Cells = np.zeros(-(-shape[0] // TILE) * -(-shape[1] // TILE), dtype=np.int64)
        self._seed = zlib.crc32(name.encode())
        self._draws = 0
        self._now_us = 0
        self._news: list[Cells] = []
        self._peers: dict[str, int] = {}  # when heard
        self._gives: dict[int, int] = {}  # cell: when to say it
        self._asks: dict[int, tuple[int, int]] = {}  # tile: when to ask, another's checksum
        self._tells: dict[int, tuple[int, int]] = {}  # tile: when to say it whole, likewise
        self._digest_at_us = self._ask_at_us = self._difference_at_us = 0  # not before
        self._next_tile = 0

    def start(self, cells_burning: Cells, at_us: int) -> None:
        """The map that all were given before the mission: known, and not news."""
        self.see(cells_burning, NONE, at_us)
        self._news.clear()

    def see(self, cells_burning: Cells, cells_unburned: Cells, at_us: int) -> tuple[Cells, Cells]:
        """Take in what is seen now; it is later than all that was heard before.

        Returns the cells that burn now and did not on this map, and the other way round.
        """
        self._now_us = max(self._now_us, at_us)
        changed = []
        for cells, burns in ((cells_burning, True), (cells_unburned, False)):
            found = NONE
            if len(cells):
                check_cells(cells, self.fire.shape)
                found = np.empty(len(cells), dtype=np.int64)
                count = _see(cells, burns, at_us, self.stamps, self.fire, self._sums, found)
                found = found[:count]
                if count:
                    self._news.append(found)
            changed.append(found)
        return changed[0], changed[1]

    def hear(self, message: MapMessage) -> tuple[Cells, Cells]:
        """Take in what another said; returns what changed, as ``see``.

        Raises MissionServiceError for cells that are not on the map.
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
        changed = self._merge(cells, stamps)
        if isinstance(message, Difference):
            for tile in message.whole:
                self._answer(tile, cells, stamps)
        return changed

    def messages(self, at_us: int) -> list[MapMessage]:
        """What is to be said now: what was seen since, and what is due."""
        self._now_us = max(self._now_us, at_us)
        said: list[MapMessage] = list(self._updates())
        if at_us >= self._difference_at_us and (self._gives or self._tells):
            said += self._difference(at_us)
        if at_us >= self._ask_at_us and self._asks:
            said += self._question(at_us)
        if at_us >= self._digest_at_us:
            said.append(self._digest(at_us))
        return said

    def _updates(self) -> list[FireUpdate]:
        found = []
        for cells in self._news:
            stamps = self.stamps.ravel()[cells]
            for stamp in np.unique(stamps).tolist():
                of_it = tuple(cells[stamps == stamp].tolist())
                both = (of_it, ()) if stamp & 1 else ((), of_it)
                found.append(FireUpdate(stamp >> 1, self.name, *both))
        self._news.clear()
        return found

    def _digest(self, at_us: int) -> Digest:
        for peer in [p for p, at in self._peers.items() if at < at_us - PEER_FOR_US]:
            del self._peers[peer]
        every_us = DIGEST_EVERY_US * max(1 + len(self._peers), TEAM) // TEAM
        # Not all at the same time, nor always after the same one.
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
        """Find out who lacks what, by another's checksums."""
        sums = np.array(digest.tiles, dtype=np.int64).reshape(-1, 2)
        count = len(self._sums)
        tiles = sums[:, 0]
        if not 0 <= digest.first <= digest.end <= count or ((tiles < 0) | (tiles >= count)).any():
            raise MissionServiceError(
                f"digest of {digest.sender}: it has tiles beyond the {count} of this map; "
                "all must fly with the same landscape"
            )
        theirs = self._sums.copy()
        theirs[digest.first : digest.end] = 0
        theirs[tiles] = sums[:, 1]
        found = np.empty(TILE * TILE, dtype=np.int64)
        for tile in np.flatnonzero(theirs != self._sums).tolist():
            checksum = int(theirs[tile])
            lacked = _lacked(tile, checksum, self.stamps, self._sums, found)
            due_us = self._slot_us()
            if lacked:
                for cell in found[:lacked].tolist():
                    self._gives.setdefault(cell, due_us)
            elif digest.first == digest.end:
                self._tells.setdefault(tile, (due_us, checksum))
            else:
                self._asks.setdefault(tile, (due_us, checksum))

    def _cells_of(self, difference: Difference) -> tuple[Cells, Cells]:
        """All cells of its runs, and their stamps."""
        runs = np.array(difference.cells, dtype=np.int64).reshape(-1, 4)
        first, count = runs[:, 0], runs[:, 1]
        if len(runs):
            check_cells(first, self.fire.shape)
            check_cells(first + count - 1, self.fire.shape)
            check_cells(count, self.fire.shape)
        before = np.cumsum(count) - count
        cells = np.repeat(first - before, count) + np.arange(count.sum())
        return cells, np.repeat(2 * runs[:, 2] + runs[:, 3], count)

    def _merge(self, cells: Cells, stamps: Cells) -> tuple[Cells, Cells]:
        if not len(cells):
            return NONE, NONE
        check_cells(cells, self.fire.shape)
        changed = np.empty(len(cells), dtype=np.int64)
        on, off = _merge(cells, stamps, self.stamps, self.fire, self._sums, changed)
        if self._gives:
            own = self.stamps.ravel()[cells]
            for cell in cells[own == stamps].tolist():
                self._gives.pop(cell, None)
        return changed[:on], changed[len(cells) - off :]

    def _answer(self, tile: int, cells: Cells, stamps: Cells) -> None:
        """Somebody said all it knows of a tile: say what is newer here."""
        self._tells.pop(tile, None)
        theirs = np.zeros(TILE * TILE, dtype=np.int64)
        found = np.empty(TILE * TILE, dtype=np.int64)
        count = _newer(tile, cells, stamps, self.stamps, theirs, found)
        due_us = self._slot_us()
        for cell in found[:count].tolist():
            self._gives.setdefault(cell, due_us)

    def _difference(self, at_us: int) -> list[MapMessage]:
        cells = [cell for cell, due_us in self._gives.items() if due_us <= at_us]
        whole: list[int] = []
        stamps = self.stamps.ravel()
        runs = _runs(np.array(sorted(cells), dtype=np.int64), stamps)[:DIFFERENCE_RUNS]
        for first, count, _, _ in runs:
            for cell in range(first, first + count):
                self._gives.pop(cell, None)
        found = np.empty(TILE * TILE, dtype=np.int64)
        for tile, (due_us, checksum) in list(self._tells.items()):
            if len(runs) >= DIFFERENCE_RUNS:
                break
            if due_us > at_us:
                continue
            del self._tells[tile]
            if checksum != self._sums[tile]:
                count = _lacked(tile, 0, self.stamps, self._sums, found)
                runs += _runs(found[:count], stamps)
                whole.append(tile)
        if not runs and not whole:
            return []
        self._difference_at_us = at_us + AGAIN_US
        return [Difference(at_us, self.name, tuple(runs), tuple(whole))]

    def _question(self, at_us: int) -> list[MapMessage]:
        tiles: list[int] = []
        for tile, (due_us, checksum) in list(self._asks.items()):
            if due_us <= at_us and len(tiles) < DIGEST_TILES:
                del self._asks[tile]
                if checksum != self._sums[tile]:
                    tiles.append(tile)
        if not tiles:
            return []
        self._ask_at_us = at_us + AGAIN_US
        return [Digest(at_us, self.name, self._with_sums(np.array(sorted(tiles))))]

    def _slot_us(self) -> int:
        """When to answer: some slots from now, others than other UAVs', fewer if they are few."""
        slots = min(max(len(self._peers) // 2, 2), MOST_SLOTS)
        return self._now_us + SLOT_US * self._draw(slots)

    def _draw(self, values: int) -> int:
        """0 to ``values`` - 1, different for each UAV and each time, but always the same."""
        self._draws += 1
        return zlib.crc32(self._draws.to_bytes(8, "little"), self._seed) % values


def _runs(cells: Cells, stamps: Cells) -> list[tuple[int, int, int, bool]]:
    """Rising cells as the runs of a ``Difference``; ``stamps`` is the whole map's, flat."""
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


@kernel
def _mix(cell, stamp):  # type: ignore[no-untyped-def]
    """A checksum's share of a cell (the finaliser of splitmix64); none if it was never heard of."""
    if stamp == 0:
        return 0
    x = np.uint64(stamp) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(cell)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.int64((x ^ (x >> np.uint64(31))) & np.uint64(CHECKSUM))


@kernel
def _set(cell, stamp, stamps, fire, sums):  # type: ignore[no-untyped-def]
    """Give a cell a new stamp; 1 if it burns now and did not, -1 if it is the reverse, else 0."""
    cols = fire.shape[1]
    row, col = cell // cols, cell % cols
    tile = row // TILE * ((cols + TILE - 1) // TILE) + col // TILE
    sums[tile] = (sums[tile] + _mix(cell, stamp) - _mix(cell, stamps[row, col])) & CHECKSUM
    stamps[row, col] = stamp
    burned, burns = fire[row, col], stamp & 1 == 1
    fire[row, col] = burns
    return int(burns) - int(burned)


@kernel
def _see(cells, burns, at_us, stamps, fire, sums, changed):  # type: ignore[no-untyped-def]
    """Cells seen to burn or not; fills ``changed``, returns how many."""
    cols = fire.shape[1]
    count = 0
    for i in range(cells.size):
        row, col = cells[i] // cols, cells[i] % cols
        if fire[row, col] == burns:
            continue
        stamp = 2 * at_us + int(burns)
        if stamp <= stamps[row, col]:
            stamp = stamps[row, col] // 2 * 2 + 2 + int(burns)
        _set(cells[i], stamp, stamps, fire, sums)
        changed[count] = cells[i]
        count += 1
    return count


@kernel
def _merge(cells, new, stamps, fire, sums, changed):  # type: ignore[no-untyped-def]
    """Take the later of two stamps.

    Fills ``changed`` with what burns now from the front, and with what no longer does from the
    back; returns how many of each.
    """
    cols = fire.shape[1]
    on, off = 0, 0
    for i in range(cells.size):
        cell = cells[i]
        if new[i] > stamps[cell // cols, cell % cols]:
            way = _set(cell, new[i], stamps, fire, sums)
            if way > 0:
                changed[on] = cell
                on += 1
            elif way < 0:
                off += 1
                changed[cells.size - off] = cell
    return on, off


@kernel
def _lacked(tile, checksum, stamps, sums, found):  # type: ignore[no-untyped-def]
    """Which cells of a tile another lacks by its checksum: all, or one, or two; 0 if it is not so.

    Fills ``found``, returns how many.
    """
    rows, cols = stamps.shape
    across = (cols + TILE - 1) // TILE
    top, left = tile // across * TILE, tile % across * TILE
    count = 0
    for row in range(top, min(top + TILE, rows)):
        for col in range(left, min(left + TILE, cols)):
            if stamps[row, col] != 0:
                found[count] = row * cols + col
                count += 1
    if checksum == 0:
        return count
    lacks = (sums[tile] - checksum) & CHECKSUM
    for i in range(count):
        cell = found[i]
        if _mix(cell, stamps[cell // cols, cell % cols]) == lacks:
            found[0] = cell
            return 1
    for i in range(count):
        cell = found[i]
        rest = (lacks - _mix(cell, stamps[cell // cols, cell % cols])) & CHECKSUM
        for k in range(i):
            other = found[k]
            if _mix(other, stamps[other // cols, other % cols]) == rest:
                found[0], found[1] = other, cell
                return 2
    return 0


@kernel
def _newer(tile, cells, said, stamps, theirs, found):  # type: ignore[no-untyped-def]
    """Cells of a tile with a later stamp than was said; ``theirs`` is zeros, a tile's size."""
    rows, cols = stamps.shape
    across = (cols + TILE - 1) // TILE
    top, left = tile // across * TILE, tile % across * TILE
    for i in range(cells.size):
        row, col = cells[i] // cols - top, cells[i] % cols - left
        if 0 <= row < TILE and 0 <= col < TILE:
            theirs[row * TILE + col] = said[i]
    count = 0
    for row in range(top, min(top + TILE, rows)):
        for col in range(left, min(left + TILE, cols)):
            if stamps[row, col] > theirs[(row - top) * TILE + col - left]:
                found[count] = row * cols + col
                count += 1
    return count
