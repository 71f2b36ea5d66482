"""Convert the fronts of a fire to KML 2.2 with calendar times, for example for Google Earth."""

from collections.abc import Iterator
from datetime import datetime, timedelta
from itertools import pairwise
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from firemodel.outputs.layer_legends import Layer, after_zero, class_of

NOTE = "Simulated, not approved. Not for navigation."


def fronts_kml(collection: dict[str, Any], name: str, layer: Layer, zero: datetime | None) -> str:
    """Convert the GeoJSON of ``fronts_geojson`` to KML.

    With a calendar date each front has a TimeSpan that ends when the next front begins, so that the
    time slider of Google Earth shows the fire's growth. Without a date the fronts have no times.

    Args:
        collection: The result of ``fronts_geojson``, in order of time.
        name: The incident's name.
        layer: The layer of arrival times; the classes of the layer define the colours.
        zero: The calendar time of 0 s, if there is one.

    Returns:
        The text of a .kml file.
    """
    root = Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2"})
    document = SubElement(root, "Document")
    _add(document, "name", name)
    _add(document, "description", f"{NOTE} Times are {after_zero(zero)}.")
    for number, each in enumerate(layer.classes):
        style = SubElement(document, "Style", {"id": f"class{number}"})
        line, fill = SubElement(style, "LineStyle"), SubElement(style, "PolyStyle")
        opaque = "".join(
            f"{part:02x}" for part in reversed(each.rgb)
        )  # KML: alpha, blue, green, red
        _add(line, "color", f"ff{opaque}")
        _add(line, "width", "2")
        _add(fill, "color", f"66{opaque}")
    features = collection["features"]
    for feature, following in pairwise([*features, None]):
        _add_placemark(document, feature, following, layer, zero)
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _add_placemark(
    document: Element,
    feature: dict[str, Any],
    following: dict[str, Any] | None,
    layer: Layer,
    zero: datetime | None,
) -> None:
    properties = feature["properties"]
    time_s = properties["time_s"]
    placemark = SubElement(document, "Placemark")
    after = f"{time_s / 3600.0:.4g} h"
    at = after if zero is None else f"{zero + timedelta(seconds=time_s):%Y-%m-%d %H:%M} ({after})"
    area = f"{properties['area_ha']:,.1f} ha ({properties['GISAcres']:,.1f} acres)"
    _add(placemark, "name", f"{at}: {area}")
    if zero is not None:
        span = SubElement(placemark, "TimeSpan")
        _add(span, "begin", _instant(zero, time_s))
        if following is not None:
            _add(span, "end", _instant(zero, following["properties"]["time_s"]))
    _add(placemark, "styleUrl", f"#class{class_of(layer, time_s)}")
    data = SubElement(placemark, "ExtendedData")
    for key, value in properties.items():
        _add(SubElement(data, "Data", {"name": key}), "value", str(value))
    shapes = SubElement(placemark, "MultiGeometry")
    for rings in feature["geometry"]["coordinates"]:
        polygon = SubElement(shapes, "Polygon")
        for side, ring in zip(_sides(), rings, strict=False):
            edge = SubElement(SubElement(polygon, side), "LinearRing")
            _add(edge, "coordinates", " ".join(f"{lon!r},{lat!r}" for lon, lat in ring))


def _sides() -> Iterator[str]:
    yield "outerBoundaryIs"
    while True:
        yield "innerBoundaryIs"


def _instant(zero: datetime, time_s: float) -> str:
    return (zero + timedelta(seconds=time_s)).isoformat(timespec="seconds")


def _add(parent: Element, tag: str, text: str) -> None:
    """Add an element with a text, without the characters that XML does not allow."""
    SubElement(parent, tag).text = "".join(each for each in text if each.isprintable())
