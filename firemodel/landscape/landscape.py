"""Define landscapes: georeferenced rasters (y, x) of fuel, ground and trees."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.moisture_zones import MoistureZones, moisture_zones
from firemodel.notebook_object import NotebookObject
from firemodel.physics.fuels import FUEL_MODELS, FuelModel, check_codes

if TYPE_CHECKING:
    from pyproj import CRS, Transformer


MAX_ELEVATION_M = 9000.0  # a higher value means a wrong unit or an undeclared nodata value
MAX_TREE_M = 120.0
MAX_CANOPY_KG_M3 = 2.0  # denser than any forest; a larger value means a wrong unit
MAX_SLOPE = 1000.0  # rise over run
MIN_CELL_M, MAX_CELL_M = 0.01, 1e6  # other cell sizes mean a wrong unit or a damaged file
ROWS_AT_ONCE = 256


@lru_cache(maxsize=8)
def transformers(crs: str) -> "tuple[Transformer, Transformer]":
    """Return the transformers from a CRS to WGS84 (longitude, latitude) and back."""
    from pyproj import Transformer

    return (
        Transformer.from_crs(crs, "EPSG:4326", always_xy=True),
        Transformer.from_crs("EPSG:4326", crs, always_xy=True),
    )


@lru_cache(maxsize=8)
def check_crs(crs: str, where: str) -> None:
    """Raise FireModelError unless ``crs`` names a projection in metres."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        found = CRS.from_user_input(crs)
    except CRSError as error:
        raise FireModelError(f"{where}: CRS {crs!r} is invalid: {error}") from None
    if not found.is_projected or found.axis_info[0].unit_name != "metre":
        raise FireModelError(
            f"{where}: CRS {crs_label(crs)} is not a projection in metres; "
            "reproject it, to UTM for example"
        )


def crs_label(crs: str) -> str:
    """Return a short label for a CRS: ``crs`` itself if it is short, else the CRS's name.

    A projection without a name is described by its method, its parameters and its ellipsoid.
    """
    from pyproj import CRS

    if len(crs) <= 20:
        return crs
    found = CRS.from_user_input(crs)
    method, ellipsoid = found.coordinate_operation, found.ellipsoid
    if found.name.lower() not in ("unknown", "unnamed", "") or not (method and ellipsoid):
        return str(found.name)
    shape = "sphere" if not ellipsoid.inverse_flattening else "ellipsoid"
    given = ", ".join(f"{each.name} {each.value:g}" for each in method.params if each.value)
    return (
        f"{method.method_name} ({given}) on a {shape} of radius {ellipsoid.semi_major_metre:.0f} m"
    )


@lru_cache(maxsize=64)
def same_crs(one: str, other: str) -> bool:
    """Return True if two CRSs give the same coordinates in the same datum.

    The definitions may differ, for example in a central meridian of 237.3 or -122.7 degrees: two
    projections of one datum are the same if the coordinates of three points agree to 1 mm.
    """
    from pyproj import CRS, Transformer

    left, right = CRS.from_user_input(one), CRS.from_user_input(other)
    if left == right:
        return True
    if not (left.is_projected and right.is_projected and _same_datum(left, right)):
        return False
    places_m = np.array([[0.0, 1e5, 5e5], [0.0, 3e5, 4e6]])
    moved_m = Transformer.from_crs(left, right, always_xy=True).transform(*places_m)
    return bool((np.abs(moved_m - places_m) < 1e-3).all())


def _same_datum(left: "CRS", right: "CRS") -> bool:
    """Return whether two projections share a datum, or have unknown datums on equal ellipsoids."""
    one, other = left.geodetic_crs, right.geodetic_crs
    if one is None or other is None or one.equals(other, ignore_axis_order=True):
        return one is not None and other is not None
    if not all("unknown" in str(crs.datum and crs.datum.name).lower() for crs in (one, other)):
        return False
    shapes = [
        (crs.ellipsoid.semi_major_metre, crs.ellipsoid.inverse_flattening)
        for crs in (one, other)
        if crs.ellipsoid
    ]
    return (
        len(shapes) == 2 and shapes[0] == shapes[1] and one.prime_meridian == other.prime_meridian
    )


def turned(north: Any, east: Any, turn_deg: float) -> tuple[Any, Any]:
    """Return the components (north, east) of vectors after turning them clockwise.

    The components are numbers or arrays. A turn by ``grid_convergence_deg`` converts components
    towards grid north to those towards true north.
    """
    cos, sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    return north * cos - east * sin, east * cos + north * sin


