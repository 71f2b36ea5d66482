"""Defines ``mission-service map``, which cuts basemaps for an incident."""

from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import JSON, echo


def bounding_box(text: str) -> tuple[float, float, float, float]:
    """Return the area WEST,SOUTH,EAST,NORTH in degrees. Raises click.BadParameter."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text}: specify WEST,SOUTH,EAST,NORTH in degrees") from None
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise click.BadParameter(f"{text}: west must be less than east, and south less than north")
    return west, south, east, north


@click.group("map")
def map_group() -> None:
    """Prepare basemaps for the map (service.http.basemaps)."""


@map_group.command(
    "pack", context_settings={"ignore_unknown_options": True}
)  # a bounding box may begin with a minus sign
@click.argument("bbox", type=bounding_box, metavar="WEST,SOUTH,EAST,NORTH")
@click.argument(
    "sources",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE...",
)
@click.option(
    "--out",
    "-o",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the files, one NAME.pmtiles for each source.",
)
@click.option(
    "--max-zoom",
    type=click.IntRange(0, 22),
    default=22,
    help="Highest zoom level (default: the highest level of the source).",
)
@JSON
def pack_command(
    bbox: tuple[float, float, float, float],
    sources: tuple[Path, ...],
    out: Path,
    max_zoom: int,
    as_json: bool,
) -> None:
    """Cut the tiles of an area from PMTiles, MBTiles or GeoTIFF files."""
    from mission_service.cli.output_folder import output_folder
    from mission_service.errors import MissionServiceError
    from mission_service.interfaces.maps.basemaps.pack import pack
    from mission_service.interfaces.maps.basemaps.tile_files import tile_file

    made = output_folder(out)
    written: dict[str, Any] = {}
    for path in sources:
        target = made / f"{path.stem}.pmtiles"
        if target.exists() and target.samefile(path):
            raise MissionServiceError(f"{path}: is in the folder of --out; choose another folder")
        if target.name in written:
            raise MissionServiceError(
                f"{path}: another source has the name {path.stem}; rename one"
            )
        tiles = pack(tile_file(path), bbox, target, max_zoom)
        written[target.name] = {"tiles": tiles, "bytes": target.stat().st_size}
    if as_json:
        echo({"files": written}, as_json)
        return
    for name, about in written.items():
        click.echo(f"{made / name}: {about['tiles']} tiles, {about['bytes'] / 1e6:.1f} MB")
