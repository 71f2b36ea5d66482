"""Describe the products of an incident as a STAC item (version 1.1.0)."""

from pathlib import Path
from typing import Any

from firemodel.landscape.landscape import transformers
from mission_service.products.incident import NOTE, Incident

VERSION = "1.1.0"
MEDIA = {
    ".gpkg": "application/geopackage+sqlite3",
    ".zip": "application/zip",
    ".kmz": "application/vnd.google-earth.kmz",
    ".png": "image/png",
    ".pdf": "application/pdf",
    ".tif": "image/tiff; application=geotiff; profile=cloud-optimized",
    ".txt": "text/plain",
    ".csv": "text/csv",
    ".qml": "application/xml",
    ".xml": "application/xml",
}
ROLES = {
    ".png": "overview",
    ".txt": "metadata",
    ".qml": "metadata",
    ".xml": "metadata",
    ".pdf": "overview",
}


def stac_item(incident: Incident, files: dict[str, str]) -> dict[str, Any]:
    """Return the item for ``files`` (titles by name), which are in the item's folder."""
    bounds = _bounds(incident)
    at = _text(incident, incident.at_s)
    assets = {}
    for name, title in files.items():
        ending = Path(name).suffix
        assets[name.replace(".", "_")] = {
            "href": f"./{name}",
            "title": title,
            "type": MEDIA[ending],
            "roles": [ROLES.get(ending, "data")],
        }
    properties = {
        "title": f"{incident.name}: fire at {at}",
        "description": NOTE,
        "datetime": at,
        "created": at,
    }
    if incident.forecast_s:
        properties["end_datetime"] = _text(incident, incident.at_s + incident.forecast_s)
        properties["start_datetime"] = at
    return {
        "type": "Feature",
        "stac_version": VERSION,
        "stac_extensions": [],
        "id": _identifier(incident),
        "geometry": _geometry(*bounds),
        "bbox": bounds,
        "properties": properties,
        "links": [],
        "assets": assets,
    }


def _identifier(incident: Incident) -> str:
    name = "".join(each if each.isalnum() else "-" for each in incident.name)
    return f"{name}-{incident.utc(incident.at_s):%Y%m%dT%H%M%SZ}"


def _text(incident: Incident, at_s: float) -> str:
    return f"{incident.utc(at_s):%Y-%m-%dT%H:%M:%SZ}"


def _geometry(west: float, south: float, east: float, north: float) -> dict[str, Any]:
    """Return a rectangle (WGS84), cut at the antimeridian if west is greater than east."""
    spans = [(west, east)] if west <= east else [(west, 180.0), (-180.0, east)]
    rings = [
        [[[low, south], [high, south], [high, north], [low, north], [low, south]]]
        for low, high in spans
    ]
    if len(rings) == 1:
        return {"type": "Polygon", "coordinates": rings[0]}
    return {"type": "MultiPolygon", "coordinates": rings}


def _bounds(incident: Incident) -> list[float]:
    """Return west, south, east, north (WGS84) of the landscape, which the rasters cover.

    Across the antimeridian, west is greater than east (RFC 7946, 5.2).
    """
    land = incident.landscape
    east_m = land.west_m + land.shape[1] * land.cell_size_m
    to_lon_lat = transformers(land.crs)[0]
    found = to_lon_lat.transform_bounds(land.west_m, land.south_m, east_m, land.north_m)
    return [round(float(each), 7) for each in found]
