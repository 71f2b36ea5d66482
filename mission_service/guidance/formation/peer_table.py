"""Stores the last received state and goal of each other UAV, in arrays for the kernels."""

import zlib

import numpy as np
from numpy.typing import NDArray

from mission_service.peer_messages import Goal, State

Floats = NDArray[np.float64]

# Columns of a row.
X, Y, ALTITUDE, VX, VY = range(5)
ORBIT_X, ORBIT_Y, RADIUS, AIRSPEED, PLANNED, AGE_S, KEY = range(5, 12)  # PLANNED: planned altitude
COLUMNS = 12

LOST_AFTER_S = 10.0  # the phase of a UAV with an older state is unknown
GOAL_LOST_AFTER_S = 30.0  # then other agents take over the area of a silent UAV's agent
AVOIDED_FOR_S = 120.0  # time for which a silent UAV is avoided; its last orbit may last longer


def priority_key(name: str) -> int:
    """Return the priority key of a UAV, computed from its name and the same in all processes."""
    return zlib.crc32(name.encode())


def recent(rows: Floats) -> Floats:
    """Return the rows with states that are not older than ``LOST_AFTER_S``."""
    return rows[rows[:, AGE_S] < LOST_AFTER_S]


class PeerTable:
    """The table of the other UAVs, with a row for each UAV that has sent a state or a goal.

    ``rows`` omits the UAVs that have left, or have sent no state in the last ``AVOIDED_FOR_S``.
    """

    def __init__(self) -> None:
        self._row_of: dict[str, int] = {}
        self._goals = np.full((8, 4), -np.inf)  # x, y, the sender's key, time in us
        self._rows = np.zeros((8, COLUMNS))
        self._received_at_us = np.zeros(8, dtype=np.int64)

    def apply_state(self, state: State) -> None:
        """Store a state, unless a state with the same or a later time is already stored."""
        row = self._row_of.get(state.sender)
        if row is None:
            row = self._new_row(state.sender)
        if state.at_us <= self._received_at_us[row]:
            return
        self._received_at_us[row] = state.at_us
        if state.goal_x_m is not None and state.goal_y_m is not None:
            self._set_goal(row, state.at_us, state.goal_x_m, state.goal_y_m)
        elif state.agent_x_m is not None and state.agent_y_m is not None:
            self._set_goal(row, state.at_us, state.agent_x_m, state.agent_y_m)
        else:
            self._goals[row, 3] = -np.inf
        planned_m = state.planned_altitude_amsl_m
        self._rows[row, :AGE_S] = (
            state.x_m,
            state.y_m,
            state.altitude_amsl_m,
            state.velocity_x_m_s,
            state.velocity_y_m_s,
            state.orbit_x_m,
            state.orbit_y_m,
            state.orbit_radius_m,
            state.airspeed_m_s,
            state.altitude_amsl_m if planned_m is None else planned_m,
        )

    def apply_goal(self, goal: Goal) -> None:
        """Store the goal of a UAV's virtual agent, unless a later goal is already stored."""
        row = self._row_of.get(goal.sender)
        if row is None:
            row = self._new_row(goal.sender)
        self._set_goal(row, goal.at_us, goal.x_m, goal.y_m)

    def goals(self, at_us: int) -> Floats:
        """Return x, y and the sender's key (n, 3) of goals not older than ``GOAL_LOST_AFTER_S``.

        If forces move a virtual agent, the agent's position counts as its goal.
        """
        known = self._goals[: len(self._row_of)]
        return known[known[:, 3] > at_us - GOAL_LOST_AFTER_S * 1e6, :3]

    def remove(self, name: str) -> None:
        """Omit a UAV until its next message is received."""
        row = self._row_of.get(name)
        if row is not None:
            self._goals[row, 3] = -np.inf
            self._rows[row, AGE_S] = np.inf
            self._received_at_us[row] = np.iinfo(np.int64).min

    def rows(self, at_us: int) -> Floats:
        """Return the last states (n, COLUMNS) of the UAVs; column ``AGE_S`` is the state's age."""
        count = len(self._row_of)
        age_s = (at_us - self._received_at_us[:count].astype(np.float64)) / 1e6
        self._rows[:count, AGE_S] = age_s
        return self._rows[:count][age_s < AVOIDED_FOR_S]

    def _set_goal(self, row: int, at_us: int, x_m: float, y_m: float) -> None:
        if at_us >= self._goals[row, 3]:
            self._goals[row] = (x_m, y_m, self._rows[row, KEY], at_us)

    def _new_row(self, name: str) -> int:
        row = self._row_of[name] = len(self._row_of)
        if row == len(self._rows):
            self._rows = np.pad(self._rows, ((0, row), (0, 0)))
            self._received_at_us = np.pad(self._received_at_us, (0, row))
            self._goals = np.pad(self._goals, ((0, row), (0, 0)), constant_values=-np.inf)
        self._received_at_us[row] = np.iinfo(np.int64).min
        self._rows[row, KEY] = priority_key(name)
        return row
