"""Find the names and units of layers in files, and check and convert the layers' values."""

import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Mask
from firemodel.errors import FireModelError
from firemodel.landscape import LAYERS
from firemodel.landscape.landscape import (
    MAX_CANOPY_KG_M3,
    MAX_ELEVATION_M,
    MAX_SLOPE,
    MAX_TREE_M,
)
from firemodel.landscape.readers.bands import Band, bands_of, cells_with
from firemodel.landscape.readers.fuel_code_systems import NO_FUEL, advice_on, renamed_code
from firemodel.physics.fuels import FUEL_MODELS, FuelModel, check_codes

# The value of each unit in metres, as a fraction, or in kg/m³.
FACTORS = {
    "m": 1.0,
    "m*10": 0.1,
    "ft": 0.3048,
    "ft*10": 0.03048,
    "percent": 0.01,
    "fraction": 1.0,
    "kg/m3": 1.0,
    "kg/m3*100": 0.01,
    "lb/ft3": 16.018463,
    "lb/ft3*1000": 0.016018463,
}
_HEIGHTS = ("m", "m*10", "ft", "ft*10")
UNITS = {
    "fuel": (),
    "elevation": ("m", "ft"),
    "slope": ("degrees", "percent"),
    "aspect": ("degrees",),
    "canopy_cover": ("percent", "fraction", "class"),
    "canopy_height": _HEIGHTS,
    "canopy_base": _HEIGHTS,
    "canopy_bulk_density": ("kg/m3", "kg/m3*100", "lb/ft3", "lb/ft3*1000"),
}
# The units that all programs use for these layers; the units of other layers must be given.
USUAL_UNITS = {"elevation": "m", "aspect": "degrees"}
# A cell without an aspect is level ground up to this slope (rise over run; 5 degrees). Data often
# have no aspect on gentle slopes; LANDFIRE's data have no aspect below 2 degrees.
LEVEL_TAN = 0.0875
BARE_GROUND = 99
# Canopy cover at the midpoints of FARSITE's classes 0 to 4, which end at 0, 20, 50, 80 and 100 %.
COVER_OF_CLASS = np.array([0.0, 0.105, 0.355, 0.655, 0.905], dtype=np.float32)

_WRITTEN_UNITS = {
    "meters": "m",
    "metres": "m",
    "meter": "m",
    "metre": "m",
    "feet": "ft",
    "foot": "ft",
    "meters x 10": "m*10",
    "feet x 10": "ft*10",
    "kg/m3 x 100": "kg/m3*100",
    "kg/m^3": "kg/m3",
    "kg/m^3 x 100": "kg/m3*100",
    "lb/ft3 x 1000": "lb/ft3*1000",
    "lb/ft^3": "lb/ft3",
    "lb/ft^3 x 1000": "lb/ft3*1000",
    "%": "percent",
    "deg": "degrees",
    "degree": "degrees",
    "azimuth degrees": "degrees",
    "categories (0-4)": "class",
}
_DESCRIPTIONS = {"fuel models": "fuel", "fuel model": "fuel", "canopy base height": "canopy_base"}
# Each of LANDFIRE's layer names implies a unit (its data dictionary).
_LANDFIRE = {
    "f13": ("fuel", ""),
    "f40": ("fuel", ""),
    "fbfm13": ("fuel", ""),
    "fbfm40": ("fuel", ""),
    "elev": ("elevation", "m"),
    "dem": ("elevation", "m"),
    "slpd": ("slope", "degrees"),
    "slpp": ("slope", "percent"),
    "asp": ("aspect", "degrees"),
    "cc": ("canopy_cover", "percent"),
    "ch": ("canopy_height", "m*10"),
    "cbh": ("canopy_base", "m*10"),
    "cbd": ("canopy_bulk_density", "kg/m3*100"),
}
_LANDFIRE_NAME = re.compile(rf"(?:^|_)(?:\d{{3}})?({'|'.join(_LANDFIRE)})(?:_|$)")


