"""Compute the dead fuel moisture in each zone of a landscape at each weather record.

In each zone the air has the temperature and humidity at the zone's elevation, and the sun shines on
its slope through clouds and crowns. Nelson's sticks (``dead_fuel_sticks``) follow this weather.
"""

from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape, turned
from firemodel.landscape.moisture_zones import MoistureZones
from firemodel.physics import sunlight
from firemodel.physics.dead_fuel_sticks import STICKS, stick_moistures
from firemodel.physics.weather import DeadMoistures

# Decrease in temperature and dew point with elevation: 3.5 and 1.1 °F per 1000 ft (Rothermel et al.
# 1986, INT-359).
LAPSE_C_M, DEW_LAPSE_C_M = 3.5 / 1.8 / 304.8, 1.1 / 1.8 / 304.8
MIN_HUMIDITY, MAX_HUMIDITY = 0.01, 0.99
MAX_TEMPERATURE_C = 70.0  # as in weather files; sticks in air of more than 100 °C have no moisture
LON_DEG_PER_H = 15.0


class ZoneConditions(NamedTuple):
    """The landscape whose zones have their own moistures, and the weather station's elevation."""

    landscape: Landscape
    station_m: float | None = None  # None: the mean elevation of the landscape


class AirRecords(NamedTuple):
    """Weather station records; each field from ``at_s`` to ``sun_w_m2`` has one value per record.

    The times are in seconds after ``begin``, in increasing order.
    """

    begin: datetime  # calendar time of 0 s; without an offset, standard time at the longitude
    at_s: Floats
    temperature_c: Floats
    humidity_pct: Floats
    rain_mm: Floats  # between this record and the next
    cloud_pct: Floats  # share of the sky covered
    sun_w_m2: Floats | None  # measured on level ground; used instead of cloud cover
    initial: DeadMoistures  # at the first record, as fractions


def zone_moistures(air: AirRecords, conditions: ZoneConditions) -> list[tuple[DeadMoistures, ...]]:
    """Return the dead fuel moistures (fractions) of a landscape's zones, for each record.

    Raises FireModelError if the landscape has no elevation, or if the air in a zone is too hot.
    """
    landscape, station_m = conditions
    if landscape.elevation_m is None:
        raise FireModelError(
            "landscape: has no elevation, which the moisture of slopes requires; add an elevation "
            'raster, or set dead_fuel_model = "time_lag"'
        )
    zones = landscape.moisture_zones
    if station_m is None:
        station_m = float(np.mean(landscape.elevation_m))
    sun_on = _sunlight(air, landscape, station_m)
    rows = [air.at_s, np.append(0.0, air.rain_mm[:-1]) / 10.0]  # rain since the previous record
    for zone in range(zones.cover.size):
        zone_m = float(zones.elevation_m[zone])
        temperature_c, humidity = at_elevation(air, zone_m - station_m)
        if (hottest_c := float(temperature_c.max())) > MAX_TEMPERATURE_C:
            raise FireModelError(
                f"weather: with the station at {station_m:g} m, the air temperature at {zone_m:g} "
                f"m is {hottest_c:.0f} °C, more than {MAX_TEMPERATURE_C:g} °C; correct the "
                "elevation of the station"
            )
        rows += (temperature_c, humidity)
        rows.append(sun_on(zone))
    return list(_stick_moistures(np.array(rows).tobytes(), air.at_s.size, air.initial))


@lru_cache(maxsize=4)
def _stick_moistures(
    rows: bytes, records: int, initial: DeadMoistures
) -> tuple[tuple[DeadMoistures, ...], ...]:
    """Return the dead fuel moistures of zones at each record.

    ``rows`` is an array (2 + 3 zones, records) of times and rain, and for each zone temperatures,
    humidities and sunlight. The array is the cache key, because different parts of a program read
    the same weather.
    """
    (at_s, rain_cm), zones = np.split(np.frombuffer(rows).reshape(-1, records), [2])
    found = [
        [
            stick_moistures(terms, at_s, temperature_c, humidity, sun_w_m2, rain_cm, wet)
            for terms, wet in zip(STICKS, initial, strict=True)
        ]
        for temperature_c, humidity, sun_w_m2 in zones.reshape(-1, 3, records)
    ]
    return tuple(
        tuple((one, ten, hundred) for one, ten, hundred in record)
        for record in np.moveaxis(np.array(found), 2, 0).tolist()
    )


def at_elevation(air: AirRecords, above_m: float) -> tuple[Floats, Floats]:
    """Return the temperatures in °C and humidities (fractions) at a height above the station."""
    humidity = np.clip(air.humidity_pct / 100.0, MIN_HUMIDITY, MAX_HUMIDITY)
    dew_c = _dew_point_c(air.temperature_c, humidity) - DEW_LAPSE_C_M * above_m
    temperature_c = air.temperature_c - LAPSE_C_M * above_m
    humidity = np.exp(_magnus(dew_c) - _magnus(temperature_c))
    return temperature_c, np.clip(humidity, MIN_HUMIDITY, MAX_HUMIDITY)


def _magnus(temperature_c: Floats) -> Floats:
    """Return the logarithm of the relative saturation vapour pressure (Magnus, WMO 2008)."""
    return 17.62 * temperature_c / (243.12 + temperature_c)


def _dew_point_c(temperature_c: Floats, humidity: Floats) -> Floats:
    log_pressure = np.log(humidity) + _magnus(temperature_c)
    return 243.12 * log_pressure / (17.62 - log_pressure)


def _sunlight(air: AirRecords, landscape: Landscape, station_m: float) -> Callable[[int], Floats]:
    """Return a function that gives the sunlight on a zone's fuel at each record, in W/m²."""
    zones: MoistureZones = landscape.moisture_zones
    lat_deg, lon_deg = landscape.centre_lat_lon
    begin = air.begin
    if begin.tzinfo is None:
        begin = begin.replace(tzinfo=timezone(timedelta(hours=round(lon_deg / LON_DEG_PER_H))))
    sun = sunlight.sun_at(lat_deg, lon_deg, begin, air.at_s)
    if air.sun_w_m2 is not None:
        passes = sunlight.measured_share(sun, station_m, air.sun_w_m2)
    else:
        passes = sunlight.share_below_clouds(air.cloud_pct / 100.0)
    north, east = turned(zones.rise_north, zones.rise_east, landscape.grid_convergence_deg)

    def on(zone: int) -> Floats:
        slope = float(zones.elevation_m[zone]), float(north[zone]), float(east[zone])
        clear = sunlight.clear_sunlight_w_m2(sun, *slope)
        return clear * passes * (1.0 - float(zones.cover[zone]))

    return on
