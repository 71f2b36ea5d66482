"""Pyretechnics' side of ``pyretechnics_compare``; runs in its own environment, without firemodel.

``python pyretechnics_worker.py case.npz answer.npz``. Rows are turned round on the way in and out,
because pyretechnics counts them from the south.
"""

import sys
import time
from pathlib import Path

import numpy as np
from pyretechnics.eulerian_level_set import (  # type: ignore[import-not-found]
    SpreadState,
    spread_fire_with_phi_field,
)
from pyretechnics.space_time_cube import SpaceTimeCube  # type: ignore[import-not-found]

RASTERS = ("slope", "aspect", "fuel_model")
NO_TREES = ("canopy_cover", "canopy_height", "canopy_base_height", "canopy_bulk_density")


def main() -> None:
    """Burn the case twice, first a little of it, and write when each cell caught fire."""
    case = dict(np.load(sys.argv[1]))
    burn(case, min(1.0, float(case["duration_min"])))  # what is only done once
    began = time.perf_counter()
    arrival_min = burn(case, float(case["duration_min"]))
    np.savez(Path(sys.argv[2]), wall_s=time.perf_counter() - began, arrival_min=arrival_min[::-1])


def burn(case: dict[str, np.ndarray], duration_min: float) -> np.ndarray:
    """Minutes (y, x) from the south, NaN where it has not burned.

    The weather does not change, so one band in time holds for all of it and nothing is read again;
    step, band width and length over width are pyretechnics' defaults.
    """
    rows, cols = case["fuel_model"].shape
    shape = (1, rows, cols)
    cell_m, band_min = float(case["cell_m"]), float(case["duration_min"]) + 1.0
    constants = dict.fromkeys(NO_TREES, 0.0) | {"foliar_moisture": 1.0}
    cubes = {name: SpaceTimeCube(shape, value) for name, value in constants.items()}
    for name, value in case.items():
        if name in RASTERS:
            raster = np.ascontiguousarray(value[::-1], dtype=np.float32)
            cubes[name] = SpaceTimeCube(shape, raster)
        elif name.startswith(("wind", "upwind", "fuel_moisture")):
            cubes[name] = SpaceTimeCube(shape, float(value))
    state = SpreadState(shape)
    row, col = (int(value) for value in case["ignition"])
    state.ignite_cell((rows - 1 - row, col))
    found = spread_fire_with_phi_field(
        cubes,
        state,
        cube_resolution=(band_min, cell_m, cell_m),
        start_time=0.0,
        max_duration=duration_min,
        use_wind_limit=False,
    )
    return np.array(found["spread_state"].get_full_matrices(["time_of_arrival"])["time_of_arrival"])


main()
