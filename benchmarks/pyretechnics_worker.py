"""Run pyretechnics for two benchmarks, in its own environment without firemodel.

    python pyretechnics_worker.py case.npz answer.npz

With a duration the worker simulates one fire, otherwise it computes the highest spread rate of each
cell. It reverses the order of rows of inputs and outputs, because pyretechnics counts rows from the
south.
"""

import sys
import time
from typing import Any

import numpy as np
from pyretechnics.burn_cells import (  # type: ignore[import-not-found]
    burn_all_cells_as_head_fire,
)
from pyretechnics.eulerian_level_set import (  # type: ignore[import-not-found]
    SpreadState,
    spread_fire_with_phi_field,
)
from pyretechnics.space_time_cube import SpaceTimeCube  # type: ignore[import-not-found]

RASTERS = ("slope", "aspect", "fuel_model")
NUMBERS = ("wind", "upwind", "fuel_moisture")  # first parts of the names
NO_TREES = ("canopy_cover", "canopy_height", "canopy_base_height", "canopy_bulk_density")

Case = dict[str, Any]


def main() -> None:
    """Compute the answer of a case; a short first run of a fire is not timed."""
    case: Case = dict(np.load(sys.argv[1]))
    if "duration_min" not in case:
        found = burn_all_cells_as_head_fire(cubes(case), 0, use_wind_limit=False)
        np.savez(sys.argv[2], rate_m_min=found["spread_rate"][::-1])
        return
    burn(case, min(1.0, float(case["duration_min"])))  # one-time initialisation
    began = time.perf_counter()
    arrival_min = burn(case, float(case["duration_min"]))
    np.savez(sys.argv[2], wall_s=time.perf_counter() - began, arrival_min=arrival_min[::-1])


def cubes(case: Case) -> dict[str, Any]:
    """Return the inputs of a case, with one band of time because the weather is constant."""
    shape = (1, *case["fuel_model"].shape)
    constants = dict.fromkeys(NO_TREES, 0.0) | {"foliar_moisture": 1.0}
    found = {name: SpaceTimeCube(shape, value) for name, value in constants.items()}
    for name, value in case.items():
        if name in RASTERS:
            raster = np.ascontiguousarray(value[::-1], dtype=np.float32)
            found[name] = SpaceTimeCube(shape, raster)
        elif name.startswith(NUMBERS):
            found[name] = SpaceTimeCube(shape, float(value))
    return found


def burn(case: Case, duration_min: float) -> Any:
    """Simulate a fire; return arrival times in minutes (y, x) from the south, NaN where unburned.

    Time step, width of the band and length-to-width ratio are pyretechnics' defaults.
    """
    rows, cols = case["fuel_model"].shape
    cell_m, band_min = float(case["cell_m"]), float(case["duration_min"]) + 1.0
    state = SpreadState((1, rows, cols))
    row, col = (int(value) for value in case["ignition"])
    state.ignite_cell((rows - 1 - row, col))
    found = spread_fire_with_phi_field(
        cubes(case),
        state,
        cube_resolution=(band_min, cell_m, cell_m),
        start_time=0.0,
        max_duration=duration_min,
        use_wind_limit=False,
    )
    return found["spread_state"].get_full_matrices(["time_of_arrival"])["time_of_arrival"]


if __name__ == "__main__":
    main()
