"""Reads map tiles from PMTiles, MBTiles and GeoTIFF files. Tiles are in Web Mercator.

The column x of a tile is counted from the west, the row y from the north.
"""

import contextlib
import json
import math
import sqlite3
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, Protocol

import msgspec
from pmtiles.reader import MmapSource, Reader
from pmtiles.tile import Compression, TileType

from mission_service.errors import MissionServiceError
from mission_service.interfaces.maps.basemaps.raster_tiles import RasterTiles

MAX_ZOOM = 22
WORLD_DEG = (-180.0, -85.0511, 180.0, 85.0511)
TYPES = {
    TileType.MVT: "application/vnd.mapbox-vector-tile",
    TileType.PNG: "image/png",
    TileType.JPEG: "image/jpeg",
    TileType.WEBP: "image/webp",
    TileType.AVIF: "image/avif",
}
OF_MBTILES = {
    "pbf": TileType.MVT,
    "png": TileType.PNG,
    "jpg": TileType.JPEG,
    "jpeg": TileType.JPEG,
    "webp": TileType.WEBP,
}


class Basemap(msgspec.Struct, tag="basemap/1", tag_field="schema"):
    """A file of map tiles. ``bounds`` are west, south, east, north in degrees.

    The tiles of the storage ``pmtiles`` are in the file ``/basemaps/NAME/archive``, which clients
    read in parts (HTTP ranges); those of ``tiles`` are at ``/basemaps/NAME/Z/X/Y``. ``layers`` are
    the names of the layers of vector tiles.
    """

    name: str
    kind: Literal["vector", "raster"]
    storage: Literal["pmtiles", "tiles"]
    min_zoom: int
    max_zoom: int
    bounds: tuple[float, float, float, float]
    attribution: str = ""
    layers: tuple[str, ...] = ()


class TileFile(Protocol):
    """A file of map tiles; ``tile_type`` is a value of ``pmtiles.tile.TileType``."""

    path: Path
    basemap: Basemap
    tile_type: Any
    metadata: dict[str, Any]

    @property
    def is_gzipped(self) -> bool:
        """Return whether the tiles are compressed."""

    def tile(self, z: int, x: int, y: int) -> bytes | None:
        """Return a tile, or None if the file does not contain it."""


class PmtilesFile:
    """A PMTiles archive (version 3)."""

    def __init__(self, path: Path) -> None:
        """Read the header. Raises MissionServiceError."""
        self.path = path
        try:
            with self._reader() as reader:
                header, self.metadata = reader.header(), reader.metadata()
        except Exception as error:  # the library raises many classes of errors for damaged files
            raise MissionServiceError(f"{path}: not a PMTiles version 3 file: {error}") from None
        self.tile_type = header["tile_type"]
        if self.tile_type not in TYPES:
            raise MissionServiceError(
                f"{path}: unknown tile type; use vector tiles (MVT) or images"
            )
        self._compression = header["tile_compression"]
        degrees = tuple(header[f"{each}_e7"] / 1e7 for each in _EDGES)
        self.basemap = Basemap(
            path.stem,
            "vector" if self.tile_type is TileType.MVT else "raster",
            "pmtiles",
            header["min_zoom"],
            header["max_zoom"],
            degrees if degrees[0] < degrees[2] else WORLD_DEG,
            str(self.metadata.get("attribution", "")),
            _layers(self.metadata.get("vector_layers")),
        )

    @property
    def is_gzipped(self) -> bool:
        """Return whether the tiles are compressed."""
        return bool(self._compression is Compression.GZIP)

    @contextlib.contextmanager
    def _reader(self) -> Iterator[Any]:
        with self.path.open("rb") as file:
            yield Reader(MmapSource(file))  # type: ignore[no-untyped-call]

    def tile(self, z: int, x: int, y: int) -> bytes | None:
        """Return a tile, or None if the file does not contain it."""
        with self._reader() as reader:
            found: bytes | None = reader.get(z, x, y)
        return found


