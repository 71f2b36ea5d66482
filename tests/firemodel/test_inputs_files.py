"""FARSITE's inputs files, its daily weather with winds, and Cell2Fire's weather."""

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from firemodel.errors import FireModelError
from firemodel.landscape.readers.inputs_files import read_fuel_moistures, read_inputs
from firemodel.landscape.readers.weather_files import read_weather
from firemodel.landscape.readers.weather_records import records_in
from firemodel.physics.rothermel import M_S_PER_MPH, Moisture
from tests.firemodel.shared import shared_file
from tests.firemodel.test_fuel_files import written

MOISTURE = Moisture(0.03, 0.04, 0.06, 0.70, 1.00)
HEAD = "FARSITE INPUTS FILE VERSION 1.0\nFARSITE_START_TIME: 07 15 2230\nFARSITE_TIMESTEP: 30\n"
RAWS = """RAWS_ELEVATION: 500
RAWS_UNITS: English
RAWS: 2
2016 7 15 2200 77 25 0 10 0 25
2016 7 15 2300 68 40 0 5 270 25
"""
MOISTURES = "FUEL_MOISTURES_DATA: 2\n0 3 4 6 70 100\n101 5 6 8 60 90\n"
WTR = "ENGLISH\n7 15 0 500 1500 50 90 60 20 1200\n7 16 10 600 1400 52 80 70 30 1200 1000 1200\n"
WND = "7 15 0 5 270 0\n7 15 1230 10 180 50\n7 16 2300 20 90 0\n"


def test_an_inputs_file_gives_start_moistures_and_weather(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + MOISTURES + RAWS + "CROWN_FIRE_METHOD: Finney\n", "a.cfg")
    stream = read_weather(path, moisture=MOISTURE)
    assert [entry.at_s for entry in stream.entries] == [-1800.0, 1800.0]
    assert stream.entries[0].wind_speed_m_s == pytest.approx(10 * M_S_PER_MPH)
    assert stream.entries[0].moisture.classes == pytest.approx((0.03, 0.04, 0.06, 0.70, 1.0))
    assert stream.entries[1].moisture_of(101).classes == pytest.approx((0.05, 0.06, 0.08, 0.6, 0.9))
    assert stream.entries[1].moisture_of(102) == stream.entries[1].moisture
    assert read_inputs(path).ignored() == [
        "FARSITE_TIMESTEP",
        "RAWS_ELEVATION",
        "CROWN_FIRE_METHOD",
    ]
    assert read_fuel_moistures(path).keys() == {0, 101}


def test_conditioning_dries_each_fuel_from_its_own_moisture(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + MOISTURES + RAWS, "a.input")
    entry = read_weather(path, moisture=MOISTURE, conditioned=True).entries[1]
    assert 0.03 < entry.moisture.dead_1h < entry.moisture_of(101).dead_1h
    assert entry.moisture_of(101).live_woody == pytest.approx(0.9)


def test_named_files_are_found_by_path_or_beside_the_inputs_file(tmp_path: Path) -> None:
    raws = written(tmp_path, "RAWS_UNITS: English\n" + RAWS.split("RAWS: 2\n")[1], "w.raws")
    text = HEAD + MOISTURES + r"RAWS_FILE: C:\fires\w.raws" + "\n"
    found = read_weather(written(tmp_path, text, "a.input"), moisture=MOISTURE)
    inline = read_weather(written(tmp_path, HEAD + MOISTURES + RAWS, "b.input"), moisture=MOISTURE)
    assert found.entries == inline.entries
    raws.unlink()
    with pytest.raises(FireModelError, match=r"a.input line 7: no file C:/fires/w.raws, and no w"):
        read_weather(tmp_path / "a.input", moisture=MOISTURE)


