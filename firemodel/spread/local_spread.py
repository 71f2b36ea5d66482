"""Compute the spread ellipse in every cell: rate and direction of the head, eccentricity.

The equations are those of ``rothermel`` and ``crown_fire``, compiled. The terms of each fuel are
computed by ``rothermel.fuel_bed`` once for each weather entry; only the effects of wind, slope and
crowns are computed for each cell.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.compiled import inlined, kernel
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import ROWS_AT_ONCE, Landscape, turned
from firemodel.physics import rothermel
from firemodel.physics.crown_fire import METHODS, NO_CROWNS, SCOTT_REINHARDT
from firemodel.physics.rothermel import FT_MIN_PER_M_S, fireline_intensity_kw_m, fuel_bed
from firemodel.physics.weather import Weather, crown_ratio_from_base, wind_adjustment_factor
from firemodel.physics.wind_field import MAX_GRIDS_OF_FIELD, WindGrids
from firemodel.spread.crown_spread import (
    NO_CANOPY,
    Canopy,
    canopy_of,
    crown_factor,
    crown_length_to_width,
    crowning_wind_of,
    with_crowns,
)
from firemodel.spread.rate_options import SURFACE_ONLY, RateOptions

HEAT, CROWN = 6, 7  # indices in ``Tables.terms``
NO_FACTOR = np.ones(1, dtype=np.float32)
ONE_FUEL = np.zeros(1, dtype=np.int64)
NO_GRIDS = np.empty((0, 2, 1), dtype=np.float32)
FIRST_GRID = 3  # index of the first grid in ``Tables.wind``
MAX_FACTOR = 1e6  # limit of the factors of wind and spread rate

_length_to_breadth = kernel(rothermel.length_to_breadth)
_eccentricity = kernel(rothermel.eccentricity)


class Terrain(NamedTuple):
    """The inputs of a cell's spread that do not change with time; cells are flattened (n)."""

    fuel: NDArray[np.int16]  # (n) index of the fuel bed in the tables; -1 if it does not burn
    gradient: NDArray[np.float32]  # (2, n) rise per metre towards north and east
    midflame: NDArray[np.float32]  # (n) ratio of midflame wind to wind 20 ft above vegetation
    rate_factor: NDArray[np.float32]  # (n) factor of the spread rate; (1) if it is 1 everywhere
    canopy: Canopy  # arrays (n); (1) without crown fire
    wind_grids: NDArray[np.float32] = NO_GRIDS  # (grids, 2, n) of the entries' wind fields


class Tables(NamedTuple):
    """The spread inputs for each weather entry."""

    # (entries, fuel beds, 8): R0 m/s, B, C for wind in m/s, K, largest φ_s, largest φ, intensity
    # (kW/m) at a rate of 1 m/s, the crown's factor (``crown_factor``)
    terms: Floats
    # (entries, 3): m/s at 20 ft, unit vector toward which it blows (grid north, east). With grids
    # (entries, 9): then, for each of two grids, its index and complex factor; the first index is -1
    # if the entry's wind is the same everywhere.
    wind: Floats
    crown_method: int = NO_CROWNS
    fuel_of_bed: NDArray[np.int64] = ONE_FUEL  # (fuel beds) index in ``Landscape.burnable_codes``


class FuelBeds(NamedTuple):
    """The combinations of fuel and moisture zone on a landscape, in ascending order.

    Without zone moistures, each fuel is one bed.
    """

    fuel: NDArray[np.int64]  # (beds) index of the fuel in ``Landscape.burnable_codes``
    zone: NDArray[np.int64]  # (beds) index of the moisture zone; 0 without zones
    of_cell: NDArray[np.int16]  # (n) index of each cell's bed; -1 if the cell does not burn


