"""Read landscapes and arrival times from GeoTIFF, FARSITE .lcp, ESRI ASCII grid and .img."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Mask
from firemodel.errors import FireModelError
from firemodel.landscape import LAYERS
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.bands import (
    Band,
    Grid,
    band_of,
    cells_with,
    grid_of,
    grid_of_landscape,
    missing_in,
    refuse,
    values_of,
)
from firemodel.landscape.readers.layers import (
    BARE_GROUND,
    layers_of,
    level_ground,
    limits,
    to_gradient,
    to_layer,
    translated,
    unit_of,
    unit_problems,
    value_problems,
)
from firemodel.physics.fuels import FUEL_MODELS, FuelModel

Source = Path | tuple[Path, int]  # a file with one band, or a file and a band number from 1
Sources = Path | Mapping[str, Source]

MAX_ARRIVAL_S = 10 * 365.25 * 86400.0
MAX_SPREAD_M_S = 30.0  # faster than any fire
MIN_COMPARED = 100  # number of cells; fewer may correlate with the elevation by chance
MIN_CORRELATION = 0.999  # above this, the values are assumed to be the elevation
SECONDS = {"seconds": 1.0, "minutes": 60.0, "hours": 3600.0, "days": 86400.0}


def read_landscape(
    files: Sources,
    *,
    units: Mapping[str, str] | None = None,
    missing: Literal["refuse", "unburnable"] = "refuse",
    crs: str | None = None,
    nodata: float | None = None,
    fuel_codes: Mapping[int, int] | None = None,
    custom_fuels: Mapping[int, FuelModel] | None = None,
) -> Landscape:
    """Read a landscape from rasters that lie on the same north-up grid of square cells in metres.

    Fuel is required. The ground is given by elevation, by slope and aspect, or by all three. The
    canopy is optional. The gradient is computed from slope and aspect if they are given, else from
    the elevation.

    Args:
        files: One file whose band descriptions name the layers (an .lcp or a GeoTIFF). Otherwise a
            mapping from each layer to its file, or to (file, band from 1). The layers are fuel,
            elevation, slope, aspect, canopy_cover, canopy_height, canopy_base and
            canopy_bulk_density.
        units: The units of layers (``layers.UNITS``), instead of those in the files. If neither
            ``units`` nor the file contains the unit of a layer, elevation is in metres, aspect is
            in degrees clockwise from north, and slope and canopy are rejected.
        missing: With "refuse", cells without a value in a layer are rejected. With "unburnable",
            these cells become bare ground (99) without slope or trees, and a missing elevation
            becomes that of the nearest cell; a slope of more than 89.9 degrees is then a missing
            value. In both cases, a cell without an aspect is level ground if its slope is at most 5
            degrees.
        crs: The CRS of files that have none.
        nodata: A nodata value, in addition to those that the files declare.
        fuel_codes: Codes in the file, mapped to the codes that replace them. Code 0 is replaced by
            99 (bare ground) unless ``fuel_codes`` contains code 0.
        custom_fuels: Fuel models by code, in addition to or instead of the standard models.

    Returns:
        The landscape, with arrays (rows, columns).

    Raises:
        FireModelError: A file cannot be used; the message names file, band, cell and value.
    """
    if missing not in ("refuse", "unburnable"):
        raise FireModelError(f'missing = {missing!r} must be "refuse" or "unburnable"')
    bands = bands_for(files)
    grid = grid_of(bands["fuel"], crs)
    for band in bands.values():
        refuse(misfits(band, grid_of(band, crs), grid, str(bands["fuel"].path)))
    refuse(unit_problems(bands, units or {}))
    kinds = {layer: unit_of(layer, band, units or {}) for layer, band in bands.items()}

    fuels = FUEL_MODELS | dict(custom_fuels or {})
    layers: dict[str, NDArray[Any]] = {}
    incomplete: Mask = np.zeros(grid.shape, dtype=np.bool_)
    for layer, band in bands.items():
        values = values_of(band)
        without = missing_in(band, values, nodata)
        if layer == "aspect":
            values, without = level_ground(layers["slope"], values, without)
        if missing == "refuse":
            refuse(gaps(band, values, without))
        elif layer == "slope":
            without |= values > limits(layer, kinds[layer])[1]
        refuse(value_problems(layer, kinds[layer], band, values, without, fuels, fuel_codes or {}))
        if layer == "fuel":
            codes = translated(values, fuel_codes or {})
            layers[layer] = np.where(without, BARE_GROUND, codes).astype(np.int16)
        else:
            layers[layer] = to_layer(layer, kinds[layer], values, without)
        if layer == "elevation" and without.any():
            layers[layer] = _filled(band, layers[layer], without)
        incomplete |= without
    if incomplete.all():
        raise FireModelError(f"{bands['fuel'].path}: no cell has a value in every layer")
    _make_bare(layers, incomplete)
    gradient = None
    if "slope" in layers:
        gradient = to_gradient(layers.pop("slope"), layers.pop("aspect"))
    return Landscape(
        grid.crs,
        grid.west_m,
        grid.north_m,
        grid.cell_size_m,
        layers["fuel"],
        layers.get("elevation"),
        gradient,  # type: ignore[arg-type]  # None is filled in
        layers.get("canopy_cover"),
        layers.get("canopy_height"),
        layers.get("canopy_base"),
        layers.get("canopy_bulk_density"),
        dict(custom_fuels or {}),
    )


def _make_bare(layers: Mapping[str, NDArray[Any]], cells: Mask) -> None:
    """Set some cells of all layers to bare ground without slope or trees."""
    for layer, values in layers.items():
        if layer not in ("elevation", "aspect"):
            values[cells] = BARE_GROUND if layer == "fuel" else 0


def bands_for(files: Sources) -> dict[str, Band]:
    """Return each layer's band, in the order of ``LAYERS``.

    Raises FireModelError if a layer is unknown or a required layer is missing.
    """
    sources = layers_of(files) if isinstance(files, Path) else files
    where = str(files) if isinstance(files, Path) else "landscape"
    for layer in sources:
        if layer not in LAYERS:
            raise FireModelError(
                f"{where}: layer {layer!r} is unknown; the layers are {', '.join(LAYERS)}"
            )
    if "fuel" not in sources:
        raise FireModelError(f"{where}: the fuel layer is missing; add it")
    if ("slope" in sources) != ("aspect" in sources):
        raise FireModelError(
            f"{where}: only one of slope and aspect is specified; specify both, or only the "
            "elevation"
        )
    if "slope" not in sources and "elevation" not in sources:
        raise FireModelError(
            f"{where}: elevation, slope and aspect are missing; specify the elevation, or slope "
            "and aspect"
        )
    return {layer: band_of(sources[layer]) for layer in LAYERS if layer in sources}


def misfits(band: Band, grid: Grid, other: Grid, name: str) -> Iterator[str]:
    """Yield a problem if a band's grid differs from another file's grid."""
    differs = other.difference(grid)
    if differs:
        yield f"{band.path}: {differs} of {name}; resample both rasters to one grid"


def gaps(band: Band, values: NDArray[Any], without: Mask) -> Iterator[str]:
    """Yield a problem if a band has cells without a value."""
    if without.any():
        yield (
            f"{band.name}: cells without data: value {cells_with(without, values)}; fill or crop "
            'them, or read them as bare ground (missing = "unburnable")'
        )


def _filled(band: Band, heights_m: NDArray[Any], without: Mask) -> NDArray[Any]:
    """Fill missing cells of elevation (y, x) from the nearest cell with a value."""
    from scipy import ndimage

    if without.all():
        raise FireModelError(f"{band.name}: no cell has a value")
    nearest = ndimage.distance_transform_edt(without, return_distances=False, return_indices=True)
    return np.asarray(heights_m[tuple(nearest)])


def read_arrival(
    file: Source,
    landscape: Landscape,
    *,
    unit: Literal["seconds", "minutes", "hours", "days"] = "seconds",
    crs: str | None = None,
    nodata: float | None = None,
) -> NDArray[np.float64]:
    """Read a fire's arrival times (y, x) in seconds; infinity in unburned cells.

    The raster must lie on the landscape's grid; cells without a value are unburned. ``unit`` is the
    unit of the raster's values; ``crs`` and ``nodata`` are as in ``read_landscape``.

    Raises FireModelError; the message names file, cell and value.
    """
    if unit not in SECONDS:
        raise FireModelError(f"arrival: unit {unit!r} must be one of {', '.join(SECONDS)}")
    band = band_of(file)
    refuse(misfits(band, grid_of(band, crs), grid_of_landscape(landscape), "the landscape"))
    values = values_of(band)
    unburned = missing_in(band, values, nodata)
    bad = (values < 0) & ~unburned
    if bad.any():
        raise FireModelError(
            f"{band.name}: arrival is {cells_with(bad, values)}; it must be 0 or later: if the "
            "value means unburned, declare it as nodata"
        )
    if unburned.all():
        raise FireModelError(f"{band.name}: no cell has a value, so nothing burns; check the band")
    arrival_s: NDArray[np.float64] = values.astype(np.float64)
    arrival_s *= SECONDS[unit]
    arrival_s[unburned] = np.inf
    refuse(_arrival_problems(band, arrival_s, landscape))
    return arrival_s


def _arrival_problems(band: Band, arrival_s: NDArray[np.float64], land: Landscape) -> Iterator[str]:
    """Yield a problem if values (y, x) are probably not the arrival times of a fire in seconds."""
    burned = np.isfinite(arrival_s)
    late = burned & (arrival_s > MAX_ARRIVAL_S)
    if late.any():
        yield (
            f"{band.name}: arrival is {cells_with(late, arrival_s)} s, more than 10 years; check "
            "the band and arrival_unit, or declare the value as nodata"
        )
    if burned.all() and _follows(arrival_s, land.elevation_m):
        yield (
            f"{band.name}: the values are proportional to the elevation of the landscape; use a "
            "raster of arrival times"
        )
    rate_m_s = _median_spread_m_s(arrival_s, land.cell_size_m)
    if rate_m_s > MAX_SPREAD_M_S:
        yield (
            f"{band.name}: as arrival times, its values imply a fire that spreads at "
            f"{rate_m_s:.0f} m/s; check the band and arrival_unit"
        )


def _follows(values: NDArray[np.float64], heights_m: NDArray[np.float32] | None) -> bool:
    """Return True if values (y, x) are a linear function of heights."""
    if heights_m is None or values.size < MIN_COMPARED or not np.ptp(heights_m) * np.ptp(values):
        return False
    return float(np.corrcoef(values.ravel(), heights_m.ravel())[0, 1]) > MIN_CORRELATION


def _median_spread_m_s(arrival_s: NDArray[np.float64], cell_size_m: float) -> float:
    """Return the median rate of spread between cells with different times; 0 if there are none."""
    with np.errstate(invalid="ignore"):
        down, right = np.abs(np.diff(arrival_s, axis=0)), np.abs(np.diff(arrival_s, axis=1))
    slowest_s = np.fmax(down[:, :-1], right[:-1])
    slowest_s = slowest_s[np.isfinite(slowest_s) & (slowest_s > 0.0)]
    return cell_size_m / float(np.median(slowest_s)) if slowest_s.size else 0.0
