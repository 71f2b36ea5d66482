"""Decodes airborne positions in Compact Position Reporting (CPR). Pure.

Source: RTCA DO-260B, A.1.7; J. Sun, *The 1090 Megahertz Riddle*, 2nd ed., chapter 5. An encoded
latitude and longitude are 17-bit fractions of a zone; even and odd messages use zones of different
sizes.
"""

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STEPS = 131_072.0  # of a fraction
ZONES = 15  # latitude zones between the equator and a pole, for even messages
EVEN_DEG, ODD_DEG = 360.0 / (4 * ZONES), 360.0 / (4 * ZONES - 1)


def _transitions() -> Floats:
    """Return the latitudes at which the number of longitude zones decreases from 59 to 1."""
    zones = np.arange(4 * ZONES - 1, 1, -1)
    share = (1.0 - math.cos(math.pi / (2.0 * ZONES))) / (1.0 - np.cos(2.0 * math.pi / zones))
    return np.degrees(np.arccos(np.sqrt(share)))


TRANSITIONS = _transitions()


def longitude_zones(lat_deg: float) -> int:
    """Return the number of longitude zones (NL) at a latitude: 59 at the equator, 1 at a pole."""
    return int(4 * ZONES - 1 - np.searchsorted(TRANSITIONS, abs(lat_deg), side="right"))


def local_positions(
    reference: tuple[float, float], lat_cpr: Floats, lon_cpr: Floats, odd: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Return the positions in degrees that are nearest to a reference (lat_deg, lon_deg).

    The encoded positions, all arrays (n,), range from 0 to 2^17 - 1. The result is the true
    position if that is within half a zone (about 180 nmi) of the reference.
    """
    size = np.where(odd, ODD_DEG, EVEN_DEG)
    lat = _nearest(reference[0], lat_cpr / STEPS, size)
    zones = 4 * ZONES - 1 - np.searchsorted(TRANSITIONS, np.abs(lat), side="right")
    lon = _nearest(reference[1], lon_cpr / STEPS, 360.0 / np.maximum(zones - odd, 1))
    return lat, (lon + 180.0) % 360.0 - 180.0


def _nearest(reference_deg: float, share: Floats, size_deg: Floats) -> Floats:
    """Return the angles at the given fractions of a zone, in the zone nearest to a reference."""
    return np.asarray(size_deg * (np.round(reference_deg / size_deg - share) + share))


def global_position(
    even: tuple[int, int], odd: tuple[int, int], odd_is_newer: bool
) -> tuple[float, float] | None:
    """Return the position in degrees from an even and an odd pair (lat, lon) of encoded values.

    The result is the position of the newer message. Returns None if the two messages are from
    different longitude zones, or do not describe a position on the Earth.
    """
    lat_even, lat_odd = even[0] / STEPS, odd[0] / STEPS
    zone = math.floor((4 * ZONES - 1) * lat_even - 4 * ZONES * lat_odd + 0.5)
    south, north = (
        EVEN_DEG * (zone % (4 * ZONES) + lat_even),
        ODD_DEG * (zone % (4 * ZONES - 1) + lat_odd),
    )
    latitudes = [lat - 360.0 if lat >= 270.0 else lat for lat in (south, north)]
    if max(map(abs, latitudes)) > 90.0:
        return None
    zones = longitude_zones(latitudes[0])
    if zones != longitude_zones(latitudes[1]):
        return None
    lon_even, lon_odd = even[1] / STEPS, odd[1] / STEPS
    zone = math.floor(lon_even * (zones - 1) - lon_odd * zones + 0.5)
    count = max(zones - odd_is_newer, 1)
    share = lon_odd if odd_is_newer else lon_even
    lon_deg = 360.0 / count * (zone % count + share)
    return latitudes[odd_is_newer], (lon_deg + 180.0) % 360.0 - 180.0