def layer_of(description: str) -> tuple[str, str]:
    """Return the layer and the unit that a band's description names; either may be empty.

    The function recognises the names in .lcp files, this package's names, and LANDFIRE's layer
    names (``LC20_SlpD_220``), which imply a unit.
    """
    words = description.strip().lower()
    layer = _DESCRIPTIONS.get(words, words.replace(" ", "_"))
    if layer in LAYERS:
        return layer, ""
    found = _LANDFIRE_NAME.search(words.replace(" ", "_"))
    return _LANDFIRE[found[1]] if found else ("", "")


def layers_of(path: Path) -> dict[str, tuple[Path, int]]:
    """Return the (file, band) of each layer named by a band description in a file.

    Raises FireModelError if no description names a layer, or if two name the same layer.
    """
    bands = bands_of(path)
    found: dict[str, tuple[Path, int]] = {}
    for band in bands:
        layer, _ = layer_of(band.description)
        if layer in found:
            raise FireModelError(
                f"{path}: bands {found[layer][1]} and {band.number} are both {layer}; select one "
                f"by its band number ({layer} = {band.number}, ...)"
            )
        if layer:
            found[layer] = (path, band.number)
    if not found:
        raise FireModelError(
            f"{path}: no band's description names a layer ({', '.join(LAYERS)}); assign band "
            "numbers to the layers (fuel = 1, ...)"
        )
    return found


def unit_problems(layers: Collection[str], units: Mapping[str, str]) -> Iterator[str]:
    """Yield a problem for each unit whose layer is unknown, missing or without units."""
    for layer in units:
        if layer not in LAYERS:
            yield f"units: layer {layer!r} is unknown; the layers are {', '.join(LAYERS)}"
        elif layer not in layers:
            yield f"units: {layer} has a unit, but no band contains this layer; remove the unit"
        elif not UNITS[layer]:
            yield f"units: the layer {layer} is dimensionless; remove its unit"


def unit_of(layer: str, band: Band, given: Mapping[str, str]) -> str:
    """Return the unit of a layer: the given unit, the file's, or that in ``USUAL_UNITS``.

    Raises FireModelError if no unit is found, or if the unit is not one of ``UNITS``.
    """
    choices = UNITS[layer]
    if not choices:
        return ""
    written = given.get(layer) or band.unit or layer_of(band.description)[1]
    words = written.strip().lower()
    unit = _WRITTEN_UNITS.get(words, words) or USUAL_UNITS.get(layer, "")
    if unit in choices:
        return unit
    problem = (
        f"unit {written!r} of {layer} is unknown" if written else f"the unit of {layer} is unknown"
    )
    raise FireModelError(
        f"{band.name}: {problem}; specify it in `units` ({layer} = ...) as one of "
        f"{', '.join(choices)}"
    )


def limits(layer: str, unit: str) -> tuple[float, float]:
    """Return the lowest and the highest valid value, in the file's unit."""
    if unit == "degrees":
        return (-1.0, 360.0) if layer == "aspect" else (0.0, 89.9)
    if unit == "class":
        return 0.0, 4.0
    least, most = {
        "elevation": (-MAX_ELEVATION_M, MAX_ELEVATION_M),
        "slope": (0.0, MAX_SLOPE),
        "canopy_cover": (0.0, 1.0),
        "canopy_bulk_density": (0.0, MAX_CANOPY_KG_M3),
    }.get(layer, (0.0, MAX_TREE_M))
    return least / FACTORS[unit], most / FACTORS[unit]


def level_ground(
    slope_tan: NDArray[np.float32], values: NDArray[Any], missing: Mask
) -> tuple[NDArray[Any], Mask]:
    """Return an aspect (y, x) with -1 on level ground, and the cells that are still missing.

    A missing cell is level ground if its slope (rise over run) is at most ``LEVEL_TAN``.
    """
    level = missing & (slope_tan <= LEVEL_TAN)
    return np.where(level, np.int16(-1), values), missing & ~level


