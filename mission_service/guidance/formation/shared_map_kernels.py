"""Compiled loops of the shared fire map: versioned cells, tiles and their checksums.

``stamps`` (y, x) holds the stamp of each cell, ``2 * seen_at_us + burning``, or 0 if the cell is
unknown. ``fire`` (y, x) is the last bit of the stamps. A tile has ``TILE`` x ``TILE`` cells; tiles
are numbered row by row. ``sums`` (tiles) holds the checksum of each tile, which is the sum of
``cell_checksum`` over the tile's known cells.
"""

import numpy as np

from firemodel.compiled import kernel

TILE = 16
CHECKSUM = 2**40 - 1  # largest value; less than 2**53, the limit of exact integers in JSON


@kernel
def cell_checksum(cell, stamp):  # type: ignore[no-untyped-def]
    """Return the hash of a cell (from the finaliser of splitmix64); 0 if the cell is unknown."""
    if stamp == 0:
        return 0
    x = np.uint64(stamp) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(cell)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.int64((x ^ (x >> np.uint64(31))) & np.uint64(CHECKSUM))


@kernel
def _set_stamp(cell, stamp, stamps, fire, sums):  # type: ignore[no-untyped-def]
    """Set a cell's stamp; return 1 if the cell begins to burn, -1 if it ceases to burn, else 0."""
    cols = fire.shape[1]
    row, col = cell // cols, cell % cols
    tile = row // TILE * ((cols + TILE - 1) // TILE) + col // TILE
    sums[tile] = (
        sums[tile] + cell_checksum(cell, stamp) - cell_checksum(cell, stamps[row, col])
    ) & CHECKSUM
    stamps[row, col] = stamp
    burned, burns = fire[row, col], stamp & 1 == 1
    fire[row, col] = burns
    return int(burns) - int(burned)


@kernel
def _first_off_map(cells, size):  # type: ignore[no-untyped-def]
    """Return the index of the first cell off a map of ``size`` cells, or -1 if there is none."""
    for i in range(cells.size):
        if cells[i] < 0 or cells[i] >= size:
            return i
    return -1


@kernel
def record_view(cells, burns, at_us, stamps, fire, sums, changed):  # type: ignore[no-untyped-def]
    """Set cells to burning or not burning, from a camera view, with the newest stamps.

    Fills ``changed`` with the changed cells. Returns the number of changed cells, and -1. If a cell
    is off the map, nothing changes, and the result is 0 and the index of this cell.
    """
    cols = fire.shape[1]
    off_map = _first_off_map(cells, fire.size)
    count = 0
    for i in range(cells.size if off_map < 0 else 0):
        row, col = cells[i] // cols, cells[i] % cols
        if fire[row, col] == burns:
            continue
        stamp = 2 * at_us + int(burns)
        if stamp <= stamps[row, col]:
            stamp = stamps[row, col] // 2 * 2 + 2 + int(burns)
        _set_stamp(cells[i], stamp, stamps, fire, sums)
        changed[count] = cells[i]
        count += 1
    return count, off_map


