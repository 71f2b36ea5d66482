"""Make the vector layers of an incident as GeoJSON features (WGS84) with WFIGS attributes."""

from typing import Any

from shapely import get_coordinates

from firemodel.outputs.event_polygon import event_polygon, feature_category, geodesic_acres
from firemodel.outputs.front_files import area_geometry
from firemodel.spread.front import multipolygon
from mission_service.products.heat import INTENSE, ISOLATED, SCATTERED
from mission_service.products.incident import LEVELS, Incident

Feature = dict[str, Any]


def perimeter(incident: Incident) -> Feature:
    """Return the current perimeter."""
    return _polygon(incident, incident.perimeter, incident.at_s)


def fronts(incident: Incident) -> list[Feature]:
    """Return the perimeter now, and at each earlier hour of mission time at which fire existed."""
    return [
        _polygon(incident, geometry, at_s)
        for at_s in incident.past_times_s()
        if (geometry := area_geometry(incident.area(at_s), incident.landscape))["coordinates"]
    ]


def forecast_isochrones(incident: Incident) -> list[Feature]:
    """Return the forecast perimeter (median of the ensemble) at each hour ahead."""
    return [
        _polygon(
            incident, area_geometry(incident.area(at_s), incident.landscape), at_s,
            ahead_h=round((at_s - incident.at_s) / 3600.0, 3),
        )
        for at_s in incident.forecast_times_s()
    ]  # fmt: skip


def burn_probability(incident: Incident) -> list[Feature]:
    """Return the areas that burn by the end of the forecast with 10, 50 and 90 % probability."""
    if incident.probability is None:
        return []
    end_s = incident.at_s + incident.forecast_s
    return [
        _polygon(
            incident, area_geometry(incident.likely_area(level), incident.landscape), end_s,
            probability=level,
        )
        for level in LEVELS
    ]  # fmt: skip


def heat_areas(incident: Incident) -> list[Feature]:
    """Return the areas of intense and scattered heat."""
    found = []
    for category, areas in ((INTENSE, incident.heat.intense), (SCATTERED, incident.heat.scattered)):
        for area in areas:
            geometry = area_geometry(multipolygon(area), incident.landscape)
            found.append(_polygon(incident, geometry, incident.at_s, category))
    return found


def heat_points(incident: Incident) -> list[Feature]:
    """Return the isolated heat sources."""
    found = []
    for point in incident.heat.isolated:
        (x_m, y_m), *_ = get_coordinates(point)
        lat, lon = incident.landscape.lat_lon_of(x_m, y_m)
        properties = _attributes(incident, incident.at_s, ISOLATED, 0.0)
        del properties["poly_GISAcres"]
        found.append(_feature("Point", [round(float(lon), 7), round(float(lat), 7)], properties))
    return found


def drops(incident: Incident) -> list[Feature]:
    """Return the drops."""
    found = []
    for name, vehicle in incident.record.vehicles.items():
        for drop in vehicle.drops:
            at_s = drop.at_us / 1e6
            properties = {
                "vehicle": name,
                "at_s": at_s,
                "DateTime": incident.unix_ms(at_s),
                "outcome": drop.outcome,
            }
            place = [round(drop.lon_deg, 7), round(drop.lat_deg, 7)]
            found.append(_feature("Point", place, properties))
    return found


def notes(incident: Incident) -> list[Feature]:
    """Return the operators' notes about places, with the names of their photos."""
    found = []
    for note in incident.notes:
        at_s = note.at_us / 1e6
        properties = {
            "author": note.by,
            "at_s": at_s,
            "DateTime": incident.unix_ms(at_s),
            "text": note.text,
            "photo": note.photo,
        }
        place = [round(note.lon_deg, 7), round(note.lat_deg, 7)]
        found.append(_feature("Point", place, properties))
    return found


def layers_of(incident: Incident) -> dict[str, list[Feature]]:
    """Return all layers that contain features, by name, the perimeter first."""
    found = {
        "perimeter": [perimeter(incident)] if incident.perimeter["coordinates"] else [],
        "fronts": fronts(incident),
        "forecast_isochrones": forecast_isochrones(incident),
        "burn_probability": burn_probability(incident),
        "heat_areas": heat_areas(incident),
        "heat_points": heat_points(incident),
        "drops": drops(incident),
        "notes": notes(incident),
    }
    return {
        name: features
        for name, layer in found.items()
        if (features := [each for each in layer if each["geometry"]["coordinates"]])
    }


def _polygon(
    incident: Incident,
    geometry: dict[str, Any],
    at_s: float,
    category: str | None = None,
    **more: Any,
) -> Feature:
    category = category or feature_category(incident.prescribed)
    properties = _attributes(incident, at_s, category, geodesic_acres(geometry))
    return {"type": "Feature", "properties": {**properties, **more}, "geometry": geometry}


def _attributes(incident: Incident, at_s: float, category: str, acres: float) -> dict[str, Any]:
    """Return the attributes; the record's time is that of the estimate, not of writing."""
    written_ms = incident.unix_ms(incident.at_s)
    found = event_polygon(incident.name, category, acres, written_ms, incident.unix_ms(at_s))
    return {**{f"poly_{key}": value for key, value in found.items()}, "at_s": at_s}


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> Feature:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}
