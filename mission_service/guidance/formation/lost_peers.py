"""Computes positions of UAVs without recent messages, by dead reckoning on their last orbits.

The virtual agent of such a UAV is removed after ``peer_table.LOST_AFTER_S``, so that the other
agents take over its area. The UAV itself may continue to fly at the common height, so the others
avoid it for much longer.
"""

import math

from msgspec.structs import replace

from mission_service.guidance.formation.peer_table import LOST_AFTER_S
from mission_service.peer_messages import State

RECKON_AFTER_US = 3_000_000  # random loss rarely lasts this long at two states a second
AVOIDED_FOR_US = 120_000_000
EVERY_US = 500_000
AGENT_FIELDS = ("agent_x_m", "agent_y_m", "goal_x_m", "goal_y_m")


def along_orbit(state: State, at_us: int) -> State:
    """Return the state at ``at_us`` of a vehicle that has followed its orbit since ``state``."""
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
    )


class LostPeers:
    """The record of each other UAV's last state, which is dead reckoned when messages stop."""

    def __init__(self) -> None:
        self._last: dict[str, State] = {}
        self._due_us = 0

    def store(self, state: State) -> None:
        """Store a received state as the sender's last state."""
        self._last[state.sender] = state

    def remove(self, name: str) -> None:
        """Remove a UAV that has sent ``Leaving``."""
        self._last.pop(name, None)

    def states(self, at_us: int) -> list[State]:
        """Return the dead-reckoned states of lost UAVs.

        States are returned at most twice a second; further calls return an empty list.
        """
        if at_us < self._due_us:
            return []
        self._due_us = at_us + EVERY_US
        found = []
        for name, state in list(self._last.items()):
            age_us = at_us - state.at_us
            if age_us > AVOIDED_FOR_US:
                del self._last[name]
            elif age_us > RECKON_AFTER_US:
                state = along_orbit(state, at_us)
                if age_us > LOST_AFTER_S * 1e6:
                    state = replace(state, **dict.fromkeys(AGENT_FIELDS))
                found.append(state)
        return found