@kernel
def merge(cells, new, stamps, fire, sums, changed):  # type: ignore[no-untyped-def]
    """Merge received stamps into the map; the later stamp of each cell wins.

    Fills ``changed`` from the front with cells that have begun to burn, and from the back with
    cells that have ceased to burn. Returns the numbers of these cells, and -1. If a cell is off the
    map, nothing changes, and the third result is the index of this cell.
    """
    cols = fire.shape[1]
    off_map = _first_off_map(cells, fire.size)
    on, off = 0, 0
    for i in range(cells.size if off_map < 0 else 0):
        cell = cells[i]
        if new[i] > stamps[cell // cols, cell % cols]:
            change = _set_stamp(cell, new[i], stamps, fire, sums)
            if change > 0:
                changed[on] = cell
                on += 1
            elif change < 0:
                off += 1
                changed[cells.size - off] = cell
    # A cell that occurs twice in a message may be in both parts.
    kept_on, kept_off = 0, 0
    for i in range(on):
        if fire[changed[i] // cols, changed[i] % cols]:
            changed[kept_on] = changed[i]
            kept_on += 1
    for i in range(cells.size - 1, cells.size - off - 1, -1):
        if not fire[changed[i] // cols, changed[i] % cols]:
            kept_off += 1
            changed[cells.size - kept_off] = changed[i]
    return kept_on, kept_off, off_map


@kernel
def cells_of_runs(runs, size):  # type: ignore[no-untyped-def]
    """Return the number of cells in the runs (n, 4) of a ``Difference``.

    If the run at an index i is not on a map of ``size`` cells, the result is -1 - i.
    """
    count = 0
    for i in range(runs.shape[0]):
        if runs[i, 0] < 0 or runs[i, 1] < 1 or runs[i, 0] + runs[i, 1] > size:
            return -1 - i
        count += runs[i, 1]
    return count


@kernel
def expand_runs(runs, cells, stamps):  # type: ignore[no-untyped-def]
    """Fill ``cells`` and ``stamps`` with all cells in the runs (n, 4) and their stamps."""
    count = 0
    for i in range(runs.shape[0]):
        for cell in range(runs[i, 0], runs[i, 0] + runs[i, 1]):
            cells[count] = cell
            stamps[count] = 2 * runs[i, 2] + runs[i, 3]
            count += 1


@kernel
def differing_tiles(listed, first, end, sums, theirs, found):  # type: ignore[no-untyped-def]
    """Find the tiles whose checksum at a sender differs from the checksum on this map.

    ``listed`` (n, 2) holds tiles and their checksums at the sender. All other tiles from ``first``
    to ``end`` (excluded) have the checksum 0 at the sender. Fills ``theirs`` (tiles) with the
    sender's checksums, and ``found`` with the differing tiles. Returns the number of differing
    tiles, or -1 if a tile is off the map.
    """
    if not 0 <= first <= end <= sums.size:
        return -1
    for tile in range(sums.size):
        theirs[tile] = 0 if first <= tile < end else sums[tile]
    for i in range(listed.shape[0]):
        if not 0 <= listed[i, 0] < sums.size:
            return -1
        theirs[listed[i, 0]] = listed[i, 1]
    count = 0
    for tile in range(sums.size):
        if theirs[tile] != sums[tile]:
            found[count] = tile
            count += 1
    return count


@kernel
def corner(tile, cols):  # type: ignore[no-untyped-def]
    """Return the first row and the first column of a tile."""
    across = (cols + TILE - 1) // TILE
    return tile // across * TILE, tile % across * TILE


@kernel
def known_cells(tile, stamps, found):  # type: ignore[no-untyped-def]
    """Fill ``found`` with the known cells of a tile in ascending order; return their number."""
    rows, cols = stamps.shape
    top, left = corner(tile, cols)
    count = 0
    for row in range(top, min(top + TILE, rows)):
        for col in range(left, min(left + TILE, cols)):
            if stamps[row, col] != 0:
                found[count] = row * cols + col
                count += 1
    return count


@kernel
def missing_cells(tile, checksum, stamps, sums, found, shares):  # type: ignore[no-untyped-def]
    """Find the cells of a tile that another UAV lacks, from that UAV's checksum of the tile.

    The result is all known cells if the checksum is 0, or else one or two cells whose hashes add up
    to the difference of the checksums. Fills ``found``; returns the number of cells, or 0 if there
    are no such cells. ``shares`` is a work array.
    """
    cols = stamps.shape[1]
    count = known_cells(tile, stamps, found)
    if checksum == 0:
        return count
    lacks = (sums[tile] - checksum) & CHECKSUM
    for i in range(count):
        shares[i] = cell_checksum(found[i], stamps[found[i] // cols, found[i] % cols])
        if shares[i] == lacks:
            found[0] = found[i]
            return 1
    for i in range(count):
        rest = (lacks - shares[i]) & CHECKSUM
        for k in range(i):
            if shares[k] == rest:
                found[0], found[1] = found[k], found[i]
                return 2
    return 0


@kernel
def newer_cells(tile, cells, sent, stamps, theirs, found):  # type: ignore[no-untyped-def]
    """Find the known cells of a tile that are newer on this map than in a received message.

    The message contains ``cells`` with the stamps ``sent``; all other cells count as older.
    ``theirs`` is a work array (TILE * TILE) of zeros. Fills ``found`` in ascending order; returns
    the number of cells.
    """
    rows, cols = stamps.shape
    top, left = corner(tile, cols)
    for i in range(cells.size):
        row, col = cells[i] // cols - top, cells[i] % cols - left
        if 0 <= row < TILE and 0 <= col < TILE:
            theirs[row * TILE + col] = max(theirs[row * TILE + col], sent[i])
    count = 0
    for row in range(top, min(top + TILE, rows)):
        for col in range(left, min(left + TILE, cols)):
            if stamps[row, col] > theirs[(row - top) * TILE + col - left]:
                found[count] = row * cols + col
                count += 1
    return count
