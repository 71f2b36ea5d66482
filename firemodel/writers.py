"""Results as files that other programs read."""

import json
from collections.abc import Sequence
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
    """Write an array (y, x) of the landscape's shape as one band on its grid."""
    import rasterio

    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=landscape.shape[0],
        width=landscape.shape[1],
        count=1,
        dtype=values.dtype,
        crs=landscape.crs,
        transform=landscape.transform(),
        nodata=nodata,
        compress="deflate",
    ) as file:
        file.write(values, 1)


def perimeters_geojson(
    arrival_time_s: NDArray[np.float64], landscape: Landscape, times_s: Sequence[float]
) -> dict[str, Any]:
    """Burned area at each time as a MultiPolygon (RFC 7946: WGS84, outer rings anticlockwise)."""
    from shapely import transform
    from shapely.geometry import MultiPolygon, mapping
    from shapely.geometry.polygon import orient

    def to_lon_lat(xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        lat, lon = landscape.lat_lon_of(*xy_m.T)
        return np.round(np.stack([lon, lat], axis=1), 7)

    features = []
    for time_s in times_s:
        regions = polygons(arrival_time_s <= time_s, landscape)
        area_m2 = sum(region.area for region in regions)
        shape = MultiPolygon([orient(transform(region, to_lon_lat)) for region in regions])
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
    times_s: Sequence[float],
) -> None:
    """Write ``perimeters_geojson`` to a file."""
    found = perimeters_geojson(arrival_time_s, landscape, times_s)
    path.write_text(json.dumps(found) + "\n", encoding="utf-8")
