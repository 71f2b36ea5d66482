"""Read and check the header and the values of one band of a raster file."""

import math
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Mask
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import (
    MAX_CELL_M,
    MIN_CELL_M,
    Landscape,
    check_crs,
    crs_label,
    same_crs,
)
from firemodel.landscape.readers.formats import OFFLINE, raster_driver

MAX_CELLS = 250_000_000  # limit for a raster; a fire on so many cells needs about 15 GB of memory
LCP_NODATA = -9999.0  # fixed by the .lcp format, whose header contains no nodata value


@dataclass(frozen=True, slots=True)
class Grid:
    """The grid of a raster; ``west_m`` and ``north_m`` are the x and y of its north-west corner."""

    crs: str
    shape: tuple[int, int]
    west_m: float
    north_m: float
    cell_size_m: float

    def difference(self, other: "Grid") -> str:
        """Return as text how another grid differs; empty if by less than 1/1000 of a cell."""
        if not same_crs(self.crs, other.crs):
            return f"CRS {crs_label(other.crs)} differs from the CRS {crs_label(self.crs)}"
        if self.shape != other.shape:
            return f"shape {other.shape} differs from the shape {self.shape}"
        tolerance_m = 1e-3 * self.cell_size_m
        if abs(self.cell_size_m - other.cell_size_m) * max(self.shape) > tolerance_m:
            return f"cell size {other.cell_size_m} m differs from the {self.cell_size_m} m"
        offset_m = max(abs(self.west_m - other.west_m), abs(self.north_m - other.north_m))
        if offset_m > tolerance_m:
            return (
                f"corner ({other.west_m}, {other.north_m}) differs from the corner "
                f"({self.west_m}, {self.north_m})"
            )
        return ""


@dataclass(frozen=True, slots=True)
class Band:
    """The unchecked header of one band of a file."""

    path: Path
    number: int  # band number, from 1
    count: int  # number of bands in the file
    driver: str
    description: str
    dtype: str
    shape: tuple[int, int]
    crs: str | None
    transform: Any  # affine.Affine from (column, row) of cell corners to x, y
    nodata: float | None
    masked: bool  # True if the file also has a mask
    unit: str  # as written in the file, or empty
    scale: float
    offset: float
    tags: dict[str, str]

    @property
    def name(self) -> str:
        """The band's name in error messages."""
        return f"{self.path}" if self.count == 1 else f"{self.path} band {self.number}"


def check_file(path: Path) -> None:
    """Raise FireModelError if a path is not that of a file."""
    if not path.is_file():
        folder = path.is_dir()
        raise FireModelError(f"{path}: {'is a folder, not a file' if folder else 'no such file'}")


def bands_of(path: Path) -> tuple[Band, ...]:
    """Return the bands of a raster file. Raises FireModelError if the file is not a raster."""
    from rasterio.enums import MaskFlags
    from rasterio.errors import NotGeoreferencedWarning

    check_file(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)  # ``grid_problems`` reports it
        with opened(path, raster_driver(path)) as file:
            crs = file.crs.to_string() if file.crs else None  # slow: searches for an EPSG code
            return tuple(
                Band(
                    path,
                    number,
                    file.count,
                    file.driver,
                    file.descriptions[number - 1] or "",
                    file.dtypes[number - 1],
                    file.shape,
                    crs,
                    file.transform,
                    _nodata(file.driver, file.nodatavals[number - 1]),
                    MaskFlags.per_dataset in file.mask_flag_enums[number - 1],
                    _unit(file.units[number - 1], file.tags(number)),
                    file.scales[number - 1],
                    file.offsets[number - 1],
                    {**file.tags(), **file.tags(number)},
                )
                for number in file.indexes
            )


@contextmanager
def opened(path: Path, driver: str, dataset: str | None = None) -> Iterator[Any]:
    """Open a raster, or one ``dataset`` in the file, without network access.

    Raises FireModelError if GDAL cannot read the file.
    """
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.Env(**OFFLINE), rasterio.open(dataset or path, driver=driver) as file:
            yield file
    except RasterioError as error:
        line = " ".join(str(error).split())
        raise FireModelError(f"{path}: cannot be read as a raster ({line})") from None


def _nodata(driver: str, declared: float | None) -> float | None:
    return LCP_NODATA if declared is None and driver == "LCP" else declared


def _unit(declared: str | None, tags: dict[str, str]) -> str:
    """Return the unit that the file declares to GDAL, or else the unit in an .lcp's header."""
    named = (value for key, value in tags.items() if key.endswith("_UNIT_NAME"))
    return declared or next(named, "")


def band_of(source: Path | tuple[Path, int]) -> Band:
    """Return the band that ``source`` names: the only band of a file, or (file, number from 1).

    Raises FireModelError if there is no such band.
    """
    path, number = source if isinstance(source, tuple) else (source, 0)
    bands = bands_of(path)
    if number == 0 and len(bands) != 1:
        raise FireModelError(
            f"{path}: has {len(bands)} bands; use a file with one band, or specify (file, band)"
        )
    if not 0 <= number <= len(bands):
        raise FireModelError(f"{path}: has no band {number}; its bands are 1 to {len(bands)}")
    return bands[max(number - 1, 0)]


