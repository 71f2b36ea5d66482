"""Describe the contents of a file of rasters or shapes, and list its problems."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import Transformer
from shapely.geometry.base import BaseGeometry

from firemodel.errors import FireModelError
from firemodel.landscape import LAYERS
from firemodel.landscape.ground_info import ground_notes
from firemodel.landscape.landscape import Landscape, crs_label
from firemodel.landscape.readers.bands import (
    Band,
    band_of,
    bands_of,
    cells_with,
    grid_of,
    grid_problems,
    missing_in,
    values_of,
)
from firemodel.landscape.readers.fuel_code_systems import NO_FUEL, renamed_code
from firemodel.landscape.readers.layers import (
    LEVEL_TAN,
    layer_of,
    level_ground,
    to_layer,
    unit_of,
    unit_problems,
    value_problems,
)
from firemodel.landscape.readers.rasters import Sources, bands_for, gaps, misfits
from firemodel.landscape.readers.shapes import (
    crs_problems,
    features_of,
    into_crs,
    place_problems,
    shape_problems,
)
from firemodel.landscape.table_info import describe_table
from firemodel.physics.fuels import FUEL_MODELS, NON_BURNABLE

Description = dict[str, Any]

USUAL_NODATA = (-9999, -32768)
REAL = "iuf"  # the kinds of NumPy's real numeric types
MAX_CODES = 200  # a band with more distinct values is not a band of fuel codes


def describe(path: Path, *, crs: str | None = None, nodata: float | None = None) -> Description:
    """Describe a file with the function for its format.

    The functions are ``describe_table``, ``describe_rasters`` and ``describe_shapes``.
    """
    table = describe_table(path)
    if table is not None:
        return table
    try:
        bands_of(path)
    except FireModelError as not_raster:
        try:
            features_of(path)
        except FireModelError as not_shapes:
            problems = dict.fromkeys([str(not_raster), str(not_shapes)])
            return {"file": str(path), "kind": "unknown", "problems": list(problems)}
        return describe_shapes(path, crs=crs)
    return describe_rasters(path, crs=crs, nodata=nodata)


def describe_rasters(
    files: Sources,
    *,
    units: Mapping[str, str] | None = None,
    crs: str | None = None,
    nodata: float | None = None,
) -> Description:
    """Describe the rasters of a landscape, which are in one or several files.

    The arguments are those of ``read_landscape``. The result has the keys ``file`` and ``kind``.
    The keys ``crs``, ``rows``, ``cols``, ``cell_size`` (in the CRS's unit) and ``extent`` (south,
    west, north, east in degrees) describe the first band. Each entry of ``bands`` has file, number,
    layer, dtype, unit, nodata, least, most and no_data_cells. A band of fuel codes also has
    ``fuels`` (code, name, percent of the cells with a value) and non_burnable_pct. ``problems`` has
    one line for each reason why ``read_landscape`` would reject the files. ``notes`` has one line
    for each value that is probably unintended, and lines about data that a run ignores.
    """
    problems: list[str] = []
    pairs = _layers_and_bands(files, problems)
    found: Description = {"file": _name(files), "kind": "raster"}
    if pairs:
        found |= _place_of(pairs[0][1], crs)
    problems += _grid_problems([band for _, band in pairs], crs)
    problems += unit_problems([layer for layer, _ in pairs], units or {})
    ground = _ground(pairs, units or {}, nodata)
    found["bands"] = [
        _band_in_words(layer, band, units or {}, nodata, ground, problems) for layer, band in pairs
    ]
    found["notes"] = [note for band in found["bands"] for note in band.pop("notes", ())]
    found["notes"] += [
        *_ignored(pairs),
        *_fuel_notes(found["bands"]),
        *_ground_notes(pairs, ground),
    ]
    return {**found, "problems": list(dict.fromkeys(problems))}


def _ground(
    pairs: list[tuple[str, Band]], units: Mapping[str, str], nodata: float | None
) -> dict[str, NDArray[Any]]:
    """Return slope (rise over run), aspect (degrees) and elevation (m), if they are valid.

    Invalid layers are left out. The arrays (y, x) must have the same shape; otherwise the result is
    empty.
    """
    found: dict[str, NDArray[Any]] = {}
    for layer, band in pairs:
        if layer not in ("elevation", "slope", "aspect"):
            continue
        ignored: list[str] = []
        unit = _kept(ignored, unit_of, layer, band, units)
        values = _kept(ignored, values_of, band)
        if unit is not None and values is not None:
            missing = missing_in(band, values, nodata)
            found[layer] = to_layer(layer, unit, values, missing)
            if layer == "aspect":
                found[layer][missing] = -1.0
    if len({layer.shape for layer in found.values()}) > 1:
        return {}
    return found


def _ignored(pairs: list[tuple[str, Band]]) -> Iterator[str]:
    """Yield a note on each band that is not a layer, if other bands are layers."""
    if not any(layer for layer, _ in pairs):
        return
    for layer, band in pairs:
        if not layer:
            what = band.description or band.unit or "without a name"
            yield f"{band.name}: a run ignores this band ({what})"


def _table_note(band: Band, present: NDArray[Any]) -> Iterator[str]:
    """Yield a note if a lookup table in the folder assigns different fuels to an unnamed band."""
    codes = np.unique(present)
    if codes.size <= MAX_CODES:
        other = renamed_code(band.path, {int(code) for code in codes}, FUEL_MODELS)
        if other:
            yield f"if these are fuel codes: {other}"


def _fuel_notes(bands: list[Description]) -> Iterator[str]:
    for band in bands:
        shares = {code: percent for code, _, percent in band.get("fuels", [])}
        if band["layer"] == "fuel" and NO_FUEL in shares:
            yield (
                f"{band['file']}: fuel code 0 (no fuel, {shares[NO_FUEL]:.1f} %) is read as bare "
                "ground (99), unless landscape.fuel_codes replaces it"
            )


def _ground_notes(
    pairs: list[tuple[str, Band]], ground: Mapping[str, NDArray[Any]]
) -> Iterator[str]:
    if "slope" not in ground or "aspect" not in ground:
        return
    bands = dict(pairs)
    unknown = ground["aspect"] < 0.0
    level = np.count_nonzero(unknown & (ground["slope"] <= LEVEL_TAN))
    if level:
        yield (
            f"{bands['aspect'].name}: {level} cells without an aspect are level ground (slope of "
            "at most 5 degrees)"
        )
    if "elevation" in ground:
        yield from ground_notes(
            bands["slope"].name,
            ground["slope"],
            ground["aspect"],
            ground["elevation"],
            bands["slope"].transform.a,
        )


def describe_shapes(
    path: Path, *, crs: str | None = None, landscape: Landscape | None = None
) -> Description:
    """Describe and check a file of shapes; with a landscape, check that the shapes lie on it.

    The keys of the result are ``file``, ``kind``, ``crs``, ``features`` (the number of features),
    ``types`` (the number of features of each type), ``extent`` (south, west, north, east in
    degrees) and ``problems``. ``problems`` has one line for each reason why ``read_shapes`` would
    reject the file.
    """
    found: Description = {"file": str(path), "kind": "shapes"}
    problems: list[str] = []
    read = _kept(problems, features_of, path)
    if read is None:
        return {**found, "problems": problems}
    shapes, own_crs = read
    problems += crs_problems(path, own_crs, crs)
    if not shapes:
        problems.append(f"{path}: has no features; use a file with at least one")
    their_crs = own_crs or crs if not problems else None
    for number, shape in enumerate(shapes, start=1):
        wrong = list(shape_problems(path, number, shape, their_crs))
        if landscape is not None and their_crs is not None and not wrong:
            moved = into_crs(shape, their_crs, landscape.crs)
            wrong = list(place_problems(path, number, moved, landscape))
        problems += wrong
    return {
        **found,
        "crs": their_crs and crs_label(their_crs),
        "features": len(shapes),
        "types": dict(Counter(_type(shape) for shape in shapes)),
        "extent": _extent(tuple(shapely.total_bounds(shapes)), their_crs) if shapes else None,
        "problems": problems,
    }


def _type(shape: BaseGeometry) -> str:
    return "empty" if shape.is_empty else str(shape.geom_type)


def in_text(found: Description) -> str:
    """Return a description as text, with the problems at the end."""
    lines = [f"{found['file']}: {found['kind']}"]
    if found.get("crs"):
        lines.append(f"  CRS {found['crs']}")
    if "rows" in found:
        lines.append(
            f"  {found['rows']} rows x {found['cols']} columns, cells of {found['cell_size']:g}"
        )
    if found.get("extent"):
        south, west, north, east = found["extent"]
        middle = (west + east + 360.0 * (east < west)) / 2  # east < west across the antimeridian
        centre = f"{(south + north) / 2:.5f},{middle - 360.0 * (middle > 180.0):.5f}"
        lines.append(
            f"  lat {south:.5f} to {north:.5f}, lon {west:.5f} to {east:.5f}, centre {centre}"
        )
    if "features" in found:
        kinds = ", ".join(f"{count} {kind}" for kind, count in found["types"].items())
        count = found["features"]
        lines.append(f"  {count} feature{'s' * (count != 1)}{kinds and ': '}{kinds}")
    for band in found.get("bands", []):
        lines += _band_lines(band)
    lines += [f"  {line}" for line in found.get("details", [])]
    lines += [f"  note: {note}" for note in found.get("notes", [])]
    lines += [f"  problem: {problem}" for problem in found["problems"]] or ["  no problems"]
    return "\n".join(lines)


def _band_lines(band: Description) -> Iterator[str]:
    unit = f" in {band['unit']}" if band["unit"] else ""
    nodata = "no nodata value" if band["nodata"] is None else f"nodata {band['nodata']:g}"
    yield (
        f"  band {band['number']} of {Path(band['file']).name}: {band['layer'] or 'unnamed'}, "
        f"{band['dtype']}, {band['least']} to {band['most']}{unit}, {nodata}, "
        f"{band['no_data_cells']} cells without a value"
    )
    if "fuels" in band:
        if not band["layer"]:
            yield "    if these are fuel codes:"
        for code, name, percent in band["fuels"]:
            yield f"    {code:>4} {percent:5.1f} % {name}"
        yield f"    non-burnable {band['non_burnable_pct']:.1f} %"


def _kept(problems: list[str], function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the result of a function; add the text of an error to ``problems`` and return None."""
    try:
        return function(*arguments)
    except FireModelError as error:
        problems.append(str(error))
        return None


