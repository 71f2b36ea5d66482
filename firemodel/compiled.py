"""How inner loops are compiled: once and for all (cached on disk), and without reference counts.

Counting references to arrays took up to half of the time. A function without them may not make new
arrays, so callers give it the room it needs.
"""

from numba import njit

kernel = njit(cache=True, _nrt=False, error_model="numpy")
