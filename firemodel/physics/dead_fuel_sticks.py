"""Compute the moisture of dead fuel from air, sun and rain with Nelson's stick model (2000).

``stick_kernels`` contains the equations. The sticks of the 1-h, 10-h and 100-h fuels are those of
the Forest Service's National Fire Danger Rating System (NFDRS4).
"""

import numpy as np

from firemodel.arrays import Floats
from firemodel.physics.stick_kernels import (
    FULL_FLOW,
    MAX_HUMIDITY,
    PORE_LENGTH_CM,
    PORE_RADIUS_CM,
    SURFACE_TENSION_DYN_CM,
    StickTerms,
    moistures,
    set_diffusivities,
)

PRESSURE_CAL_CM3 = 0.0218  # pressure of the air, as in NFDRS4
W_M2_PER_CAL_CM2_H = 94.743  # sunlight absorbed by a stick, as in NFDRS4
WALL_DENSITY_G_CM3, STICK_LENGTH_CM = 1.53, 41.0


def stick_terms(
    radius_cm: float,
    adsorption_cm_h: float | None = None,
    max_moisture: float = 0.60,
    density_g_cm3: float = 0.4,
) -> StickTerms:
    """Return the parameters of a stick; those not given depend on the radius (Bevins 2005)."""
    if adsorption_cm_h is None:
        adsorption_cm_h = 0.06 + 0.006126 / radius_cm**2.6
    nodes = int(10.727 + 0.1746 / radius_cm)
    nodes += nodes % 2 == 0
    heat_transfer = 0.2195 + 0.05260 / radius_cm**2.5
    vapour_transfer = 0.622 * heat_transfer * (0.7 / 0.58) ** 0.667
    capillary = 3600.0 * 3.141592654 * SURFACE_TENSION_DYN_CM * PORE_RADIUS_CM**2
    return StickTerms(
        radius_cm=radius_cm,
        density_g_cm3=density_g_cm3,
        passes=int(9.8202 + 26.865 / radius_cm**1.4),
        diffusivity_updates=int(4.777 + 2.496 / radius_cm**1.3),
        heat_transfer=heat_transfer,
        adsorption_cm_h=adsorption_cm_h,
        desorption_cm_h=0.06,
        rain_uptake=0.02822 + 0.1056 / radius_cm**2.2,
        max_moisture=max_moisture,
        node_distance_cm=radius_cm / (nodes - 1),
        vapour_transfer=vapour_transfer,
        evaporation=vapour_transfer / (0.24 * density_g_cm3 * radius_cm),
        capillary_evaporation=capillary / (16.0 * radius_cm**2 * STICK_LENGTH_CM * density_g_cm3),
        capillary_pressure=SURFACE_TENSION_DYN_CM / (density_g_cm3 * PORE_LENGTH_CM * FULL_FLOW),
        pore_moisture=1.0 / density_g_cm3 - 1.0 / WALL_DENSITY_G_CM3,
    )


# The 1-h, 10-h and 100-h fuels of NFDRS4.
STICKS = (
    stick_terms(0.2, 0.462252733, 0.35),
    stick_terms(0.64, 0.079548303, 0.35),
    stick_terms(2.0, 0.06, 0.35),
)


def stick_moistures(
    terms: StickTerms,
    at_s: Floats,
    temperature_c: Floats,
    humidity: Floats,
    sun_w_m2: Floats,
    rain_cm: Floats,
    initial: float,
) -> Floats:
    """Return the mean moisture (n,) of a stick at n weather records, as a fraction.

    Args:
        terms: The stick (``STICKS`` or ``stick_terms``).
        at_s: Times of the records in seconds (n), in increasing order.
        temperature_c: Temperature of the air (n), -60 to 60.
        humidity: Relative humidity (n), a fraction above 0.
        sun_w_m2: Sunlight on the stick (n). Between records, temperature, humidity and sunlight are
            interpolated linearly.
        rain_cm: Rain since the previous record (n); the first value has no effect.
        initial: Moisture of the whole stick at the first record.
    """
    count = round(terms.radius_cm / terms.node_distance_cm) + 1
    nodes = np.zeros((4, count))
    nodes[0], nodes[1] = initial, temperature_c[0]
    surface = np.array([initial + 0.1, min(humidity[0], MAX_HUMIDITY)])
    set_diffusivities(nodes, surface, PRESSURE_CAL_CM3, terms)
    air = np.column_stack([temperature_c, humidity, sun_w_m2 / W_M2_PER_CAL_CM2_H])
    hours = np.diff(at_s, prepend=at_s[0]) / 3600.0
    found = np.empty(at_s.size)
    work = np.empty((5, count))
    moistures(air, rain_cm, hours, nodes, surface, work, PRESSURE_CAL_CM3, terms, found)
    return found
