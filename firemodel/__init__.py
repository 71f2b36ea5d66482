"""Wildfire spread over landscapes: Rothermel's surface fire model on a grid of cells.

    from pathlib import Path
    import firemodel

    fire = firemodel.burn(ignitions=[(36.364, -84.141)], duration_s=3 * 3600)
    print(fire.burned_ha, fire.arrival_time_s.shape, fire.front(3600.0).wkt)
    firemodel.write_fronts(Path("fronts.geojson"), fire, [3600.0, 7200.0], "my fire")

In a notebook, a landscape, fire or front at the end of a cell is shown as a picture. Landscapes are
read from files (``read_landscape``) or generated (``jacksboro``, ``flat_landscape``). ``SCHEMES``
lists the spread schemes. Each module is imported when one of its names is first used, so that
``import firemodel`` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from firemodel.errors import FireModelError, FireModelWarning
    from firemodel.landscape.default import jacksboro
    from firemodel.landscape.flat import flat_landscape
    from firemodel.landscape.landscape import Landscape
    from firemodel.landscape.rasterise import with_barriers
    from firemodel.landscape.readers.rasters import read_landscape
    from firemodel.landscape.readers.shapes import read_shapes
    from firemodel.landscape.readers.weather_files import read_weather
    from firemodel.outputs.arrival_map import draw_map
    from firemodel.outputs.front_files import write_fronts
    from firemodel.outputs.geotiff import write_rasters
    from firemodel.outputs.netcdf import write_netcdf
    from firemodel.outputs.xarray_datasets import from_xarray, to_xarray
    from firemodel.physics.fuels import FUEL_MODELS
    from firemodel.physics.weather import Weather, WeatherStream
    from firemodel.simulate import burn
    from firemodel.spread.behaviour import behaviour_of
    from firemodel.spread.fire_scheme import Fire
    from firemodel.spread.schemes import SCHEMES

_MODULES = {
    "FUEL_MODELS": "firemodel.physics.fuels",
    "SCHEMES": "firemodel.spread.schemes",
    "Fire": "firemodel.spread.fire_scheme",
    "FireModelError": "firemodel.errors",
    "FireModelWarning": "firemodel.errors",
    "Landscape": "firemodel.landscape.landscape",
    "Weather": "firemodel.physics.weather",
    "WeatherStream": "firemodel.physics.weather",
    "behaviour_of": "firemodel.spread.behaviour",
    "burn": "firemodel.simulate",
    "draw_map": "firemodel.outputs.arrival_map",
    "flat_landscape": "firemodel.landscape.flat",
    "from_xarray": "firemodel.outputs.xarray_datasets",
    "jacksboro": "firemodel.landscape.default",
    "read_landscape": "firemodel.landscape.readers.rasters",
    "read_shapes": "firemodel.landscape.readers.shapes",
    "read_weather": "firemodel.landscape.readers.weather_files",
    "to_xarray": "firemodel.outputs.xarray_datasets",
    "with_barriers": "firemodel.landscape.rasterise",
    "write_fronts": "firemodel.outputs.front_files",
    "write_netcdf": "firemodel.outputs.netcdf",
    "write_rasters": "firemodel.outputs.geotiff",
}

__all__ = [
    "FUEL_MODELS",
    "SCHEMES",
    "Fire",
    "FireModelError",
    "FireModelWarning",
    "Landscape",
    "Weather",
    "WeatherStream",
    "behaviour_of",
    "burn",
    "draw_map",
    "flat_landscape",
    "from_xarray",
    "jacksboro",
    "read_landscape",
    "read_shapes",
    "read_weather",
    "to_xarray",
    "with_barriers",
    "write_fronts",
    "write_netcdf",
    "write_rasters",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_MODULES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
