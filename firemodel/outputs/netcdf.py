"""Write a fire as NetCDF-4 with CF conventions: behaviour in each cell and state over time."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.front_files import check_increasing
from firemodel.outputs.layer_legends import (
    CROWN_FRACTION_LAYER,
    CROWNING_WIND_LAYER,
    FLAME_LENGTH_LAYER,
    INTENSITY_LAYER,
    SPREAD_RATE_LAYER,
    SPREAD_TOWARD_LAYER,
    STATE_LAYER,
    TORCHING_WIND_LAYER,
    Layer,
    after_zero,
    fuel_layer,
)
from firemodel.outputs.whole_file import whole_file, write_error
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.crown_winds import crown_winds_of
from firemodel.spread.fire_scheme import Fire

if TYPE_CHECKING:
    from netCDF4 import Dataset

MAX_CHUNK = 512  # maximum number of cells in a chunk in each direction
GRID: dict[str, Any] = {"grid_mapping": "crs", "coordinates": "lat lon"}


def check_netcdf() -> None:
    """Raise FireModelError if the NetCDF library is not installed."""
    if find_spec("netCDF4") is None:
        raise FireModelError(
            "NetCDF needs netCDF4, which is not installed; pip install 'mission-service[export]'"
        )


def write_netcdf(
    path: Path | str,
    fire: Fire,
    times_s: Sequence[float],
    name: str,
    time_zero: datetime | None = None,
) -> None:
    """Write a fire as NetCDF-4 (CF-1.8) on the landscape's grid.

    The variables (y, x) are arrival_time, spread_rate, spread_toward, flame_length and
    fireline_intensity and, with crown fire, crown_fraction (float32, missing where nothing
    burned), torching_wind and crowning_wind (``crown_winds``; missing where no wind suffices),
    fuel_model, lat and lon; the variables over time are state (time, y, x) and burned_area (time),
    the total area of the burned cells. The first row is in the north. Without a calendar date the
    dimension time is named elapsed, because a time axis in the CF conventions requires a date.
    Equal fires give identical files.

    Args:
        path: The file to write, in an existing folder.
        fire: A fire that has been advanced at least to the last of the times.
        times_s: The times of ``state`` in seconds, increasing.
        name: The title of the file.
        time_zero: The calendar time of 0 s. Without a calendar time, times are elapsed seconds.

    Raises:
        FireModelError: netCDF4 is not installed, the times do not increase, the fire has not been
            advanced to one of them, or the file cannot be written.
    """
    check_netcdf()
    check_increasing(times_s)
    from netCDF4 import Dataset

    try:
        with whole_file(Path(path)) as part, Dataset(part, "w", format="NETCDF4") as file:
            file.setncatts(
                {
                    "Conventions": "CF-1.8",
                    "title": name,
                    "source": "simulated by mission-service (Rothermel 1972), not observed",
                    "history": "written by firemodel.write_netcdf",
                    "comment": f"Not for navigation. Times are {after_zero(time_zero)}.",
                }
            )
            _add_grid(file, fire.landscape)
            _add_behaviour(file, fire, time_zero)
            _add_times(file, fire, times_s, time_zero)
    except RuntimeError as error:  # raised by the library, for example on a full disk
        raise write_error(Path(path), error) from None


def _add_grid(file: "Dataset", land: Landscape) -> None:
    from pyproj import CRS

    rows, cols = land.shape
    x_m, _ = land.xy_of(0, np.arange(cols))
    _, y_m = land.xy_of(np.arange(rows), 0)
    for axis, values in (("y", y_m), ("x", x_m)):
        file.createDimension(axis, len(values))
        attributes = {
            "standard_name": f"projection_{axis}_coordinate",
            "long_name": f"{axis} of the cell's centre",
            "units": "m",
            "axis": axis.upper(),
        }
        _add(file, axis, values, (axis,), attributes)
    lat_deg, lon_deg = land.lat_lon_of(*np.meshgrid(x_m, y_m))
    for variable, standard, unit, degrees in (
        ("lat", "latitude", "degrees_north", lat_deg),
        ("lon", "longitude", "degrees_east", lon_deg),
    ):
        attributes = {"standard_name": standard, "long_name": standard, "units": unit}
        _add(file, variable, degrees, ("y", "x"), attributes)
    crs = file.createVariable("crs", "i4")
    crs.setncatts(CRS.from_user_input(land.crs).to_cf())


def _add_behaviour(file: "Dataset", fire: Fire, time_zero: datetime | None) -> None:
    found = behaviour_of(fire)
    arrival_s = np.where(fire.burned(), fire.arrival_time_s, np.nan)
    arrival = {**_time_units(time_zero), "long_name": "time of arrival of fire"}
    _add_cells(file, "arrival_time", arrival_s, arrival)
    layers: dict[str, tuple[Any, Layer]] = {
        "spread_rate": (found.spread_rate_m_s, SPREAD_RATE_LAYER),
        "spread_toward": (found.toward_deg, SPREAD_TOWARD_LAYER),
        "flame_length": (found.flame_length_m, FLAME_LENGTH_LAYER),
        "fireline_intensity": (found.intensity_kw_m, INTENSITY_LAYER),
    }
    if fire.rate_options.crown != "none":
        winds = (np.where(np.isfinite(each), each, np.nan) for each in crown_winds_of(fire))
        layers["crown_fraction"] = (found.crown_fraction, CROWN_FRACTION_LAYER)
        layers["torching_wind"] = (next(winds), TORCHING_WIND_LAYER)
        layers["crowning_wind"] = (next(winds), CROWNING_WIND_LAYER)
    for name, (values, layer) in layers.items():
        _add_cells(file, name, values, {"long_name": layer.description, "units": layer.unit})
    codes = fire.landscape.fuel_model
    layer = fuel_layer(codes)
    fuel = {"long_name": layer.description, **_flags(layer, np.int16), **GRID}
    _add(file, "fuel_model", codes, ("y", "x"), fuel)


def _add_cells(file: "Dataset", name: str, values: Floats, attributes: dict[str, Any]) -> None:
    _add(file, name, values.astype(np.float32), ("y", "x"), attributes | GRID)


def _add_times(
    file: "Dataset", fire: Fire, times_s: Sequence[float], time_zero: datetime | None
) -> None:
    axis = "elapsed" if time_zero is None else "time"
    named = {"standard_name": "forecast_period"} if time_zero is None else {"axis": "T"}
    named["long_name"] = "time of the state of the fire"
    file.createDimension(axis, len(times_s))
    _add(file, axis, np.array(times_s), (axis,), _time_units(time_zero) | named)
    state = _variable(file, "state", np.dtype(np.int8), (axis, "y", "x"))
    state.setncatts({"long_name": "state of the cell", **_flags(STATE_LAYER, np.int8), **GRID})
    for number, time_s in enumerate(times_s):
        state[number] = fire.state_at(time_s)
    cell_m2 = fire.landscape.cell_size_m**2
    burned_m2 = [cell_m2 * np.count_nonzero(fire.arrival_time_s <= time_s) for time_s in times_s]
    area = {"standard_name": "burned_area", "long_name": "area of burned cells", "units": "m2"}
    _add(file, "burned_area", np.array(burned_m2), (axis,), area)


def _time_units(time_zero: datetime | None) -> dict[str, Any]:
    if time_zero is None:
        return {"units": "s", "comment": after_zero(None)}
    since = time_zero.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {"standard_name": "time", "units": f"seconds since {since}", "calendar": "standard"}


def _flags(layer: Layer, dtype: type) -> dict[str, Any]:
    words = [each.label.replace(",", "").replace(" ", "_") for each in layer.classes]
    codes: Any = np.array([each.upto for each in layer.classes], dtype)
    return {"flag_values": codes, "flag_meanings": " ".join(words)}


def _variable(file: "Dataset", name: str, dtype: Any, dimensions: tuple[str, ...]) -> Any:
    rows_cols = [min(len(file.dimensions[each]), MAX_CHUNK) for each in dimensions[-2:]]
    chunks = None if len(dimensions) == 1 else [1] * (len(dimensions) - 2) + rows_cols
    missing = np.nan if dtype == np.float32 else None  # xarray requires the attribute _FillValue
    return file.createVariable(
        name, dtype, dimensions, compression="zlib", chunksizes=chunks, fill_value=missing
    )


def _add(
    file: "Dataset", name: str, values: Any, dimensions: tuple[str, ...], attributes: dict[str, Any]
) -> None:
    variable = _variable(file, name, values.dtype, dimensions)
    variable.setncatts(attributes)
    variable[:] = values
