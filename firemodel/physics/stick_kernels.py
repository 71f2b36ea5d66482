"""Compute the moisture inside dead fuel sticks in changing weather (Nelson 2000), compiled.

A stick is a cylinder of wood with nodes from its surface (node 0) to its centre. Each pass computes
the temperature and the moisture of the surface from the air, the sun and the rain, and then the
flow of capillary water, bound water and heat between the nodes, by implicit finite differences.

Source: Nelson, Can. J. For. Res. 30, 1071-1087 (2000), with the parameters and the order of the
steps of Bevins' program (2005), which is part of the Forest Service's NFDRS4. The program computes
the first pass of an update twice; this is retained so that results can be compared. Units are those
of the publication: cm, g, cal, h, °C. Moistures are in g of water per g of dry wood.
"""

import math
from typing import NamedTuple

from firemodel.compiled import kernel

PORE_LENGTH_CM, PORE_RADIUS_CM = 0.0023, 0.5 * 0.8 * 0.0023
SURFACE_TENSION_DYN_CM = 72.8
PERMEABILITY_CM2 = 2.0e-13  # of wood with filled pores
PSYCHROMETER = 0.000772  # 1/K
HEAT_DIFFUSIVITY_CM2_H = 8.0
KELVIN = 273.2  # 0 °C, as rounded in the program
MAX_HUMIDITY, LOG_MAX_HUMIDITY = 0.99, 4.60517  # humidity of a wet surface; -ln(1 - humidity)
MIN_FLOW, FULL_FLOW = 0.0714285, 0.285714  # pore saturations between which water flows
MAX_TEMPERATURE_C = 71.0
LITTLE = 1e-6
SUN_CAL_CM2_H = 14.82052  # sunlight relative to this amount decides whether it is day
DAY_COOLING, NIGHT_COOLING = 0.116171, 0.112467  # cal/(cm² h K), heat lost by radiation
DAY_SKY_C, NIGHT_SKY_C = 6.0, 3.0
SHARE_IN_FALLING_HUMIDITY = 0.15  # factor of the rain uptake while the humidity falls


class StickTerms(NamedTuple):
    """The parameters of one kind of stick, and terms computed from them."""

    radius_cm: float
    density_g_cm3: float
    passes: int  # in each update
    diffusivity_updates: int  # in each update
    heat_transfer: float  # cal/(cm² h K)
    adsorption_cm_h: float
    desorption_cm_h: float
    rain_uptake: float
    max_moisture: float
    node_distance_cm: float
    vapour_transfer: float  # heat transfer converted to vapour transfer
    evaporation: float
    capillary_evaporation: float
    capillary_pressure: float
    pore_moisture: float  # moisture of wood with filled pores


class Air(NamedTuple):
    """The surroundings of a stick at one time."""

    temperature_c: float
    humidity: float  # fraction
    sun_cal_cm2_h: float


@kernel
def vapour_pressure(temperature_k):  # type: ignore[no-untyped-def]
    """Return the saturation vapour pressure in cal/cm³."""
    return 0.0000239 * math.exp(20.58 - 5205.0 / temperature_k)


