"""Warnings about inputs that are valid but probably unintended, and about the edge."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import firemodel
from firemodel.errors import FireModelWarning
from firemodel.input_warnings import FireInputs, input_warnings
from firemodel.landscape.readers.weather_files import read_weather
from firemodel.physics.rothermel import Moisture
from firemodel.physics.weather import Weather, WeatherSource, WeatherStream
from firemodel.spread.edge import AtEdge, at_edge
from tests.firemodel.grids import landscape, steady, weather

HOUR_S = 3600.0
LAND = landscape()
LIT = [(20, 20, 0.0)]
ROCK = 99


def lines_for(
    *entries: Weather, source: WeatherSource | None = None, end_s: float = HOUR_S
) -> list[str]:
    return input_warnings(FireInputs(LAND, WeatherStream(entries, source), LIT, end_s))


def hourly(*hours: float) -> list[Weather]:
    return [weather(2.0, at_s=HOUR_S * hour) for hour in hours]


def test_usual_inputs_give_no_warning() -> None:
    assert lines_for(weather(60.0)) == []
    dry = replace(weather(), dead_1h_pct=1.0, live_herb_pct=5.0, live_woody_pct=0.0)
    assert lines_for(dry) == []


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"dead_1h_pct": 0.06},
            "dead_1h_pct = 0.06 %: probably a fraction; specify it in percent (6)",
        ),
        (
            {"live_herb_pct": 0.6},
            "live_herb_pct = 0.6 %: probably a fraction; specify it in percent (60)",
        ),
        ({"dead_100h_pct": 0.0}, "dead_100h_pct = 0 %: dead fuel is never this dry"),
        ({"wind_speed_m_s": 61.0}, "wind of 61 m/s, more than 60 m/s: probably in another"),
    ],
)
def test_a_value_is_named_with_its_entry(changes: dict[str, Any], text: str) -> None:
    (line,) = lines_for(weather(), replace(weather(at_s=60.0), **changes))
    assert line.startswith(f"weather entry 1: {text}")


def test_each_rule_gives_one_line_with_the_number_of_the_others() -> None:
    fractions = [
        replace(weather(at_s=at_s), dead_1h_pct=0.06, dead_10h_pct=0.07) for at_s in (0.0, 60.0)
    ]
    (line,) = lines_for(*fractions)
    assert line.endswith("specify it in percent (6) (and 3 more values)")


def test_a_fuel_with_its_own_moistures() -> None:
    own = replace(weather(), of_fuels=((8, Moisture(0.0006, 0.0, 0.08, 0.6, 0.9)),))
    fraction, missing = lines_for(own)
    assert fraction.startswith("weather entry 0: dead_1h_pct of fuel 8 = 0.06 %: probably a frac")
    assert missing.startswith("weather entry 0: dead_10h_pct of fuel 8 = 0 %: dead fuel")


def test_an_entry_after_the_end_gives_no_warning() -> None:
    assert lines_for(weather(), replace(weather(at_s=HOUR_S), dead_1h_pct=0.06)) == []


def test_the_air_of_a_file_is_too_dry() -> None:
    source = WeatherSource("a.csv", datetime.fromisoformat("2024-07-01T12:00"), (30.0, 0.3, 0.2))
    (line,) = lines_for(*hourly(0, 0.25, 0.5), source=source)
    assert line == (
        "a.csv, record of 2024-07-01T12:15: humidity of 0.3 %, below 1 %: probably a fraction or a "
        "missing value; specify it in percent (and 1 more record)"
    )


def test_a_file_ends_before_the_fire() -> None:
    source = WeatherSource("a.csv")
    assert lines_for(*hourly(0, 1), source=source, end_s=2 * HOUR_S) == []
    (line,) = lines_for(*hourly(0, 1), source=source, end_s=3 * HOUR_S)
    assert line.startswith("a.csv: ends at 3600 s; its last record is used until 10800 s")
    # Entries of a scenario are used until the next entry.
    assert lines_for(*hourly(0, 1), end_s=3 * HOUR_S) == []


def test_a_file_has_a_gap() -> None:
    source = WeatherSource("a.csv")
    assert lines_for(*hourly(0, 3, 6), source=source, end_s=7 * HOUR_S) == []
    (line,) = lines_for(*hourly(0, 1, 4.5), source=source, end_s=5 * HOUR_S)
    assert line.startswith("a.csv: no record between 3600 s and 16200 s (3.5 h)")
    assert lines_for(*hourly(0, 1, 4.5), end_s=5 * HOUR_S) == []


@pytest.mark.parametrize(
    ("start", "change"),
    [
        (
            datetime.fromisoformat("2026-03-07T22:00"),
            "2026-03-08",
        ),  # clocks go forward in Tennessee
        (datetime.fromisoformat("2026-10-31T22:00"), "2026-11-01"),  # clocks go back
        (datetime.fromisoformat("2026-03-08T04:00"), None),
        (datetime(2026, 3, 7, 22, tzinfo=UTC), None),
    ],
)
def test_local_times_cross_a_change_of_clocks(start: datetime, change: str | None) -> None:
    lines = lines_for(*hourly(0, 2, 4, 6), source=WeatherSource("a.csv", start), end_s=7.0 * HOUR_S)
    if change is None:
        assert lines == []
    else:
        (line,) = lines
        assert line.startswith("a.csv: its times have no UTC offset, and clocks in America/Chicago")
        assert f"change on {change}" in line


def test_the_file_s_times_and_humidity_reach_the_rules(tmp_path: Path) -> None:
    path = tmp_path / "station.csv"
    path.write_text(
        "time,wind_speed_m_s,wind_from_deg,humidity_pct,dead_1h_pct,dead_10h_pct,dead_100h_pct,"
        "live_herb_pct,live_woody_pct\n"
        "2026-03-07T20:00,2,0,0.1,6,7,8,60,90\n"
        "2026-03-07T21:00,2,0,30,6,7,8,60,90\n"
        "2026-03-08T05:00,2,0,0.25,6,7,8,60,90\n"
    )
    whole = read_weather(path)
    assert whole.source == WeatherSource(
        str(path), datetime.fromisoformat("2026-03-07T20:00"), (0.1, 30.0, 0.25)
    )
    start = datetime.fromisoformat("2026-03-07T21:30")
    stream = read_weather(path, start=start)
    assert stream.source == WeatherSource(str(path), start, (30.0, 0.25))
    lines = input_warnings(FireInputs(LAND, stream, LIT, 9.0 * HOUR_S))
    assert [line.removeprefix(str(path)) for line in lines] == [
        ", record of 2026-03-08T05:00: humidity of 0.25 %, below 1 %: probably a fraction or a "
        "missing value; specify it in percent",
        ": no record between -1800 s and 27000 s (8 h): records are probably missing; the record "
        "before the gap is used",
        ": its times have no UTC offset, and clocks in America/Chicago change on 2026-03-08: if "
        "these are local times, an hour is missing or repeated; add a UTC offset to the times",
    ]


def lines_of_ignition(*cells: tuple[int, int], burnable: set[tuple[int, int]]) -> list[str]:
    fuel = np.full((41, 41), ROCK)
    fuel[tuple(np.array(sorted(burnable)).T)] = 1
    lit = [(row, col, 0.0) for row, col in cells]
    return input_warnings(FireInputs(landscape(fuel), steady(), lit, HOUR_S))


def test_an_ignition_is_enclosed() -> None:
    (line,) = lines_of_ignition((5, 5), burnable={(5, 5), (5, 7)})
    assert line.startswith("ignition at row 5, column 5: no cell around it can burn, so the fire")
    assert lines_of_ignition((5, 5), burnable={(5, 5), (6, 6)}) == []
    # All of them are lit.
    (line,) = lines_of_ignition((5, 5), (5, 6), burnable={(5, 5), (5, 6), (9, 9)})
    assert line.startswith("ignition at row 5, column 5")
    (line,) = lines_of_ignition((5, 5), (8, 8), burnable={(5, 5), (8, 8), (8, 9)})
    assert line.startswith("ignition at row 5, column 5")
    assert "so from there the fire cannot spread" in line


def test_an_ignition_is_at_the_edge() -> None:
    found = input_warnings(FireInputs(LAND, steady(), [(3, 0, 0.0), (3, 40, 0.0)], HOUR_S))
    (line,) = found
    assert line.startswith("ignition at row 3, column 0: at the edge of the landscape")
    assert line.endswith("(and 1 more cell)")


@pytest.mark.parametrize(
    ("row", "col"), [(2, 20), (38, 20), (20, 2), (20, 38)], ids=["north", "south", "west", "east"]
)
def test_the_first_arrival_at_the_edge(row: int, col: int) -> None:
    lat, lon = LAND.lat_lon_of(*LAND.xy_of(row, col))
    fire = firemodel.burn(LAND, steady(), [(float(lat), float(lon))], duration_s=1.0)
    assert at_edge(fire) is None
    while at_edge(fire) is None:
        fire.advance(fire.time_s + 60.0)
    found = at_edge(fire)
    assert found is not None
    row, col = {2: 0, 38: 40, 20: 20}[row], {2: 0, 38: 40, 20: 20}[col]
    assert LAND.cell_of_lat_lon(found.lat_deg, found.lon_deg) == (row, col)
    assert found.at_s == fire.arrival_time_s[row, col]
    fire.advance(fire.time_s + HOUR_S)
    assert at_edge(fire) == found


def test_a_cell_at_the_edge_that_is_lit_later_has_not_burned_yet() -> None:
    fire = firemodel.burn(LAND, steady(), duration_s=1.0)
    fire.arrival_time_s[0, 3] = 60.0  # some schemes store a future time
    assert at_edge(fire) is None
    fire.time_s = 60.0
    assert at_edge(fire) is not None


def test_burn_issues_python_warnings() -> None:
    fraction = replace(weather(5.0), dead_1h_pct=0.06)
    with pytest.warns(FireModelWarning) as caught:
        firemodel.burn(LAND, fraction, duration_s=HOUR_S)
    texts = [str(each.message) for each in caught]
    assert texts[0].startswith("weather entry 0: dead_1h_pct = 0.06 %")
    assert texts[1].startswith("the fire reached the edge of the landscape at 0:")
    assert all(each.filename == __file__ for each in caught)


def test_an_arrival_at_the_edge_before_0_s_is_stated_with_a_minus() -> None:
    assert "landscape at -0:01:40 (lat" in str(AtEdge(-99.5, 46.0, 9.0))
