"""Settings of the C library's allocator for a process that runs for weeks.

glibc maps large blocks one by one and unmaps them when they are freed, but only until the first of
them is freed: then it raises its threshold to that size and keeps such blocks in its heaps, where
later allocations behind them prevent their release. States, forecasts and corrections allocate and
free arrays of a few hundred KiB to a few MiB every few seconds, in several threads with a heap
each. ``benchmarks.weeks`` shows the difference.
"""

import ctypes
import platform

LARGE_BYTES = 128 * 1024  # blocks of this size and more are mapped: glibc's initial threshold
MAX_HEAPS = 2
# Of glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8


def give_back_freed() -> bool:
    """Return large blocks to the system whenever they are freed; False without glibc."""
    if platform.libc_ver()[0] != "glibc":
        return False
    mallopt = ctypes.CDLL(None).mallopt
    settings = {_MMAP_THRESHOLD: LARGE_BYTES, _TRIM_THRESHOLD: LARGE_BYTES, _ARENA_MAX: MAX_HEAPS}
    return all(mallopt(name, value) for name, value in settings.items())
