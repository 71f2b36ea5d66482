"""Define a perimeter's attributes in the US interagency standard (WFIGS, NWCG event polygon)."""

from typing import Any

SOURCE = "mission-service"
STATUS = "Proposed"  # "Approved" requires a person's decision
MAP_METHOD = "Modeled"
M2_PER_ACRE = 4046.8564224


def feature_category(prescribed: bool) -> str:
    """Return the category of a wildfire's or a prescribed fire's perimeter."""
    return "Prescribed Fire" if prescribed else "Wildfire Daily Fire Perimeter"


def event_polygon(
    name: str,
    category: str,
    acres: float,
    written_unix_ms: int,
    at_unix_ms: int | None,
) -> dict[str, Any]:
    """Return the attributes of an unapproved event polygon, without the prefix ``poly_``.

    Args:
        name: The incident's name.
        category: The FeatureCategory, for example that of ``feature_category``.
        acres: The area in acres (4046.8564224 m²).
        written_unix_ms: The time of the record, in ms since 1970 UTC.
        at_unix_ms: The time that the polygon represents, in ms since 1970 UTC, if it is known.
    """
    return {
        "IncidentName": name,
        "FeatureCategory": category,
        "MapMethod": MAP_METHOD,
        "GISAcres": round(acres, 2),
        "CreateDate": written_unix_ms,
        "DateCurrent": written_unix_ms,
        "PolygonDateTime": at_unix_ms,
        "IRWINID": None,
        "Source": SOURCE,
        "FeatureAccess": None,
        "FeatureStatus": STATUS,
        "IsVisible": None,
    }


def geodesic_acres(geometry: dict[str, Any]) -> float:
    """Return a GeoJSON MultiPolygon's area in acres on the WGS84 ellipsoid.

    Outer rings are anticlockwise, as in RFC 7946.
    """
    from pyproj import Geod
    from shapely.geometry import shape

    area_m2, _ = Geod(ellps="WGS84").geometry_area_perimeter(shape(geometry))
    return float(area_m2) / M2_PER_ACRE
