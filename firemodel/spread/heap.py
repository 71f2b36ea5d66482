"""Keep times and keys in a compiled heap; entries with the same time are ordered by key.

Each entry has four children, which are close together in memory. The code that finds the earliest
child has no branches, because the processor could not predict them.
"""

import numpy as np

from firemodel.compiled import inlined

ONE, TWO, THREE, FOUR = (np.uint64(each) for each in (1, 2, 3, 4))  # unsigned: faster as an index


@inlined
def push(times, keys, size, time, key):  # type: ignore[no-untyped-def]
    """Add an entry and return the new size of the heap; the arrays must have room for the entry."""
    child = np.uint64(size)
    while child > 0:
        parent = (child - ONE) // FOUR
        if times[parent] < time or (times[parent] == time and keys[parent] <= key):
            break
        times[child], keys[child] = times[parent], keys[parent]
        child = parent
    times[child], keys[child] = time, key
    return size + 1


@inlined
def _earlier(times, keys, one, other):  # type: ignore[no-untyped-def]
    """Return the index of the earlier of two entries."""
    later = times[one] > times[other]
    later |= (times[one] == times[other]) & (keys[one] > keys[other])
    return other if later else one


@inlined
def drop_first(times, keys, size):  # type: ignore[no-untyped-def]
    """Remove the earliest entry (at index 0) and return the new size of the heap."""
    last = np.uint64(size - 1)
    time, key = times[last], keys[last]
    parent = np.uint64(0)
    while True:
        child = FOUR * parent + ONE
        if child + THREE < last:
            one = _earlier(times, keys, child, child + ONE)
            two = _earlier(times, keys, child + TWO, child + THREE)
            first = _earlier(times, keys, one, two)
        elif child < last:
            first = child
            while child + ONE < last:
                child += ONE
                first = _earlier(times, keys, first, child)
        else:
            break
        if time < times[first] or (time == times[first] and key <= keys[first]):
            break
        times[parent], keys[parent] = times[first], keys[first]
        parent = first
    times[parent], keys[parent] = time, key
    return size - 1