def horn(elevation_m: NDArray[np.floating], cell_size_m: float) -> NDArray[np.float32]:
    """Compute the rise per metre (2, y, x) towards north and towards east from elevation (y, x).

    The rise is a weighted difference of the eight neighbours (Horn 1981, Proc. IEEE 69, 14-47).
    Beyond the edge, the elevation at the edge is used. The computation is done in float64, and in
    blocks of rows to save memory.
    """
    rows, cols = elevation_m.shape
    padded = np.pad(elevation_m, 1, mode="edge")
    gradient = np.empty((2, rows, cols), dtype=np.float32)
    for top in range(0, rows, ROWS_AT_ONCE):
        z = padded[top : top + ROWS_AT_ONCE + 2].astype(np.float64)
        here = slice(top, top + ROWS_AT_ONCE)
        across = z[:, :-2] + 2 * z[:, 1:-1] + z[:, 2:]
        gradient[0, here] = (across[:-2] - across[2:]) / (8 * cell_size_m)
        down = z[:-2] + 2 * z[1:-1] + z[2:]
        gradient[1, here] = (down[:, 2:] - down[:, :-2]) / (8 * cell_size_m)
    return gradient


def bilinear(values: NDArray[Any], row: Any, col: Any) -> Any:
    """Interpolate values (y, x) at float rows and columns, with constant values beyond the edge."""
    last_row, last_col = values.shape[0] - 1, values.shape[1] - 1
    if isinstance(row, float):  # for a single position this is much faster without arrays
        row, col = min(max(float(row), 0.0), last_row), min(max(float(col), 0.0), last_col)
        top, left = min(int(row), last_row - 1), min(int(col), last_col - 1)
        north_west, north_east = values.item(top, left), values.item(top, left + 1)
        south_west, south_east = values.item(top + 1, left), values.item(top + 1, left + 1)
    else:
        row, col = np.clip(row, 0.0, last_row), np.clip(col, 0.0, last_col)
        top = np.minimum(row.astype(np.int64), last_row - 1)
        left = np.minimum(col.astype(np.int64), last_col - 1)
        north_west, north_east = values[top, left], values[top, left + 1]
        south_west, south_east = values[top + 1, left], values[top + 1, left + 1]
    down, right = row - top, col - left
    north = north_west * (1 - right) + north_east * right
    south = south_west * (1 - right) + south_east * right
    return north * (1 - down) + south * down


