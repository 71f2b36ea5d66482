"""Weather files: units, directions, constant or conditioned moistures, errors with line numbers."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from firemodel.errors import FireModelError
from firemodel.landscape.readers.weather_files import read_weather
from firemodel.physics.moisture import equilibrium_moisture_pct
from firemodel.physics.rothermel import Moisture
from tests.firemodel.shared import shared_file

MOISTURE = Moisture(0.03, 0.04, 0.06, 0.70, 1.00)
ENGLISH = """RAWS_ELEVATION: 500
RAWS_UNITS: English
RAWS: 3
2016 7 15 2200 77 25 0.00 10 0 25
2016 7 15 2300 68 40 0.10 5 270 25
2016 7 16 0 59 60 0.00 0 360 25
"""
METRIC = """RAWS_UNITS: Metric
RAWS_ELEVATION: 150
RAWS: 1
Year  Mth  Day   Time    Temp     RH  HrlyPcp  WindSpd WindDir CloudCov
2016 \t7 \t15 \t2200 \t25 \t25 \t0.00 \t18.507456 \t0 \t25
2016 \t7 \t15 \t2300 \t20 \t40 \t2.54 \t9.253728 \t270 \t25
2016 \t7 \t16 \t0000 \t15 \t60 \t0.00 \t0 \t0 \t25
"""
CSV = """time, wind_speed_mph, wind_from_deg, temperature_f, humidity_pct, rain_in
2016-07-15T22:00, 10, 0, 77, 25, 0
2016-07-15T23:00, 5, 270, 68, 40, 0.1
2016-07-16T00:00, 0, 0, 59, 60, 0
"""


def start(text: str) -> datetime:
    """Return a local time without a UTC offset, as in the files."""
    return datetime.fromisoformat(text)


def written(folder: Path, text: str, name: str = "weather.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_raws_speeds_are_mph_at_20_feet_and_times_count_from_the_first(tmp_path: Path) -> None:
    stream = read_weather(written(tmp_path, ENGLISH, "a.raws"), moisture=MOISTURE)
    assert [entry.at_s for entry in stream.entries] == [0.0, 3600.0, 7200.0]
    assert [entry.wind_speed_m_s for entry in stream.entries] == [4.4704, 2.2352, 0.0]
    assert [entry.wind_from_deg for entry in stream.entries] == [0.0, 270.0, 0.0]
    for entry in stream.entries:
        assert entry.moisture.classes == pytest.approx(MOISTURE.classes)


@pytest.mark.parametrize("conditioned", [False, True])
def test_metric_raws_and_csv_give_the_same_as_english_raws(
    tmp_path: Path, conditioned: bool
) -> None:
    """Metric winds are in km/h at 10 m: 18.507456 = 10 mph times 1.609344 times 1.15."""
    read = [
        read_weather(written(tmp_path, text, name), moisture=MOISTURE, conditioned=conditioned)
        for text, name in ((ENGLISH, "a.raws"), (METRIC, "b.WXS"), (CSV, "c.csv"))
    ]
    for entries in zip(*(stream.entries for stream in read), strict=True):
        for other in entries[1:]:
            assert other.at_s == entries[0].at_s
            assert other.wind_speed_m_s == pytest.approx(entries[0].wind_speed_m_s)
            assert other.wind_from_deg == entries[0].wind_from_deg
            assert other.moisture.classes == pytest.approx(entries[0].moisture.classes)


def test_conditioned_moistures_follow_the_weather_and_the_live_ones_stay(tmp_path: Path) -> None:
    path = written(tmp_path, ENGLISH, "a.raws")
    first, second, third = read_weather(path, moisture=MOISTURE, conditioned=True).entries
    assert first.dead_1h_pct == pytest.approx(3.0)
    tends_to = float(equilibrium_moisture_pct(25.0, 25.0))
    assert second.dead_1h_pct == pytest.approx(tends_to + (3.0 - tends_to) * 0.36788, rel=1e-4)
    assert 20.0 < third.dead_1h_pct < 35.0  # the hour of rain
    assert third.dead_10h_pct < 10.0
    assert third.live_herb_pct == pytest.approx(70.0)


def test_what_is_past_at_the_start_is_left_out_but_has_dried_the_fuel(tmp_path: Path) -> None:
    path = written(tmp_path, ENGLISH, "a.raws")
    whole = read_weather(path, moisture=MOISTURE, conditioned=True)
    later = read_weather(path, start=start("2016-07-15T23:30"), moisture=MOISTURE, conditioned=True)
    assert [entry.at_s for entry in later.entries] == [-1800.0, 1800.0]
    assert later.weather_at(0.0).wind_from_deg == 270.0
    assert later.entries[0].dead_1h_pct == whole.entries[1].dead_1h_pct


@pytest.mark.parametrize(
    ("column", "value", "m_s"),
    [
        ("wind_speed_m_s", 4.0, 4.0),
        ("wind_speed_mph", 10.0, 4.4704),
        ("wind_speed_kmh", 36.0, 10.0),
        ("wind_10m_m_s", 11.5, 10.0),
        ("wind_10m_mph", 11.5, 4.4704),
        ("wind_10m_kmh", 41.4, 10.0),
    ],
)
def test_wind_speeds_in_csv_name_unit_and_height(
    tmp_path: Path, column: str, value: float, m_s: float
) -> None:
    path = written(tmp_path, f"wind_from_deg,{column},at_s\n90,{value},0\n")
    assert read_weather(path, moisture=MOISTURE).weather_at(0.0).wind_speed_m_s == pytest.approx(
        m_s
    )


def test_wind_towards_south_comes_from_north(tmp_path: Path) -> None:
    text = "at_s,wind_speed_m_s,wind_toward_deg\n0,1,180\n60,1,350\n120,1,360\n"
    entries = read_weather(written(tmp_path, text), moisture=MOISTURE).entries
    assert [entry.wind_from_deg for entry in entries] == [0.0, 170.0, 180.0]


def test_moistures_in_csv_go_before_those_given(tmp_path: Path) -> None:
    names = "dead_1h_pct,dead_10h_pct,dead_100h_pct,live_herb_pct,live_woody_pct"
    text = f"at_s,wind_speed_m_s,wind_from_deg,{names}\n-60,1,0,5,6,7,80,90\n60,1,0,4,5,6,80,90\n"
    alone = read_weather(written(tmp_path, text)).entries
    assert [entry.dead_1h_pct for entry in alone] == [5.0, 4.0]
    assert alone[1].moisture.classes == pytest.approx((0.04, 0.05, 0.06, 0.80, 0.90))
    part = "at_s,wind_speed_m_s,wind_from_deg,dead_1h_pct\n0,1,0,5\n"
    mixed = read_weather(written(tmp_path, part), moisture=MOISTURE).weather_at(0.0)
    assert mixed.moisture.classes == pytest.approx((0.05, 0.04, 0.06, 0.70, 1.00))


def test_times_with_an_offset_are_compared_as_moments(tmp_path: Path) -> None:
    text = "time,wind_speed_m_s,wind_from_deg\n2016-07-15T22:00-05:00,1,0\n2016-07-16T04:00Z,2,0\n"
    begin = datetime(2016, 7, 16, 3, 30, tzinfo=UTC)
    stream = read_weather(written(tmp_path, text), start=begin, moisture=MOISTURE)
    assert [entry.at_s for entry in stream.entries] == [-1800.0, 1800.0]


HEAD = "at_s,wind_speed_m_s,wind_from_deg\n"
DATED = "time,wind_speed_m_s,wind_from_deg\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"w\.csv: contains no weather"),
        (HEAD, r"w\.csv: contains no weather"),
        (HEAD + "0,1,0\n60,fast,0\n", r"w\.csv line 3: wind_speed_m_s = 'fast' is not a number"),
        (HEAD + "0,1,0\n\n60,1,400\n", r"w\.csv line 4: wind_from_deg = 400 must be 0 to 360"),
        (HEAD + "0,-1,0\n", r"line 2: wind_speed_m_s = -1 must be 0 to 100"),
        (HEAD + "0,nan,0\n", r"line 2: wind_speed_m_s = nan must be 0 to 100"),
        (HEAD + "0,,0\n", r"line 2: wind_speed_m_s = '' is not a number"),
        (HEAD + "0,1\n", r"line 2: 2 values, but 3 column names"),
        (HEAD + "nan,1,0\n", r"line 2: at_s = nan is not a number of seconds"),
        (HEAD + "0,1,0\n0,2,0\n", r"line 3: at_s = 0 is not later than the previous record \(0\)"),
        (HEAD + "60,1,0\n", r"weather covers at_s = 60 to 60; the start 0 s is outside"),
        ("at_s,wind_from_deg\n0,0\n", r"no column for wind speed, such as wind_speed_m_s"),
        ("at_s,wind_speed_m_s\n0,0\n", r"no column for wind_from_deg or wind_toward_deg"),
        ("wind_from_deg,wind_speed_m_s\n0,0\n", r"no column for time or at_s"),
        ("at_s,wind_dir\n0,0\n", r"column 'wind_dir' is unknown; columns are at_s, time, wind_"),
        ("at_s,at_s\n0,0\n", r"two columns have the same name"),
        (
            "at_s,wind_speed_mph,wind_10m_kmh,wind_from_deg\n0,1,1,0\n",
            r"wind_speed_mph and wind_10m_kmh have the same meaning; remove one",
        ),
        (
            DATED + "2016-07-15T22:00,1,0\n2016-07-32,1,0\n",
            r"line 3: time = '2016-07-32' is not a date",
        ),
        (
            DATED + "2016-07-15T22:00,1,0\n2016-07-15T23:00Z,1,0\n",
            r"line 3: time = 2016-07-15T23:00Z and 2016-07-15T22:00:00: one has a UTC offset",
        ),
    ],
)
def test_a_bad_csv_is_refused_with_line_field_and_value(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(FireModelError, match=message):
        read_weather(written(tmp_path, text, "w.csv"), moisture=MOISTURE)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "English",
            "Imperial",
            r"w\.raws line 2: RAWS_UNITS = Imperial: must be English or Metric",
        ),
        ("RAWS_UNITS: English\n", "", r"line 3: no units before the first record"),
        (" 10 0 25", " 10 0", r"line 4: 9 fields instead of 10: year, month"),
        ("68 40", "68 140", r"line 5: humidity_pct = 140 must be 0 to 100"),
        ("68 40", "-999 40", r"line 5: temperature_f = -999 must be -76 to 158"),
        ("0.10", "0,10", r"line 5: rain_in = '0,10' is not a number"),
        ("7 15 2300", "7 15 2360", r"line 5: time = '2016-07-15T23:60' is not a date"),
        ("7 16 0 ", "7 15 2300 ", r"line 6: time = 2016-07-15T23:00 is not later"),
        (
            "2016 7 16",
            "O2016 7 16",
            r"line 6: 'O2016' is not the first field of a header line or a record",
        ),
    ],
)
def test_a_bad_raws_is_refused_with_line_field_and_value(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in ENGLISH
    with pytest.raises(FireModelError, match=message):
        read_weather(written(tmp_path, ENGLISH.replace(old, new), "w.raws"), moisture=MOISTURE)


def test_what_does_not_go_together_is_refused(tmp_path: Path) -> None:
    raws, plain = written(tmp_path, ENGLISH, "w.raws"), written(tmp_path, HEAD + "0,1,0\n", "a.csv")
    dead = written(tmp_path, "at_s,wind_speed_m_s,wind_from_deg,dead_1h_pct\n0,1,0,5\n", "d.csv")
    for message, path, options in (
        ("no column dead_1h_pct; add it, or specify the moisture", raws, {}),
        ("start 2017-07-15 00:00:00 is outside", raws, {"start": start("2017-07-15T00:00")}),
        ("start 2016-07-15 21:59:00 is outside", raws, {"start": start("2016-07-15T21:59")}),
        ("one has a UTC offset", raws, {"start": datetime(2016, 7, 15, 22, tzinfo=UTC)}),
        ("in which 0 s is the start", plain, {"start": start("2016-07-15T22:00")}),
        ("has no column temperature_c", plain, {"moisture": MOISTURE, "conditioned": True}),
        ("has a column dead_1h_pct", dead, {"moisture": MOISTURE, "conditioned": True}),
    ):
        with pytest.raises(FireModelError, match=message):
            read_weather(path, **options)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FireModelError, match=r"missing\.wxs: cannot be read \(No such file"):
        read_weather(tmp_path / "missing.wxs", moisture=MOISTURE)
    with pytest.raises(FireModelError, match="not a known kind of weather file"):
        read_weather(written(tmp_path, ENGLISH, "a.txt"), moisture=MOISTURE)
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FireModelError, match="is not text in UTF-8"):
        read_weather(tmp_path / "b.csv", moisture=MOISTURE)


def test_farsites_own_flatland_stream_turns_clockwise() -> None:
    folder = "farsite_flatland/Inputs/d_weatherFiles"
    path = shared_file(f"{folder}/flatland_clockwise1hr.raws")
    stream = read_weather(path, start=start("2013-04-26T12:00"), moisture=MOISTURE)
    assert [entry.wind_from_deg for entry in stream.entries] == [180, 240, 300, 0, 60, 120, 180]
    assert {entry.wind_speed_m_s for entry in stream.entries} == {3 * 0.44704}
    assert stream.entries[-1].at_s == 6 * 3600.0


def test_a_summer_of_a_real_wxs_stays_within_the_moistures_of_dead_fuel() -> None:
    path = shared_file("weather/OakKnoll2016.wxs")
    stream = read_weather(path, moisture=MOISTURE, conditioned=True)
    assert len(stream.entries) == 1502
    fine, coarse = zip(*((e.dead_1h_pct, e.dead_100h_pct) for e in stream.entries), strict=True)
    assert 1.0 < min(fine) < 3.0
    assert 10.0 < max(fine) < 36.0
    assert max(fine) - min(fine) > 3.0 * (max(coarse) - min(coarse))
