"""Write all products of an incident to a folder."""

import json
from pathlib import Path

from firemodel.outputs.whole_file import write_whole
from mission_service.products.features import layers_of
from mission_service.products.geospatial_pdf import write_pdf, write_png
from mission_service.products.incident import Incident
from mission_service.products.incident_rasters import (
    ARRIVAL,
    FLAME_LENGTH,
    PROBABILITY,
    write_rasters,
)
from mission_service.products.interpreter_log import log_text
from mission_service.products.kmz import write_kmz
from mission_service.products.map_page import A4, LETTER, draw_page
from mission_service.products.stac_item import stac_item
from mission_service.products.vector_files import write_geopackage, write_shapefile
from mission_service.runtime.run_outputs import write_drops

ITEM = "stac-item.json"
RASTER_TITLES = {
    ARRIVAL: "Arrival time of fire, estimated and forecast (s of mission time)",
    PROBABILITY: "Burn probability by the end of the forecast",
    FLAME_LENGTH: "Flame length of the front at its arrival (m)",
}

NOT_ALWAYS_WRITTEN = {
    *("incident.gpkg", "incident.kmz", "perimeter.zip", "drops.csv"),
    *(f"{name}.{suffix}" for name in RASTER_TITLES for suffix in ("tif", "qml")),
}


def write_products(out: Path, incident: Incident) -> list[str]:
    """Write the products; return the names of the files.

    Equal incidents give identical files. Products of an earlier call that this call does not write
    are removed. Raises FireModelError if a file cannot be written.
    """
    written, titles = incident.utc(incident.at_s), {}
    layers = layers_of(incident)
    if layers:
        write_geopackage(out / "incident.gpkg", layers, written)
        titles["incident.gpkg"] = "All vector layers (GeoPackage)"
        write_kmz(out / "incident.kmz", incident, layers)
        titles["incident.kmz"] = "All vector layers by time (KMZ)"
    if "perimeter" in layers:
        write_shapefile(out / "perimeter.zip", "perimeter", layers["perimeter"], written)
        titles["perimeter.zip"] = "Fire perimeter (Shapefile)"
    for size in (LETTER, A4):
        page = draw_page(incident, size)
        name = f"map-{size.name}.pdf"
        write_pdf(out / name, page, incident.landscape, f"{incident.name} fire map", written)
        titles[name] = f"Georeferenced map, {size.name}"
        if size is LETTER:
            sidecar = write_png(out / "map.png", page, incident.landscape)
            titles["map.png"] = "Map"
            titles[sidecar.name] = "Georeference of map.png"
    for path in write_rasters(out, incident):
        titles[path.name] = RASTER_TITLES[path.stem]
        titles[f"{path.stem}.qml"] = "QGIS style for the raster of the same name"
    if any(vehicle.drops for vehicle in incident.record.vehicles.values()):
        write_drops(out / "drops.csv", incident.record)
        titles["drops.csv"] = "Drops"
    for name in NOT_ALWAYS_WRITTEN.difference(titles):
        (out / name).unlink(missing_ok=True)
    names = [*titles, "interpreter-log.txt"]
    write_whole(out / "interpreter-log.txt", log_text(incident, names))
    titles["interpreter-log.txt"] = "Interpreter's log"
    item = json.dumps(stac_item(incident, titles), indent=2)
    write_whole(out / ITEM, item + "\n")
    return [*titles, ITEM]
