"""Results as files that other programs read."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.front import polygons
from firemodel.landscape import Landscape

M2_PER_ACRE = 4046.8564224


def write_geotiff(
    path: Path, values: NDArray[Any], landscape: Landscape, nodata: float | None = None
) -> None:
    """One band on the landscape's grid."""
    import rasterio
    from rasterio.transform import from_origin

    cell_m = landscape.cell_size_m
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=landscape.shape[0],
        width=landscape.shape[1],
        count=1,
        dtype=values.dtype,
        crs=landscape.crs,
        transform=from_origin(landscape.west_m, landscape.north_m, cell_m, cell_m),
        nodata=nodata,
        compress="deflate",
    ) as file:
        file.write(values, 1)


def perimeters_geojson(
    arrival_time_s: NDArray[np.float64], landscape: Landscape, times_s: list[float]
) -> dict[str, Any]:
    """Burned area at each time as a MultiPolygon (RFC 7946: WGS84, outer rings anticlockwise)."""
    from shapely.geometry import MultiPolygon, mapping
    from shapely.geometry.polygon import orient
    from shapely.ops import transform

    def to_lon_lat(x_m: Any, y_m: Any, _z_m: Any = None) -> tuple[Any, Any]:
        lat, lon = landscape.lat_lon_of(x_m, y_m)
        return np.round(lon, 7), np.round(lat, 7)

    features = []
    for time_s in times_s:
        regions = polygons(arrival_time_s <= time_s, landscape)
        area_m2 = sum(region.area for region in regions)
        shape = MultiPolygon([orient(transform(to_lon_lat, region)) for region in regions])
        features.append(
            {
                "type": "Feature",
                "properties": {
                    "time_s": time_s,
                    "area_ha": round(area_m2 / 1e4, 2),
                    "GISAcres": round(area_m2 / M2_PER_ACRE, 2),
                },
                "geometry": mapping(shape),
            }
        )
    return {"type": "FeatureCollection", "features": features}


def write_perimeters(
    path: Path,
    arrival_time_s: NDArray[np.float64],
    landscape: Landscape,
    times_s: list[float],
) -> None:
    """Write ``perimeters_geojson`` to a file."""
    found = perimeters_geojson(arrival_time_s, landscape, times_s)
    path.write_text(json.dumps(found) + "\n", encoding="utf-8")