def _name(files: Sources) -> str:
    if isinstance(files, Path):
        return str(files)
    paths = (source[0] if isinstance(source, tuple) else source for source in files.values())
    return ", ".join(dict.fromkeys(map(str, paths)))


def _layers_and_bands(files: Sources, problems: list[str]) -> list[tuple[str, Band]]:
    """Return each band with the name of its layer, which is empty if the file names no layer."""
    if isinstance(files, Path):
        bands = _kept(problems, bands_of, files) or ()
        if len(bands) > 1:
            _kept(problems, bands_for, files)
        return [(layer_of(band.description)[0], band) for band in bands]
    pairs = [(layer, _kept(problems, band_of, source)) for layer, source in files.items()]
    if not problems:
        _kept(problems, bands_for, files)
    return [(layer if layer in LAYERS else "", band) for layer, band in pairs if band is not None]


def _grid_problems(bands: list[Band], crs: str | None) -> Iterator[str]:
    """Yield the problems of each band's grid, and its differences from the first valid grid."""
    first: Band | None = None
    for band in bands:
        wrong = list(grid_problems(band, crs))
        yield from wrong
        if wrong:
            continue
        first = first or band
        yield from misfits(band, grid_of(band, crs), grid_of(first, crs), str(first.path))


def _place_of(band: Band, crs: str | None) -> Description:
    from rasterio.transform import array_bounds

    rows, cols = band.shape
    bounds = array_bounds(rows, cols, band.transform)
    found = band.crs or crs
    return {
        "crs": found and crs_label(found),
        "rows": rows,
        "cols": cols,
        "cell_size": band.transform.a,
        "extent": _extent(bounds, found),
    }


