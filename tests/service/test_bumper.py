"""Bent's bumper rule on a ring whose number of cells changes: vehicles turn at their neighbours."""

import numpy as np
import pytest

from mission_service.experiments.bent.ring_flight import fly_team
from mission_service.experiments.bent.ring_history import RingStep
from mission_service.guidance.team.baselines import Bumper

LENGTH_M, RADIUS_CELLS, SPEED_M_S = 3600.0, 1000.0, 15.0


def changing_ring(minutes: int) -> list[RingStep]:
    """Return a circle of 120 or 97 cells that is read every 20 s: cells merge and divide."""
    steps, before = [], 120
    for index in range(3 * minutes):
        count = 97 if index % 2 else 120
        turn = 2.0 * np.pi * np.arange(count) / count
        cells = np.column_stack([-np.cos(turn), np.sin(turn)]) * RADIUS_CELLS
        steps.append(
            RingStep(
                20.0 * index,
                cells.astype(np.int64),
                np.full(count, LENGTH_M / count),
                np.full(count, 0.1),
                np.arange(count) * before // count,
                np.arange(before) * count // before,
            )
        )
        before = count
    return steps


@pytest.mark.parametrize("uavs", [2, 3, 4, 5, 6])
def test_bumpers_keep_their_order_around_the_fire(uavs: int) -> None:
    history = changing_ring(120)
    cell_m = LENGTH_M / (2.0 * np.pi * RADIUS_CELLS)
    flight = fly_team(history, Bumper(), uavs, SPEED_M_S, cell_m=cell_m)
    times = np.arange(0.0, history[-1].at_s, 7.0)
    around = []
    for track in flight.tracks.values():
        turn = np.unwrap(np.arctan2(track[:, 2], -track[:, 1]) % (2.0 * np.pi))
        around.append(np.interp(times, track[:, 0], turn) * LENGTH_M / (2.0 * np.pi))
    gaps_m = np.diff([*around, around[0] + LENGTH_M], axis=0)
    assert gaps_m.min() > -100.0  # a cell or two for each vehicle, at their meeting
    assert gaps_m.max() < LENGTH_M + 100.0
    assert flight.decisions > 3000 * uavs
    reversals = [np.count_nonzero(np.diff(np.sign(np.diff(track)))) for track in around]
    assert min(reversals) >= 4