def translated(values: NDArray[Any], fuel_codes: Mapping[int, int]) -> NDArray[Any]:
    """Return fuel codes (y, x) after the replacements in ``fuel_codes``.

    Code 0 (no fuel, as in FARSITE) becomes bare ground, unless ``fuel_codes`` replaces it.
    """
    others = {NO_FUEL: BARE_GROUND} | dict(fuel_codes)
    found = values.astype(np.result_type(values, *map(np.min_scalar_type, others.values())))
    for code, other in others.items():
        found[values == code] = other
    return found


def value_problems(
    layer: str,
    unit: str,
    band: Band,
    values: NDArray[Any],
    missing: Mask,
    fuels: Mapping[int, FuelModel] = FUEL_MODELS,
    fuel_codes: Mapping[int, int] | None = None,
) -> Iterator[str]:
    """Yield the problems of a layer's values (y, x) in the file's unit, one line each.

    ``fuels`` are the fuel models that burn; ``fuel_codes`` replaces codes (``translated``).
    """
    if layer == "fuel":
        yield from _fuel_problems(band, values, missing, fuels, fuel_codes or {})
        return
    least, most = limits(layer, unit)
    bad = (values < least) | (values > most)
    if unit == "class":
        bad |= values != np.round(values)
    bad &= ~missing
    if bad.any():
        bare = 'read these cells as bare ground (missing = "unburnable"), ' * (layer == "slope")
        yield (
            f"{band.name}: {layer} is {cells_with(bad, values)}; in {unit} it must be from "
            f"{least:g} to {most:g}: correct it, declare it as nodata, {bare}or specify another "
            "unit"
        )


def _fuel_problems(
    band: Band,
    values: NDArray[Any],
    missing: Mask,
    fuels: Mapping[int, FuelModel],
    fuel_codes: Mapping[int, int],
) -> Iterator[str]:
    if int(band.tags.get("FUEL_MODEL_OPTION", 0)) >= 2:
        yield (
            f"{band.name}: its header requires a conversion file for its fuel codes; store the "
            "converted codes"
        )
    if np.issubdtype(values.dtype, np.floating):
        broken = (values != np.round(values)) & ~missing
        if broken.any():
            yield (
                f"{band.name}: fuel code {cells_with(broken, values)} is not a whole number; "
                "resample the fuel layer with the nearest-neighbour method"
            )
            return
    codes = {int(code) for code in np.unique(values[~missing])}
    other = renamed_code(band.path, codes - {*fuel_codes}, fuels)
    if other:
        yield other
        return
    found = translated(values, fuel_codes)
    try:
        check_codes(np.where(missing, values.dtype.type(BARE_GROUND), found), band.name, fuels)
    except FireModelError as error:
        left = {int(code) for code in np.unique(found[~missing])}
        yield f"{error}; {advice_on(left, fuels)}"


def to_layer(layer: str, unit: str, values: NDArray[Any], missing: Mask) -> NDArray[np.float32]:
    """Convert a file's values (y, x) to metres, degrees or fractions; missing values become 0.

    Slope in any unit becomes rise over run.
    """
    present = np.where(missing, 0, values)  # a nodata value may be too large for float32
    if unit == "class":
        return COVER_OF_CLASS[present.astype(np.int8)]
    found = present.astype(np.float32)
    if layer == "slope" and unit == "degrees":
        np.tan(np.deg2rad(found, out=found), out=found)
    elif unit in FACTORS:
        found *= np.float32(FACTORS[unit])
    return found


def to_gradient(
    slope_tan: NDArray[np.float32], aspect_deg: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Compute the rise per metre (2, y, x) towards north and east from slope and aspect (y, x).

    Aspect is the direction in which the ground falls, in degrees clockwise from north; as in
    LANDFIRE, -1 means level ground.
    """
    gradient = np.empty((2, *slope_tan.shape), dtype=np.float32)
    falls = np.deg2rad(aspect_deg)
    np.multiply(-slope_tan, np.cos(falls), out=gradient[0])
    np.multiply(-slope_tan, np.sin(falls), out=gradient[1])
    gradient[:, aspect_deg < 0.0] = 0.0
    return gradient
