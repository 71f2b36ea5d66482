"""Stand-in until the lead's: see ISSUE6.md. An agent that orbits a fixed place around the fire."""

import math
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_service.formation.grid import Grid
from mission_service.formation.messages import AnyMessage, Leaving, State
from mission_service.formation.settings import Settings

Cells = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Own:
    """What a UAV knows of itself."""

    at_us: int
    x_m: float
    y_m: float
    altitude_amsl_m: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    airspeed_m_s: float
    wind_x_m_s: float = 0.0
    wind_y_m_s: float = 0.0
    hot: bool = False


@dataclass(frozen=True, slots=True)
class Intention:
    """What a UAV means to fly."""

    orbit_x_m: float
    orbit_y_m: float
    orbit_radius_m: float
    airspeed_m_s: float
    climb_m: float
    settled: bool
    agent_x_m: float
    agent_y_m: float
    in_conflict: bool = False


class Agent:
    """A stand-in."""

    def __init__(
        self,
        name: str,
        settings: Settings,
        grid: Grid,
        fire: Cells,
        at_us: int,
        avoidance: str = "intent",
        synchronises: bool = True,
    ) -> None:
        """Orbit a place that its name says."""
        self.name, self.settings = name, settings
        rows, cols = np.divmod(fire, grid.cols)
        angle = zlib.crc32(name.encode()) % 360 * math.pi / 180.0
        x_m, y_m = grid.xy_of(float(rows.mean()), float(cols.mean()))
        self.place = (x_m + 800.0 * math.cos(angle), y_m + 800.0 * math.sin(angle))
        self.agent_m: tuple[float, float] | None = None
        self._said: list[AnyMessage] = []

    def hear(self, message: AnyMessage) -> None:
        """Nothing."""

    def see(self, burning: Cells, unburned: Cells, at_us: int) -> None:
        """Nothing."""

    def step(self, own: Own) -> Intention:
        """The same orbit always."""
        self.agent_m = self.place
        off_m = math.dist(self.place, (own.x_m, own.y_m))
        radius_m = self.settings.loiter_radius_m
        phase = math.atan2(own.y_m - self.place[1], own.x_m - self.place[0])
        rate = self.settings.airframe.cruise_m_s / radius_m
        behind = (rate * own.at_us / 1e6 - phase + math.pi) % math.tau - math.pi
        speed = self.settings.airframe.cruise_m_s + max(-5.0, min(5.0, 8.0 * behind))
        self._said.append(
            State(
                own.at_us,
                self.name,
                own.x_m,
                own.y_m,
                own.altitude_amsl_m,
                own.velocity_x_m_s,
                own.velocity_y_m_s,
                *self.place,
                *self.place,
                -radius_m,
                speed,
                off_m < 1.2 * radius_m,
            )
        )
        settled = off_m < 1.2 * radius_m
        return Intention(*self.place, -radius_m, speed, 0.0, settled, *self.place)

    def messages(self, at_us: int) -> list[AnyMessage]:
        """States."""
        said, self._said = self._said, []
        return said

    def leave(self, at_us: int, why: str) -> None:
        """It is told."""
        self._said.append(Leaving(at_us, self.name, why))
