"""Writes the scenario file for a new incident. Pure."""

import json
import math
from dataclasses import dataclass
from datetime import datetime

CELL_M = 30.0
MIN_CELLS, MAX_CELLS = 20, 4000  # along each side of a landscape

Box = tuple[float, float, float, float]  # west, south, east, north in degrees
Place = tuple[float, float]  # latitude, longitude in degrees


@dataclass(frozen=True)
class NewVehicle:
    """A vehicle: its name, autopilot, kind, home and connection.

    Without a link or system id, those of the vehicle's number in the scenario are used.
    """

    name: str
    stack: str
    kind: str
    home: Place
    link: str | None = None
    system_id: int | None = None


@dataclass(frozen=True)
class NewIncident:
    """The inputs for a new incident. Paths are relative to the scenario file.

    The landscape is the level ground of ``box``, ``landscape`` (one file) or ``layers``. The wind
    is ``wind`` (speed in m/s, direction from which it blows) or in the file ``weather``. The fire
    begins at ``ignitions`` or has the outline ``perimeter``.
    """

    name: str
    hours: float
    box: Box | None
    fuel_model: int
    landscape: str | None
    layers: dict[str, str]
    units: dict[str, str]  # by raster name
    missing: str | None  # fuel of cells without data
    wind: tuple[float, float] | None
    weather: str | None
    start: datetime | None  # mission time 0, in the local time of the weather file
    moistures_pct: tuple[float, float, float, float, float]
    ignitions: tuple[Place, ...]
    perimeter: str | None
    aircraft: tuple[NewVehicle, ...]
    is_simulated: bool
    time_zero: datetime | None  # calendar time of mission time 0, with its UTC offset


def grid_of(box: Box) -> tuple[int, int]:
    """Return the numbers of rows and columns that cover an area from its centre.

    Cells are ``CELL_M`` wide. The rows of a landscape follow the grid of a UTM zone, which is
    rotated relative to true north.
    """
    from firemodel.landscape.flat import flat_landscape

    west, south, east, north = box
    middle = ((south + north) / 2.0, (west + east) / 2.0)
    projected = flat_landscape(1, 1, CELL_M, *middle)
    x_m, y_m = projected.xy_of_lat_lon(*middle)
    edges = [
        projected.xy_of_lat_lon(lat, lon)
        for lat in (south, middle[0], north)
        for lon in (west, middle[1], east)
    ]
    rows = max(math.ceil(2.0 * abs(y - y_m) / CELL_M) for _, y in edges)
    cols = max(math.ceil(2.0 * abs(x - x_m) / CELL_M) for x, _ in edges)
    return rows, cols


def scenario_text(incident: NewIncident) -> str:
    """Return the content of the scenario file (TOML)."""
    run = {"name": incident.name, "seed": 1, "duration_s": round(3600 * incident.hours)}
    zero = {} if incident.time_zero is None else {"time_zero": incident.time_zero}
    parts = [
        _table("", {**run, **zero}),
        _table("landscape", _landscape(incident)),
        _table("fire", {"perimeter": incident.perimeter} if incident.perimeter else {}),
    ]
    if incident.is_simulated:
        parts.append(
            "[simulation.fire]  # cameras observe a simulated fire; omit this table for a real "
            "fire\n"
        )
    for lat_deg, lon_deg in incident.ignitions:
        parts.append(_table("[ignition]", {"lat_deg": lat_deg, "lon_deg": lon_deg}))
    parts.append(_weather(incident))
    for number, each in enumerate(incident.aircraft):
        parts.append(_table("[vehicles]", _vehicle(each, number)))
    return "\n".join(part for part in parts if part)


def _landscape(incident: NewIncident) -> dict[str, object]:
    if incident.box is None:
        found: dict[str, object] = {"source": "files"}
        found |= {"file": incident.landscape} if incident.landscape else incident.layers
        found |= {"missing": incident.missing} if incident.missing else {}
        return found | {f"units.{name}": unit for name, unit in incident.units.items()}
    west, south, east, north = incident.box
    rows, cols = grid_of(incident.box)
    return {
        "source": "flat",
        "lat_deg": round((south + north) / 2.0, 6),
        "lon_deg": round((west + east) / 2.0, 6),
        "rows": rows,
        "cols": cols,
        "cell_size_m": CELL_M,
        "fuel_model": incident.fuel_model,
    }


def _weather(incident: NewIncident) -> str:
    names = ("dead_1h_pct", "dead_10h_pct", "dead_100h_pct", "live_herb_pct", "live_woody_pct")
    moistures = dict(zip(names, incident.moistures_pct, strict=True))
    if incident.wind is None:
        start = {} if incident.start is None else {"start": incident.start}
        return _table("weather_file", {"path": incident.weather, **start, **moistures})
    speed_m_s, from_deg = incident.wind
    wind = {"at_s": 0, "wind_speed_m_s": speed_m_s, "wind_from_deg": from_deg}
    return _table("[weather]", {**wind, **moistures})


def _vehicle(each: NewVehicle, number: int) -> dict[str, object]:
    return {
        "name": each.name,
        "stack": each.stack,
        "kind": each.kind,
        "link": each.link or f"udpin:127.0.0.1:{14550 + 10 * number}",
        "system_id": number + 1 if each.system_id is None else each.system_id,
        "altitude_agl_m": 150.0 + 50.0 * number,  # vehicles at different heights keep apart
        "home_lat_deg": each.home[0],
        "home_lon_deg": each.home[1],
    }


def _table(name: str, values: dict[str, object]) -> str:
    """Return a table; without a name its values are at the beginning of the file."""
    head = [f"[{name}]"] if name else []
    if name and not values:
        return ""
    return "\n".join([*head, *(f"{key} = {_value(value)}" for key, value in values.items()), ""])


def _value(value: object) -> str:
    """Return a value as TOML, which writes strings and numbers as JSON does."""
    return (
        value.isoformat()
        if isinstance(value, datetime)
        else json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    )
