"""Compute the acceleration of a new fire, whose rate rises towards the steady rate of a large fire.

McAlpine & Wakimoto (1989, For. Sci. 35, 1314-1337), as in the Canadian Forest Fire Behavior
Prediction System (1992, ST-X-3, eq. 70) and in FARSITE (Finney 1998, RMRS-RP-4): the fraction of
the steady rate at time t after ignition is 1 - exp(-a t). Because the fraction depends only on
time, the fire at time t is as large as a fire without acceleration would be at time
t - (1 - exp(-a t))/a.
"""

import math

import numpy as np

from firemodel.arrays import Floats

# The constant a: 90 % of the steady rate after 20 min (point source) or 8 min (line source).
POINT_PER_S = 0.115 / 60.0
LINE_PER_S = 0.300 / 60.0
NEWTON_STEPS = 60  # more than Newton's method needs


def rate_share(since_s: float | Floats, per_s: float) -> Floats:
    """Return the fraction (0 to 1) of the steady rate at the given times after ignition.

    Args:
        since_s: Times since ignition in s.
        per_s: The constant a in 1/s.
    """
    return np.asarray(-np.expm1(-per_s * np.asarray(since_s)))


def steady_time_s(since_s: float, per_s: float) -> float:
    """Return the time in s in which a fire without acceleration would spread as far.

    The arguments are those of ``rate_share``. After a long time the result is ``since_s`` - 1/a.
    """
    if since_s == math.inf:
        return since_s
    return since_s + math.expm1(-per_s * since_s) / per_s


def time_since_s(steady_s: float, per_s: float) -> float:
    """Return the time since ignition in s, the inverse of ``steady_time_s``."""
    if not 0.0 < steady_s < math.inf:
        return steady_s
    goal = per_s * steady_s
    # Solve x - 1 + exp(-x) = goal; the function is convex and the start is not below the solution.
    x = goal + min(1.0, math.sqrt(2.0 * goal))
    for _ in range(NEWTON_STEPS):
        lower = x - (x + math.expm1(-x) - goal) / -math.expm1(-x)
        if not lower < x:
            break
        x = lower
    return x / per_s
