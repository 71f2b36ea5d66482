"""Keep times and keys in a compiled binary heap; entries with equal times are ordered by key."""

from firemodel.compiled import kernel


@kernel
def push(times, keys, size, time, key):  # type: ignore[no-untyped-def]
    """Add an entry and return the new size of the heap; the arrays must have room for the entry."""
    child = size
    while child > 0:
        parent = (child - 1) // 2
        if times[parent] < time or (times[parent] == time and keys[parent] <= key):
            break
        times[child], keys[child] = times[parent], keys[parent]
        child = parent
    times[child], keys[child] = time, key
    return size + 1


@kernel
def drop_first(times, keys, size):  # type: ignore[no-untyped-def]
    """Remove the earliest entry (at index 0) and return the new size of the heap."""
    size -= 1
    time, key = times[size], keys[size]
    parent = 0
    while True:
        child = 2 * parent + 1
        if child >= size:
            break
        other = child + 1
        if other < size and (
            times[other] < times[child]
            or (times[other] == times[child] and keys[other] < keys[child])
        ):
            child = other
        if time < times[child] or (time == times[child] and key <= keys[child]):
            break
        times[parent], keys[parent] = times[child], keys[child]
        parent = child
    times[parent], keys[parent] = time, key
    return size
