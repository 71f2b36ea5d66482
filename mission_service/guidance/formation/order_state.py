"""The state of one vehicle in a formation, and of the orders sent to it."""

import math
from dataclasses import dataclass

from mission_service.missions.orbits import (
    Circle,
)

SETTLED_FOR_S = 20.0


@dataclass
class OrderState:
    """The state of one vehicle, and of the orders sent to it."""

    guided: bool = False  # whether the vehicle flies its mission or commanded orbits
    taken_over: bool = False
    mode: str = ""
    order: str = ""  # pending order
    ordered_at_s: float = -math.inf
    circle: Circle | None = None  # circle last commanded, or flown by the mission
    altitude_m: float = 0.0
    orbit_at_s: float = -math.inf
    check_ground_at_s: float = -math.inf
    airspeed_m_s: float | None = None
    speed_at_s: float = -math.inf
    settled_since_s: float | None = None
    start_not_before_s: float = -math.inf
    goes_home_until_s: float = math.inf  # time at which the agent's guidance home ends
    led_home: bool = False  # whether an order that leads home was sent
    sending: Circle | None = None  # final circle of a mission being uploaded
    loiter: Circle | None = None  # final circle of the mission on board

    def has_settled(self, at_s: float) -> bool:
        """Return whether the orbit has been unchanged for long enough to use a loiter item."""
        return self.settled_since_s is not None and at_s - self.settled_since_s >= SETTLED_FOR_S

    def start_due(self, at_s: float) -> bool:
        """Return whether to start the mission on board now.

        The mission must end in the circle that the vehicle is flying.
        """
        if self.loiter is None or self.loiter != self.circle or self.mode == "mission":
            return False
        return self.has_settled(at_s) and at_s >= self.start_not_before_s
