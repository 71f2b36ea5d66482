"""Avoidance by shared intentions: an orbit is adopted only if its path is clear of all others.

Beyond the paper, whose vehicles use velocities only. Each vehicle sends the orbit it flies to
(``State.orbit_*``) and flies it by eqs. 14 and 15, so that all others can predict its path. A
vehicle keeps its orbit, which was clear of all others when adopted, until another one is clear over
the horizon: the one wanted, or else the best of some detours, waiting circles and other airspeeds.
So the orbit flown has always been checked, and later adopters have checked theirs against it. Only
two that adopt at once could conflict: vehicles near each other take turns.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.formation.intent_avoidance_kernels import NOTES, decide_orbit
from mission_service.guidance.formation.settings import Airframe, Settings

Floats = NDArray[np.float64]


class IntendedOrbit(NamedTuple):
    """The circle that a vehicle flies to and round; a negative radius is anticlockwise."""

    x_m: float
    y_m: float
    radius_m: float
    airspeed_m_s: float


class OwnMotion(NamedTuple):
    """The vehicle itself, now."""

    key: int  # peer_table.priority_key(name)
    x_m: float
    y_m: float
    altitude_m: float  # the planned one, if altitudes are planned
    heading_rad: float
    airspeed_m_s: float
    wind_x_m_s: float = 0.0
    wind_y_m_s: float = 0.0


class AdoptedOrbit(NamedTuple):
    """The orbit adopted, and the result of the last decision about it."""

    orbit: IntendedOrbit
    in_conflict: bool = False  # the orbit wanted is not flown: another vehicle is in the way
    clear_s: float = 0.0  # how long the path of the orbit adopted is clear
    looked_at_s: float = -1e9


@dataclass(frozen=True, slots=True)
class AvoidanceRules:
    """Distances and times of the avoidance."""

    airframe: Airframe
    apart_m: float  # nearer is a collision: 2 r_s
    margin_m: float = 15.0  # on top of it, between paths
    margin_m_s: float = 5.0  # on top of that, for each second that a peer's state is late
    horizon_s: float = 40.0
    every_s: float = 0.5  # between decisions
    turn_s: float = 2.0  # duration of a turn, in which states of all near vehicles must arrive
    layers_m: float = 1e9  # planned altitudes this far apart need no avoidance

    @property
    def for_kernel(self) -> tuple[float, float, float, float, float]:
        """The argument ``rule`` of ``decide_orbit``."""
        numbers = (self.apart_m, self.margin_m, self.margin_m_s, self.turn_s, self.layers_m)
        one, two, three, four, five = map(float, numbers)
        return one, two, three, four, five

    @property
    def frame(self) -> tuple[float, float, float]:
        """The argument ``frame`` of ``decide_orbit``."""
        frame = self.airframe
        return (
            float(frame.min_airspeed_m_s),
            float(frame.max_airspeed_m_s),
            float(frame.bank_rad),
        )


def avoidance_rules(settings: Settings) -> AvoidanceRules:
    """The rules that follow from the formation's settings."""
    return AvoidanceRules(
        settings.airframe, 2.0 * settings.safety_radius_m, layers_m=settings.vertical_separation_m
    )


def choose_orbit(
    at_s: float,
    own: OwnMotion,
    wanted: IntendedOrbit,
    held: AdoptedOrbit,
    peers: Floats,
    rules: AvoidanceRules,
) -> AdoptedOrbit:
    """The orbit to fly from now on. Called at each position; decides every ``every_s``.

    ``peers`` (n, COLUMNS) are rows of ``PeerTable.rows``.
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
