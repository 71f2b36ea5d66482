"""What logs tell of flights, as files for other programs."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

from autopilot_bridge.client_events import Position
from autopilot_bridge.items import Plan
from autopilot_bridge.logs.entries import Log, LogEvent
from autopilot_bridge.planfile import write_plan
from autopilot_bridge.stacks import stack_named
from mission_service.flights.flown import Flown, flown_in
from mission_service.flights.instants import utc
from mission_service.track import track_geojson

COLUMNS = (
    *("log", "vehicle", "at_us", "utc", "lat_deg", "lon_deg", "altitude_amsl_m"),
    *("altitude_relative_m", "velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s"),
    "heading_deg",
)


def export(logs: list[Log], out: Path) -> list[str]:
    """Tracks as GeoJSON and KML, all positions as CSV, each mission as .plan; the files' names."""
    flown: list[Flown] = []
    with (out / "positions.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for log in logs:
            offset_us = log.unix_offset_us()
            flown += flown_in(log, [_row(table, log.path, offset_us)]).values()
    files = ["positions.csv", "tracks.geojson", "tracks.kml"]
    features = [track_geojson(each.name, each.track) for each in flown]
    collection = {"type": "FeatureCollection", "features": features}
    (out / "tracks.geojson").write_text(json.dumps(collection), encoding="utf-8")
    with (out / "tracks.kml").open("w", encoding="utf-8") as file:
        file.writelines(_kml(flown))
    for each in flown:
        for number, (_, items) in enumerate(each.missions, 1):
            name = f"{each.name}-mission-{number}.plan"
            stack = each.stack or stack_named("px4", "plane")
            write_plan(out / name, Plan(items, home=each.home or (0.0, 0.0, 0.0)), stack)
            files.append(name)
    return files


def _row(table: Any, path: Path, offset_us: int | None) -> Any:
    def write(system_id: int, event: LogEvent) -> None:
        if not isinstance(event, Position):
            return
        at = "" if offset_us is None else utc(event.at_us + offset_us)
        place = (event.lat_deg, event.lon_deg, event.altitude_amsl_m, event.altitude_relative_m)
        velocity = (event.velocity_north_m_s, event.velocity_east_m_s, event.velocity_down_m_s)
        table.writerow(
            (path.name, system_id, event.at_us, at, *place, *velocity, event.heading_deg)
        )

    return write


def _kml(flown: list[Flown]) -> Iterator[str]:
    """One gx:Track a vehicle (KML 2.2 with Google's extensions), heights above sea level."""
    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>\n'
    )
    for each in flown:
        yield f"<Placemark><name>{escape(each.name)}</name><gx:Track>"
        yield "<altitudeMode>absolute</altitudeMode>\n"
        for at_us, lat_deg, lon_deg, altitude_m in each.track:
            yield f"<when>{utc(at_us + each.offset_us)}</when>"
            yield f"<gx:coord>{lon_deg:.7f} {lat_deg:.7f} {altitude_m:.2f}</gx:coord>\n"
        yield "</gx:Track></Placemark>\n"
    yield "</Document></kml>\n"
