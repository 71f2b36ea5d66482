"""Compute the sunlight on sloping ground under clouds and trees.

The sunlight under a clear sky is the sum of the direct beam, attenuated by the air, and the diffuse
light of the sky (Liu & Jordan 1960, Solar Energy 4(3), 1-19; as in Campbell & Norman 1998, ch. 11).
Clouds reduce the beam and the diffuse light (Kasten & Czeplak 1980, Solar Energy 24, 177-189).
Crowns reduce the sunlight in proportion to the canopy cover. Shading by ridges is not considered.
"""

from datetime import datetime
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats

SOLAR_CONSTANT_W_M2 = 1361.0
CLEAR_AIR = 0.70  # fraction of a vertical beam that reaches sea level
SCALE_HEIGHT_M = 8200.0  # the pressure of the air falls to 1/e over this height
MIN_SIN_ELEVATION = 0.035  # 2°; the beam of a lower sun is neglected
MIN_MEASURED_SIN = 0.10  # measurements under a lower sun are not used


class Sun(NamedTuple):
    """The unit vector (3, n) to the sun (true north, east, up), and its distance factor (n)."""

    direction: Floats
    distance_factor: Floats  # of the light outside the atmosphere


def sun_at(lat_deg: float, lon_deg: float, begin: datetime, at_s: Floats) -> Sun:
    """Return the direction to the sun at times (n) in seconds after ``begin``.

    ``begin`` has an offset from UTC. Source: Spencer 1971, Search 2(5), 172; the error is at most a
    quarter of a degree.
    """
    utc = begin.utctimetuple()
    day_h = utc.tm_hour + utc.tm_min / 60.0 + utc.tm_sec / 3600.0
    hours = day_h + at_s / 3600.0
    angle = 2.0 * np.pi * (utc.tm_yday - 1.0 + hours / 24.0) / 365.2425
    cos1, sin1, cos2, sin2 = np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)
    declination = 0.006918 - 0.399912 * cos1 + 0.070257 * sin1 - 0.006758 * cos2 + 0.000907 * sin2
    declination += -0.002697 * np.cos(3 * angle) + 0.00148 * np.sin(3 * angle)
    equation_h = 0.000075 + 0.001868 * cos1 - 0.032077 * sin1 - 0.014615 * cos2 - 0.04089 * sin2
    equation_h *= 12.0 / np.pi
    turn = np.pi / 12.0 * (hours + equation_h - 12.0) + np.deg2rad(lon_deg)
    lat = np.deg2rad(lat_deg)
    up = np.sin(lat) * np.sin(declination) + np.cos(lat) * np.cos(declination) * np.cos(turn)
    north = np.cos(lat) * np.sin(declination) - np.sin(lat) * np.cos(declination) * np.cos(turn)
    east = -np.cos(declination) * np.sin(turn)
    factor = 1.000110 + 0.034221 * cos1 + 0.001280 * sin1 + 0.000719 * cos2 + 0.000077 * sin2
    return Sun(np.stack([north, east, up]), factor)


def clear_sunlight_w_m2(
    sun: Sun,
    elevation_m: float | Floats,
    rise_north: float | Floats,
    rise_east: float | Floats,
) -> Floats:
    """Return the sunlight (n) on ground with the given rise per metre, under a clear sky.

    For one time, elevation and rises may be arrays of the same shape, which the result also has.
    """
    north, east, up = sun.direction
    lit = up > 0.0
    outside = SOLAR_CONSTANT_W_M2 * sun.distance_factor
    air_mass = np.exp(-elevation_m / SCALE_HEIGHT_M) / np.maximum(up, MIN_SIN_ELEVATION)
    passes = CLEAR_AIR**air_mass
    flat = 1.0 / np.sqrt(1.0 + rise_north**2 + rise_east**2)  # cosine of the slope
    facing = np.maximum((up - north * rise_north - east * rise_east) * flat, 0.0)
    beam = np.where(up > MIN_SIN_ELEVATION, outside * passes * facing, 0.0)
    sky = 0.3 * (1.0 - passes) * outside * np.maximum(up, 0.0) * (1.0 + flat) / 2.0
    return np.where(lit, beam + sky, 0.0)


def share_below_clouds(cloud_fraction: Floats) -> Floats:
    """Return the fraction of the sunlight that passes through clouds (Kasten & Czeplak 1980)."""
    share: Floats = 1.0 - 0.75 * np.asarray(cloud_fraction) ** 3.4
    return share


def measured_share(sun: Sun, elevation_m: float, measured_w_m2: Floats) -> Floats:
    """Return the ratio (n) of measured to clear-sky sunlight on level ground, at most 1.2.

    While the sun is low, the ratio is interpolated from the hours before and after.
    """
    clear = clear_sunlight_w_m2(sun, elevation_m, 0.0, 0.0)
    high = sun.direction[2] > MIN_MEASURED_SIN
    if not high.any():
        return np.ones(measured_w_m2.size)
    places = np.arange(measured_w_m2.size)
    share = np.clip(measured_w_m2[high] / clear[high], 0.0, 1.2)
    found: Floats = np.interp(places, places[high], share)
    return found
