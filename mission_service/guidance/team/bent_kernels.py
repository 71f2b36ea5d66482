"""Inner loops of Bent's planners and negotiations over the cells of a region.

A region is ``range(begin, end)`` of unwrapped cell indices (see ``regions``) on a ring of n cells.
The arrays (n) over the ring are ``rate`` (spread rate in m/s), ``visited`` (time of the last view
in s) and ``step`` (metres to the next cell clockwise).
"""

from firemodel.compiled import compiled


@compiled
def _importance(rate, age, exponential):  # type: ignore[no-untyped-def]
    """Return Bent's importance of a cell, linear or exponential (thesis, 3.2)."""
    age = max(age, 0.0)  # a view may be later than the time of a decision
    return age ** (1.0 + rate) if exponential else rate * age


@compiled
def highest(rate, visited, begin, end, own_cell, at_s, exponential):  # type: ignore[no-untyped-def]
    """Return the unwrapped index of the most important cell; ``own_cell`` in a region of one cell.

    The vehicle's own cell has no importance (4.1.3). Among equally important cells, the nearest is
    returned; of two cells at the same distance, the clockwise one.
    """
    n = rate.size
    best, best_worth = own_cell, -1.0
    for cell in range(begin, end):
        if cell == own_cell:
            continue
        place = cell % n
        importance = _importance(rate[place], at_s - visited[place], exponential)
        nearer = abs(cell - own_cell) < abs(best - own_cell) or (
            abs(cell - own_cell) == abs(best - own_cell) and cell > best
        )
        if importance > best_worth or (importance == best_worth and nearer):
            best, best_worth = cell, importance
    return best


@compiled
def best_path(  # type: ignore[no-untyped-def]
    rate, visited, step, begin, end, own_cell, target, at_s, speed_m_s, exponential
):
    """Return the end of the path whose cells have the highest mean importance (4.1.4).

    The end is an unwrapped cell index. The importance of each cell is computed for the time of the
    visit. Among paths with the same mean, the path to ``target`` is preferred, then the path with
    the nearest end, then the path in the clockwise direction.
    """
    n = rate.size
    best, best_worth, before = own_cell, -1.0, -1.0
    for direction in (1, -1):
        total, reached_s, cells = 0.0, at_s, 0
        cell = own_cell
        while begin <= cell + direction < end:
            reached_s += step[(cell if direction == 1 else cell - 1) % n] / speed_m_s
            cell += direction
            cells += 1
            place = cell % n
            total += _importance(rate[place], reached_s - visited[place], exponential)
            mean = total / cells
            if mean > best_worth or (
                mean == best_worth and abs(cell - own_cell) < abs(best - own_cell)
            ):
                best, best_worth = cell, mean
            if cell == target:
                before = mean
    return target if before == best_worth else best


@compiled
def total(rate, visited, begin, end, at_s, exponential):  # type: ignore[no-untyped-def]
    """Return the summed importance of all cells in a region."""
    n = rate.size
    found = 0.0
    for cell in range(begin, end):
        place = cell % n
        found += _importance(rate[place], at_s - visited[place], exponential)
    return found


@compiled
def chunk(  # type: ignore[no-untyped-def]
    rate, visited, first, direction, max_cells, offer, at_s, exponential
):
    """Return how many cells, from ``first`` inwards, have a total importance of at most ``offer``.

    The result is the largest such number up to ``max_cells``.
    """
    n = rate.size
    worth = 0.0
    for count in range(max_cells):
        place = (first + direction * count) % n
        worth += _importance(rate[place], at_s - visited[place], exponential)
        if worth > offer:
            return count
    return max_cells


@compiled
def max_centred(  # type: ignore[no-untyped-def]
    rate, visited, begin, end, max_first, max_last, at_s, exponential
):
    """Return the numbers of cells to give away at the beginning and at the end of a region.

    The numbers are at most ``max_first`` and ``max_last``. The remaining importance is then best
    centred in the remaining region (4.2.2). The result is (0, 0) unless giving cells away improves
    the centring.
    """
    n = rate.size
    worth, moment = 0.0, 0.0
    for cell in range(begin, end):
        place = cell % n
        importance = _importance(rate[place], at_s - visited[place], exponential)
        worth += importance
        moment += importance * cell
    if worth <= 0.0:
        return 0, 0
    best_first, best_last = 0, 0
    best_off = abs(moment / worth - (begin + end - 1) / 2.0)
    # Sums over the remaining cells: all ``max_first`` cells are removed, then added one by one.
    worth_first, moment_first = worth, moment
    for cell in range(begin, begin + max_first):
        place = cell % n
        importance = _importance(rate[place], at_s - visited[place], exponential)
        worth_first -= importance
        moment_first -= importance * cell
    for first in range(max_first, -1, -1):
        if first < max_first:
            place = (begin + first) % n
            importance = _importance(rate[place], at_s - visited[place], exponential)
            worth_first += importance
            moment_first += importance * (begin + first)
        worth_both, moment_both = worth_first, moment_first
        for last in range(max_last + 1):
            if last:
                place = (end - last) % n
                importance = _importance(rate[place], at_s - visited[place], exponential)
                worth_both -= importance
                moment_both -= importance * (end - last)
            if worth_both <= 1e-12 * worth:
                continue
            middle = (begin + first + end - last - 1) / 2.0
            off = abs(moment_both / worth_both - middle)
            if off < best_off - 1e-9:
                best_first, best_last, best_off = first, last, off
    return best_first, best_last
