"""Generate small random fires for tuning the virtual agents' constants (section 5.2.6).

Maps have 50 x 50 and 100 x 100 cells. The paper gives no cell size. Here a cell is 50 m wide, so
that 50 cells (2.5 km) are enough for a fire, 350 m around the fire, and the approach. Fires have
the areas in table 2 and do not grow; agents approach from one side, in line abreast.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.physics.weather import WeatherStream
from firemodel.spread.probabilistic import ProbabilisticFire
from mission_service.experiments.fires import flat, wind
from mission_service.experiments.virtual_agents.rollout_kernels import unroll
from mission_service.experiments.virtual_agents.static_placement import (
    coverage,
    maps_of,
    weights_of,
)
from mission_service.guidance.formation.agent_maps import AgentMaps
from mission_service.guidance.formation.map_grid import MapGrid
from mission_service.guidance.formation.settings import Settings
from mission_service.guidance.formation.virtual_forces_kernels import tie_rad

Floats = NDArray[np.float64]

CELL_M = 50.0
STEP_S = 1.0
P_SPREAD = 0.2
ABREAST_M = 150.0  # spacing of agents at the start
PENALTY = 10.0  # weight of the fraction of time during which virtual agents lead UAVs over fire


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of scenario.

    The fields are the number of cells along each side of the map, the number of steps of a
    roll-out, the number of agents, and the minimum and maximum number of burned cells.
    """

    cells: int
    steps: int
    agents: int
    fire_cells: tuple[int, int]


KINDS = (Kind(50, 250, 4, (15, 60)),) * 3 + (Kind(100, 500, 8, (60, 160)),) * 3


@dataclass(frozen=True, eq=False, slots=True)
class Scenario:
    """A fire with its maps (y, x), and the start positions ``agents_m`` (2, n) of the agents."""

    kind: Kind
    grid: MapGrid
    maps: AgentMaps
    danger: NDArray[Any]  # (y, x) not 0 where a virtual agent's UAV would fly over fire
    weights: Floats
    agents_m: Floats


@lru_cache(maxsize=4)
def scenarios(seed: int, kinds: tuple[Kind, ...] = KINDS) -> tuple[Scenario, ...]:
    """Return one scenario of each kind; the scenarios depend only on the seed and the kinds."""
    rng = np.random.default_rng(seed)
    return tuple(_scenario(kind, rng) for kind in kinds)


def _scenario(kind: Kind, rng: np.random.Generator) -> Scenario:
    settings = Settings()
    fire = np.flatnonzero(_fire(kind, rng))
    size_m = kind.cells * CELL_M
    grid = MapGrid(kind.cells, kind.cells, CELL_M, 0.0, size_m)
    maps = maps_of(fire, grid, settings)
    near = AgentMaps(grid.shape, CELL_M, settings.loiter_radius_m, 0.0)
    near.set(fire, np.empty(0, dtype=np.int64))
    side_rad = rng.uniform(0.0, 2.0 * math.pi)
    abreast_m = ABREAST_M * (np.arange(kind.agents) - (kind.agents - 1) / 2.0)
    away_m = 0.45 * size_m
    agents_m = size_m / 2.0 + np.array(
        [
            away_m * math.cos(side_rad) - abreast_m * math.sin(side_rad),
            away_m * math.sin(side_rad) + abreast_m * math.cos(side_rad),
        ]
    )
    return Scenario(kind, grid, maps, near.augmentation, weights_of(maps), agents_m)


def _fire(kind: Kind, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return the burned cells (y, x) of a fire grown from one to three ignitions close together."""
    cells = kind.cells
    landscape = flat(np.ones((cells, cells), dtype=np.int16), CELL_M)
    middle = rng.integers(int(0.42 * cells), int(0.58 * cells), size=2)
    lit = [middle + rng.integers(-3, 4, size=2) for _ in range(rng.integers(1, 4))]
    fire = ProbabilisticFire(
        landscape,
        WeatherStream((wind(0.0, 0.0, 0.0),)),
        [(int(row), int(col), 0.0) for row, col in lit],
        p_spread=P_SPREAD,
        update_s=1.0,
        rng=rng,
    )
    min_cells, max_cells = kind.fire_cells
    count = int(rng.integers(min_cells, max_cells + 1))
    while np.count_nonzero(np.isfinite(fire.arrival_time_s)) < count:
        fire.advance(fire.time_s + 1.0)
    return np.isfinite(fire.arrival_time_s)


def flown(scenario: Scenario, constants: Floats) -> tuple[float, float]:
    """Return the final coverage, and the fraction of time that agents are too close to fire.

    ``constants`` (8) are in the order of ``constants_array``.
    """
    settings, grid = Settings(), scenario.grid
    agents_m = scenario.agents_m.copy()
    centre = scenario.maps.centre_row_col
    assert centre is not None
    touched = unroll(
        agents_m,
        np.empty_like(agents_m),
        scenario.kind.steps,
        STEP_S,
        np.array([tie_rad(number) for number in range(scenario.kind.agents)]),
        *grid.xy_of(*centre),
        *(scenario.maps.augmentation, scenario.maps.area, scenario.danger),
        *(grid.west_m, grid.north_m, grid.cell_m),
        *(constants, settings.spacing_m, settings.agent_speed_m_s),
    )
    rows, cols = grid.row_col_of(agents_m[0], agents_m[1])
    places = np.stack([rows, cols], axis=1)
    share = coverage(scenario.weights, places, settings.coverage_radius_m / grid.cell_m)
    return share, touched / (scenario.kind.steps * scenario.kind.agents)


def fitness(genes: tuple[float, ...], seed: int) -> float:
    """Return the final coverage minus the penalty, averaged over a seed's scenarios."""
    constants = np.array(genes, dtype=np.float64)
    results = [flown(scenario, constants) for scenario in scenarios(seed)]
    return sum(covered - PENALTY * too_near for covered, too_near in results) / len(results)