def test_one_wind_of_flammap(tmp_path: Path) -> None:
    text = "ShortTerm-Inputs-File-Version-1\n\nWIND_SPEED: 23\nWIND_DIRECTION: 80\n"
    path = written(tmp_path, text + "WIND_SPEED_UNITS: 1\n", "a.txt")
    (entry,) = read_weather(path, moisture=MOISTURE).entries
    assert entry.wind_speed_m_s == pytest.approx(23 / 3.6 / 1.15)
    with pytest.raises(FireModelError, match=r"wind_from_deg = -1 must be 0 to 360"):
        read_weather(written(tmp_path, text.replace("80", "-1"), "b.txt"), moisture=MOISTURE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + RAWS.replace("RAWS: 2", "RAWS: 3"), "line 6: RAWS = 3, but 2 rows follow"),
        (HEAD + "FARSITE_TIMESTEP: 5\n", "line 4: FARSITE_TIMESTEP is given twice"),
        (HEAD + "what is this\n", "line 4: 'what is this' is neither KEY: value nor a row"),
        (HEAD, "contains no weather; add RAWS"),
        (HEAD.replace("2230", "2290") + RAWS, "line 2: FARSITE_START_TIME: '07 15 2290' is not"),
        (HEAD + RAWS.replace("English", "Knots"), "must be ENGLISH or METRIC"),
        (HEAD + "WIND_DATA: 1\n" + WND[:13], "has no WEATHER_DATA; add this key with its rows"),
    ],
)
def test_bad_inputs_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FireModelError, match=message) as caught:
        read_weather(written(tmp_path, text, "a.input"), moisture=MOISTURE)
    assert "\n" not in str(caught.value)


def test_daily_weather_has_its_extremes_at_their_hours(tmp_path: Path) -> None:
    """The minimum is at 05:00, the maximum at 15:00; the wind changes at its own times."""
    path = written(tmp_path, WTR, "a.wtr")
    written(tmp_path, WND, "a.wnd")
    begin = datetime.fromisoformat("2019-07-15T05:00")
    stream = read_weather(path, start=begin, moisture=MOISTURE, conditioned=True)
    hours = [entry.at_s / 3600.0 for entry in stream.entries]
    assert hours[0] == 0.0
    assert 7.5 in hours  # the wind from 12:30 on
    assert stream.weather_at(7.5 * 3600.0).wind_from_deg == 180.0
    assert stream.weather_at(7.4 * 3600.0).wind_speed_m_s == pytest.approx(5 * M_S_PER_MPH)
    dry = np.array([entry.dead_1h_pct for entry in stream.entries])
    assert dry[hours.index(11.0)] < dry[hours.index(24.0)]  # driest after the warm afternoon


def test_daily_weather_in_the_rows_of_an_inputs_file(tmp_path: Path) -> None:
    days, winds = WTR.partition("\n")[2], WND
    text = f"{HEAD}WEATHER_DATA: 2\n{days}WEATHER_DATA_UNITS: English\nWIND_DATA: 3\n{winds}"
    found = read_weather(written(tmp_path, text, "a.input"), moisture=MOISTURE)
    written(tmp_path, WND, "b.wnd")
    path = written(tmp_path, WTR, "a.wtr")
    begin = datetime.fromisoformat("2001-07-15T22:30")
    both = read_weather(path, start=begin, moisture=MOISTURE, wind=tmp_path / "b.wnd")
    assert found.entries == both.entries


@pytest.mark.parametrize(
    ("wtr", "wnd", "message"),
    [
        (WTR, None, "a.wtr: contains no wind, and its folder contains no a.wnd"),
        (WTR, "METRIC\n" + WND, "is ENGLISH, .* is METRIC"),
        ("7 15 0 500\n", WND, "a.wtr line 1: 4 fields; required are month, day, rain"),
        (WTR.replace("50 90 ", "90 50 "), WND, "a.wtr line 2: the minimum temperature 90"),
        (WTR.replace("7 16", "7 15"), WND, "a.wtr line 3: not later than the previous"),
        (WTR.replace("1500", "2500"), WND, "a.wtr line 2: '7 15 2500' is not a time"),
        (WTR, WND.replace("7 16", "7 15 x"), "a.wnd line 3: 7 fields"),
        (WTR, WND.replace(" 20 90", " 20 500"), "a.wnd line 3: wind direction is '500'"),
        (WTR, WND.replace("7 1", "9 1"), "contains no wind on the days of"),
    ],
)
def test_bad_daily_files_are_refused(
    tmp_path: Path, wtr: str, wnd: str | None, message: str
) -> None:
    path = written(tmp_path, wtr, "a.wtr")
    if wnd is not None:
        written(tmp_path, wnd, "a.wnd")
    with pytest.raises(FireModelError, match=message) as caught:
        read_weather(path, moisture=MOISTURE)
    assert "\n" not in str(caught.value)


