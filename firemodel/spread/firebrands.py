"""Let burning crowns light spot fires: firebrands fly with the wind, land and ignite fuel.

In each step the cells whose crowns have begun to burn emit firebrands. The number is random, with a
mean proportional to the area and the crown fraction burned. The distances are log-normal (Sardoy et
al. 2008), up to the maximum distance of an active crown fire (Albini et al. 2012). A firebrand
ignites burnable, unburned fuel with the probability of Schroeder (1969). All draws of a cell depend
only on the seed and on the cell, so that a fire does not depend on how it is advanced.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from firemodel.arrays import Floats
from firemodel.compiled import kernel
from firemodel.landscape.landscape import Landscape
from firemodel.physics import spotting
from firemodel.physics.weather import Weather
from firemodel.spread.local_spread import HEAT, Tables, Terrain, crowned_head, wind_at

STEP_S = 60.0  # firebrands are emitted at whole minutes
MIN_FLIGHT_M = 50.0  # the front reaches closer places as soon (Perryman et al. 2013)
ACROSS_SD_DEG = 5.0  # of flight directions around the wind direction


@dataclass(frozen=True, slots=True)
class Firebrands:
    """The settings and the seed of a fire's firebrands.

    ``per_ha`` is the mean number of firebrands that land burning on receptive fuel, for each
    hectare whose crowns burn completely. Cells that burned before ``from_s`` emit none. Spot fires
    begin ``delay_s`` after the firebrand lands.
    """

    per_ha: float
    air_temperature_c: float
    seed: int | tuple[int, ...]
    from_s: float
    delay_s: float = 0.0

    def spot_fires(
        self,
        landscape: Landscape,
        weather: Weather,
        arrival_s: Floats,
        span_s: tuple[float, float],
        spread: tuple[Terrain, Tables, int],
    ) -> list[tuple[int, int, float]]:
        """Return the row, column and time of each spot fire that results from a step.

        Args:
            landscape: The landscape.
            weather: The weather entry in effect.
            arrival_s: Arrival times (y, x) at the end of the step.
            span_s: Start and end of the step.
            spread: The fire's terrain, tables and weather entry (``local_spread``).
        """
        terrain, tables, entry = spread
        begin_s = max(span_s[0], self.from_s)
        cells = np.nonzero(((arrival_s > begin_s) & (arrival_s <= span_s[1])).ravel())[0]
        found: list[tuple[int, int, float]] = []
        if landscape.canopy_height_m is None:
            return found
        height_m = landscape.canopy_height_m.ravel()
        for cell in cells.tolist():
            wind = wind_at(cell, entry, terrain, tables)
            fraction, *flight = _flight(cell, entry, float(height_m[cell]), wind, terrain, tables)
            if fraction > 0.0:
                rng = np.random.default_rng((*np.atleast_1d(self.seed).tolist(), cell))
                for row, col, distance_m in self._landings(
                    landscape, cell, fraction, flight, wind, rng
                ):
                    if self._ignites(landscape, weather, arrival_s, (row, col), rng):
                        lands_s = float(arrival_s.ravel()[cell]) + distance_m / wind[0]
                        at_s = max(lands_s + self.delay_s, span_s[1])
                        found.append((row, col, at_s))
        return found

    def _landings(
        self,
        landscape: Landscape,
        cell: int,
        fraction: float,
        flight: list[float],
        wind: tuple[float, float, float],
        rng: np.random.Generator,
    ) -> list[tuple[int, int, float]]:
        """Return row, column and distance of each of a cell's firebrands that lands on the grid."""
        mu, sigma, max_m = flight
        size_m, (rows, cols) = landscape.cell_size_m, landscape.shape
        count = int(rng.poisson(self.per_ha * fraction * size_m**2 / 1e4))
        distances_m = np.exp(rng.normal(mu, sigma, count))
        turns = np.deg2rad(rng.normal(0.0, ACROSS_SD_DEG, count))
        north = wind[1] * np.cos(turns) - wind[2] * np.sin(turns)
        east = wind[2] * np.cos(turns) + wind[1] * np.sin(turns)
        to_row = np.rint(cell // cols - distances_m * north / size_m).astype(np.int64)
        to_col = np.rint(cell % cols + distances_m * east / size_m).astype(np.int64)
        lands = (distances_m >= MIN_FLIGHT_M) & (distances_m <= max_m)
        lands &= (to_row >= 0) & (to_row < rows) & (to_col >= 0) & (to_col < cols)
        return list(
            zip(
                to_row[lands].tolist(),
                to_col[lands].tolist(),
                distances_m[lands].tolist(),
                strict=True,
            )
        )

    def _ignites(
        self,
        landscape: Landscape,
        weather: Weather,
        arrival_s: Floats,
        place: tuple[int, int],
        rng: np.random.Generator,
    ) -> bool:
        """Return whether a firebrand ignites the fuel where it lands."""
        draw = float(rng.random())
        code = int(landscape.fuel_model[place])
        if code not in landscape.fuels or arrival_s[place] < math.inf:
            return False
        cover = landscape.canopy_cover
        shade = 0.0 if cover is None else float(cover[place])
        fuel_c = spotting.fuel_temperature_c(self.air_temperature_c, shade)
        zone = int(landscape.moisture_zones.of_cell[place]) if weather.of_zones else 0
        wet = weather.moisture_of(code, zone).dead_1h
        return draw < spotting.firebrand_ignition_probability(fuel_c, wet)


@kernel
def _flight(cell, entry, canopy_m, wind, terrain: Any, tables: Any):  # type: ignore[no-untyped-def]
    """Return a cell's crown fraction burned, and μ, σ and maximum of its firebrands' distances.

    The intensity is that of the head. Without wind, firebrands do not fly.
    """
    wind_m_s, _, _ = wind
    if wind_m_s <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    rate, _, _, _, fraction = crowned_head(cell, entry, terrain, tables)
    if fraction <= 0.0 or canopy_m <= 0.1:
        return 0.0, 0.0, 0.0, 0.0
    heat = tables.terms[entry, terrain.fuel[cell], HEAT]
    intensity_kw_m = rate * (heat + fraction * terrain.canopy.heat_kj_m2[cell])
    mu, sigma = spotting.firebrand_flights(
        intensity_kw_m, spotting.canopy_wind_m_s(canopy_m, wind_m_s)
    )
    return fraction, mu, sigma, spotting.crown_distance_m(canopy_m, intensity_kw_m, wind_m_s)
