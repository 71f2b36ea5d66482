"""Adds the routes of basemaps: map tile files, and lines derived from the elevation."""

from functools import partial

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse

from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.openapi import V1, file, json, route, structs
from mission_service.interfaces.api.responses import ApiError, answer
from mission_service.interfaces.maps.basemaps.relief_lines import relief_lines
from mission_service.interfaces.maps.basemaps.tile_files import MAX_ZOOM, TYPES, Basemap, TileFile

GEOJSON = "application/geo+json"
ARCHIVE = "application/vnd.pmtiles"
EXAMPLE = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "geometry": {"type": "LineString", "coordinates": [[-84.16, 36.35], [-84.15, 36.351]]},
            "properties": {"kind": "contour", "height_m": 480.0, "index": False},
        }
    ],
}


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add the routes ``/basemaps``."""
    lines: list[Response] = []  # computed at the first request

    def found(name: str) -> TileFile:
        basemap = api.basemaps.get(name)
        if basemap is None:
            names = ", ".join(api.basemaps) or "none"
            raise ApiError(404, f"no basemap {name[:40]!r}; the basemaps are {names}")
        return basemap

    @routes.get(f"{V1}/basemaps", **route("look", "The basemaps.", structs(Basemap)))
    async def basemaps() -> Response:
        return answer([each.basemap for each in api.basemaps.values()])

    @routes.get(
        f"{V1}/relief.geojson",
        **route("look", "Contour lines and drainage lines from elevation.", json(EXAMPLE, GEOJSON)),
    )
    async def relief() -> Response:
        if not lines:
            compute = partial(relief_lines, api.context.landscape)
            lines.append(answer(await api.run_in_thread(compute), GEOJSON))
        return Response(lines[0].body, media_type=GEOJSON)

    @routes.get(
        f"{V1}/basemaps/{{name}}/archive",
        **route("look", "A PMTiles file, which clients read in byte ranges.", file(ARCHIVE)),
    )
    async def archive(name: str) -> Response:
        basemap = found(name)
        if basemap.basemap.storage != "pmtiles":
            raise ApiError(404, f"{basemap.path.name} is not a PMTiles file; request its tiles")
        if not basemap.path.is_file():
            raise ApiError(404, f"{basemap.path.name} was removed")
        return FileResponse(basemap.path, media_type=ARCHIVE)

    @routes.get(
        f"{V1}/basemaps/{{name}}/{{z}}/{{x}}/{{y}}",
        **route("look", "A tile of a basemap.", file("application/octet-stream")),
    )
    async def tile(name: str, z: int, x: int, y: int) -> Response:
        basemap, data = found(name), None
        if 0 <= z <= MAX_ZOOM and 0 <= x < 2**z and 0 <= y < 2**z:
            data = await api.run_in_thread(partial(basemap.tile, z, x, y))
        if data is None:  # common: tiles beyond the edge
            return Response(status_code=204)
        encoding = {"content-encoding": "gzip"} if basemap.is_gzipped else {}
        return Response(data, media_type=TYPES[basemap.tile_type], headers=encoding)
