"""Configures the C library's allocator for a process that runs for weeks.

glibc maps each large block of memory separately and unmaps the block when it is freed. When the
first such block is freed, glibc by default raises the threshold for large blocks to the size of
that block. glibc then allocates later blocks of this size in its heaps. In a heap, a freed block is
not released while blocks above it are in use. States, forecasts and corrections allocate and free
arrays of a few hundred KiB to a few MiB every few seconds, in several threads with separate heaps.
``benchmarks.weeks`` measures the memory use.
"""

import ctypes
import platform

LARGE_BYTES = 128 * 1024  # blocks of this size or more are mapped: glibc's initial threshold
MAX_HEAPS = 2
# Constants from glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8


def give_back_freed() -> bool:
    """Make glibc release large freed blocks to the system; return False if this is impossible."""
    if platform.libc_ver()[0] != "glibc":
        return False
    mallopt = ctypes.CDLL(None).mallopt
    settings = {_MMAP_THRESHOLD: LARGE_BYTES, _TRIM_THRESHOLD: LARGE_BYTES, _ARENA_MAX: MAX_HEAPS}
    return all(mallopt(name, value) for name, value in settings.items())
