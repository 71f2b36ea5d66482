"""Stores the last received state of each other UAV, as rows of numbers for the kernels."""

import math
import zlib

import numpy as np
from numpy.typing import NDArray

from mission_service.peer_messages import State

Floats = NDArray[np.float64]

# Columns of a row.
X, Y, ALTITUDE, VX, VY = range(5)
GOAL_X, GOAL_Y = 5, 6  # goal or position of its virtual agent; NaN without an agent
ORBIT_X, ORBIT_Y, RADIUS, AIRSPEED, AGE_S, KEY = range(7, 13)
COLUMNS = 13

LOST_AFTER_S = 10.0


def priority_key(name: str) -> int:
    """Return the number for a UAV's priority, computed from its name in every process."""
    return zlib.crc32(name.encode())


class PeerTable:
    """The table of other UAVs, with a row for each UAV that has sent a state.

    ``rows`` omits the UAVs that have left, or have sent no state in the last ``LOST_AFTER_S``.
    """

    def __init__(self) -> None:
        self._row_of: dict[str, int] = {}
        self._rows = np.zeros((8, COLUMNS))
        self._received_at_us = np.zeros(8, dtype=np.int64)

    def apply_state(self, state: State) -> None:
        """Store a state, unless a state of the same or a later time is stored."""
        row = self._row_of.get(state.sender)
        if row is None:
            row = self._new_row(state.sender)
        if state.at_us <= self._received_at_us[row]:
            return
        self._received_at_us[row] = state.at_us
        goal_x_m = state.agent_x_m if state.goal_x_m is None else state.goal_x_m
        goal_y_m = state.agent_y_m if state.goal_y_m is None else state.goal_y_m
        self._rows[row, :AGE_S] = (
            state.x_m,
            state.y_m,
            state.altitude_amsl_m,
            state.velocity_x_m_s,
            state.velocity_y_m_s,
            math.nan if goal_x_m is None else goal_x_m,
            math.nan if goal_y_m is None else goal_y_m,
            state.orbit_x_m,
            state.orbit_y_m,
            state.orbit_radius_m,
            state.airspeed_m_s,
        )

    def remove(self, name: str) -> None:
        """Omit a UAV until its next state is received."""
        row = self._row_of.get(name)
        if row is not None:
            self._rows[row, AGE_S] = np.inf
            self._received_at_us[row] = np.iinfo(np.int64).min

    def rows(self, at_us: int) -> Floats:
        """Return the rows (n, COLUMNS) of UAVs with a recent state; column ``AGE_S`` is its age."""
        count = len(self._row_of)
        age_s = (at_us - self._received_at_us[:count].astype(np.float64)) / 1e6
        self._rows[:count, AGE_S] = age_s
        return self._rows[:count][age_s < LOST_AFTER_S]

    def _new_row(self, name: str) -> int:
        row = self._row_of[name] = len(self._row_of)
        if row == len(self._rows):
            self._rows = np.pad(self._rows, ((0, row), (0, 0)))
            self._received_at_us = np.pad(self._received_at_us, (0, row))
        self._received_at_us[row] = np.iinfo(np.int64).min
        self._rows[row, KEY] = priority_key(name)
        return row
