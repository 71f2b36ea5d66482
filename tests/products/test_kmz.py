"""KMZ of features that short simulated runs do not have."""

import io
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring
from zipfile import ZipFile

import numpy as np
from PIL import Image
from shapely import Point, box

from mission_service.events import NoteAdded
from mission_service.products.features import layers_of
from mission_service.products.heat import Heat
from mission_service.products.kmz import write_kmz
from mission_service.products.note_pictures import picture_of
from mission_service.products.vector_files import write_geopackage
from mission_service.runtime.published_states import DropState
from mission_service.runtime.run_statistics import VehicleStatistics
from mission_service.uploaded_photos import FOLDER, store_photo
from tests.products.incidents import incident, land

KML = "{http://www.opengis.net/kml/2.2}"
# The sequences of the elements in the schema of KML 2.2.
PLACEMARK = (
    "name",
    "description",
    "TimeSpan",
    "styleUrl",
    "ExtendedData",
    "Point",
    "MultiGeometry",
)
STYLE = ("IconStyle", "LineStyle", "PolyStyle")


def photo() -> bytes:
    """Return a photo of 3000 x 1000 pixels, red at the left, that is to be shown turned right."""
    image = Image.new("RGB", (3000, 1000), "blue")
    image.paste((255, 0, 0), (0, 0, 1000, 1000))
    exif = Image.Exif()
    exif[0x0112] = 6
    data = io.BytesIO()
    image.save(data, "JPEG", exif=exif)
    return data.getvalue()


def note(by: str, text: str, photo_name: str) -> NoteAdded:
    return NoteAdded(8_000_000_000, by, "", text, 36.4, -84.2, photo_name)


def _document(path: Path) -> Element:
    x_m, y_m = land().xy_of(30, 40)
    heat = Heat([box(x_m, y_m, x_m + 100, y_m + 100)], [], [Point(x_m, y_m)])
    notes = [note("Hope", "Tank & <pump>", store_photo(path.parent, photo()))]
    found = incident(heat=heat, notes=notes, run=path.parent)
    drop = DropState(8_000_000_000, "heron", "hash", 0, 36.4, -84.2)
    found.record.vehicles["heron"] = VehicleStatistics(drops=[drop])
    layers = layers_of(found)
    assert {"heat_areas", "heat_points", "drops", "notes"} <= set(layers)
    write_kmz(path, found, layers)
    write_geopackage(path.with_suffix(".gpkg"), layers, found.utc(found.at_s))
    with ZipFile(path) as archive:
        return fromstring(archive.read("doc.kml"))


def test_elements_are_in_the_order_of_the_schema(tmp_path: Path) -> None:
    root = _document(tmp_path / "a.kmz")
    for kind, order in (("Placemark", PLACEMARK), ("Style", STYLE)):
        for each in root.iter(f"{KML}{kind}"):
            places = [order.index(child.tag.removeprefix(KML)) for child in each]
            assert places == sorted(places)


def test_heat_and_drops_are_dated_and_have_a_style(tmp_path: Path) -> None:
    root = _document(tmp_path / "a.kmz")
    styles = {f"#{each.get('id')}" for each in root.iter(f"{KML}Style")}
    folders = {each.findtext(f"{KML}name"): each for each in root.iter(f"{KML}Folder")}
    for name, begin, style in (
        ("Heat: areas", "2026-08-01T20:30:00+00:00", "#hot"),
        ("Heat: isolated sources", "2026-08-01T20:30:00+00:00", "#source"),
        ("Drops", "2026-08-01T20:13:20+00:00", "#drop"),
    ):
        (placemark,) = folders[name].iter(f"{KML}Placemark")
        assert placemark.findtext(f"{KML}TimeSpan/{KML}begin") == begin
        assert placemark.findtext(f"{KML}styleUrl") == style
        assert style in styles
    assert not [each.text for each in root.iter(f"{KML}begin") if "1970" in (each.text or "")]


def test_a_note_is_dated_and_shows_its_photo_upright(tmp_path: Path) -> None:
    root = _document(tmp_path / "a.kmz")
    (folder,) = [
        each for each in root.iter(f"{KML}Folder") if each.findtext(f"{KML}name") == "Notes"
    ]
    (placemark,) = folder.iter(f"{KML}Placemark")
    assert (placemark.findtext(f"{KML}name") or "").endswith(": Tank & <pump>")
    assert placemark.findtext(f"{KML}Point/{KML}coordinates") == "-84.2,36.4"
    assert placemark.findtext(f"{KML}TimeSpan/{KML}begin") == "2026-08-01T20:13:20+00:00"
    description = placemark.findtext(f"{KML}description") or ""
    assert description.startswith("Tank &amp; &lt;pump&gt;<br/>Hope<br/><img src=")
    with ZipFile(tmp_path / "a.kmz") as archive:
        (name,) = [each for each in archive.namelist() if each.startswith("photos/")]
        picture = Image.open(io.BytesIO(archive.read(name)))
    assert f'<img src="{name}" ' in description
    assert picture.size == (533, 1600)
    red, _, blue = np.asarray(picture)[200, 266]
    assert red > 200 > 60 > blue
    assert not picture.getexif()


def test_equal_notes_and_photos_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("a.kmz", "b.kmz"):
        _document(tmp_path / name)
    assert (tmp_path / "a.kmz").read_bytes() == (tmp_path / "b.kmz").read_bytes()


def test_a_missing_or_changed_photo_is_stated(tmp_path: Path) -> None:
    path = tmp_path / "a.kmz"
    found = incident(notes=[note("", "", store_photo(tmp_path, photo()))])
    (stored,) = (tmp_path / FOLDER).iterdir()
    stored.write_bytes(b"other")
    for run in (tmp_path, tmp_path / "elsewhere"):
        found = replace(found, run=run)
        write_kmz(path, found, layers_of(found))
        with ZipFile(path) as archive:
            assert archive.namelist() == ["doc.kml", "circle.png"]
            assert f"The photo {stored.name} is missing from" in archive.read("doc.kml").decode()


def test_unreadable_exif_data_do_not_prevent_the_products(tmp_path: Path) -> None:
    made = io.BytesIO()
    Image.new("RGB", (40, 30), "red").save(made, "PNG", exif=b"Exif\0\0garbage!")
    name = store_photo(tmp_path, made.getvalue())
    found = picture_of(tmp_path, name)
    assert found is not None
    assert Image.open(io.BytesIO(found)).size == (40, 30)