def values_of(band: Band) -> NDArray[Any]:
    """Return a band's values (y, x) in the band's data type.

    Raises FireModelError if the file is damaged or has more than ``MAX_CELLS`` cells.
    """
    refuse(size_problems(band))
    with opened(band.path, band.driver) as file:
        values: NDArray[Any] = file.read(band.number)
    return values


def size_problems(band: Band) -> Iterator[str]:
    """Yield a problem if a band has too many cells to be read."""
    rows, cols = band.shape
    if rows * cols > MAX_CELLS:
        yield (
            f"{band.path}: has {rows} x {cols} = {rows * cols:,} cells, more than {MAX_CELLS:,}; "
            "crop it to the surroundings of the fire (gdal_translate -projwin)"
        )


def missing_in(band: Band, values: NDArray[Any], nodata: float | None = None) -> Mask:
    """Return a mask (y, x) that is True in each cell without a value.

    A cell without a value is not finite, has the file's nodata value or ``nodata``, or is masked in
    the file.
    """
    if np.issubdtype(values.dtype, np.floating):
        missing: Mask = ~np.isfinite(values)
    else:
        missing = np.zeros(values.shape, dtype=np.bool_)
    for value in (band.nodata, nodata):
        if value is not None and not math.isnan(value):
            missing |= values == values.dtype.type(value) if _fits(value, values) else False
    if band.masked:
        with opened(band.path, band.driver) as file:
            missing |= file.read_masks(band.number) == 0
    return missing


def _fits(value: float, values: NDArray[Any]) -> bool:
    """Return True if the array's type can hold a value; a float type may round the value."""
    if np.issubdtype(values.dtype, np.floating):
        return abs(value) <= float(np.finfo(values.dtype).max)
    kind = np.iinfo(values.dtype)
    return kind.min <= value <= kind.max and value == int(value)


def cells_with(bad: Mask, values: NDArray[Any]) -> str:
    """Describe the first bad cell (value, row, column) and the number of bad cells."""
    row, col = divmod(int(np.argmax(bad)), bad.shape[1])
    return f"{values[row, col]} at row {row}, column {col} ({np.count_nonzero(bad)} such cells)"


def grid_problems(band: Band, crs: str | None = None) -> Iterator[str]:
    """Yield the reasons why a band is not a north-up grid of square cells in metres.

    ``crs`` is the CRS of files without one.
    """
    yield from size_problems(band)
    transform, found = band.transform, band.crs or crs
    if found is None:
        yield (
            f"{band.path}: has no CRS; assign the file's projection to it, or specify it as `crs`"
        )
    else:
        try:
            check_crs(found, str(band.path))
            check_crs(crs or found, f"{band.path}: specified as `crs`")
            if crs is not None and not same_crs(found, crs):
                yield (
                    f"{band.path}: CRS {crs_label(found)} differs from {crs_label(crs)}, "
                    "specified as `crs`; omit `crs`, or correct the CRS in the file"
                )
        except FireModelError as error:
            yield str(error)
    if band.tags.get("LINEAR_UNIT", "Meters") != "Meters":
        yield f"{band.path}: its cells are in {band.tags['LINEAR_UNIT']}; warp it to metres"
    if transform.b or transform.d or transform.a <= 0 or transform.e >= 0:
        yield f"{band.path}: is not north-up; warp it to an unrotated grid"
    elif abs(transform.a + transform.e) > 1e-6 * transform.a:
        yield (
            f"{band.path}: cells are {transform.a} x {-transform.e} m; resample it to square cells"
        )
    elif not MIN_CELL_M <= transform.a <= MAX_CELL_M:
        yield (
            f"{band.path}: cells are {transform.a:g} m, but must be {MIN_CELL_M:g} to "
            f"{MAX_CELL_M:.0f} m; correct the cell size in the file"
        )
    if band.dtype.startswith("complex"):
        yield f"{band.name}: contains complex numbers; store real numbers"
    if (band.scale, band.offset) != (1.0, 0.0):
        yield (
            f"{band.name}: values have scale {band.scale} and offset {band.offset}; store them "
            "unscaled (gdal_translate -unscale)"
        )


def grid_of(band: Band, crs: str | None = None) -> Grid:
    """Return a band's grid. Raises FireModelError with the first of ``grid_problems``."""
    refuse(grid_problems(band, crs))
    west_m, north_m = band.transform.c, band.transform.f
    return Grid(str(band.crs or crs), band.shape, west_m, north_m, band.transform.a)


def grid_of_landscape(land: Landscape) -> Grid:
    """Return the grid of a landscape."""
    return Grid(land.crs, land.shape, land.west_m, land.north_m, land.cell_size_m)


def refuse(problems: Iterable[str]) -> None:
    """Raise FireModelError with the first problem, if there is one."""
    for problem in problems:
        raise FireModelError(problem)