class MbtilesFile:
    """An MBTiles file: an SQLite database of tiles, with rows counted from the south."""

    def __init__(self, path: Path) -> None:
        """Read the metadata. Raises MissionServiceError."""
        self.path = path
        try:
            with self._database() as database:
                self.metadata = dict(database.execute("SELECT name, value FROM metadata"))
                zooms = database.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles")
                lowest, highest = zooms.fetchone()
        except sqlite3.Error as error:
            raise MissionServiceError(f"{path}: not an MBTiles file: {error}") from None
        kind = str(self.metadata.get("format", "")).lower()
        if kind not in OF_MBTILES or lowest is None:
            usable = ", ".join(sorted(OF_MBTILES))
            raise MissionServiceError(f"{path}: no tiles in a supported format ({usable})")
        self.tile_type = OF_MBTILES[kind]
        try:
            described = json.loads(str(self.metadata.get("json", "{}")))
        except ValueError:
            described = {}
        layers = described.get("vector_layers", []) if isinstance(described, dict) else []
        try:
            bounds = tuple(float(each) for each in str(self.metadata["bounds"]).split(","))
        except (KeyError, ValueError):
            bounds = WORLD_DEG
        self.basemap = Basemap(
            path.stem,
            "vector" if self.tile_type is TileType.MVT else "raster",
            "tiles",
            lowest,
            highest,
            bounds if len(bounds) == 4 else WORLD_DEG,
            str(self.metadata.get("attribution", "")),
            _layers(layers),
        )
        self.metadata |= {"vector_layers": layers}

    @property
    def is_gzipped(self) -> bool:
        """Return whether the tiles are compressed; vector tiles in MBTiles files are."""
        return self.tile_type is TileType.MVT

    @contextlib.contextmanager
    def _database(self) -> Iterator[sqlite3.Connection]:
        uri = f"{self.path.resolve().as_uri()}?mode=ro&immutable=1"
        with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
            yield database

    def tile(self, z: int, x: int, y: int) -> bytes | None:
        """Return a tile, or None if the file does not contain it."""
        select = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"
        with self._database() as database:
            found = database.execute(select, (z, x, 2**z - 1 - y)).fetchone()
        return None if found is None else bytes(found[0])


class RasterFile:
    """A georeferenced raster (GeoTIFF): its tiles are drawn on demand."""

    tile_type = TileType.WEBP
    is_gzipped = False
    MAX_TILES = 256  # kept in memory

    def __init__(self, path: Path) -> None:
        """Read the extent and the resolution. Raises MissionServiceError."""
        self.path = path
        self._tiles = RasterTiles(path)
        self.metadata: dict[str, Any] = {}
        zooms = self._tiles.zooms
        self.basemap = Basemap(path.stem, "raster", "tiles", *zooms, self._tiles.bounds_deg)
        self._drawn = lru_cache(maxsize=self.MAX_TILES)(self._tiles.draw)

    def tile(self, z: int, x: int, y: int) -> bytes | None:
        """Return a tile, or None outside the raster."""
        return self._drawn(z, x, y)


_EDGES = ("min_lon", "min_lat", "max_lon", "max_lat")
OF_SUFFIX: dict[str, type[PmtilesFile] | type[MbtilesFile] | type[RasterFile]] = {
    ".pmtiles": PmtilesFile,
    ".mbtiles": MbtilesFile,
    ".tif": RasterFile,
    ".tiff": RasterFile,
}


def _layers(described: Any) -> tuple[str, ...]:
    """Return the layer names in the metadata of vector tiles."""
    if not isinstance(described, list):
        return ()
    return tuple(str(each["id"]) for each in described if isinstance(each, dict) and "id" in each)


def tile_file(path: Path) -> TileFile:
    """Open a file of map tiles. Raises MissionServiceError."""
    kind = OF_SUFFIX.get(path.suffix.lower())
    if kind is None:
        raise MissionServiceError(
            f"{path}: not a basemap; use a file of type {', '.join(OF_SUFFIX)}"
        )
    if not path.is_file():
        raise MissionServiceError(f"{path}: no such file")
    return kind(path)


def tile_files(folder: Path) -> tuple[dict[str, TileFile], list[str]]:
    """Return the basemaps in a folder by name, and a line of text for each unusable file."""
    found: dict[str, TileFile] = {}
    problems = []
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in OF_SUFFIX:
            continue
        if path.stem in found:
            problems.append(f"{path}: another basemap has the name {path.stem}; rename one")
            continue
        try:
            found[path.stem] = tile_file(path)
        except MissionServiceError as error:
            problems.append(str(error))
    return found, problems


def column_of(lon_deg: float, zoom: int) -> int:
    """Return the column of the tile that contains a longitude."""
    return min(max(math.floor((lon_deg + 180.0) / 360.0 * (1 << zoom)), 0), (1 << zoom) - 1)


def row_of(lat_deg: float, zoom: int) -> int:
    """Return the row of the tile that contains a latitude."""
    y = math.asinh(math.tan(math.radians(min(max(lat_deg, WORLD_DEG[1]), WORLD_DEG[3]))))
    return min(max(math.floor((1.0 - y / math.pi) / 2.0 * (1 << zoom)), 0), (1 << zoom) - 1)