def fuel_beds(landscape: Landscape, entries: Sequence[Weather]) -> FuelBeds:
    """Return the fuel beds of a landscape in the given weather.

    Raises FireModelError if the weather has moistures for the zones of another landscape.
    """
    codes = landscape.burnable_codes
    place = np.full(int(landscape.fuel_model.max()) + 1, -1, dtype=np.int16)
    place[list(codes)] = np.arange(len(codes))
    fuel = place[landscape.fuel_model.ravel()]
    if not entries[0].of_zones:
        return FuelBeds(np.arange(len(codes)), np.zeros(len(codes), dtype=np.int64), fuel)
    zones, given = landscape.moisture_zones, len(entries[0].of_zones)
    if given != zones.cover.size:
        raise FireModelError(
            f"weather: has moistures for {given} zones, but the landscape has {zones.cover.size}; "
            "read the weather with this landscape"
        )
    burns = fuel >= 0
    beds, of_cell = np.unique(
        fuel[burns].astype(np.int64) * given + zones.of_cell.ravel()[burns], return_inverse=True
    )
    fuel[burns] = of_cell
    return FuelBeds(*np.divmod(beds, given), fuel)


def terrain_of(
    landscape: Landscape, entries: Sequence[Weather], options: RateOptions = SURFACE_ONLY
) -> Terrain:
    """Return the flattened cells of a landscape, with the fuel beds in the given weather.

    Raises FireModelError if crown fire is enabled and the landscape has no canopy layers.
    """
    midflame = _midflame(landscape).ravel()
    canopy = NO_CANOPY
    if options.crown != "none":
        canopy = canopy_of(landscape, options.foliar_moisture_pct)
    beds = fuel_beds(landscape, entries).of_cell
    grids = _grids_of(landscape, entries)[0]
    return Terrain(beds, landscape.gradient.reshape(2, -1), midflame, NO_FACTOR, canopy, grids)


def window_of(terrain: Terrain, shape: tuple[int, int], here: tuple[slice, slice]) -> Terrain:
    """Return the cells in a window of a landscape with ``shape``, flattened."""

    def cut(layer: NDArray[np.generic]) -> Any:
        return layer if layer.size == 1 else layer.reshape(shape)[here].ravel()

    return Terrain(
        cut(terrain.fuel),
        terrain.gradient.reshape(2, *shape)[:, *here].reshape(2, -1),
        cut(terrain.midflame),
        cut(terrain.rate_factor),
        Canopy(*map(cut, terrain.canopy)),
        _window_of_grids(terrain.wind_grids, shape, here),
    )


def _window_of_grids(
    grids: NDArray[np.float32], shape: tuple[int, int], here: tuple[slice, slice]
) -> NDArray[np.float32]:
    if not len(grids):
        return grids
    cut = grids.reshape(len(grids), 2, *shape)[:, :, *here]
    return np.ascontiguousarray(cut).reshape(len(grids), 2, -1)


def _grids_of(
    landscape: Landscape, entries: Sequence[Weather]
) -> tuple[NDArray[np.float32], dict[int, int]]:
    """Return the grids of all wind fields (grids, 2, n), and the index of each ``WindGrids``.

    The indices are keyed by the identity of the object. Grids are copied only if there are several
    objects.

    Raises FireModelError for a field of another landscape.
    """
    found: dict[int, WindGrids] = {}
    for field in (entry.wind_field for entry in entries if entry.wind_field is not None):
        found[id(field.grids)] = field.grids
        if field.grid_shape != landscape.shape:
            raise FireModelError(
                f"weather: has a wind field of {field.grid_shape} cells, but the landscape has "
                f"{landscape.shape}; read the wind with this landscape"
            )
    if len(found) <= 1:
        return next((each.cells for each in found.values()), NO_GRIDS), dict.fromkeys(found, 0)
    counts = [len(each.cells) for each in found.values()]
    places = dict(zip(found, np.cumsum([0, *counts]).tolist(), strict=False))
    return np.concatenate([each.cells for each in found.values()]), places


def _midflame(landscape: Landscape) -> NDArray[np.float32]:
    """Return the ratio (y, x) of midflame wind to wind at 20 ft, including sheltering by trees."""
    depth_ft = np.zeros(int(landscape.fuel_model.max()) + 1)
    for code in landscape.burnable_codes:
        depth_ft[code] = landscape.fuels[code].depth_ft
    cover, height_m = landscape.canopy_cover, landscape.canopy_height_m
    if cover is None or height_m is None:
        factor = np.asarray(wind_adjustment_factor(depth_ft)).astype(np.float32)
        return np.asarray(factor[landscape.fuel_model])
    base_m = np.zeros(1, np.float32) if landscape.canopy_base_m is None else landscape.canopy_base_m
    base_m = np.broadcast_to(base_m, landscape.shape)
    found = np.empty(landscape.shape, dtype=np.float32)
    for top in range(0, landscape.shape[0], ROWS_AT_ONCE):  # computed in blocks to save memory
        rows = slice(top, top + ROWS_AT_ONCE)
        ratio = crown_ratio_from_base(height_m[rows], base_m[rows])
        depths = depth_ft[landscape.fuel_model[rows]]
        found[rows] = np.asarray(wind_adjustment_factor(depths, cover[rows], height_m[rows], ratio))
    return found


