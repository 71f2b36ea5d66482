"""Write an incident as KMZ: fronts, isochrones, uncertainty, heat, drops and notes, with styles.

Each feature has a TimeSpan in calendar time, so that the time slider of Google Earth or ATAK shows
the growth of the fire.
"""

import html
import io
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from firemodel.outputs.fronts_kml import (
    add_class_styles,
    add_data,
    add_polygons,
    add_span,
    add_style,
    add_text,
    kml_colour,
    kml_document,
    kml_text,
)
from firemodel.outputs.layer_legends import arrival_layer, class_of
from mission_service.products.features import Feature
from mission_service.products.heat import INTENSE
from mission_service.products.incident import NOTE, Incident
from mission_service.products.note_pictures import picture_of
from mission_service.products.vector_files import write_zip

AHEAD, LIKELY, HOT, DROP = "#6a1b9a", "#0b57a4", "#e00000", "#4a148c"
NOTED = "#ffb300"
PICTURE_WIDTH = 480  # pixels
MAX_TITLE = 60  # characters of a note in the name of its placemark
CIRCLE, CIRCLE_PIXELS = "circle.png", 32  # white; the styles give the colour
FOLDERS = {
    "fronts": "Fire perimeter by time",
    "forecast_isochrones": "Forecast perimeter",
    "burn_probability": "Burn probability at the end of the forecast",
    "heat_areas": "Heat: areas",
    "heat_points": "Heat: isolated sources",
    "drops": "Drops",
    "notes": "Notes",
}


def write_kmz(path: Path, incident: Incident, layers: dict[str, list[Feature]]) -> None:
    """Write the layers of ``features.layers_of`` as one KMZ with calendar times."""
    now = incident.in_words(incident.at_s)
    root, document = kml_document(incident.name, f"{NOTE} State at {now}.")
    times_s = incident.past_times_s()
    layer = arrival_layer(min(float(incident.arrival.arrival_s.min()), times_s[-1]), times_s[-1],
                          incident.time_zero)  # fmt: skip
    add_class_styles(document, layer)
    _add_styles(document)
    pictures = _pictures(incident)
    for key, title in FOLDERS.items():
        if key in layers:
            folder = SubElement(document, "Folder")
            add_text(folder, "name", title)
            ends_s = [*(each["properties"]["at_s"] for each in layers[key][1:]), None]
            for feature, end_s in zip(layers[key], ends_s, strict=True):
                front_style = f"class{class_of(layer, feature['properties']['at_s'])}"
                placemark = _add_placemark(folder, incident, key, feature, (end_s, front_style))
                if key == "notes":
                    _add_description(placemark, feature, pictures)
    text = kml_text(root)
    contents = {"doc.kml": text.encode(), CIRCLE: _circle(), **pictures}
    write_zip(path, contents, incident.utc(incident.at_s))


def _circle() -> bytes:
    """Return the point icon as a PNG, embedded in the file because viewers may be offline."""
    from PIL import Image, ImageDraw

    image = Image.new("RGBA", (CIRCLE_PIXELS, CIRCLE_PIXELS), (255, 255, 255, 0))
    ImageDraw.Draw(image).ellipse((2, 2, CIRCLE_PIXELS - 3, CIRCLE_PIXELS - 3), fill="white")
    data = io.BytesIO()
    image.save(data, "png")
    return data.getvalue()


def _add_styles(document: Element) -> None:
    """Add the styles of all features except fronts."""
    for name, colour, alpha in (
        ("ahead", AHEAD, "00"),
        ("likely", LIKELY, "22"),
        ("hot", HOT, "88"),
        ("scattered", HOT, "33"),
    ):
        add_style(document, name, (f"ff{kml_colour(colour)}", "2"), f"{alpha}{kml_colour(colour)}")
    for name, colour in (("source", HOT), ("drop", DROP), ("note", NOTED)):
        icon = SubElement(SubElement(document, "Style", {"id": name}), "IconStyle")
        add_text(icon, "color", f"ff{kml_colour(colour)}")
        add_text(icon, "scale", "0.6")
        add_text(SubElement(icon, "Icon"), "href", CIRCLE)


def _add_placemark(
    folder: Element,
    incident: Incident,
    key: str,
    feature: Feature,
    of_front: tuple[float | None, str],
) -> Element:
    """Add a feature; ``of_front`` are the time of the next front (None: no end) and the style."""
    properties, geometry = feature["properties"], feature["geometry"]
    placemark = SubElement(folder, "Placemark")
    at_s = properties["at_s"]
    when = incident.in_words(at_s)
    acres = properties.get("poly_GISAcres")
    area = "" if acres is None else f": {acres:,.0f} acres"
    begin_s: float = at_s
    end_s: float | None = None
    match key:
        case "fronts":
            name, (end_s, style) = f"{when}{area}", of_front
        case "forecast_isochrones":
            name, style = f"Forecast {when}{area}", "ahead"
        case "burn_probability":
            name, style = f"{properties['probability']:.0%} by {when}{area}", "likely"
            begin_s = incident.at_s
        case "heat_areas":
            category = properties["poly_FeatureCategory"]
            name, style = f"{category}{area}", "hot" if category == INTENSE else "scattered"
        case "heat_points":
            name, style = properties["poly_FeatureCategory"], "source"
        case "notes":
            text = properties["text"]
            title = text if len(text) <= MAX_TITLE else f"{text[: MAX_TITLE - 1]}…"
            name, style = f"{when}: {title or 'photo'}", "note"
        case _:
            name, style = f"{properties['vehicle']} {when}: {properties['outcome']}", "drop"
    add_text(placemark, "name", name)
    add_span(placemark, incident.time_zero, begin_s, end_s)
    add_text(placemark, "styleUrl", f"#{style}")
    add_data(placemark, properties)
    if geometry["type"] == "Point":
        lon, lat = geometry["coordinates"]
        add_text(SubElement(placemark, "Point"), "coordinates", f"{lon!r},{lat!r}")
    else:
        add_polygons(placemark, geometry)
    return placemark


def _pictures(incident: Incident) -> dict[str, bytes]:
    """Return the pictures of the notes by their names in the archive."""
    photos = {note.photo for note in incident.notes if note.photo}
    made = {_picture_name(photo): picture_of(incident.run, photo) for photo in sorted(photos)}
    return {name: data for name, data in made.items() if data is not None}


def _picture_name(photo: str) -> str:
    return f"photos/{photo.partition('.')[0]}.jpg"


def _add_description(placemark: Element, note: Feature, pictures: dict[str, bytes]) -> None:
    """Insert a description (text, author, picture) after the name, as the KML schema requires."""
    properties = note["properties"]
    lines = [html.escape(each) for each in (properties["text"], properties["author"]) if each]
    if photo := properties["photo"]:
        name = _picture_name(photo)
        lines.append(
            f'<img src="{name}" width="{PICTURE_WIDTH}"/>'
            if name in pictures
            else f"The photo {html.escape(photo)} is missing from the folder or was changed."
        )
    description = Element("description")
    description.text = "<br/>".join(lines)
    placemark.insert(1, description)
