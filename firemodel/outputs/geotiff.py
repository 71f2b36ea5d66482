"""Write rasters as cloud-optimised GeoTIFFs (COG), each with a QGIS style file."""

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
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
    arrival_layer_of,
    fuel_layer,
)
from firemodel.outputs.qgis_style_files import raster_qml
from firemodel.outputs.whole_file import whole_file, write_whole
from firemodel.spread.behaviour import behaviour_of
from firemodel.spread.crown_winds import crown_winds_of
from firemodel.spread.fire_scheme import Fire

NO_VALUE = -1.0  # nodata value of float32 layers, which have no negative values


def write_raster(path: Path, values: NDArray[Any], landscape: Landscape, layer: Layer) -> None:
    """Write an array as a cloud-optimised GeoTIFF, and a QGIS style of the same name (.qml).

    The band has the layer's description and unit, and codes have a colour table. A raster with more
    than 512 rows or columns has overviews with the mean value or the most frequent code. Equal
    arrays give identical files. An existing file is replaced completely or not at all.

    Args:
        path: The file to write, ending in .tif, in an existing folder.
        values: (y, x) with the landscape's shape, row 0 in the north. Codes are integers from 0 to
            65534, written as uint8 if they are all below 255, else as uint16. Other values must not
            be negative and are written as float32; NaN and infinity are written as no data (-1).
        landscape: The landscape, for its grid and CRS.
        layer: Description, unit and classes, for example ``layer_legends.PROBABILITY_LAYER`` or
            ``arrival_layer(...)``.

    Raises:
        FireModelError: The shape of the array differs from that of the landscape, or a file cannot
            be written.
    """
    from rasterio.io import MemoryFile

    if values.shape != landscape.shape:
        raise FireModelError(
            f"{path}: the values have the shape {values.shape}, but the landscape has "
            f"{landscape.shape} (rows, columns); the shapes must be equal"
        )
    if layer.categorical:
        dtype = np.uint8 if values.max() < np.iinfo(np.uint8).max else np.uint16
        array, nodata, overviews = values.astype(dtype), float(np.iinfo(dtype).max), "MODE"
    else:
        array = np.where(np.isfinite(values), values, NO_VALUE).astype(np.float32)
        # The arithmetic mean of directions is meaningless.
        nodata, overviews = NO_VALUE, "NEAREST" if layer.unit == "degree" else "AVERAGE"
    # Written in memory first: on a full disk GDAL raises an exception of a non-public class.
    with MemoryFile() as memory:
        with memory.open(
            driver="COG",
            height=landscape.shape[0],
            width=landscape.shape[1],
            count=1,
            dtype=array.dtype,
            crs=landscape.crs,
            transform=landscape.transform(),
            nodata=nodata,
            compress="DEFLATE",
            predictor="YES",
            overview_resampling=overviews,
        ) as file:
            file.write(array, 1)
            file.set_band_description(1, layer.description)
            file.units = (layer.unit,)
            if layer.categorical:
                file.write_colormap(1, {int(each.upto): (*each.rgb, 255) for each in layer.classes})
        with whole_file(path) as part:
            part.write_bytes(memory.read())
    write_whole(path.with_suffix(".qml"), raster_qml(layer))


def write_rasters(
    folder: Path | str, fire: Fire, time_zero: datetime | None = None
) -> dict[str, Path]:
    """Write a fire's rasters as cloud-optimised GeoTIFFs on the landscape's grid, with QGIS styles.

    Args:
        folder: An existing folder.
        fire: A fire that has been advanced to the time of interest.
        time_zero: The calendar time of 0 s, if there is one; the arrival times' style contains this
            time.

    Returns:
        The path of each layer: arrival_time_s, spread_rate_m_s, spread_toward_deg, flame_length_m,
        fireline_intensity_kw_m and, with crown fire, crown_fraction (float32; unburned cells have
        -1), torching_wind_m_s and crowning_wind_m_s (``crown_winds``; float32, also in unburned
        cells; -1 where no wind suffices), state and fuel_model (uint8).

    Raises:
        FireModelError: A file cannot be written.
    """
    found, codes = behaviour_of(fire), fire.landscape.fuel_model
    layers: dict[str, tuple[NDArray[Any], Layer]] = {
        "arrival_time_s": (fire.burned_arrival_s(), arrival_layer_of(fire, time_zero)),
        "spread_rate_m_s": (found.spread_rate_m_s, SPREAD_RATE_LAYER),
        "spread_toward_deg": (found.toward_deg, SPREAD_TOWARD_LAYER),
        "flame_length_m": (found.flame_length_m, FLAME_LENGTH_LAYER),
        "fireline_intensity_kw_m": (found.intensity_kw_m, INTENSITY_LAYER),
        "state": (fire.state_at(fire.time_s), STATE_LAYER),
        "fuel_model": (codes, fuel_layer(codes)),
    }
    if fire.rate_options.crown != "none":
        winds = crown_winds_of(fire)
        layers["crown_fraction"] = (found.crown_fraction, CROWN_FRACTION_LAYER)
        layers["torching_wind_m_s"] = (winds.torching_m_s, TORCHING_WIND_LAYER)
        layers["crowning_wind_m_s"] = (winds.crowning_m_s, CROWNING_WIND_LAYER)
    paths = {}
    for name, (values, layer) in layers.items():
        paths[name] = Path(folder) / f"{name}.tif"
        write_raster(paths[name], values, fire.landscape, layer)
    return paths
