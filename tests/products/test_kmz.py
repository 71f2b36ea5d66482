"""KMZ of features that short simulated runs do not have."""

from pathlib import Path
from xml.etree.ElementTree import Element, fromstring
from zipfile import ZipFile

from shapely import Point, box

from mission_service.products.features import layers_of
from mission_service.products.heat import Heat
from mission_service.products.kmz import write_kmz
from mission_service.products.vector_files import write_geopackage
from mission_service.runtime.published_states import DropState
from mission_service.runtime.run_statistics import VehicleStatistics
from tests.products.incidents import incident, land

KML = "{http://www.opengis.net/kml/2.2}"
# The sequences of the elements in the schema of KML 2.2.
PLACEMARK = ("name", "TimeSpan", "styleUrl", "ExtendedData", "Point", "MultiGeometry")
STYLE = ("IconStyle", "LineStyle", "PolyStyle")


def _document(path: Path) -> Element:
    x_m, y_m = land().xy_of(30, 40)
    heat = Heat([box(x_m, y_m, x_m + 100, y_m + 100)], [], [Point(x_m, y_m)])
    found = incident(heat=heat)
    drop = DropState(8_000_000_000, "heron", "hash", 0, 36.4, -84.2)
    found.record.vehicles["heron"] = VehicleStatistics(drops=[drop])
    layers = layers_of(found)
    assert {"heat_areas", "heat_points", "drops"} <= set(layers)
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
