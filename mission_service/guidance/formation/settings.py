"""The constants of the formation: table 1 of the paper, and what it needs but does not print."""

import math
from dataclasses import dataclass
from typing import Literal

from mission_service.fire.camera import Camera

NEVER_M = 1e9  # as good as infinite, for kernels
PAPER_CELL_M = 10.0  # forces count distances in the paper's cells, whatever the map's are


# Its example (eq. 3); along the track a 4:3 sensor is taken.
PAPER_CAMERA = Camera(across_rad=1.047, along_rad=0.817)


@dataclass(frozen=True, slots=True)
class Airframe:
    """The limits of a fixed wing; speeds are airspeeds.

    The paper's thrust goes from 0.4 of the most to the most (eq. 16); here so does the airspeed.
    """

    min_airspeed_m_s: float = 10.0
    max_airspeed_m_s: float = 25.0
    bank_rad: float = 0.7
    climb_m_s: float = 3.0

    @property
    def cruise_m_s(self) -> float:
        """The airspeed of a vehicle that is in phase: 0.7 of the most (eq. 16)."""
        return max(0.7 * self.max_airspeed_m_s, self.min_airspeed_m_s)

    def turn_rate_rad_s(self, airspeed_m_s: float) -> float:
        """Largest turn rate in level flight."""
        return 9.80665 * math.tan(self.bank_rad) / airspeed_m_s


@dataclass(frozen=True, slots=True)
class Constants:
    """The eight tunable constants of section 5.2 (c1 to c5, e3, t1, t2).

    As found by ``mission-service tune virtual-agents``; ``tuned.json`` is that run.
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
    """Table 1, and below the line settings without a value in the paper."""

    monitoring_m: float = 350.0  # d_mon
    altitude_agl_m: float = 300.0  # alt
    loiter_radius_m: float = 150.0  # r_l, anticlockwise
    agent_speed_m_s: float = 25.0  # vel_max of virtual agents
    safety_radius_m: float = 30.0  # r_s: nearer than twice that is a collision
    neighbourhood_m: float = 500.0  # d_n
    # ---
    range_m: float = 2000.0  # r_com: range of state messages; fire updates reach all UAVs
    restart_m: float = 600.0  # a virtual agent farther than this from its UAV starts anew
    vertical_separation_m: float = NEVER_M  # altitudes that differ so much need no avoidance
    placement: Literal["coverage", "forces"] = "coverage"  # ``coverage.py``; the paper's forces
    camera: Camera = PAPER_CAMERA
    airframe: Airframe = Airframe()
    constants: Constants = Constants()

    @property
    def coverage_radius_m(self) -> float:
        """Radius in metres of the area that a UAV sees on a full circle (eq. 2)."""
        return self.loiter_radius_m + self.camera.half_width_m(self.altitude_agl_m)

    @property
    def spacing_m(self) -> float:
        """The distance below which virtual agents repel each other (eq. 8)."""
        return 2.0 * self.coverage_radius_m / math.sqrt(2.0)

    def augmentation_m(self, cell_m: float) -> float:
        """Minimum distance of a virtual agent from fire in metres: r_l and a cell (section 5.1)."""
        return self.loiter_radius_m + cell_m

    @property
    def agent_area_m(self) -> float:
        """Maximum distance from fire at which a virtual agent covers cells (section 3.4)."""
        return self.monitoring_m + self.coverage_radius_m
