"""Find fire inputs that are valid but probably unintended; each rule gives one warning."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import date, datetime, timedelta
from itertools import pairwise
from typing import NamedTuple
from zoneinfo import ZoneInfo

import numpy as np

from firemodel.landscape.landscape import Landscape
from firemodel.landscape.readers.weather_records import YEAR
from firemodel.landscape.time_zone import time_zone_of
from firemodel.physics.fuels import NON_BURNABLE
from firemodel.physics.weather import DEAD_PCT, Weather, WeatherStream
from firemodel.spread.edge import BEYOND_EDGE
from firemodel.spread.fire_scheme import Ignition

MAX_LAST_RECORD_S = 3600.0  # the last weather record may be used for this long without a warning
MAX_GAP_S = 3.0 * 3600.0
MIN_DEAD_PCT = 1.0  # even in a desert the moisture of dead fuel is higher
MIN_LIVE_PCT = 5.0  # live fuel is moister; a moisture given as a fraction is at most 3
MIN_HUMIDITY_PCT = 1.0
MAX_WIND_M_S = 60.0
MAX_ZONES = timedelta(hours=26)  # largest difference between local times on Earth
LIVE = ("live_herb_pct", "live_woody_pct")


class FireInputs(NamedTuple):
    """The inputs of a fire that is simulated until the time ``end_s``."""

    landscape: Landscape
    weather: WeatherStream
    ignitions: Sequence[Ignition]
    end_s: float


def input_warnings(inputs: FireInputs) -> list[str]:
    """Return the warnings about the inputs, at most one for each rule of ``RULES``.

    Args:
        inputs: The inputs, which a spread scheme has accepted or would accept.

    Returns:
        Lines of text, each with the location, the value and the probable cause. The list is empty
        for usual inputs.
    """
    return [line for rule in RULES for line in rule(inputs)]


def time_zero_warnings(weather: WeatherStream, time_zero: datetime | None) -> list[str]:
    """Return a warning if the calendar time of 0 s differs from the weather file's time at 0 s.

    Times without a UTC offset may be in any zone; for such times, a difference of at most
    ``MAX_ZONES`` gives no warning. The year is ignored if the file contains no year (``YEAR``).
    """
    source = weather.source
    if time_zero is None or source is None or source.start is None:
        return []
    start, allowed = source.start, timedelta(0)
    if start.tzinfo is None:
        start, allowed = start.replace(tzinfo=time_zero.tzinfo), MAX_ZONES
    if start.year == YEAR:
        start = start.replace(year=time_zero.year)
    if abs(start - time_zero) <= allowed:
        return []
    return [
        f"{source.name}: 0 s is {source.start.isoformat()} in the weather, but time_zero = "
        f"{time_zero.isoformat()}; correct time_zero, or the start of the weather"
    ]


def _moisture_as_fraction(inputs: FireInputs) -> Iterator[str]:
    limits_pct = dict.fromkeys(DEAD_PCT, MIN_DEAD_PCT) | dict.fromkeys(LIVE, MIN_LIVE_PCT)
    found = [
        f"{place}: {name} = {value:g} %: probably a fraction; specify it in percent "
        f"({100.0 * value:g})"
        for place, entry in _used(inputs)
        for name, value in _moistures_pct(entry)
        if 0.0 < value < limits_pct[name.partition(" ")[0]]
    ]
    yield from _first(found, "value")


def _no_dead_moisture(inputs: FireInputs) -> Iterator[str]:
    found = [
        f"{place}: {name} = 0 %: dead fuel is never this dry, so a value is probably missing; "
        "specify the moisture in percent"
        for place, entry in _used(inputs)
        for name, value in _moistures_pct(entry)
        if value == 0.0 and name.startswith(DEAD_PCT)
    ]
    yield from _first(found, "value")


def _moistures_pct(entry: Weather) -> Iterator[tuple[str, float]]:
    """Yield the name and the value of each moisture, including moistures of single fuels."""
    names = (*DEAD_PCT, *LIVE)
    yield from ((name, getattr(entry, name)) for name in names)
    for code, moisture in entry.of_fuels:
        for name, value in zip(names, moisture.classes, strict=True):
            yield f"{name} of fuel {code}", 100.0 * value


def _strong_wind(inputs: FireInputs) -> Iterator[str]:
    found = [
        f"{place}: wind of {entry.wind_speed_m_s:g} m/s, more than {MAX_WIND_M_S:g} m/s: probably "
        "in another unit (km/h, mph); convert it to m/s"
        for place, entry in _used(inputs)
        if entry.wind_speed_m_s > MAX_WIND_M_S
    ]
    yield from _first(found, "entry")


def _dry_air(inputs: FireInputs) -> Iterator[str]:
    source = inputs.weather.source
    if source is None or source.humidity_pct is None:
        return
    pairs = zip(_used(inputs), source.humidity_pct, strict=False)
    found = [
        f"{place}: humidity of {value:g} %, below {MIN_HUMIDITY_PCT:g} %: probably a fraction or "
        "a missing value; specify it in percent"
        for (place, _), value in pairs
        if value < MIN_HUMIDITY_PCT
    ]
    yield from _first(found, "record")


def _weather_ends_early(inputs: FireInputs) -> Iterator[str]:
    source, entries, end_s = inputs.weather.source, inputs.weather.entries, inputs.end_s
    last_s = entries[-1].at_s
    usual_s = last_s - entries[-2].at_s if len(entries) > 1 else MAX_LAST_RECORD_S
    if source is not None and end_s - last_s > max(usual_s, MAX_LAST_RECORD_S):
        yield (
            f"{source.name}: ends at {last_s:g} s; its last record is used until {end_s:g} s; use "
            "a longer file, or check the start and the duration"
        )


def _weather_gap(inputs: FireInputs) -> Iterator[str]:
    source = inputs.weather.source
    if source is None:
        return
    times_s = [entry.at_s for _, entry in _used(inputs)]
    found = [
        f"{source.name}: no record between {before_s:g} s and {after_s:g} s "
        f"({(after_s - before_s) / 3600.0:g} h): records are probably missing; the record before "
        "the gap is used"
        for before_s, after_s in pairwise(times_s)
        if after_s - before_s > MAX_GAP_S
    ]
    yield from _first(found, "gap")


def _change_of_clocks(inputs: FireInputs) -> Iterator[str]:
    source, last_s = inputs.weather.source, inputs.weather.entries[-1].at_s
    if source is None or source.start is None or source.start.tzinfo is not None:
        return
    to = source.start + timedelta(seconds=min(last_s, inputs.end_s))
    zone = time_zone_of(inputs.landscape)
    change = None if zone is None else _first_change(zone, source.start, to)
    if change is not None:
        yield (
            f"{source.name}: its times have no UTC offset, and clocks in {zone} change on "
            f"{change}: if these are local times, an hour is missing or repeated; add a UTC offset "
            "to the times"
        )


def _first_change(zone: ZoneInfo, start: datetime, to: datetime) -> date | None:
    """Return the first date between two local times on which the UTC offset changes, or None."""
    hours = int((to - start).total_seconds() // 3600.0)
    times = [start + timedelta(hours=each) for each in range(hours + 1)] + [to]
    offset = zone.utcoffset(start)
    return next((each.date() for each in times if zone.utcoffset(each) != offset), None)


def _enclosed_ignition(inputs: FireInputs) -> Iterator[str]:
    """Warn about lit cells without a burnable neighbour: fire cannot spread from these cells."""
    land = inputs.landscape
    lit = {(row, col) for row, col, _ in inputs.ignitions}
    burnable = {cell: _burnable_around(land, *cell) for cell in sorted(lit)}
    then = "the fire cannot spread; move the ignition, or check the fuel and the barriers around it"
    if lit and not any(around - lit for around in burnable.values()):
        row, col = min(lit)
        yield f"ignition at row {row}, column {col}: no cell around it can burn, so {then}"
        return
    found = [
        f"ignition at row {row}, column {col}: no cell around it can burn, so from there {then}"
        for (row, col), around in burnable.items()
        if not around
    ]
    yield from _first(found, "cell")


def _burnable_around(land: Landscape, row: int, col: int) -> set[tuple[int, int]]:
    """Return the burnable cells (row, column) among the eight neighbours of a cell."""
    top, left = max(row - 1, 0), max(col - 1, 0)
    codes = land.fuel_model[top : row + 2, left : col + 2]
    found = np.argwhere(~np.isin(codes, list(NON_BURNABLE))).tolist()
    return {(top + down, left + right) for down, right in found} - {(row, col)}


def _ignition_at_edge(inputs: FireInputs) -> Iterator[str]:
    rows, cols = inputs.landscape.shape
    found = [
        f"ignition at row {row}, column {col}: at the edge of the landscape; {BEYOND_EDGE}"
        for row, col, _ in inputs.ignitions
        if row in (0, rows - 1) or col in (0, cols - 1)
    ]
    yield from _first(found, "cell")


def _used(inputs: FireInputs) -> list[tuple[str, Weather]]:
    """Return the entries that take effect before ``end_s``, each with the name used in messages."""
    source = inputs.weather.source
    return [
        (f"weather entry {number}" if source is None else source.place(entry.at_s), entry)
        for number, entry in enumerate(inputs.weather.entries)
        if entry.at_s < inputs.end_s
    ]


def _first(lines: Sequence[str], kind: str) -> Iterable[str]:
    """Return a list with the first line and the number of further lines, or an empty list.

    ``kind`` is the noun for the counted lines.
    """
    others = len(lines) - 1
    more = f" (and {others} more {kind}{'s' * (others != 1)})" if others > 0 else ""
    return [f"{line}{more}" for line in lines[:1]]


RULES: tuple[Callable[[FireInputs], Iterator[str]], ...] = (
    _moisture_as_fraction,
    _no_dead_moisture,
    _strong_wind,
    _dry_air,
    _weather_ends_early,
    _weather_gap,
    _change_of_clocks,
    _enclosed_ignition,
    _ignition_at_edge,
)