def _extent(bounds: tuple[float, ...], crs: str | None) -> tuple[float, float, float, float] | None:
    """Convert bounds (west, south, east, north) to (south, west, north, east) in degrees."""
    if crs is None or not np.isfinite(bounds).all():
        return None
    transformer = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    west, south, east, north = bounds
    west, south, east, north = transformer.transform_bounds(west, south, east, north)
    return south, west, north, east


def _band_in_words(
    layer: str,
    band: Band,
    units: Mapping[str, str],
    nodata: float | None,
    ground: Mapping[str, NDArray[Any]],
    problems: list[str],
) -> Description:
    unit = _kept(problems, unit_of, layer, band, units) if layer else band.unit
    found: Description = {
        "file": str(band.path),
        "number": band.number,
        "layer": layer,
        "dtype": band.dtype,
        "unit": unit,
        "nodata": band.nodata,
        "least": None,
        "most": None,
        "no_data_cells": None,
    }
    values = _kept(problems, values_of, band)
    if values is None:
        return found
    missing = missing_in(band, values, nodata)
    if layer == "aspect" and "slope" in ground:
        values, missing = level_ground(ground["slope"], values, missing)
    if layer and unit is not None:
        problems += value_problems(layer, unit, band, values, missing)
    found["no_data_cells"] = int(np.count_nonzero(missing))
    present = values[~missing]
    if present.size:
        found |= {"least": present.min().item(), "most": present.max().item()}
        found |= _fuels(present, layer)
    if not layer and present.size and present.dtype.kind in REAL:
        found["notes"] = list(_table_note(band, present))
    if layer or "fuels" in found:
        problems += gaps(band, values, missing)
    elif found["least"] in USUAL_NODATA:
        problems.append(
            f"{band.name}: {cells_with(values == found['least'], values)} probably means no data, "
            "but the file does not declare it; declare it in the file, or specify it as nodata"
        )
    return found


def _fuels(present: NDArray[Any], layer: str) -> Description:
    """Return each fuel code's share of a fuel layer, or of an unnamed band of fuel codes."""
    names = {code: fuel.name for code, fuel in FUEL_MODELS.items()} | NON_BURNABLE
    names[NO_FUEL] = "no fuel"
    if layer not in ("fuel", "") or present.dtype.kind not in REAL:
        return {}
    found, counts = np.unique(present, return_counts=True)
    if found.size > 2 * len(names) or (found != np.round(found)).any():
        return {}
    codes = [int(code) for code in found]
    if not (layer or set(codes) <= set(names)):
        return {}
    percents = dict(zip(codes, (100.0 * counts / present.size).tolist(), strict=True))
    return {
        "fuels": [(code, names.get(code, "unknown"), percents[code]) for code in codes],
        "non_burnable_pct": sum(percents.get(code, 0.0) for code in NON_BURNABLE),
    }
