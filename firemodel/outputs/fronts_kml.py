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

    With a calendar date each front has a TimeSpan that ends when the next front begins, so that
    Google Earth's time slider shows the fire's growth. Without a date the fronts have no times.

    Args:
        collection: The result of ``fronts_geojson``, in order of time.
        name: The incident's name.
        layer: The arrival time layer; its classes define the colours.
        zero: The calendar time of 0 s, if there is one.

    Returns:
        The text of a .kml file.
    """
    root, document = kml_document(name, f"{NOTE} Times are {after_zero(zero)}.")
    add_class_styles(document, layer)
    features = collection["features"]
    for feature, following in pairwise([*features, None]):
        _add_placemark(document, feature, following, layer, zero)
    return kml_text(root)


def kml_document(name: str, description: str) -> tuple[Element, Element]:
    """Return the root of a KML file, and the file's document with a name and a description."""
    root = Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2"})
    document = SubElement(root, "Document")
    add_text(document, "name", name)
    add_text(document, "description", description)
    return root, document


def kml_text(root: Element) -> str:
    """Return the text of a .kml file."""
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def add_class_styles(document: Element, layer: Layer) -> None:
    """Add the styles ``class0``, ``class1``, ... with the colours of a layer's classes."""
    for number, each in enumerate(layer.classes):
        colour = kml_colour(each.colour)
        add_style(document, f"class{number}", line=(f"ff{colour}", "2"), fill=f"66{colour}")


def add_style(document: Element, name: str, line: tuple[str, str], fill: str) -> None:
    """Add a style with a line (colour as aabbggrr, width in pixels) and a fill."""
    style = SubElement(document, "Style", {"id": name})
    of_line, of_fill = SubElement(style, "LineStyle"), SubElement(style, "PolyStyle")
    add_text(of_line, "color", line[0])
    add_text(of_line, "width", line[1])
    add_text(of_fill, "color", fill)


def kml_colour(colour: str) -> str:
    """Convert #rrggbb to the bbggrr of KML."""
    return colour[5:7] + colour[3:5] + colour[1:3]


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
    add_text(placemark, "name", f"{at}: {area}")
    if zero is not None:
        end_s = None if following is None else following["properties"]["time_s"]
        add_span(placemark, zero, time_s, end_s)
    add_text(placemark, "styleUrl", f"#class{class_of(layer, time_s)}")
    add_data(placemark, properties)
    add_polygons(placemark, feature["geometry"])


def add_span(placemark: Element, zero: datetime, begin_s: float, end_s: float | None) -> None:
    """Add a TimeSpan in seconds after the calendar time ``zero``; an end of None leaves it open."""
    span = SubElement(placemark, "TimeSpan")
    add_text(span, "begin", _instant(zero, begin_s))
    if end_s is not None:
        add_text(span, "end", _instant(zero, end_s))


def add_data(placemark: Element, properties: dict[str, Any]) -> None:
    """Add the properties of a feature, which viewers show as a table."""
    data = SubElement(placemark, "ExtendedData")
    for key, value in properties.items():
        add_text(SubElement(data, "Data", {"name": key}), "value", str(value))


def add_polygons(placemark: Element, geometry: dict[str, Any]) -> None:
    """Add a GeoJSON MultiPolygon."""
    shapes = SubElement(placemark, "MultiGeometry")
    for rings in geometry["coordinates"]:
        polygon = SubElement(shapes, "Polygon")
        for side, ring in zip(_sides(), rings, strict=False):
            edge = SubElement(SubElement(polygon, side), "LinearRing")
            add_text(edge, "coordinates", " ".join(f"{lon!r},{lat!r}" for lon, lat in ring))


def _sides() -> Iterator[str]:
    yield "outerBoundaryIs"
    while True:
        yield "innerBoundaryIs"


def _instant(zero: datetime, time_s: float) -> str:
    return (zero + timedelta(seconds=time_s)).isoformat(timespec="seconds")


def add_text(parent: Element, tag: str, text: str) -> None:
    """Add an element with text, without the characters that XML does not allow."""
    SubElement(parent, tag).text = "".join(each for each in text if each.isprintable())
