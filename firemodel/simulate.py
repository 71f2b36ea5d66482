"""Simulate a fire from ignition to a given time in one call."""

import warnings
from collections.abc import Sequence
from numbers import Real
from pathlib import Path
from typing import Any

from firemodel.errors import FireModelError, FireModelWarning
from firemodel.input_warnings import FireInputs, input_warnings
from firemodel.landscape.default import jacksboro
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.rasterise import burnable_cells
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.edge import at_edge
from firemodel.spread.fire_scheme import Fire
from firemodel.spread.schemes import SCHEMES, SchemeName, new_fire

HOUR_S = 3600.0
# Dry weather with a moderate wind, as in the first hours of the default scenario.
DRY = Weather(
    at_s=0.0,
    wind_speed_m_s=4.0,
    wind_from_deg=45.0,
    dead_1h_pct=4.0,
    dead_10h_pct=5.0,
    dead_100h_pct=6.0,
    live_herb_pct=60.0,
    live_woody_pct=80.0,
)


def burn(
    landscape: Landscape | Path | str | None = None,
    weather: WeatherStream | Weather | Path | str | None = None,
    ignitions: Sequence[tuple[float, float]] | Path | str | None = None,
    *,
    duration_s: float = 6.0 * HOUR_S,
    scheme: SchemeName = "anyangle",
    **settings: Any,
) -> Fire:
    """Simulate a fire that is lit at 0 s on a landscape, for a given duration.

    The rates of spread are Rothermel's (1972, INT-115; Albini 1976, INT-30); where crowns burn, the
    rates are those of ``physics/crown_fire.py``. The default scheme computes arrival times by
    integrating these rates along straight lines at any angle (``spread/anyangle.py``).

    Args:
        landscape: Terrain and fuel, or the path of a file with named bands (.lcp, GeoTIFF; see
            ``read_landscape``). Default: ``jacksboro()``, 200 x 200 cells of 30 m in Tennessee.
        weather: A stream, a single entry for the whole duration, or the path of a weather file (see
            ``read_weather``). Default: dry weather with a wind of 4 m/s from the north-east.
        ignitions: WGS84 (latitude, longitude) of points in degrees, or the path of a file of
            points, lines or polygons (GeoJSON, KML, GeoPackage, Shapefile). Default: the centre
            cell.
        duration_s: Duration of the simulation in seconds.
        scheme: A spread scheme, a key of ``SCHEMES``.
        settings: Settings of the scheme, such as ``crown="scott_reinhardt"`` (crown fire) or
            ``wind_limit=True``; ``seed`` for random schemes.

    Returns:
        The fire. ``arrival_time_s`` is float64 (y, x) with row 0 in the north. Arrival times are in
        seconds after ignition, and infinity in unburned cells. ``front(time_s)`` returns a shapely
        MultiPolygon in the landscape's CRS, ``burned_ha`` is the burned area, and
        ``advance(time_s)`` continues the fire.

    Raises:
        FireModelError: A file or an argument cannot be used, or an ignition is off the landscape or
            on ground that does not burn.

    Warns:
        FireModelWarning: An input is valid but probably unintended (``input_warnings``), or the
            fire reached the edge of the landscape.

    Example:
        >>> import firemodel
        >>> fire = firemodel.burn(ignitions=[(36.364, -84.141)], duration_s=3600.0)
        >>> fire.arrival_time_s.shape
        (200, 200)
        >>> round(fire.burned_ha)
        13
        >>> fire.front(1800.0).geom_type
        'MultiPolygon'
    """
    if scheme not in SCHEMES:
        raise FireModelError(f"scheme = {scheme!r}: must be one of {', '.join(SCHEMES)}")
    unknown = sorted(settings.keys() - {"seed", *SCHEMES[scheme].settings})
    if unknown:
        names = ", ".join(SCHEMES[scheme].settings)
        raise FireModelError(f"{unknown[0]}: scheme {scheme} has no such setting; it has {names}")
    if not isinstance(duration_s, Real):
        raise FireModelError(f"duration_s = {duration_s!r}: must be a number of seconds")
    land = _landscape(landscape)
    lit = [(row, col, 0.0) for row, col in _cells(ignitions, land)]
    stream = _stream(weather)
    fire = new_fire(scheme, land, stream, lit, **settings)
    for line in input_warnings(FireInputs(land, stream, lit, duration_s)):
        warnings.warn(line, FireModelWarning, stacklevel=2)
    fire.advance(duration_s)
    if (reached := at_edge(fire)) is not None:
        warnings.warn(str(reached), FireModelWarning, stacklevel=2)
    return fire


def _landscape(given: Landscape | Path | str | None) -> Landscape:
    if given is None:
        return jacksboro()
    if isinstance(given, Landscape):
        return given
    if not isinstance(given, (str, Path)):
        raise FireModelError(f"landscape = {given!r}: must be a Landscape or the path of a file")
    from firemodel.landscape.readers.rasters import read_landscape

    return read_landscape(Path(given))


def _stream(given: WeatherStream | Weather | Path | str | None) -> WeatherStream:
    if given is None or isinstance(given, Weather):
        return WeatherStream([given or DRY])
    if isinstance(given, WeatherStream):
        return given
    if not isinstance(given, (str, Path)):
        raise FireModelError(
            f"weather = {given!r}: must be a Weather, a WeatherStream or the path of a file"
        )
    from firemodel.landscape.readers.weather_files import read_weather

    return read_weather(Path(given))


def _cells(
    given: Sequence[tuple[float, float]] | Path | str | None, land: Landscape
) -> list[tuple[int, int]]:
    """Return the row and column of each cell that is lit."""
    rows, cols = land.shape
    if given is None:
        return [(rows // 2, cols // 2)]
    if isinstance(given, (str, Path)):
        return cells_of_file(Path(given), land)
    try:
        places = [(float(lat_deg), float(lon_deg)) for lat_deg, lon_deg in given]
    except (TypeError, ValueError):
        places = []
    if not places:
        raise FireModelError(
            f"ignitions = {given!r}: must be one or more (latitude, longitude) in degrees, as in "
            "[(36.364, -84.141)], or the path of a file"
        )
    return [land.cell_of_lat_lon(*place) for place in places]


def cells_of_file(path: Path, land: Landscape) -> list[tuple[int, int]]:
    """Return the row and column of each burnable cell that the shapes in a file touch.

    Raises FireModelError if the file cannot be used, or if its shapes touch no burnable cell.
    """
    from firemodel.landscape.readers.shapes import read_shapes

    cells = burnable_cells(read_shapes(path, land), land)
    if not cells:
        raise FireModelError(f"{path}: all its cells are non-burnable; use another position")
    return cells
