"""Compute the moisture of dead fuel from the weather: equilibrium, time lag and rain.

The fuel is in the shade; the model ignores drying by the sun and effects of elevation. Moistures
are in percent of the oven-dry weight.
"""

import numpy as np

from firemodel.arrays import Floats

TIME_LAGS_H = np.array([1.0, 10.0, 100.0])  # time lags of the 1-h, 10-h and 100-h fuel
HOUR_S, DAY_S = 3600.0, 86400.0


def equilibrium_moisture_pct(temperature_c: float | Floats, humidity_pct: float | Floats) -> Floats:
    """Return the equilibrium moisture of wood from the air temperature and relative humidity.

    The equation is Simard's (1968, FF-X-14), in degrees Fahrenheit as in Cohen & Deeming 1985
    (PSW-82), eq. 1. The equation has three parts, with jumps of up to one percentage point of
    moisture between them.
    """
    t = np.asarray(temperature_c) * 1.8 + 32.0
    h = np.asarray(humidity_pct)
    dry = 0.03229 + 0.281073 * h - 0.000578 * h * t
    middling = 2.22749 + 0.160107 * h - 0.014784 * t
    humid = 21.0606 + 0.005565 * h**2 - 0.00035 * h * t - 0.483199 * h
    found: Floats = np.where(h < 10.0, dry, np.where(h < 50.0, middling, humid))
    return found


def rain_moisture_pct(rain_hours: float) -> Floats:
    """Return the moisture (3,) in percent that each fuel class approaches in rain.

    ``rain_hours`` is the number of hours of rain in the last 24 h. The moisture is 35 % for the 1-h
    fuel and (41 + hours/2) % for the 100-h fuel (Cohen & Deeming 1985). The 10-h fuel also tends to
    35 %, as in the Forest Service's WIMS (TechNote 99-01).
    """
    return np.array([35.0, 35.0, 41.0 + 0.5 * rain_hours])


def after_time_lag(
    moisture: Floats, tends_to: Floats, elapsed_h: float, time_lag_h: Floats
) -> Floats:
    """Return the moisture of fuel classes after ``elapsed_h`` hours.

    After one time lag, the difference from ``tends_to`` has fallen to 1/e of its initial value
    (Byram 1963; Fosberg 1970).
    """
    return tends_to + (moisture - tends_to) * np.exp(-elapsed_h / time_lag_h)


def rain_hours(at_s: Floats, rain_mm: Floats) -> Floats:
    """Return the hours of rain (n - 1,) in the 24 h before the end of each step."""
    wet_h = np.where(rain_mm[:-1] > 0.0, np.diff(at_s), 0.0) / HOUR_S
    so_far_h = np.concatenate([[0.0], np.cumsum(wet_h)])
    before: Floats = np.interp(at_s[1:] - DAY_S, at_s, so_far_h)
    return so_far_h[1:] - before


def dead_moistures_pct(
    at_s: Floats,
    temperature_c: Floats,
    humidity_pct: Floats,
    rain_mm: Floats,
    initial_pct: tuple[float, float, float],
) -> Floats:
    """Return the moistures (n, 3) of 1-h, 10-h and 100-h fuel from n weather records.

    The times must increase. Each record is in effect until the next. The effect of rain depends on
    the duration of the rain, not on the amount. The moistures at the first time are
    ``initial_pct``.
    """
    equilibrium = equilibrium_moisture_pct(temperature_c, humidity_pct)
    rained_h = rain_hours(at_s, rain_mm)
    found = np.empty((at_s.size, 3))
    found[0] = initial_pct
    for step, elapsed_s in enumerate(np.diff(at_s)):
        dry = np.full(3, equilibrium[step])
        tends_to = rain_moisture_pct(rained_h[step]) if rain_mm[step] > 0.0 else dry
        found[step + 1] = after_time_lag(found[step], tends_to, elapsed_s / HOUR_S, TIME_LAGS_H)
    return found
