"""Files are identified by their content, and no file makes the fire model fetch data."""

import http.server
import json
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from firemodel.errors import FireModelError
from firemodel.landscape.readers.bands import bands_of
from firemodel.landscape.readers.shapes import features_of

KML = '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'


class Counted(http.server.ThreadingHTTPServer):
    """A server that counts its requests."""

    asked = 0


class Count(http.server.BaseHTTPRequestHandler):
    def handle_one_request(self) -> None:
        assert isinstance(self.server, Counted)
        self.server.asked += 1
        super().handle_one_request()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Counted]:
    with Counted(("127.0.0.1", 0), Count) as made:
        thread = threading.Thread(target=made.serve_forever)
        thread.start()
        yield made
        made.shutdown()
        thread.join(10)


def raster_vrt(url: str) -> str:
    return (
        '<VRTDataset rasterXSize="4" rasterYSize="4"><SRS>EPSG:32616</SRS>'
        "<GeoTransform>0,30,0,0,0,-30</GeoTransform>"
        '<VRTRasterBand dataType="Byte" band="1"><SimpleSource>'
        f'<SourceFilename relativeToVRT="0">{url}</SourceFilename><SourceBand>1</SourceBand>'
        "</SimpleSource></VRTRasterBand></VRTDataset>"
    )


def vector_vrt(url: str) -> str:
    return (
        '<OGRVRTDataSource><OGRVRTLayer name="x">'
        f"<SrcDataSource>{url}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>"
    )


@pytest.mark.parametrize("name", ["fuel.vrt", "fuel.tif", "fuel.asc", "fuel.lcp"])
@pytest.mark.parametrize("scheme", ["/vsicurl/http", "http"])
def test_a_raster_that_lists_others_is_refused(
    tmp_path: Path, server: Counted, name: str, scheme: str
) -> None:
    path = tmp_path / name
    path.write_text(raster_vrt(f"{scheme}://127.0.0.1:{server.server_port}/x.tif"))
    with pytest.raises(FireModelError, match="is not a GeoTIFF") as error:
        bands_of(path)
    assert "\n" not in str(error.value)
    assert server.asked == 0


@pytest.mark.parametrize("name", ["lit.vrt", "lit.kml", "lit.geojson", "lit.shp"])
@pytest.mark.parametrize("scheme", ["/vsicurl/http", "http"])
def test_shapes_that_list_others_are_refused(
    tmp_path: Path, server: Counted, name: str, scheme: str
) -> None:
    path = tmp_path / name
    (tmp_path / "lit.shx").write_bytes(b"")
    path.write_text(vector_vrt(f"{scheme}://127.0.0.1:{server.server_port}/x.json"))
    with pytest.raises(FireModelError, match="is XML, but not KML: OGRVRTDataSource") as error:
        features_of(path)
    assert "\n" not in str(error.value)
    assert server.asked == 0


def test_other_ways_to_have_something_fetched(tmp_path: Path, server: Counted) -> None:
    url = f"http://127.0.0.1:{server.server_port}/x"
    point = {"type": "Point", "coordinates": [0, 0]}
    link = {"type": "link", "properties": {"href": url, "name": "EPSG:4326"}}
    alg = {"type": "gdal_streamed_alg", "command_line": f"gdal vector pipeline ! read {url}"}
    for number, (content, words) in enumerate(
        [
            ({**point, "crs": link}, "its crs member is not supported"),
            (alg, "is JSON, but not GeoJSON"),
            ({"type": "Topology", "objects": {}}, "is JSON, but not GeoJSON"),
        ]
    ):
        path = tmp_path / f"{number}.geojson"
        path.write_text(json.dumps(content))
        with pytest.raises(FireModelError, match=words):
            features_of(path)
    for member, text, words in (
        ("x.vrt", vector_vrt(url), "which is not part of a Shapefile or KMZ"),
        ("x.kml", vector_vrt(url), "is XML, but not KML"),
        ("x.txt", vector_vrt(url), "contains no Shapefile or KML"),
    ):
        path = tmp_path / "packed.zip"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(member, text)
        with pytest.raises(FireModelError, match=words):
            features_of(path)
    linked = tmp_path / "linked.kml"
    place = "<Placemark><Point><coordinates>0,0</coordinates></Point></Placemark>"
    linked.write_text(
        KML.format(f"{place}<NetworkLink><Link><href>{url}</href></Link></NetworkLink>")
    )
    assert len(features_of(linked)[0]) == 1
    assert server.asked == 0