def tables_of(
    landscape: Landscape, entries: Sequence[Weather], options: RateOptions = SURFACE_ONLY
) -> Tables:
    """Return the terms of the landscape's fuels for each weather entry.

    Wind directions are converted from true north to grid north.
    """
    beds = fuel_beds(landscape, entries)
    terms = terms_of(landscape, beds, entries, options)
    return Tables(terms, _winds(landscape, entries), METHODS[options.crown], beds.fuel)


def terms_of(
    landscape: Landscape, beds: FuelBeds, entries: Sequence[Weather], options: RateOptions
) -> Floats:
    """Return ``Tables.terms`` of the fuel beds of a landscape."""
    terms = np.empty((len(entries), beds.fuel.size, 8))
    for number, entry in enumerate(entries):
        zones = range(max(len(entry.of_zones), 1))
        crowns = np.array([crown_factor(options.crown, entry, zone) for zone in zones])
        terms[number, :, CROWN] = crowns[beds.zone]
        for place, (fuel, zone) in enumerate(zip(beds.fuel, beds.zone, strict=True)):
            code = landscape.burnable_codes[fuel]
            bed = fuel_bed(landscape.fuels[code], entry.moisture_of(code, zone))
            limit_ft_min = rothermel.wind_limit_ft_min(bed.reaction_intensity_btu_ft2_min)
            terms[number, place, :CROWN] = (
                bed.no_wind_rate_ft_min / FT_MIN_PER_M_S,
                bed.wind_b,
                bed.wind_c * FT_MIN_PER_M_S**bed.wind_b,
                bed.slope_k,
                limit_ft_min,
                rothermel.wind_factor(bed, limit_ft_min) if options.wind_limit else math.inf,
                fireline_intensity_kw_m(bed, 1.0),
            )
    return terms


def _winds(landscape: Landscape, entries: Sequence[Weather]) -> Floats:
    """Return ``Tables.wind``."""
    _, places = _grids_of(landscape, entries)
    found = np.zeros((len(entries), FIRST_GRID + 3 * MAX_GRIDS_OF_FIELD if places else FIRST_GRID))
    found[:, FIRST_GRID:] = -1.0
    for number, entry in enumerate(entries):
        toward = math.radians(landscape.grid_deg(entry.wind_from_deg + 180.0))
        found[number, :FIRST_GRID] = entry.wind_speed_m_s, math.cos(toward), math.sin(toward)
        if entry.wind_field is not None:
            first = places[id(entry.wind_field.grids)]
            parts = [(first + grid, each.real, each.imag) for grid, each in entry.wind_field.parts]
            found[number, FIRST_GRID : FIRST_GRID + 3 * len(parts)] = np.ravel(parts)
    return found


def perturbed(
    tables: Tables,
    entry: int,
    wind_factor: float | Floats,
    turn_deg: float | Floats,
    spread_factor: float | Floats,
) -> Tables:
    """Return tables with one entry split into two parts and the second part changed.

    All later entries are changed too. In the changed entries the wind speed is multiplied by
    ``wind_factor``, and the wind direction is turned clockwise by ``turn_deg``: numbers, or one
    number for each changed entry. The spread rate is multiplied by ``spread_factor``: a number, or
    an array. Its last axis is ``Landscape.burnable_codes`` or the fuel beds; its first axis, if
    there are two, is the changed entries. An array with three axes (changed entries, fuel beds,
    8) contains a factor for each of ``Tables.terms``. Raises FireModelError for a factor that is
    not from 0 to ``MAX_FACTOR``, or a turn that is not a finite number.
    """
    factors = np.append(spread_factor, wind_factor)
    if not (np.all((factors >= 0.0) & (factors <= MAX_FACTOR)) and np.isfinite(turn_deg).all()):
        raise FireModelError(
            f"perturb: wind_factor = {wind_factor}, turn_deg = {turn_deg}, spread_factor = "
            f"{spread_factor}: factors must be 0 to {MAX_FACTOR:g}, the angle in degrees finite"
        )
    terms = np.concatenate([tables.terms[: entry + 1], tables.terms[entry:]])
    wind = np.concatenate([tables.wind[: entry + 1], tables.wind[entry:]])
    terms[entry + 1 :] *= _term_factors(np.asarray(spread_factor), tables)
    speed, north, east = tables.wind[entry:, :FIRST_GRID].T
    turns_deg = np.broadcast_to(turn_deg, speed.shape).tolist()
    toward = [turned(*each) for each in zip(north, east, turns_deg, strict=True)]
    wind[entry + 1 :, :FIRST_GRID] = np.column_stack([speed * wind_factor, toward])
    return tables._replace(terms=terms, wind=wind)