@kernel
def diffusivity(moisture, temperature_c, saturation, humidity, pressure, density_g_cm3):  # type: ignore[no-untyped-def]
    """Return the diffusivity in cm²/h of bound water and vapour in wood (Nelson 2000)."""
    temperature_k = temperature_c + KELVIN
    latent = 13550.0 - 10.22 * temperature_k
    heat_capacity = 7.22 + 0.002374 * temperature_k + 2.67e-07 * temperature_k * temperature_k
    in_air = 0.22 * 3600.0 * (0.0242 / pressure) * math.pow(temperature_k / KELVIN, 1.75)
    c1, c2 = 0.1617 - 0.001419 * temperature_c, 0.4657 + 0.003578 * temperature_c
    bound = moisture
    if moisture < saturation:
        slope = (1.0 - humidity) * math.pow(-math.log(1.0 - humidity), 1.0 - c2) / (c1 * c2)
    else:
        bound = saturation
        slope = (1.0 - MAX_HUMIDITY) * math.pow(LOG_MAX_HUMIDITY, 1.0 - c2) / (c1 * c2)
    volume = 1.0 / (1.3 - 0.64 * bound) * bound  # of the bound water
    water_share = volume / (0.685 + volume)
    wall_share = (0.685 + volume) / (1.0 / density_g_cm3 + volume)
    wall = 1.0 - math.sqrt(1.0 - wall_share)
    energy = (latent + 5040.0 * math.exp(-14.0 * bound) - heat_capacity * temperature_k) / 1.2
    vapour = (
        18.0 * 0.016 * (1.0 - wall_share) * in_air * vapour_pressure(temperature_k) * slope
    ) / (density_g_cm3 * 1.987 * temperature_k)
    in_walls = 3600.0 * 0.0985 / (2.0 - water_share) / (wall * wall_share)
    return vapour + in_walls * math.exp(-energy / (1.987 * temperature_k))


@kernel
def set_diffusivities(nodes, surface, pressure, terms):  # type: ignore[no-untyped-def]
    """Set the diffusivities of all nodes (row 3) from moistures (0) and temperatures (1)."""
    for node in range(nodes.shape[1]):
        nodes[3, node] = diffusivity(
            nodes[0, node], nodes[1, node], surface[0], surface[1], pressure, terms.density_g_cm3
        )


@kernel
def diffuse(nodes, row, before, factors, store):  # type: ignore[no-untyped-def]
    """Compute one step of a quantity in the nodes between surface and centre.

    ``before`` contains the quantity before the step, ``factors`` the conductances of the nodes, and
    ``store`` the capacity of each node.
    """
    for node in range(1, nodes.shape[1] - 1):
        out, inward, kept = factors[node - 1], factors[node + 1], store[node]
        nodes[row, node] = (
            inward * before[node + 1] + out * before[node - 1] + kept * before[node]
        ) / (inward + out + kept)


