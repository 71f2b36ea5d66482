"""Vehicles of a formation whose link is lost: others go on minding them for a while.

A vehicle that hears nothing more circles on where its last orbit was ordered, at the height of the
others. Nobody else can tell where it is, so that is said in its place.
"""

import math
from dataclasses import dataclass

from msgspec.structs import replace

from mission_service.formation.messages import State

SAID_EVERY_US = 500_000
MINDED_FOR_US = 120_000_000


def along_its_orbit(state: State, at_us: int) -> State:
    """Where a vehicle is that has flown on along its orbit since ``state``, at its airspeed."""
    off_x_m, off_y_m = state.x_m - state.orbit_x_m, state.y_m - state.orbit_y_m
    rate_rad_s = -state.airspeed_m_s / state.orbit_radius_m
    phase_rad = math.atan2(off_y_m, off_x_m) + rate_rad_s * (at_us - state.at_us) / 1e6
    size_m, turn = abs(state.orbit_radius_m), math.copysign(1.0, rate_rad_s)
    return replace(
        state,
        at_us=at_us,
        x_m=state.orbit_x_m + size_m * math.cos(phase_rad),
        y_m=state.orbit_y_m + size_m * math.sin(phase_rad),
        velocity_x_m_s=-turn * state.airspeed_m_s * math.sin(phase_rad),
        velocity_y_m_s=turn * state.airspeed_m_s * math.cos(phase_rad),
        agent_x_m=state.orbit_x_m,
        agent_y_m=state.orbit_y_m,
    )


@dataclass
class Lost:
    """The last that a vehicle said, and when something was last said in its place."""

    state: State
    said_at_us: int

    def due(self, at_us: int) -> bool:
        """Whether it is time to say something again."""
        return at_us - self.said_at_us >= SAID_EVERY_US

    def over(self, at_us: int) -> bool:
        """Whether nobody needs to mind it any more: where it is now is anybody's guess."""
        return at_us - self.state.at_us > MINDED_FOR_US