def _term_factors(spread_factor: Floats, tables: Tables) -> Floats:
    """Return factors of ``Tables.terms`` from the argument ``spread_factor`` of ``perturbed``."""
    if spread_factor.ndim == 3:
        return spread_factor
    if spread_factor.ndim > 0 and spread_factor.shape[-1] != tables.fuel_of_bed.size:
        spread_factor = spread_factor[..., tables.fuel_of_bed]
    found = np.ones((*spread_factor.shape, tables.terms.shape[-1]))
    found[..., 0] = found[..., CROWN] = spread_factor
    return found


@kernel
def wind_at(cell, entry, terrain, tables):  # type: ignore[no-untyped-def]
    """Return the wind in a cell: m/s at 20 ft, and the unit vector toward which it blows."""
    wind, grids = tables.wind, terrain.wind_grids
    speed, north, east = wind[entry, 0], wind[entry, 1], wind[entry, 2]
    if grids.shape[0] == 0 or wind[entry, FIRST_GRID] < 0.0:
        return speed, north, east
    real = imaginary = 0.0
    for place in range(FIRST_GRID, FIRST_GRID + 3 * MAX_GRIDS_OF_FIELD, 3):
        grid = int(wind[entry, place])
        if grid >= 0:
            to_north, to_east = np.float64(grids[grid, 0, cell]), np.float64(grids[grid, 1, cell])
            a, b = wind[entry, place + 1], wind[entry, place + 2]
            real += a * to_north - b * to_east
            imaginary += a * to_east + b * to_north
    ratio = math.sqrt(real * real + imaginary * imaginary)
    if ratio == 0.0:
        return 0.0, north, east
    real, imaginary = real / ratio, imaginary / ratio
    return speed * ratio, north * real - east * imaginary, east * real + north * imaginary


@kernel
def surface_head(cell, entry, wind, terrain, tables):  # type: ignore[no-untyped-def]
    """Return the fastest spread of the surface fire in a cell, and the eccentricity of the ellipse.

    ``wind`` is the wind as returned by ``wind_at``. The result is the rate in m/s along the slope,
    the unit vector (north, east) of the direction of spread, and the eccentricity. Wind and slope
    are added as vectors (``rothermel.fastest_spread``).
    """
    wind_m_s, wind_north, wind_east = wind
    terms, fuel = tables.terms, terrain.fuel[cell]
    b, c = terms[entry, fuel, 1], terms[entry, fuel, 2]
    rise_north = np.float64(terrain.gradient[0, cell])
    rise_east = np.float64(terrain.gradient[1, cell])
    slope = math.sqrt(rise_north * rise_north + rise_east * rise_east)
    midflame_m_s = wind_m_s * terrain.midflame[cell]
    by_wind = c * midflame_m_s**b if midflame_m_s > 0.0 else 0.0
    north = by_wind * wind_north
    east = by_wind * wind_east
    if slope > 0.0:
        by_slope = min(terms[entry, fuel, 3] * slope * slope, terms[entry, fuel, 4])
        north += by_slope * rise_north / slope
        east += by_slope * rise_east / slope
    factor = math.sqrt(north * north + east * east)
    rate_factor = terrain.rate_factor
    rate = terms[entry, fuel, 0] * rate_factor[cell if rate_factor.size > 1 else 0]
    if factor == 0.0 or rate == 0.0:
        return rate, 1.0, 0.0, 0.0
    north, east = north / factor, east / factor
    factor = min(factor, terms[entry, fuel, 5])
    effective_m_s = (factor / c) ** (1.0 / b)
    e = _eccentricity(_length_to_breadth(effective_m_s))
    return rate * (1.0 + factor), north, east, e


