"""Perimeters as KML, for tests of readers."""

from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np


def perimeter_kml(collection: dict[str, Any]) -> bytes:
    """Return the result of ``perimeter_geojson`` as KML 2.2, with its fields as extended data."""
    placemarks = "".join(_placemark(feature) for feature in collection["features"])
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        '<Style id="fire"><LineStyle><color>ff0000ff</color><width>3</width></LineStyle>'
        "<PolyStyle><color>330000ff</color></PolyStyle></Style>"
        f"{placemarks}</Document></kml>\n"
    ).encode()


def _placemark(feature: dict[str, Any]) -> str:
    properties = feature["properties"]
    data = "".join(
        f"<Data name={quoteattr(key)}><value>{_text(value)}</value></Data>"
        for key, value in properties.items()
        if value is not None
    )
    when, of_when_ms = "", properties["PolygonDateTime"]
    if of_when_ms is not None:
        when = f"<TimeStamp><when>{np.datetime64(of_when_ms, 'ms')}Z</when></TimeStamp>"
    polygons = "".join(_polygon(rings) for rings in feature["geometry"]["coordinates"])
    return (
        f"<Placemark><name>{_text(properties['IncidentName'])}</name>{when}"
        f"<styleUrl>#fire</styleUrl><ExtendedData>{data}</ExtendedData>"
        f"<MultiGeometry>{polygons}</MultiGeometry></Placemark>"
    )


def _polygon(rings: list[list[list[float]]]) -> str:
    sides = ["outerBoundaryIs"] + ["innerBoundaryIs"] * (len(rings) - 1)
    edges = "".join(
        f"<{side}><LinearRing><coordinates>"
        f"{' '.join(f'{lon!r},{lat!r},0' for lon, lat in ring)}"
        f"</coordinates></LinearRing></{side}>"
        for side, ring in zip(sides, rings, strict=True)
    )
    return f"<Polygon>{edges}</Polygon>"


def _text(value: Any) -> str:
    """Return escaped text without characters that XML does not allow."""
    return escape("".join(c for c in str(value) if c >= " " or c in "\t\n"))
