"""Write valid files of each kind that the sensor ``observation_files`` reads, for one landscape."""

import json
import zipfile
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from firemodel.landscape.landscape import Landscape

Ring = list[tuple[float, float]]  # longitude, latitude


def ring_of(land: Landscape, top: int, left: int, below: int, right: int) -> Ring:
    """Return the closed outline of cells of a landscape, in longitude and latitude."""
    cells = ((top, left), (top, right), (below, right), (below, left), (top, left))
    found = (land.lat_lon_of(*land.xy_of(float(row), float(col))) for row, col in cells)
    return [(round(float(lon), 6), round(float(lat), 6)) for lat, lon in found]


def write_geojson(path: Path, features: list[tuple[Any, dict[str, Any]]]) -> None:
    """Write shapes (longitude, latitude) with their properties."""
    content = {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": properties,
                "geometry": shapely.geometry.mapping(shape),
            }
            for shape, properties in features
        ],
    }
    path.write_text(json.dumps(content), encoding="utf-8")


def kml_of(ring: Ring, at: datetime) -> str:
    """Return a KML document with one polygon."""
    points = " ".join(f"{lon},{lat},0" for lon, lat in ring)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">'
        f"<Document><Placemark><name>Heat perimeter</name><TimeStamp><when>{at.isoformat()}</when>"
        "</TimeStamp><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{points}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document>"
        "</kml>"
    )


def write_layer(path: Path, ring: Ring, at: datetime, driver: str) -> None:
    """Write a polygon with the fields of WFIGS as a GeoPackage or a Shapefile."""
    import pyogrio

    pyogrio.raw.write(
        path,
        np.array([shapely.to_wkb(shapely.Polygon(ring))], dtype=object),
        [np.array([text], dtype=object) for text in (at.isoformat(), "WFIGS", "GPS-Walked")],
        ["PolygonDat", "Source", "MapMethod"],
        layer=path.stem,
        driver=driver,
        geometry_type="Polygon",
        crs="EPSG:4326",
    )


def write_mask(path: Path, land: Landscape, burned: Any, at: datetime, cell_m: float) -> None:
    """Write burned cells (y, x), from the landscape's north-west corner, as a GeoTIFF."""
    import rasterio

    transform = rasterio.Affine(cell_m, 0.0, land.west_m, 0.0, -cell_m, land.north_m)
    values = np.asarray(burned, dtype=np.uint8)
    shape = {"height": values.shape[0], "width": values.shape[1], "count": 1}
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        dtype="uint8",
        crs=land.crs,
        transform=transform,
        nodata=255,
        **shape,
    ) as file:
        file.write(values, 1)
        file.update_tags(TIFFTAG_DATETIME=f"{at:%Y:%m:%d %H:%M:%S}")


VIIRS = (
    "latitude,longitude,bright_ti4,scan,track,acq_date,acq_time,satellite,instrument,confidence,"
    "version,bright_ti5,frp,daynight\n"
)


def viirs_line(lat_deg: float, lon_deg: float, at: datetime, confidence: str = "h") -> str:
    """Return a line as in the files of FIRMS."""
    clock = f"{at:%Y-%m-%d},{at:%H%M}"
    return f"{lat_deg},{lon_deg},340.1,0.39,0.36,{clock},N,VIIRS,{confidence},2.0NRT,295.2,5.1,D\n"


def write_samples(folder: Path, land: Landscape, at: datetime) -> list[Path]:
    """Write a file of each kind with observations of about the same cells; return the files."""
    ring, island = ring_of(land, 50, 50, 90, 90), ring_of(land, 60, 60, 70, 70)
    line = shapely.LineString(ring_of(land, 20, 20, 30, 60)[:2])
    wfigs = {
        "poly_PolygonDateTime": round(at.timestamp() * 1000),
        "poly_Source": "WFIGS",
        "poly_IncidentName": "Jones",
        "poly_MapMethod": "Infrared Image",
        "poly_FeatureCategory": "Wildfire Daily Fire Perimeter",
    }
    points = shapely.MultiPoint(ring_of(land, 20, 20, 30, 60))
    writers: dict[str, Callable[[Path], object]] = {
        "shapes.geojson": lambda path: write_geojson(
            path, [(shapely.Polygon(ring, [island]), wfigs), (line, wfigs), (points, wfigs)]
        ),
        "perimeter.kml": lambda path: path.write_text(kml_of(ring, at), encoding="utf-8"),
        "perimeter.gpkg": lambda path: write_layer(path, ring, at, "GPKG"),
        "perimeter.shp": lambda path: write_layer(path, ring, at, "ESRI Shapefile"),
        "mask.tif": lambda path: write_mask(path, land, np.eye(60, dtype=bool), at, 30.0),
        "viirs.csv": lambda path: path.write_text(
            VIIRS + "".join(viirs_line(lat, lon, at) for lon, lat in ring), encoding="utf-8"
        ),
    }
    for name, write in writers.items():
        write(folder / name)
    found = [folder / name for name in writers]
    archives = {
        "perimeter.kmz": {"doc.kml": folder / "perimeter.kml"},
        "perimeter.zip": {path.name: path for path in sorted(folder.glob("perimeter.[sdpc]*"))},
    }
    for name, members in archives.items():
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
            for inside, path in members.items():
                if path.suffix != ".zip":
                    archive.write(path, inside)
        found.append(folder / name)
    return found