@kernel
def crowned_head(cell, entry, terrain, tables):  # type: ignore[no-untyped-def]
    """Return the fastest spread in a cell as ``surface_head`` does, and the crown fraction burned.

    Whether crowns burn depends on the intensity of the surface fire at its head. The front moves
    with the faster of surface and crown fire.
    """
    wind_m_s, wind_north, wind_east = wind_at(cell, entry, terrain, tables)
    wind = wind_m_s, wind_north, wind_east
    rate, north, east, e = surface_head(cell, entry, wind, terrain, tables)
    if tables.crown_method == NO_CROWNS:
        return rate, north, east, e, 0.0
    fuel, rate_factor = terrain.fuel[cell], terrain.rate_factor
    heat = tables.terms[entry, fuel, HEAT]
    critical_kw_m = terrain.canopy.critical_kw_m[cell]
    if rate <= 0.0 or rate * heat < critical_kw_m:
        return rate, north, east, e, 0.0
    factor = tables.terms[entry, fuel, CROWN] * rate_factor[cell if rate_factor.size > 1 else 0]
    density_kg_m3 = terrain.canopy.density_kg_m3[cell]
    full_m_s = 0.0
    if tables.crown_method == SCOTT_REINHARDT:
        crowning_wind = crowning_wind_of(factor, density_kg_m3), wind_north, wind_east
        full_m_s, _, _, _ = surface_head(cell, entry, crowning_wind, terrain, tables)
    crown, fraction, active = with_crowns(
        tables.crown_method,
        rate,
        critical_kw_m / heat,
        full_m_s,
        factor,
        wind_m_s,
        density_kg_m3,
    )
    if active:
        e = max(e, _eccentricity(crown_length_to_width(wind_m_s)))
    return max(rate, crown), north, east, e, fraction


@kernel
def head_of(cell, entry, terrain, tables):  # type: ignore[no-untyped-def]
    """Return the first four results of ``crowned_head``."""
    rate, north, east, e, _ = crowned_head(cell, entry, terrain, tables)
    return rate, north, east, e


@inlined
def same_conditions(cell, other, terrain):  # type: ignore[no-untyped-def]
    """Return True if fire spreads identically in two cells in any weather."""
    fuel, gradient, midflame, rate_factor, canopy, wind_grids = terrain
    same = (
        fuel[cell] == fuel[other]
        and gradient[0, cell] == gradient[0, other]
        and gradient[1, cell] == gradient[1, other]
        and midflame[cell] == midflame[other]
    )
    if same and rate_factor.size > 1:
        same = rate_factor[cell] == rate_factor[other]
    if same and canopy.critical_kw_m.size > 1:
        same = (
            canopy.critical_kw_m[cell] == canopy.critical_kw_m[other]
            and canopy.density_kg_m3[cell] == canopy.density_kg_m3[other]
        )
    for grid in range(wind_grids.shape[0]):
        for part in range(2):
            same = same and wind_grids[grid, part, cell] == wind_grids[grid, part, other]
    return same


@kernel
def slowness_of(cell, entry, terrain, tables):  # type: ignore[no-untyped-def]
    """Return A and the vector B (north, east) in s/m: the time along a vector v is A |v| - B v.

    v is horizontal; |v| is the length of v on the sloping plane. In that plane, an ellipse with the
    ignition at a focus gives A = 1/(R (1 - e)) and a vector B of length e A towards the fastest
    spread R. The result contains the horizontal projection of B. Where fire does not spread, A is
    infinite and B is 0.
    """
    if terrain.fuel[cell] < 0:
        return np.inf, 0.0, 0.0
    rate, to_north, to_east, e = head_of(cell, entry, terrain, tables)
    if rate <= 0.0:
        return np.inf, 0.0, 0.0
    rise_north = np.float64(terrain.gradient[0, cell])
    rise_east = np.float64(terrain.gradient[1, cell])
    a = 1.0 / (rate * (1.0 - e))
    up = rise_north * to_north + rise_east * to_east
    b = e * a / math.sqrt(1.0 + up * up)
    return a, b * (to_north + up * rise_north), b * (to_east + up * rise_east)
