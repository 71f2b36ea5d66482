"""Add the local winds of a landscape to the entries of a weather stream."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import WeatherStream
from firemodel.physics.wind_field import WindGrids, response_field
from firemodel.wind.terrain_wind import MapFunction, TerrainWind, terrain_wind
from firemodel.wind.vegetation import REFERENCE_M, surface_of

# A station with a smaller share of the reference wind is too sheltered to determine this wind.
MIN_RESPONSE = 0.05


def wind_of_landscape(landscape: Landscape, run: MapFunction = map) -> TerrainWind:
    """Return the solutions for a landscape (see ``terrain_wind``).

    Args:
        landscape: A landscape with elevation.
        run: Calls a function for each direction, like ``map``.

    Returns:
        The solutions, for winds 20 ft above the vegetation.

    Raises:
        FireModelError: The landscape has no elevation, or the solver does not converge.
    """
    if landscape.elevation_m is None:
        raise FireModelError(
            "wind over terrain: the landscape has no elevation; add the layer elevation"
        )
    surface = surface_of(landscape)
    return terrain_wind(landscape.elevation_m, landscape.cell_size_m, surface, run=run)


def relative_to_station(responses: NDArray[np.float32], row: int, col: int) -> NDArray[np.float32]:
    """Return responses (2, 2, y, x) to the wind in a station's cell instead of the free wind.

    Raises FireModelError for a station sheltered from the wind.
    """
    found = np.einsum("sr,rcyx->scyx", _free_per_local(responses, row, col), responses)
    return np.asarray(found, dtype=np.float32)


def free_wind(responses: NDArray[np.float32], row: int, col: int, local: Floats) -> Floats:
    """Return the free wind (2) that gives a local wind (2) in a cell, towards north and east.

    Args:
        responses: (2, 2, y, x) of ``TerrainWind.responses``.
        row: The row of the cell.
        col: The column of the cell.
        local: The wind in the cell.

    Returns:
        The free wind.

    Raises:
        FireModelError: The cell is sheltered from the wind.
    """
    found: Floats = local @ _free_per_local(responses, row, col)
    return found


def _free_per_local(responses: NDArray[np.float32], row: int, col: int) -> Floats:
    here = responses[:, :, row, col].astype(np.float64)
    if np.linalg.svd(here, compute_uv=False)[-1] < MIN_RESPONSE:
        raise FireModelError(
            f"wind over terrain: the station at row {row}, column {col} is sheltered from the "
            "wind; use a station in a less sheltered location, or none"
        )
    return np.linalg.inv(here).astype(np.float64)


def over_terrain(
    weather: WeatherStream, responses: WindGrids, landscape: Landscape
) -> WeatherStream:
    """Return a weather stream with winds that vary from place to place.

    Args:
        weather: The stream; its winds are those at the station of ``responses_of`` or, without a
            station, the free wind.
        responses: The local winds for a wind of 1 m/s (``responses_of``).
        landscape: The landscape; its grid north may differ from true north.

    Returns:
        The stream with a ``wind_field`` in each entry; all of them share ``responses``.
    """
    entries = [
        replace(
            entry,
            wind_field=response_field(responses, landscape.grid_deg(entry.wind_from_deg + 180.0)),
        )
        for entry in weather.entries
    ]
    return WeatherStream(entries, weather.source)


def responses_of(
    landscape: Landscape, station: tuple[int, int] | None = None, run: MapFunction = map
) -> WindGrids:
    """Return the responses of a landscape's terrain, 20 ft above the vegetation.

    Args:
        landscape: A landscape with elevation.
        station: The cell (row, column) in which winds are measured; without a station, winds are
            the free wind around the landscape.
        run: Calls a function for each direction, like ``map``.

    Returns:
        Two grids: the local wind for a wind of 1 m/s towards grid north, and towards grid east.

    Raises:
        FireModelError: As for ``wind_of_landscape``, or the station is sheltered from the wind.
    """
    found = wind_of_landscape(landscape, run).responses(REFERENCE_M)
    return WindGrids(found if station is None else relative_to_station(found, *station))
