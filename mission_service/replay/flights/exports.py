"""Exports logs as files for other programs."""

import json
import re
from collections.abc import Collection, Iterator
from functools import partial
from importlib import import_module
from itertools import chain, count
from pathlib import Path
from xml.sax.saxutils import escape

from autopilot_bridge.items import Plan
from autopilot_bridge.logs.entries import Log, LogEvent
from autopilot_bridge.missions.plan_file import write_plan
from autopilot_bridge.stacks.stacks import stack_named
from mission_service.errors import FlightError, RequestError
from mission_service.replay.flights.flight_tables import TABLES, Rows
from mission_service.replay.flights.flown_vehicle import Flown, file_of, flown_in
from mission_service.replay.flights.mcap_file import write_mcap
from mission_service.replay.flights.table_files import WRITERS, TableFiles
from mission_service.replay.flights.utc_time import utc
from mission_service.runtime.track import track_geojson

PLAN = re.compile(r".+-mission-\d+\.plan")
WRITTEN = ".log-export"  # lists the tables and missions that exports have written to a folder
LIBRARIES = {"parquet": "pyarrow", "mcap": "mcap"}


def check_libraries(formats: Collection[str]) -> None:
    """Raise RequestError if the library of a format is not installed."""
    for each, library in LIBRARIES.items():
        if each in formats:
            try:
                import_module(library)
            except ImportError:
                raise RequestError(
                    f"log export: {each} needs {library}, which is not installed; "
                    "pip install 'mission-service[export]'"
                ) from None


def export(logs: list[Log], out: Path, formats: Collection[str]) -> list[str]:
    """Write tables, tracks, missions and MCAP in the requested formats; return the file names.

    Tables and missions that an earlier export in these formats has written to ``out`` are removed.
    Raises FlightError if no log contains a vehicle.
    """
    names: dict[tuple[int, int], str] = {}
    flown: list[Flown] = []
    with TableFiles(out, [each for each in WRITERS if each in formats]) as tables:
        for number, log in enumerate(logs):
            rows = Rows(file_of(log), log.unix_offset_us())
            for each in flown_in(log, partial(_add_rows, tables, rows)).values():
                each.name = _unique(each.name, log.path.suffix, names.values())
                names[number, each.system_id] = each.name
                flown.append(each)
    if not flown:
        raise FlightError(f"no vehicle in {', '.join(str(log.path) for log in logs)}")
    files = list(tables.names)
    if "geojson" in formats:
        features = [track_geojson(each.name, each.track) for each in flown]
        collection = {"type": "FeatureCollection", "features": features}
        (out / "tracks.geojson").write_text(json.dumps(collection), encoding="utf-8")
        files.append("tracks.geojson")
    if "kml" in formats:
        with (out / "tracks.kml").open("w", encoding="utf-8") as file:
            file.writelines(_kml(flown))
        files.append("tracks.kml")
    if "mcap" in formats:
        write_mcap(out / "flight.mcap", logs, names)
        files.append("flight.mcap")
    if "plan" in formats:
        files += _plans(flown, out)
    _remove_earlier(out, formats, files)
    return files


def _remove_earlier(out: Path, formats: Collection[str], files: Collection[str]) -> None:
    """Remove the files of earlier exports in these formats, and list those that now exist."""
    listed = out / WRITTEN
    earlier = set(listed.read_text(encoding="utf-8").splitlines()) if listed.is_file() else set()
    for name in (_names_in(out, formats) & earlier).difference(files):
        (out / name).unlink()
    written = _names_in(out, (*WRITERS, "plan")) & earlier.union(files)
    if written:
        listed.write_text("\n".join(sorted(written)) + "\n", encoding="utf-8")


def _names_in(out: Path, formats: Collection[str]) -> set[str]:
    """Return the names of the tables and missions of all exports to a folder in these formats."""
    tables = {f"{table}.{each}" for table in TABLES for each in WRITERS if each in formats}
    found = {each.name for each in out.iterdir()}
    plans = {name for name in found if PLAN.fullmatch(name)} if "plan" in formats else set[str]()
    return found & tables | plans


def _add_rows(tables: TableFiles, rows: Rows, system_id: int, event: LogEvent) -> None:
    for table, row in rows.of(system_id, event):
        tables.add_row(table, row)


def _unique(name: str, suffix: str, used: Collection[str]) -> str:
    """Return the name, extended if another log of the flight has the same name."""
    others = (f"{name}{suffix}-{number}" for number in count(2))
    return next(each for each in chain((name, name + suffix), others) if each not in used)


def _plans(flown: list[Flown], out: Path) -> list[str]:
    files = []
    for each in flown:
        for number, (_, items) in enumerate(each.missions, 1):
            name = f"{each.name}-mission-{number}.plan"
            stack = each.stack or stack_named("px4", "plane")
            write_plan(out / name, Plan(items, home=each.home or (0.0, 0.0, 0.0)), stack)
            files.append(name)
    return files


def _kml(flown: list[Flown]) -> Iterator[str]:
    """Yield KML 2.2 with a gx:Track (Google's extension) for each vehicle.

    Altitudes are above sea level. The track of a log without a date is a line without times.
    """
    yield (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>\n'
    )
    for each in flown:
        yield f"<Placemark><name>{escape(each.name)}</name>"
        yield from _kml_track(each) if each.dated else _kml_line(each)
        yield "</Placemark>\n"
    yield "</Document></kml>\n"


def _kml_track(flown: Flown) -> Iterator[str]:
    yield "<gx:Track><altitudeMode>absolute</altitudeMode>\n"
    for at_us, lat_deg, lon_deg, altitude_m in flown.track:
        yield f"<when>{utc(at_us + flown.offset_us)}</when>"
        yield f"<gx:coord>{lon_deg:.7f} {lat_deg:.7f} {altitude_m:.2f}</gx:coord>\n"
    yield "</gx:Track>"


def _kml_line(flown: Flown) -> Iterator[str]:
    yield "<description>The log has no calendar date, so the line has no times.</description>"
    yield "<LineString><altitudeMode>absolute</altitudeMode><coordinates>\n"
    for _, lat_deg, lon_deg, altitude_m in flown.track:
        yield f"{lon_deg:.7f},{lat_deg:.7f},{altitude_m:.2f}\n"
    yield "</coordinates></LineString>"