@lru_cache(maxsize=64, typed=True)  # each vehicle position is converted several times
def _projected(crs: str, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    x_m, y_m = transformers(crs)[1].transform(lon_deg, lat_deg)
    return x_m, y_m


@dataclass(frozen=True, eq=False)
class Landscape(NotebookObject):
    """A grid of square cells in a projected CRS in metres.

    ``west_m``, ``north_m`` are the coordinates of the outer north-west corner of cell (0, 0). The
    arrays are (y, x) with row 0 in the north. The layers are fuel codes (see ``fuels``), elevation
    in metres above sea level and, optionally, canopy cover (0 to 1), canopy height in metres,
    canopy base height in metres and canopy bulk density in kg/m³. ``gradient`` (2, y, x) is the
    rise per metre towards north and towards east. If no gradient is given, it is computed from the
    elevation (see ``horn``). If a gradient is given, the elevation may be missing. ``custom_fuels``
    are the fuel models of codes that are not standard, or that replace standard models. A position
    in the grid is a pair of floats (row, col). At the centre of a cell both are whole numbers, so
    that ``round`` converts a position to its cell. Positions and coordinates may be scalars or
    arrays.
    """

    crs: str
    west_m: float
    north_m: float
    cell_size_m: float
    fuel_model: NDArray[np.int16]
    elevation_m: NDArray[np.float32] | None
    gradient: NDArray[np.float32] = None  # type: ignore[assignment]  # filled in if not given
    canopy_cover: NDArray[np.float32] | None = None
    canopy_height_m: NDArray[np.float32] | None = None
    canopy_base_m: NDArray[np.float32] | None = None
    canopy_bulk_density_kg_m3: NDArray[np.float32] | None = None
    custom_fuels: Mapping[int, FuelModel] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the values and compute the gradient if it is not given.

        Raises FireModelError; the message names the invalid value.
        """
        if self.fuel_model.ndim != 2 or self.fuel_model.size == 0:
            raise FireModelError(
                f"landscape: fuel has the shape {self.fuel_model.shape}, but must have (rows, "
                "columns)"
            )
        if not MIN_CELL_M <= self.cell_size_m <= MAX_CELL_M:
            raise FireModelError(
                f"landscape: cell_size_m = {self.cell_size_m} must be {MIN_CELL_M:g} to "
                f"{MAX_CELL_M:.0f}"
            )
        check_crs(self.crs, "landscape")
        check_codes(self.fuel_model, "landscape", self.fuels)
        self._check_layer("elevation", self.elevation_m, -MAX_ELEVATION_M, MAX_ELEVATION_M)
        self._check_layer("canopy cover", self.canopy_cover, 0.0, 1.0)
        self._check_layer("canopy height", self.canopy_height_m, 0.0, MAX_TREE_M)
        self._check_layer("canopy base", self.canopy_base_m, 0.0, MAX_TREE_M)
        density = self.canopy_bulk_density_kg_m3
        self._check_layer("canopy bulk density", density, 0.0, MAX_CANOPY_KG_M3)
        if self.gradient is not None:
            gradient = np.ascontiguousarray(self.gradient, dtype=np.float32)
            if gradient.shape != (2, *self.shape):
                raise FireModelError(
                    f"landscape: gradient has the shape {gradient.shape}, but must have "
                    f"{(2, *self.shape)}: towards north and towards east"
                )
            self._check_layer("gradient towards north", gradient[0], -MAX_SLOPE, MAX_SLOPE)
            self._check_layer("gradient towards east", gradient[1], -MAX_SLOPE, MAX_SLOPE)
        elif self.elevation_m is not None:
            gradient = horn(self.elevation_m, self.cell_size_m)
        else:
            raise FireModelError(
                "landscape: elevation and gradient are both missing; specify one of them"
            )
        object.__setattr__(self, "gradient", gradient)

    def _check_layer(
        self, name: str, layer: NDArray[np.float32] | None, least: float, most: float
    ) -> None:
        if layer is None:
            return
        if layer.shape != self.shape:
            raise FireModelError(
                f"landscape: fuel has the shape {self.shape}, but {name} {layer.shape}; the "
                "shapes must be equal"
            )
        within = (layer >= least) & (layer <= most)  # False for NaN
        if not within.all():
            row, col = divmod(int(np.argmin(within)), self.shape[1])
            raise FireModelError(
                f"landscape: {name} is {layer[row, col]} at row {row}, column {col}; "
                f"it must be from {least:g} to {most:g}"
            )

    @cached_property
    def fuels(self) -> Mapping[int, FuelModel]:
        """The fuel model of each burnable code, standard or custom."""
        return FUEL_MODELS | dict(self.custom_fuels)

    @cached_property
    def burnable_codes(self) -> tuple[int, ...]:
        """The codes of the burnable fuels on this landscape, in ascending order."""
        present = np.bincount(self.fuel_model.ravel()).nonzero()[0]
        return tuple(int(code) for code in present if int(code) in self.fuels)

    @cached_property
    def moisture_zones(self) -> MoistureZones:
        """The zones of equal dead fuel moisture; requires this landscape to have an elevation."""
        assert self.elevation_m is not None
        return moisture_zones(self.elevation_m, self.gradient, self.canopy_cover)

    @property
    def shape(self) -> tuple[int, int]:
        """The number of rows and the number of columns."""
        rows, cols = self.fuel_model.shape
        return rows, cols

    @property
    def south_m(self) -> float:
        """The coordinate of the outer southern edge, in metres."""
        return self.north_m - self.shape[0] * self.cell_size_m

    @property
    def slope_tan(self) -> Floats:
        """The slope (y, x) as rise over run, computed at each access like ``aspect_deg``."""
        north, east = self.gradient
        slope: Floats = np.hypot(north, east, dtype=np.float64)
        return slope

    @property
    def aspect_deg(self) -> Floats:
        """The direction (y, x) in which the ground falls, in degrees clockwise from grid north."""
        north, east = self.gradient
        falls: Floats = np.arctan2(-east, -north, dtype=np.float64)
        return np.rad2deg(falls) % 360.0

    @cached_property
    def centre_lat_lon(self) -> tuple[float, float]:
        """WGS84 latitude and longitude of the grid's centre in degrees."""
        rows, cols = self.shape
        lat_deg, lon_deg = self.lat_lon_of(*self.xy_of((rows - 1) / 2, (cols - 1) / 2))
        return float(lat_deg), float(lon_deg)

    def unwrapped_deg(self, lon_deg: Any) -> Any:
        """Return longitudes within 180 degrees of the grid's centre.

        Across the antimeridian, these longitudes continue beyond -180 or 180 degrees.
        """
        lon, (_, middle_deg) = np.asarray(lon_deg, dtype=np.float64), self.centre_lat_lon
        lon = np.where(lon - middle_deg > 180.0, lon - 360.0, lon)
        return np.where(lon - middle_deg < -180.0, lon + 360.0, lon)

    @cached_property
    def grid_convergence_deg(self) -> float:
        """The direction of grid north at the grid's centre, clockwise from true north."""
        from pyproj import Proj

        lat_deg, lon_deg = self.centre_lat_lon
        return float(Proj(self.crs).get_factors(lon_deg, lat_deg).meridian_convergence)

    def grid_deg(self, true_deg: float) -> float:
        """Convert degrees clockwise from true north to degrees clockwise from grid north."""
        return true_deg - self.grid_convergence_deg

    def true_deg(self, grid_deg: Any) -> Any:
        """Convert degrees clockwise from grid north to degrees clockwise from true north.

        The result is from 0 to 360.
        """
        return (grid_deg + self.grid_convergence_deg) % 360.0

    def xy_of(self, row: Any, col: Any) -> tuple[Any, Any]:
        """Return the projected x, y in metres of grid positions."""
        return (
            self.west_m + (col + 0.5) * self.cell_size_m,
            self.north_m - (row + 0.5) * self.cell_size_m,
        )

    def row_col_of(self, x_m: Any, y_m: Any) -> tuple[Any, Any]:
        """Return the grid position (float row, col) of projected coordinates."""
        return (
            (self.north_m - y_m) / self.cell_size_m - 0.5,
            (x_m - self.west_m) / self.cell_size_m - 0.5,
        )

    def lat_lon_of(self, x_m: Any, y_m: Any) -> tuple[Any, Any]:
        """Return the WGS84 latitude and longitude in degrees of projected coordinates in metres."""
        lon, lat = transformers(self.crs)[0].transform(x_m, y_m)
        return lat, lon

    def xy_of_lat_lon(self, lat_deg: Any, lon_deg: Any) -> tuple[Any, Any]:
        """Return the projected x, y in metres of WGS84 coordinates."""
        if isinstance(lat_deg, float) and isinstance(lon_deg, float):
            return _projected(self.crs, lat_deg, lon_deg)
        x_m, y_m = transformers(self.crs)[1].transform(lon_deg, lat_deg)
        return x_m, y_m

    def xy_of_places(self, places: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
        """Return the projected x, y in metres (n, 2) of WGS84 positions (lat_deg, lon_deg)."""
        lat, lon = np.array(places, dtype=float).reshape(-1, 2).T
        return np.column_stack(self.xy_of_lat_lon(lat, lon))

    def cell_of_lat_lon(self, lat_deg: float, lon_deg: float) -> tuple[int, int]:
        """Return the row and column of the cell at a WGS84 position.

        Raises FireModelError for a position off the landscape.
        """
        x_m, y_m = self.xy_of_lat_lon(lat_deg, lon_deg)
        if not self.contains(x_m, y_m):
            raise FireModelError(
                f"ignition at lat {lat_deg}, lon {lon_deg} lies outside the landscape"
            )
        row, col = self.row_col_of(x_m, y_m)
        return round(float(row)), round(float(col))

    def contains(self, x_m: float, y_m: float) -> bool:
        """Return True if a point lies on the grid."""
        row, col = self.row_col_of(x_m, y_m)
        return bool(-0.5 <= row < self.shape[0] - 0.5 and -0.5 <= col < self.shape[1] - 0.5)

    def elevation_at(self, x_m: Any, y_m: Any) -> Any:
        """Return the elevation in metres, interpolated bilinearly between cell centres.

        Off the grid, the elevation at the edge is returned. Raises FireModelError if the landscape
        has no elevation.
        """
        z = self.elevation_m
        if z is None:
            raise FireModelError(
                "this landscape has no elevation; add an elevation raster along with slope and "
                "aspect"
            )
        return bilinear(z, *self.row_col_of(x_m, y_m))

    def transform(self) -> Any:
        """Return rasterio's transform from (column, row) of cell corners to x, y."""
        from rasterio import Affine

        return Affine(self.cell_size_m, 0.0, self.west_m, 0.0, -self.cell_size_m, self.north_m)

    def digest(self) -> str:
        """Return the SHA-256 of the landscape's grid and layers.

        The gradient is left out if it was computed from the elevation.
        """
        sha = hashlib.sha256(
            repr(
                (
                    self.crs,
                    float(self.west_m),
                    float(self.north_m),
                    float(self.cell_size_m),
                    self.shape,
                )
            ).encode()
        )
        sha.update(self.fuel_model.astype("<i2").tobytes())
        if self.custom_fuels:
            sha.update(repr(sorted(self.custom_fuels.items())).encode())
        elevation = self.elevation_m
        layers = {
            "elevation": elevation,
            "gradient": self.gradient,
            "canopy cover": self.canopy_cover,
            "canopy height": self.canopy_height_m,
            "canopy base": self.canopy_base_m,
            "canopy bulk density": self.canopy_bulk_density_kg_m3,
        }
        if elevation is not None and np.array_equal(
            self.gradient, horn(elevation, self.cell_size_m)
        ):
            del layers["gradient"]
        for name, layer in layers.items():
            if layer is not None:
                # The elevation's name is not hashed, so that the digests in earlier records remain
                # valid.
                sha.update(b"" if name == "elevation" else name.encode())
                sha.update(layer.astype("<f4").tobytes())
        return sha.hexdigest()