@kernel
def wet_surface(nodes, surface, air, rain, step_h, pressure, terms):  # type: ignore[no-untyped-def]
    """Set temperature, moisture and saturation of the surface in one pass.

    ``rain`` is the gain in moisture in this pass; it is negative if there is no rain. ``surface``
    receives the fibre-saturation moisture and the humidity at the surface. The results are whether
    nothing changes, the kinematic viscosity, and the moisture that the pores can take up.
    """
    air_k = air.temperature_c + KELVIN
    dew_k = 5205.0 / (5205.0 / air_k - math.log(air.humidity))
    day = air.sun_cal_cm2_h / SUN_CAL_CM2_H >= LITTLE
    cooling = DAY_COOLING if day else NIGHT_COOLING
    sky_c = DAY_SKY_C if day else NIGHT_SKY_C
    sun = air.sun_cal_cm2_h if day else 0.0
    dry_c = air.temperature_c + (sun - cooling * (air.temperature_c - sky_c)) / (
        cooling + terms.heat_transfer
    )
    latent = 13550.0 - 10.22 * (dry_c + KELVIN)
    evaporation = terms.vapour_transfer * PSYCHROMETER / 0.24 * latent / 18.0
    temperature_c = dry_c - evaporation * (dry_c - air.temperature_c) / (
        cooling + terms.heat_transfer + evaporation
    )
    old = nodes[0, 0]
    bound_heat = 5040.0 * math.exp(-14.0 * old)
    temperature_k = temperature_c + KELVIN
    viscosity = 0.00439 + 0.00000177 * math.pow(338.76 - temperature_k, 2.1237)
    c1, c2 = 0.1617 - 0.001419 * temperature_c, 0.4657 + 0.003578 * temperature_c
    saturation = c1 * math.pow(LOG_MAX_HUMIDITY, c2)
    pores = max(terms.pore_moisture - saturation, LITTLE)
    saturated = vapour_pressure(temperature_k)
    dew = vapour_pressure(dew_k)
    at_surface = air.humidity * vapour_pressure(air_k)
    at_surface += PSYCHROMETER * pressure * latent / (latent + bound_heat) * (air_k - temperature_k)
    at_surface = max(at_surface, LITTLE)
    humidity = min(at_surface / saturated, MAX_HUMIDITY)
    equilibrium = c1 * math.pow(-math.log(1.0 - humidity), c2)
    in_pores = still = False
    if rain >= 0.0:
        new, in_pores, humidity, temperature_c = old + rain, True, MAX_HUMIDITY, dry_c
    elif old > saturation:
        in_pores, humidity = True, MAX_HUMIDITY
        flow = terms.evaporation * (saturated - dew) / pressure
        if temperature_c <= dew_k - KELVIN and saturated > dew:
            flow = 0.0
        new = old - flow * 2.0 * step_h
        if flow > 0.0:
            new -= step_h * terms.capillary_evaporation / viscosity
        new = min(new, terms.max_moisture)
        still = new == old
    elif temperature_c <= dew_k - KELVIN:
        in_pores = True
        flow = 0.0 if at_surface > dew else terms.evaporation * (at_surface - dew) / pressure
        new = old - flow * 2.0 * step_h
    else:
        exchange = terms.desorption_cm_h if old >= equilibrium else terms.adsorption_cm_h
        inward = exchange * terms.node_distance_cm / nodes[3, 0]
        new = (nodes[0, 1] + inward * equilibrium) / (1.0 + inward)
    nodes[2, 0] = max((new - saturation) / pores, 0.0) if in_pores else 0.0
    nodes[0, 0] = min(new, terms.max_moisture)
    nodes[1, 0] = temperature_c
    surface[0], surface[1] = saturation, humidity
    return still, viscosity, pores


@kernel
def move_water(nodes, surface, viscosity, pores, step_h, work, terms):  # type: ignore[no-untyped-def]
    """Compute the flow of water between the nodes in one pass.

    Capillary water flows through pores whose saturation is between two limits. If all pores between
    surface and centre are filled to this extent, their water is the moisture; otherwise bound water
    and vapour diffuse.
    """
    count, distance_cm = nodes.shape[1], terms.node_distance_cm
    moisture, before, saturated, factors, store = work
    for node in range(count):
        position_cm = terms.radius_cm - distance_cm * node if node < count - 1 else 0.0
        moisture[node], saturated[node] = nodes[0, node], nodes[2, node]
        before[node] = nodes[3, node] * position_cm / distance_cm
        store[node] = position_cm * distance_cm / step_h
        factors[node] = 0.0
        share = (nodes[0, node] - surface[0]) / pores
        if MIN_FLOW <= share <= FULL_FLOW:
            conductance = PERMEABILITY_CM2 * (2.0 * math.sqrt(share / FULL_FLOW) - 1.0)
            conductance *= position_cm * terms.capillary_pressure / (viscosity * pores)
            factors[node] = conductance * math.pow(FULL_FLOW / share, 1.5) / distance_cm
    diffuse(nodes, 2, saturated, factors, store)
    filled = True
    for node in range(1, count - 1):
        nodes[2, node] = min(max(nodes[2, node], 0.0), MIN_FLOW)
        filled = filled and nodes[2, node] >= MIN_FLOW
    nodes[2, count - 1] = nodes[2, count - 2]
    if filled:
        for node in range(1, count - 1):
            nodes[0, node] = surface[0] + nodes[2, node] * pores
    else:
        diffuse(nodes, 0, moisture, before, store)
    for node in range(1, count - 1):
        nodes[0, node] = min(max(nodes[0, node], 0.0), terms.max_moisture)
    nodes[0, count - 1] = nodes[0, count - 2]