def test_winds_may_begin_in_another_year_than_the_days(tmp_path: Path) -> None:
    december, january = "12 31 0 500 1500 50 90 60 20 1200\n", "1 1 0 500 1500 50 90 60 20 1200\n"
    old, late = "12 30 0 5 270 0\n", "1 1 1230 10 180 50\n"
    begin = datetime.fromisoformat("2002-01-01T06:00")
    for days, winds in (
        (december + january, "1 1 0 5 270 0\n" + late),
        (january, old + late),
        (december + january, old + late),
    ):
        path = written(tmp_path, days, "a.wtr")
        written(tmp_path, winds, "a.wnd")
        stream = read_weather(path, start=begin, moisture=MOISTURE)
        at_h = (0.0, 7.0)
        assert [stream.weather_at(h * 3600.0).wind_from_deg for h in at_h] == [270.0, 180.0]


def test_rain_wets_the_fuel_only_in_its_hours(tmp_path: Path) -> None:
    path = written(tmp_path, WTR, "a.wtr")
    written(tmp_path, WND, "a.wnd")
    begin = datetime.fromisoformat("2001-07-16T09:00")
    entries = read_weather(path, start=begin, moisture=MOISTURE, conditioned=True).entries
    before, after = entries[0], next(each for each in entries if each.at_s == 3.0 * 3600.0)
    assert after.dead_1h_pct > before.dead_1h_pct + 10.0
    later = next(each for each in entries if each.at_s == 6.0 * 3600.0)
    assert later.dead_1h_pct < after.dead_1h_pct - 5.0


