"""UAVs whose messages have stopped: dead reckoning along the orbits they sent last.

Their virtual agents are dropped after ``peer_table.LOST_AFTER_S``, so that the others close the
gap. The vehicles themselves fly on at the common height, and are avoided for much longer.
"""

import math

from msgspec.structs import replace

from mission_service.guidance.formation.peer_table import LOST_AFTER_S
from mission_service.peer_messages import State

SILENT_US = 3_000_000  # states are sent twice a second: not by chance, even if a third is lost
MINDED_FOR_US = 120_000_000
AGAIN_US = 500_000


def along_its_orbit(state: State, at_us: int) -> State:
    """The state of a vehicle that has flown along its orbit since ``state``, at its airspeed."""
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


class LostPeers:
    """The last state of each other UAV, and its dead reckoning once messages stop."""

    def __init__(self) -> None:
        self._last: dict[str, State] = {}
        self._due_us = 0

    def update(self, state: State) -> None:
        """Keep a state received."""
        self._last[state.sender] = state

    def remove(self, name: str) -> None:
        """Drop a UAV that has sent ``Leaving``."""
        self._last.pop(name, None)

    def states(self, at_us: int) -> list[State]:
        """Dead-reckoned states of the lost UAVs, twice a second at most."""
        if at_us < self._due_us:
            return []
        self._due_us = at_us + AGAIN_US
        found = []
        for name, state in list(self._last.items()):
            silent_us = at_us - state.at_us
            if silent_us > MINDED_FOR_US:
                del self._last[name]
            elif silent_us > SILENT_US:
                there = along_its_orbit(state, at_us)
                given_up = silent_us > LOST_AFTER_S * 1e6
                agent_m = (None, None) if given_up else (state.agent_x_m, state.agent_y_m)
                goal_m = (None, None) if given_up else (state.goal_x_m, state.goal_y_m)
                found.append(
                    replace(
                        there,
                        agent_x_m=agent_m[0],
                        agent_y_m=agent_m[1],
                        goal_x_m=goal_m[0],
                        goal_y_m=goal_m[1],
                    )
                )
        return found
