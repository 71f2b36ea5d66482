"""Write a map page as PNG and as PDF with a geospatial measure dictionary (ISO 32000-2, 12.10).

Avenza Maps, QGIS (GDAL) and Acrobat read the coordinates of the map frame from this dictionary.
"""

import io
import warnings
from datetime import datetime
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from firemodel.landscape.landscape import Landscape
from firemodel.outputs.whole_file import whole_file, write_whole
from mission_service.products.map_page import MapPage

PNG_DPI, PDF_DPI = 200, 250  # PDF_DPI: raster parts of the PDF
POINTS_PER_IN = 72.0
# Corners of the map frame as fractions of its width and height, from the lower left.
CORNERS = ((0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0))


def write_png(path: Path, page: MapPage, land: Landscape) -> Path:
    """Write a page as PNG; return the file with its georeference for GDAL and QGIS."""
    with whole_file(path) as part, _quiet():
        page.figure.savefig(part, format="png", dpi=PNG_DPI, metadata={"Software": None})
    sidecar = path.with_name(f"{path.name}.aux.xml")
    write_whole(sidecar, _auxiliary_metadata(page, land))
    return sidecar


def _auxiliary_metadata(page: MapPage, land: Landscape) -> str:
    """Return GDAL's auxiliary metadata: the projection, and the transform of the page's pixels."""
    from pyproj import CRS

    west, east, south, north = (1e3 * each for each in page.frame)
    box, (width_in, height_in) = page.axes.get_position(), page.figure.get_size_inches()
    x_m = (east - west) / (box.width * width_in * PNG_DPI)  # the size of a pixel
    y_m = (north - south) / (box.height * height_in * PNG_DPI)
    left_m = land.west_m + west - box.x0 * width_in * PNG_DPI * x_m
    top_m = land.south_m + north + (1.0 - box.y1) * height_in * PNG_DPI * y_m
    root = Element("PAMDataset")
    SubElement(root, "SRS").text = CRS.from_user_input(land.crs).to_wkt("WKT1_GDAL")
    transform = (left_m, x_m, 0.0, top_m, 0.0, -y_m)
    SubElement(root, "GeoTransform").text = ", ".join(
        repr(round(float(each), 6)) for each in transform
    )
    return tostring(root, encoding="unicode") + "\n"


def write_pdf(path: Path, page: MapPage, land: Landscape, title: str, made: datetime) -> None:
    """Write a page as a georeferenced PDF.

    Args:
        path: The file to write.
        page: The page.
        land: The landscape, for its projection.
        title: The title in the file's properties.
        made: The date in the file's properties.
    """
    from matplotlib import rc_context
    from pypdf import PdfReader, PdfWriter
    from pypdf.generic import ArrayObject, NameObject

    drawn = io.BytesIO()
    facts = {"Title": title, "Creator": "mission-service", "Producer": None, "CreationDate": made}
    with rc_context({"pdf.fonttype": 42}), _quiet():  # searchable text
        page.figure.savefig(drawn, format="pdf", dpi=PDF_DPI, metadata=facts)
    drawn.seek(0)
    writer = PdfWriter(clone_from=PdfReader(drawn))
    writer.pages[0][NameObject("/VP")] = ArrayObject([writer._add_object(_viewport(page, land))])
    with whole_file(path) as part, part.open("wb") as file:
        writer.write(file)


def _viewport(page: MapPage, land: Landscape) -> Any:
    """Return the viewport of the map frame, with its measure dictionary."""
    from pypdf.generic import (
        ArrayObject,
        DictionaryObject,
        FloatObject,
        NameObject,
        TextStringObject,
    )
    from pyproj import CRS

    def numbers(values: Any) -> ArrayObject:
        return ArrayObject([FloatObject(round(float(value), 9)) for value in values])

    west, east, south, north = (1e3 * each for each in page.frame)
    shares = np.array(CORNERS)
    lat, lon = land.lat_lon_of(
        land.west_m + west + (east - west) * shares[:, 0],
        land.south_m + south + (north - south) * shares[:, 1],
    )
    crs = CRS.from_user_input(land.crs)
    system = DictionaryObject({
        NameObject("/Type"): NameObject("/PROJCS"),
        NameObject("/WKT"): TextStringObject(crs.to_wkt("WKT1_ESRI")),
    })  # fmt: skip
    box = page.axes.get_position()
    width, height = POINTS_PER_IN * page.figure.get_size_inches()
    return DictionaryObject({
        NameObject("/Type"): NameObject("/Viewport"),
        NameObject("/Name"): TextStringObject("Map"),
        NameObject("/BBox"): numbers(
            (box.x0 * width, box.y0 * height, box.x1 * width, box.y1 * height)
        ),
        NameObject("/Measure"): DictionaryObject({
            NameObject("/Type"): NameObject("/Measure"),
            NameObject("/Subtype"): NameObject("/GEO"),
            NameObject("/Bounds"): numbers(shares.ravel()),
            NameObject("/LPTS"): numbers(shares.ravel()),
            NameObject("/GPTS"): numbers(np.stack([lat, lon], axis=1).ravel()),
            NameObject("/GCS"): system,
        }),
    })  # fmt: skip


def _quiet() -> Any:
    """Ignore warnings about characters missing from the font, which are drawn as boxes."""
    return warnings.catch_warnings(action="ignore", category=UserWarning)