@pytest.mark.parametrize(
    ("hours", "begin_h", "wet"),
    [
        ("1000 1200", 34.0, {34: 0.05, 35: 0.05}),
        ("1010 1050", 34.0, {34 + 1 / 6: 0.1}),
        ("2200 200", 46.0, {46: 0.025, 47: 0.025, 48: 0.025, 49: 0.025}),
        ("0 0", 24.0, dict.fromkeys(range(24, 48), 0.1 / 24)),
        ("", 24.0, dict.fromkeys(range(24, 48), 0.1 / 24)),
    ],
)
def test_all_the_rain_falls_in_its_hours(
    tmp_path: Path, hours: str, begin_h: float, wet: dict[float, float]
) -> None:
    """Rain of a tenth of an inch falls on 16 July; the wind may change in each quarter hour."""
    days = WTR.replace("1000 1200", hours) + "7 17 0 600 1400 52 80 70 30 1200\n"
    quarters = "".join(
        f"7 16 {hour:02}{minute} 5 270 0\n" for hour in range(24) for minute in (15, 45)
    )
    for winds in (WND, f"7 15 0 5 270 0\n{quarters}7 17 2300 5 270 0\n"):
        written(tmp_path, winds, "a.wnd")
        rows = records_in(written(tmp_path, days, "a.wtr"), None, None).rows
        begin = datetime.fromisoformat("2001-07-15T00:00")
        found: dict[float, float] = {}
        for _, row in rows:
            hour = (datetime.fromisoformat(row["time"]) - begin).total_seconds() / 3600.0
            if float(row["rain_in"]) > 0.0:
                key = hour if winds == WND else float(hour // 1)
                found[round(key, 4)] = found.get(round(key, 4), 0.0) + float(row["rain_in"])
        assert sum(found.values()) == pytest.approx(0.1, abs=1e-4)
        if winds == WND:
            assert found == pytest.approx(
                {round(key, 4): each for key, each in wet.items()}, abs=1e-5
            )
        assert min(found) == pytest.approx(begin_h, abs=0.2)


NEW_YEAR = "12 30 0 500 1500 50 90 60 20 1200\n12 31 0 500 1500 50 90 60 20 1200\n"
NEW_YEAR += "1 1 0 500 1500 50 90 60 20 1200\n1 2 0 500 1500 50 90 60 20 1200\n"
NEW_YEAR_WIND = "12 30 0 5 270 0\n1 1 1100 10 180 50\n"


def test_daily_weather_may_begin_in_the_year_before_the_start(tmp_path: Path) -> None:
    path = written(tmp_path, NEW_YEAR, "a.wtr")
    written(tmp_path, NEW_YEAR_WIND, "a.wnd")
    for text, speed_mph in (("2026-12-31T12:00", 5.0), ("2027-01-01T12:00", 10.0)):
        stream = read_weather(path, start=datetime.fromisoformat(text), moisture=MOISTURE)
        assert stream.weather_at(0.0).wind_speed_m_s == pytest.approx(speed_mph * M_S_PER_MPH)
    with pytest.raises(FireModelError, match="2027-12-30"):
        read_weather(path, start=datetime.fromisoformat("2027-06-01T12:00"), moisture=MOISTURE)


def test_the_start_of_an_inputs_file_may_be_after_new_year(tmp_path: Path) -> None:
    head = HEAD.replace("07 15 2230", "01 01 1200")
    text = f"{head}WEATHER_DATA: 4\n{NEW_YEAR}WIND_DATA: 2\n{NEW_YEAR_WIND}"
    stream = read_weather(written(tmp_path, text, "a.input"), moisture=MOISTURE)
    assert stream.weather_at(0.0).wind_speed_m_s == pytest.approx(10.0 * M_S_PER_MPH)
    assert stream.source is not None
    assert stream.source.start == datetime.fromisoformat("2002-01-01T12:00")


def test_cell2fires_weather_has_an_hour_a_line(tmp_path: Path) -> None:
    text = "Instance,datetime,WS,WD\nBE,12/04/25 14:00,18,90\nBE,12/04/25 14:00,36,180\n"
    entries = read_weather(written(tmp_path, text, "Weather.csv"), moisture=MOISTURE).entries
    assert [entry.at_s for entry in entries] == [0.0, 3600.0]
    assert [entry.wind_from_deg for entry in entries] == [90.0, 180.0]
    assert entries[0].wind_speed_m_s == pytest.approx(5.0 / 1.15)


def test_farsites_own_inputs_file_names_a_missing_weather_file() -> None:
    folder = "farsite_flatland/Inputs/c_inputSpecFiles"
    path = shared_file(f"{folder}/flatland_clockwise1hr_RAWS.input")
    assert read_fuel_moistures(path) == {0: Moisture(0.03, 0.04, 0.06, 0.70, 1.0)}
    with pytest.raises(
        FireModelError, match=r"no file \./examples/flatland/.* in the folder of the inputs"
    ):
        read_weather(path)


@pytest.mark.parametrize(
    ("second", "third", "message"),
    [
        ("yesterday", "7/15/2019 15:00", "line 2: time = 'yesterday' is not a date"),
        ("7/15/2019 14:00", "7/15/2019 13:00", "line 4: datetime = 7/15/2019 13:00 is earlier"),
        ("2019-07-15 14:00", "2019-07-14 15:00", "line 4: .* keep only those of one scenario"),
    ],
)
def test_times_of_cell2fires_weather_must_not_decrease(
    tmp_path: Path, second: str, third: str, message: str
) -> None:
    first = second.replace("14:00", "13:00")
    rows = "".join(f"1,{time},10,90\n" for time in (first, second, third))
    path = written(tmp_path, "Scenario,datetime,WS,WD\n" + rows, "Weather.csv")
    with pytest.raises(FireModelError, match=message):
        read_weather(path, moisture=MOISTURE)


@pytest.mark.parametrize("days", [["18/03/25 11:15", "19/03/25 11:00"], ["2007-03-09"] * 2])
def test_cell2fires_dates_have_several_forms(tmp_path: Path, days: list[str]) -> None:
    rows = "".join(f"{day},10,90\n" for day in days)
    path = written(tmp_path, "datetime,WS,WD\n" + rows, "Weather.csv")
    assert len(read_weather(path, moisture=MOISTURE).entries) == 2