@kernel
def move_heat(nodes, step_h, work, terms):  # type: ignore[no-untyped-def]
    """Compute the flow of heat between the nodes in one pass."""
    count, distance_cm = nodes.shape[1], terms.node_distance_cm
    before, _, _, factors, store = work
    for node in range(count):
        position_cm = terms.radius_cm - distance_cm * node if node < count - 1 else 0.0
        before[node] = nodes[1, node]
        factors[node] = HEAT_DIFFUSIVITY_CM2_H * position_cm / distance_cm
        store[node] = position_cm * distance_cm / step_h
    diffuse(nodes, 1, before, factors, store)
    for node in range(1, count - 1):
        nodes[1, node] = min(nodes[1, node], MAX_TEMPERATURE_C)
    nodes[1, count - 1] = nodes[1, count - 2]


@kernel
def update(nodes, surface, before, after, rain_cm, hours, pressure, work, terms):  # type: ignore[no-untyped-def]
    """Advance one stick by ``hours``, between two records of the air (``Air``).

    ``nodes`` (4, nodes) contains moisture, temperature, saturation of pores and diffusivity;
    ``surface`` contains the fibre-saturation moisture and the humidity at the surface; ``work`` (5,
    nodes) is overwritten.
    """
    step_h, between_h = hours / terms.passes, hours / terms.diffusivity_updates
    rain = -1.0
    if rain_cm > 0.0:
        rain = step_h * terms.rain_uptake * (1.0 - math.exp(-100.0 * rain_cm / hours / 3.141592654))
        if after.humidity < before.humidity:
            rain *= SHARE_IN_FALLING_HUMIDITY
    next_h, time_h, number = between_h, step_h, 0
    while time_h <= hours:
        part = time_h / hours
        air = Air(
            before.temperature_c + (after.temperature_c - before.temperature_c) * part,
            before.humidity + (after.humidity - before.humidity) * part,
            before.sun_cal_cm2_h + (after.sun_cal_cm2_h - before.sun_cal_cm2_h) * part,
        )
        still, viscosity, pores = wet_surface(nodes, surface, air, rain, step_h, pressure, terms)
        if not still:
            move_water(nodes, surface, viscosity, pores, step_h, work, terms)
        move_heat(nodes, step_h, work, terms)
        if next_h - time_h < 0.5 * step_h:
            set_diffusivities(nodes, surface, pressure, terms)
            next_h += between_h
        number += 1
        time_h = number * step_h


@kernel
def mean_moisture(nodes, terms):  # type: ignore[no-untyped-def]
    """Return the moisture of the whole stick, weighted by the volume around each node."""
    count, found = nodes.shape[1], 0.0
    outer_cm = terms.radius_cm
    for node in range(count):
        inner_cm = outer_cm - terms.node_distance_cm * (0.5 if node == 0 else 1.0)
        if node == count - 1:
            inner_cm = 0.0
        found += nodes[0, node] * (outer_cm * outer_cm - inner_cm * inner_cm)
        outer_cm = inner_cm
    return min(found / terms.radius_cm**2, terms.max_moisture)


@kernel
def moistures(air, rain_cm, hours, nodes, surface, work, pressure, terms, found):  # type: ignore[no-untyped-def]
    """Compute the mean moisture of a stick at each weather record.

    ``air`` (records, 3) contains the fields of ``Air``; ``rain_cm`` and ``hours`` (records) are
    those since the previous record. ``nodes`` and ``surface`` contain the state at the first
    record.
    """
    found[0] = mean_moisture(nodes, terms)
    for record in range(1, air.shape[0]):
        before = Air(air[record - 1, 0], air[record - 1, 1], air[record - 1, 2])
        after = Air(air[record, 0], air[record, 1], air[record, 2])
        update(nodes, surface, before, after, rain_cm[record], hours[record], pressure, work, terms)
        found[record] = mean_moisture(nodes, terms)
