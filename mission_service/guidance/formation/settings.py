"""The settings of the formation: table 1 of the paper, and values that the paper does not give."""

import math
from dataclasses import dataclass
from typing import Literal

from mission_service.fire.camera import Camera

NEVER_M = 1e9  # stands for "no vertical separation", as a finite number for kernels
PAPER_CELL_M = 10.0  # unit of distances in forces, on maps with any cell size

# The paper's example (eq. 3), with a 4:3 sensor for the angle along the track.
PAPER_CAMERA = Camera(across_rad=1.047, along_rad=0.817)


@dataclass(frozen=True, slots=True)
class Airframe:
    """The limits of a fixed-wing UAV; speeds are airspeeds.

    In the paper the thrust varies from 0.4 to 1 of its maximum (eq. 16). Here the airspeed varies
    instead.
    """

    min_airspeed_m_s: float = 10.0
    max_airspeed_m_s: float = 25.0
    bank_rad: float = 0.7
    climb_m_s: float = 3.0

    @property
    def cruise_m_s(self) -> float:
        """Return the airspeed of a vehicle in phase, which is 0.7 of the maximum (eq. 16).

        The result is not below the minimum airspeed.
        """
        return max(0.7 * self.max_airspeed_m_s, self.min_airspeed_m_s)


@dataclass(frozen=True, slots=True)
class Constants:
    """The eight tunable constants in section 5.2 of the paper (c1 to c5, e3, t1, t2).

    Their values are results of ``mission-service tune virtual-agents``, recorded in ``tuned.json``.
    """

    c1: float = 7.63
    c2: float = 17.1
    c3: float = 1.95
    c4: float = 19.1
    c5: float = 16.8
    e3: float = 0.539
    t1: float = 0.276
    t2: float = 0.751


@dataclass(frozen=True, slots=True)
class Settings:
    """The settings in table 1 of the paper, then settings for which the table has no value."""

    monitoring_m: float = 350.0  # d_mon
    altitude_agl_m: float = 300.0  # alt
    loiter_radius_m: float = 150.0  # r_l, anticlockwise
    agent_speed_m_s: float = 25.0  # vel_max of virtual agents
    safety_radius_m: float = 30.0  # r_s: a distance below 2 r_s is a collision
    neighbourhood_m: float = 500.0  # d_n
    # Not in the paper:
    range_m: float = 2000.0  # r_com: range of state messages; fire updates reach all UAVs
    restart_m: float = 600.0  # a virtual agent farther from its UAV restarts at the UAV
    vertical_separation_m: float = (
        NEVER_M  # no avoidance between altitudes that differ by this or more
    )
    lossy_layers: int = 8  # number of altitude layers while many messages are lost
    placement: Literal["coverage", "forces"] = (
        "coverage"  # rule of ``coverage.py``, or "forces", the rule of the paper
    )
    camera: Camera = PAPER_CAMERA
    airframe: Airframe = Airframe()
    constants: Constants = Constants()

    @property
    def coverage_radius_m(self) -> float:
        """Return the radius of the area that the camera covers during a full circle (eq. 2)."""
        return self.loiter_radius_m + self.camera.half_width_m(self.altitude_agl_m)

    @property
    def spacing_m(self) -> float:
        """Return the distance below which virtual agents repel each other (eq. 8)."""
        return 2.0 * self.coverage_radius_m / math.sqrt(2.0)

    def augmentation_m(self, cell_m: float) -> float:
        """Return the minimum distance between a virtual agent and fire: r_l plus one cell (5.1)."""
        return self.loiter_radius_m + cell_m

    @property
    def agent_area_m(self) -> float:
        """Return the maximum distance from fire at which an agent covers cells (section 3.4)."""
        return self.monitoring_m + self.coverage_radius_m
