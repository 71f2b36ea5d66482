"""Avoidance that sees intentions: an orbit is adopted only if its path is clear of all others.

Beyond the paper, whose vehicles see velocities only. Everybody tells the orbit it flies to
(``State.orbit_*``) and flies it by eqs. 14 and 15, so that its path can be worked out by everybody.
A vehicle keeps the orbit it has, which was clear of everybody when it was adopted, until another
one is clear as far as it looks ahead: the one wanted, or else the best of some ways round, to wait,
or to be slower or faster. So what it flies has always been checked, and those who adopt later have
checked theirs against it. Only two at once could miss each other: who is near takes turns.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.formation.intent_avoidance_kernels import NOTES, decide_orbit
from mission_service.guidance.formation.settings import Airframe, Settings

Floats = NDArray[np.float64]


class IntendedOrbit(NamedTuple):
    """What a vehicle intends to fly: to and round a circle; a negative radius is anticlockwise."""

    x_m: float
    y_m: float
    radius_m: float
    airspeed_m_s: float


class OwnMotion(NamedTuple):
    """The vehicle itself, now."""

    key: int  # peers.key_of(name): who goes first
    x_m: float
    y_m: float
    altitude_m: float  # the planned one, if altitudes are planned
    heading_rad: float
    airspeed_m_s: float
    wind_x_m_s: float = 0.0
    wind_y_m_s: float = 0.0


class AdoptedOrbit(NamedTuple):
    """The orbit adopted, and what was seen when it was last thought about."""

    orbit: IntendedOrbit
    in_conflict: bool = False  # what is wanted is not flown, because somebody is in the way
    clear_s: float = 0.0  # how long the path of the orbit adopted is clear
    looked_at_s: float = -1e9


@dataclass(frozen=True, slots=True)
class AvoidanceRules:
    """How avoidance looks ahead."""

    airframe: Airframe
    apart_m: float  # nearer is a collision: 2 r_s
    margin_m: float = 15.0  # more than that between paths
    margin_m_s: float = 5.0  # and more for each second that news of a peer is late
    horizon_s: float = 40.0
    every_s: float = 0.5  # thinks no more often
    turn_s: float = 2.0  # how long a turn takes: news from all who are near must come in it
    layers_m: float = 1e9  # planned altitudes this far apart need no avoidance

    @property
    def for_kernel(self) -> tuple[float, float, float, float, float]:
        """What ``decide_orbit`` takes as ``rule``."""
        numbers = (self.apart_m, self.margin_m, self.margin_m_s, self.turn_s, self.layers_m)
        one, two, three, four, five = map(float, numbers)
        return one, two, three, four, five

    @property
    def frame(self) -> tuple[float, float, float]:
        """What ``decide_orbit`` takes as ``frame``."""
        frame = self.airframe
        return (
            float(frame.least_airspeed_m_s),
            float(frame.most_airspeed_m_s),
            float(frame.bank_rad),
        )


def avoidance_rules(settings: Settings) -> AvoidanceRules:
    """Of the formation's settings."""
    return AvoidanceRules(
        settings.airframe, 2.0 * settings.safety_radius_m, layers_m=settings.apart_by_height_m
    )


def choose_orbit(
    at_s: float,
    own: OwnMotion,
    wanted: IntendedOrbit,
    held: AdoptedOrbit,
    peers: Floats,
    rules: AvoidanceRules,
) -> AdoptedOrbit:
    """What to intend now: called at each position, it thinks as often as ``every_s`` says.

    ``peers`` (n, COLUMNS) are rows as of ``peers.Peers.rows``.
    """
    if at_s - held.looked_at_s < rules.every_s - 1e-6:
        return held
    rows = int(rules.horizon_s) + 1
    orbit = np.empty(4)
    changed, other, clear_s = decide_orbit(
        float(at_s),
        np.array(own, np.float64),
        np.array(wanted, np.float64),
        np.array(held.orbit, np.float64),
        peers,
        rules.for_kernel,
        rules.frame,
        np.empty((rows, 2)),
        np.empty((len(peers), rows, 2)),
        np.empty((len(peers), NOTES)),
        orbit,
    )
    return AdoptedOrbit(
        IntendedOrbit(*orbit.tolist()) if changed else held.orbit, other, clear_s, at_s
    )
