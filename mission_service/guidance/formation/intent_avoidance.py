"""Avoids collisions: each vehicle sends its intended orbit, and adopts orbits with a clear path.

In the paper, vehicles avoid each other using only their velocities. Here each vehicle sends the
orbit to which it flies (``State.orbit_*``), and flies to this orbit according to eqs. 14 and 15, so
that the other vehicles can predict its path.

An orbit is clear if the predicted path to the orbit and around it keeps the minimum distances from
the predicted paths of all other vehicles. A vehicle keeps its adopted orbit until another orbit is
clear over the whole horizon. The new orbit is the desired orbit or, if the desired orbit is not
clear, the best of several detours, waiting circles and orbits at different airspeeds. Each adopted
orbit has therefore been checked against all orbits that were adopted earlier. Conflicts could arise
only if two vehicles adopted orbits at the same time, so nearby vehicles take turns. If no orbit is
clear over the whole horizon, the vehicle flies the orbit that is clear for the longest time.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mission_service.guidance.formation.intent_avoidance_kernels import NOTES, decide_orbit
from mission_service.guidance.formation.settings import Airframe, Settings

Floats = NDArray[np.float64]

LAYER_MARGIN_M = 10.0  # height of a layer minus the distance that counts as a collision


class IntendedOrbit(NamedTuple):
    """The circle to which a vehicle flies, and on which it then stays.

    A negative radius means an anticlockwise orbit.
    """

    x_m: float
    y_m: float
    radius_m: float
    airspeed_m_s: float


class OwnMotion(NamedTuple):
    """The current motion of this vehicle."""

    key: int  # peer_table.priority_key(name)
    x_m: float
    y_m: float
    altitude_m: float
    planned_altitude_m: float  # the altitude to which the vehicle climbs or descends
    heading_rad: float
    airspeed_m_s: float
    wind_x_m_s: float = 0.0
    wind_y_m_s: float = 0.0


class AdoptedOrbit(NamedTuple):
    """The adopted orbit, and the result of the vehicle's last decision."""

    orbit: IntendedOrbit
    in_conflict: bool = False  # another vehicle prevents the desired orbit
    clear_s: float = 0.0  # time for which the path of the orbit is clear
    decided_at_s: float = -1e9


@dataclass(frozen=True, slots=True)
class AvoidanceRules:
    """The distances and times that vehicles use to avoid each other."""

    airframe: Airframe
    apart_m: float  # a smaller distance is a collision: 2 r_s
    margin_m: float = 15.0  # additional distance between paths
    margin_m_s: float = 5.0  # additional distance for each second that a peer's state is late
    horizon_s: float = 40.0
    every_s: float = 0.5  # time between decisions
    turn_s: float = (
        2.0  # duration of a turn, during which states of all nearby vehicles must arrive
    )
    layers_m: float = 1e9  # no avoidance between planned altitudes this far apart

    @property
    def for_kernel(self) -> tuple[float, float, float, float, float]:
        """Return the argument ``rule`` of ``decide_orbit``."""
        apart_m, margin_m, margin_m_s = map(float, (self.apart_m, self.margin_m, self.margin_m_s))
        return apart_m, margin_m, margin_m_s, float(self.turn_s), float(self.layers_m)

    @property
    def frame(self) -> tuple[float, float, float]:
        """Return the argument ``frame`` of ``decide_orbit``."""
        min_m_s, max_m_s = self.airframe.min_airspeed_m_s, self.airframe.max_airspeed_m_s
        return float(min_m_s), float(max_m_s), float(self.airframe.bank_rad)


def avoidance_rules(settings: Settings) -> AvoidanceRules:
    """Return the avoidance rules that follow from a formation's settings."""
    return AvoidanceRules(
        settings.airframe, 2.0 * settings.safety_radius_m, layers_m=settings.vertical_separation_m
    )


def layer_m(settings: Settings) -> float:
    """Return the height of an altitude layer, used while many messages are lost."""
    return 2.0 * settings.safety_radius_m + LAYER_MARGIN_M


def layered_rules(settings: Settings) -> AvoidanceRules:
    """Return the avoidance rules for times of heavy message loss: layers count as separated."""
    separation_m = min(settings.vertical_separation_m, layer_m(settings) - 0.5 * LAYER_MARGIN_M)
    return replace(avoidance_rules(settings), layers_m=separation_m)


def choose_orbit(
    at_s: float,
    own: OwnMotion,
    desired: IntendedOrbit,
    held: AdoptedOrbit,
    peers: Floats,
    rules: AvoidanceRules,
    listens: bool = False,
) -> AdoptedOrbit:
    """Return the orbit to fly now; a new decision is made every ``every_s``.

    ``peers`` (n, COLUMNS) is the result of ``PeerTable.rows``. See ``decide_orbit`` for
    ``listens``.
    """
    if at_s - held.decided_at_s < rules.every_s - 1e-6:
        return held
    rows = int(rules.horizon_s) + 1
    orbit = np.empty(4)
    changed, in_conflict, clear_s = decide_orbit(
        float(at_s),
        np.array(own, np.float64),
        np.array(desired, np.float64),
        np.array(held.orbit, np.float64),
        listens,
        peers,
        rules.for_kernel,
        rules.frame,
        np.empty((rows, 2)),
        np.empty((len(peers), rows, 2)),
        np.empty((len(peers), NOTES)),
        orbit,
    )
    adopted = IntendedOrbit(*orbit.tolist()) if changed else held.orbit
    return AdoptedOrbit(adopted, in_conflict, clear_s, at_s)
