"""What the C library does with memory that was freed, for a process that runs for weeks.

glibc takes large blocks from the system one by one and gives them back when they are freed, but
only until the first of them is: then it keeps blocks up to that size in its heaps, where whatever
was allocated behind them keeps them from being given back. States, forecasts and corrections make
and drop arrays of a few hundred KiB to a few MiB every few seconds, in several threads, each with
a heap of its own. ``benchmarks.weeks`` shows the difference.
"""

import ctypes
import platform

LARGE_BYTES = 128 * 1024  # from here on a block is the system's own: glibc's first threshold
MAX_HEAPS = 2
# Of glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8


def give_back_freed() -> bool:
    """Have large blocks given back whenever they are freed; False where there is no glibc."""
    if platform.libc_ver()[0] != "glibc":
        return False
    mallopt = ctypes.CDLL(None).mallopt
    settings = {_MMAP_THRESHOLD: LARGE_BYTES, _TRIM_THRESHOLD: LARGE_BYTES, _ARENA_MAX: MAX_HEAPS}
    return all(mallopt(name, value) for name, value in settings.items())
