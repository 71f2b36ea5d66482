"""Convert landscapes and fires to xarray datasets, and datasets to landscapes.

Names, dimensions and units are those of ``write_netcdf`` for variables that both contain. The
coordinates ``y`` and ``x`` are cell centres in CRS metres; row 0 is in the north.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire

if TYPE_CHECKING:
    from xarray import Dataset

# For each attribute of a landscape: the variable, its unit and its type.
LAYERS = {
    "elevation_m": ("elevation", "m", np.float32),
    "canopy_cover": ("canopy_cover", "1", np.float32),
    "canopy_height_m": ("canopy_height", "m", np.float32),
    "canopy_base_m": ("canopy_base", "m", np.float32),
    "canopy_bulk_density_kg_m3": ("canopy_bulk_density", "kg m-3", np.float32),
}
GRADIENT = ("gradient_north", "gradient_east")
SPACING = 1e-3  # largest difference between cell spacings, as a fraction of a cell


def to_xarray(thing: Landscape | Fire) -> "Dataset":
    """Convert a landscape, or a fire with its landscape, to an xarray dataset.

    Args:
        thing: A landscape, or a fire that has been advanced to the time of interest.

    Returns:
        A dataset with the dimensions (y, x), the variables fuel_model, elevation (m),
        gradient_north and gradient_east (rise over run) and the landscape's canopy variables, if
        any; for a fire also arrival_time (s, NaN where nothing has burned by ``time_s``). The
        variable ``crs`` has the attributes of the CF conventions.

    Raises:
        FireModelError: xarray is not installed, the landscape has custom fuel models, which a
            dataset cannot contain, or ``thing`` is neither a landscape nor a fire.
    """
    xarray = _xarray()
    if isinstance(thing, Fire):
        land = thing.landscape
    elif isinstance(thing, Landscape):
        land = thing
    else:
        raise FireModelError(
            f"to_xarray: {type(thing).__name__} cannot be converted; pass a Landscape or a Fire"
        )
    if land.custom_fuels:
        raise FireModelError("to_xarray: a dataset cannot contain custom fuel models")
    from pyproj import CRS

    rows, cols = land.shape
    x_m, _ = land.xy_of(0, np.arange(cols))
    _, y_m = land.xy_of(np.arange(rows), 0)
    layers: dict[str, tuple[Any, str]] = {"fuel_model": (land.fuel_model, "1")}
    for attribute, (name, unit, _) in LAYERS.items():
        if (layer := getattr(land, attribute)) is not None:
            layers[name] = (layer, unit)
    layers |= {name: (land.gradient[n], "1") for n, name in enumerate(GRADIENT)}
    if isinstance(thing, Fire):
        arrival_s = np.where(thing.burned(), thing.arrival_time_s, np.nan)
        layers["arrival_time"] = (arrival_s, "s")
    variables: dict[str, Any] = {
        name: (("y", "x"), values.copy(), {"units": unit, "grid_mapping": "crs"})
        for name, (values, unit) in layers.items()
    }
    variables["crs"] = ((), 0, CRS.from_user_input(land.crs).to_cf())
    coordinates = {
        axis: (axis, values, {"units": "m", "standard_name": f"projection_{axis}_coordinate"})
        for axis, values in (("y", y_m), ("x", x_m))
    }
    found: Dataset = xarray.Dataset(variables, coordinates, {"Conventions": "CF-1.8"})
    return found


def from_xarray(dataset: "Dataset") -> Landscape:
    """Create a landscape from an xarray dataset with the variables of ``to_xarray``.

    Args:
        dataset: A dataset with the dimensions (y, x) in either direction, the variable fuel_model,
            and elevation, or both gradients, or all three; canopy layers are optional. The CRS is
            in the attribute ``crs_wkt`` of the variable ``crs`` or ``spatial_ref``, as written by
            this function's inverse and by rioxarray. Units are those of ``to_xarray``.

    Returns:
        The landscape, with row 0 in the north.

    Raises:
        FireModelError: xarray is not installed, a variable or the CRS is missing, the cells are not
            square, or the landscape is not valid.
    """
    _xarray()
    missing = [name for name in ("x", "y", "fuel_model") if name not in dataset.variables]
    if missing:
        raise FireModelError(f"from_xarray: the dataset lacks {', '.join(missing)}")
    ordered = dataset.sortby("x").sortby("y", ascending=False)
    x_m, y_m = (np.asarray(ordered[axis].values, dtype=np.float64) for axis in ("x", "y"))
    cell_m = _cell_size_m(x_m, y_m)

    def layer(name: str, dtype: Any) -> Any:
        values = ordered[name].transpose("y", "x").values if name in ordered else None
        return None if values is None else np.ascontiguousarray(values, dtype=dtype)

    gradients = [layer(name, np.float32) for name in GRADIENT]
    given = all(each is not None for each in gradients)
    return Landscape(
        crs=_crs(ordered),
        west_m=float(x_m[0] - cell_m / 2.0),
        north_m=float(y_m[0] + cell_m / 2.0),
        cell_size_m=cell_m,
        fuel_model=layer("fuel_model", np.int16),
        gradient=np.stack(gradients) if given else None,  # type: ignore[arg-type]
        **{attribute: layer(name, dtype) for attribute, (name, _, dtype) in LAYERS.items()},
    )


def _xarray() -> Any:
    if find_spec("xarray") is None:
        raise FireModelError(
            "xarray is not installed; pip install 'mission-service[export]' installs it"
        )
    import xarray

    return xarray


def _cell_size_m(x_m: Any, y_m: Any) -> float:
    if min(len(x_m), len(y_m)) < 2:
        raise FireModelError("from_xarray: x and y need at least 2 cells each")
    steps_m = np.concatenate([np.diff(x_m), -np.diff(y_m)])
    cell_m = float(np.round(steps_m.mean(), 6))
    if not (np.abs(steps_m - cell_m) <= SPACING * cell_m).all():
        raise FireModelError(
            f"from_xarray: cells are {steps_m.min():g} to {steps_m.max():g} m apart; they must be "
            "squares of one size"
        )
    return cell_m


def _crs(dataset: "Dataset") -> str:
    from pyproj import CRS

    for name in ("crs", "spatial_ref"):
        attributes = dataset[name].attrs if name in dataset.variables else {}
        if wkt := attributes.get("crs_wkt") or attributes.get("spatial_ref"):
            found = CRS.from_user_input(wkt)
            code = found.to_epsg()
            return str(wkt) if code is None else f"EPSG:{code}"
    raise FireModelError(
        "from_xarray: the dataset has no CRS; add a variable crs with the attribute crs_wkt"
    )
