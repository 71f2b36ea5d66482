"""Extracts the tiles of an area from basemaps into one PMTiles file per basemap."""

from collections.abc import Callable, Iterator
from pathlib import Path

from pmtiles.tile import Compression, zxy_to_tileid
from pmtiles.writer import write

from mission_service.errors import MissionServiceError
from mission_service.interfaces.maps.basemaps.tile_files import TileFile, column_of, row_of

MAX_TILES = 500_000
KEPT_METADATA = ("name", "attribution", "description", "vector_layers", "version", "type")

Box = tuple[float, float, float, float]  # west, south, east, north in degrees


def tiles_in(box: Box, lowest: int, highest: int) -> Iterator[tuple[int, int, int]]:
    """Yield zoom, column and row of the tiles that an area touches."""
    west, south, east, north = box
    for zoom in range(lowest, highest + 1):
        for x in range(column_of(west, zoom), column_of(east, zoom) + 1):
            for y in range(row_of(north, zoom), row_of(south, zoom) + 1):
                yield zoom, x, y


def common(box: Box, other: Box) -> Box | None:
    """Return the intersection of two areas, or None."""
    west, south = max(box[0], other[0]), max(box[1], other[1])
    east, north = min(box[2], other[2]), min(box[3], other[3])
    return (west, south, east, north) if west < east and south < north else None


def pack(
    source: TileFile,
    box: Box,
    out: Path,
    max_zoom: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Write the tiles of ``source`` in an area to ``out``; return their number.

    Equal tiles give identical files. ``progress`` receives the number of tiles read and the total
    number of tiles. Raises MissionServiceError for an area that the source does not contain, or
    with more than ``MAX_TILES`` tiles.
    """
    basemap = source.basemap
    area = common(box, basemap.bounds)
    if area is None:
        edges = ", ".join(f"{each:.4f}" for each in basemap.bounds)
        raise MissionServiceError(f"{source.path}: does not cover the area; it covers {edges}")
    highest = min(max_zoom, basemap.max_zoom)
    if highest < basemap.min_zoom:
        raise MissionServiceError(
            f"{source.path}: begins at zoom {basemap.min_zoom}, above --max-zoom"
        )
    wanted: list[tuple[int, tuple[int, int, int]]] = []
    for place in tiles_in(area, basemap.min_zoom, highest):
        wanted.append((zxy_to_tileid(*place), place))
        if len(wanted) > MAX_TILES:
            raise MissionServiceError(
                f"{source.path}: the area has more than {MAX_TILES} tiles; choose a smaller area "
                "or a lower --max-zoom"
            )
    wanted.sort()
    count = 0
    made = out.with_suffix(".pmtiles.new")
    with write(made) as writer:
        for done, (tile_id, place) in enumerate(wanted, start=1):
            data = source.tile(*place)
            if data is not None:
                writer.write_tile(tile_id, data)
                count += 1
            progress(done, len(wanted))
        if count == 0:
            made.unlink()
            raise MissionServiceError(f"{source.path}: has no tiles in the area")
        writer.finalize(_header(source, area, highest), _metadata(source))
    made.replace(out)
    return count


def _header(source: TileFile, area: Box, highest: int) -> dict[str, object]:
    west, south, east, north = (round(each * 1e7) for each in area)
    return {
        "tile_type": source.tile_type,
        "tile_compression": Compression.GZIP if source.is_gzipped else Compression.NONE,
        "min_lon_e7": west,
        "min_lat_e7": south,
        "max_lon_e7": east,
        "max_lat_e7": north,
        "center_zoom": highest,
        "center_lon_e7": (west + east) // 2,
        "center_lat_e7": (south + north) // 2,
    }


def _metadata(source: TileFile) -> dict[str, object]:
    found = {key: source.metadata[key] for key in KEPT_METADATA if key in source.metadata}
    return {"name": source.basemap.name, **found}
