"""Decoders of other aircraft: published messages, messages made by the tests, and garbage."""

import copy
import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.config.surveillance_section import AircraftSource, SurveillanceSection
from mission_service.events import AircraftReported
from mission_service.ground_distance import M_PER_DEG
from mission_service.interfaces.cot.cot_events import zulu
from mission_service.surveillance.aircraft_reports import DECODERS, AircraftReports
from mission_service.surveillance.aircraft_table import (
    MAX_AGE_S,
    AircraftDecoder,
    AircraftTable,
    OwnPosition,
    Track,
    pressure_offset_m,
)
from mission_service.surveillance.beast import BeastDecoder
from mission_service.surveillance.cot_tracks import CotTrackDecoder, unix_us_of
from mission_service.surveillance.cpr import global_position, longitude_zones
from mission_service.surveillance.gdl90 import Gdl90Decoder, crc_of
from mission_service.surveillance.mode_s import ModeSDecoder
from mission_service.surveillance.sbs import SbsDecoder
from tests.service.aircraft_messages import (
    Aircraft,
    beast,
    beast_frames,
    callsign_squitter,
    cot_event,
    gdl90_frame,
    gdl90_report,
    position_squitter,
    sbs_lines,
)

# From "The 1090 Megahertz Riddle": an even and an odd position, a callsign and a velocity.
EVEN, ODD = "8D40621D58C382D690C8AC2863A7", "8D40621D58C386435CC412692AD6"
CALLSIGN, VELOCITY = "8D4840D6202CC371C32CE0576098", "8D485020994409940838175B284F"
HOME = (36.37, -84.13)
CRAFT = Aircraft(0xA4C2F1, 36.4, -84.1, 800.0, 40.0, -30.0, 2.6)


def table_at(lat_deg: float, lon_deg: float, **settings: Any) -> AircraftTable:
    table = AircraftTable(**{"range_m": 50_000.0, "qnh_hpa": 1013.25, **settings})
    table.update_region([OwnPosition("hawk", lat_deg, lon_deg, 500.0)])
    return table


def all_messages(form: str, craft: Aircraft) -> bytes:
    match form:
        case "sbs":
            return sbs_lines(craft)
        case "beast":
            frames = beast_frames(craft, odd=False) + beast_frames(craft, odd=True)
            return frames + beast(callsign_squitter(craft))
        case "gdl90":
            return gdl90_report(craft)
        case _:
            return cot_event(craft)


def test_the_published_messages_have_their_published_values() -> None:
    table = table_at(52.2, 3.9)
    decoder = ModeSDecoder(table, "radio")
    decoder.decode_squitters([bytes.fromhex(ODD)], 0)
    assert not table.tracks, "one position is ambiguous"
    decoder.decode_squitters([bytes.fromhex(EVEN)], 1_000_000)
    track = table.tracks["40621d"]
    assert (track.lat_deg, track.lon_deg) == pytest.approx((52.2572, 3.91937), abs=1e-5)
    assert track.altitude_amsl_m == pytest.approx(38_000 * 0.3048)
    for key in ("4840d6", "485020"):
        table.tracks[key] = Track("radio", 0, 52.2, 3.9, 0.0)
    decoder.decode_squitters([bytes.fromhex(CALLSIGN), bytes.fromhex(VELOCITY)], 2_000_000)
    assert table.tracks["4840d6"].callsign == "KLM1023"
    moved = table.tracks["485020"]
    speed_m_s = math.hypot(moved.north_m_s, moved.east_m_s)
    track_deg = math.degrees(math.atan2(moved.east_m_s, moved.north_m_s)) % 360.0
    assert speed_m_s / 0.514444 == pytest.approx(159.2, abs=0.1)
    assert track_deg == pytest.approx(182.88, abs=0.01)
    assert moved.climb_m_s / 0.00508 == pytest.approx(-832.0)
    assert decoder.rejected == 0


def test_longitude_zones_and_pairs_of_different_zones() -> None:
    assert [longitude_zones(lat) for lat in (0.0, 10.0, -11.0, 52.2, 86.0, 89.0)] == [
        *(59, 59, 58, 36),
        *(3, 1),
    ]
    assert global_position((93_000, 51_372), (74_158, 50_194), odd_is_newer=False) == pytest.approx(
        (52.2572, 3.91937), abs=1e-5
    )
    assert global_position((0, 0), (66_000, 0), odd_is_newer=True) is None


def test_the_crc_of_gdl90_is_that_of_the_specification() -> None:
    # The heartbeat in the specification: 7E 00 81 41 DB D0 08 02 B3 8B 7E
    assert crc_of(bytes.fromhex("008141DBD00802")) == 0x8BB3


@pytest.mark.parametrize("form", sorted(DECODERS))
@pytest.mark.parametrize("whole", [True, False])
def test_each_format_gives_the_aircraft_that_was_sent(form: str, whole: bool) -> None:
    table = table_at(*HOME)
    decoder = DECODERS[form](table, form)
    data = all_messages(form, CRAFT)
    if whole or form == "gdl90":  # datagrams are whole
        decoder.decode(data, 5_000_000)
    else:
        for byte in data:
            decoder.decode(bytes([byte]), 5_000_000)
        decoder.decode(b"\x1a" if form == "beast" else b"\n", 5_000_000)
    (key,) = table.tracks
    track = table.tracks[key]
    assert (key, track.source, track.callsign) == ("a4c2f1", form, "N417EA")
    assert (track.lat_deg, track.lon_deg) == pytest.approx((36.4, -84.1), abs=5e-5)
    assert track.altitude_amsl_m == pytest.approx(800.0, abs=4.0)
    assert (track.north_m_s, track.east_m_s) == pytest.approx((40.0, -30.0), abs=0.7)
    assert track.climb_m_s == pytest.approx(0.0 if form == "cot" else 2.6, abs=0.2)
    assert decoder.rejected == 0


@pytest.mark.parametrize("lat_deg", [-33.9, 0.001, 36.4, 71.2])
@pytest.mark.parametrize("lon_deg", [-179.0, -84.1, 0.01, 151.2])
def test_positions_are_decoded_everywhere(lat_deg: float, lon_deg: float) -> None:
    rng, table = random.Random(1), table_at(lat_deg, lon_deg)
    decoder = ModeSDecoder(table, "radio")
    for address in range(20):
        place = (lat_deg + rng.uniform(-0.2, 0.2), lon_deg + rng.uniform(-0.2, 0.2))
        craft = replace(CRAFT, address=address, lat_deg=place[0], lon_deg=place[1])
        both = [position_squitter(craft, odd=odd) for odd in (False, True)]
        decoder.decode_squitters(both, 0)
        track = table.tracks.get(f"{address:06x}")
        if track is None:  # the even and the odd latitude are in different longitude zones
            continue
        assert (track.lat_deg, track.lon_deg) == pytest.approx(place, abs=1e-4)
    assert len(table.tracks) >= 18


def test_an_aircraft_with_the_same_fraction_of_a_zone_far_away_is_not_used() -> None:
    table = table_at(*HOME)
    far = replace(CRAFT, lat_deg=CRAFT.lat_deg + 6.0)  # an even position equals that of CRAFT
    decoder = ModeSDecoder(table, "radio")
    for _ in range(5):
        decoder.decode_squitters([position_squitter(far, odd=False)], 0)
        decoder.decode_squitters([position_squitter(far, odd=True)], 0)
    assert not table.tracks


def test_a_jump_of_a_track_is_rejected() -> None:
    table, decoder = table_at(*HOME), ModeSDecoder(table_at(*HOME), "radio")
    decoder = ModeSDecoder(table, "radio")
    decoder.decode_squitters([position_squitter(CRAFT, odd=odd) for odd in (False, True)], 0)
    before = copy.copy(table.tracks["a4c2f1"])
    moved = replace(CRAFT, lat_deg=CRAFT.lat_deg + 0.3)
    decoder.decode_squitters([position_squitter(moved, odd=False)], 1_000_000)
    assert table.tracks["a4c2f1"] == before
    assert decoder.rejected == 1


@pytest.mark.parametrize("form", sorted(DECODERS))
def test_aircraft_outside_the_region_or_ignored_are_not_kept(form: str) -> None:
    far = table_at(HOME[0] + 2.0, HOME[1])
    DECODERS[form](far, form).decode(all_messages(form, CRAFT), 0)
    ignoring = table_at(*HOME, ignored=("A4C2F1",))
    DECODERS[form](ignoring, form).decode(all_messages(form, CRAFT), 0)
    nowhere = AircraftTable(50_000.0, 1013.25)
    DECODERS[form](nowhere, form).decode(all_messages(form, CRAFT), 0)
    assert [each.tracks for each in (far, ignoring, nowhere)] == [{}, {}, {}]


def test_aircraft_on_the_ground_are_removed() -> None:
    table = table_at(*HOME)
    sbs, gdl90 = SbsDecoder(table, "sbs"), Gdl90Decoder(table, "gdl90")
    sbs.decode(sbs_lines(CRAFT), 0)
    assert table.tracks
    sbs.decode(sbs_lines(CRAFT).replace(b",0,0,0,0\r\n", b",0,0,0,-1\r\n"), 0)
    assert not table.tracks
    gdl90.decode(gdl90_report(CRAFT), 0)
    assert table.tracks
    flags_at = 13  # of the miscellaneous indicators, in the unescaped message
    body = bytearray(gdl90_report(CRAFT)[1:-3].replace(b"\x7d\x5e", b"\x7e"))
    body[flags_at - 1] &= 0xF0
    gdl90.decode(gdl90_frame(bytes(body)), 0)
    assert not table.tracks
    assert (sbs.rejected, gdl90.rejected) == (0, 0)


def test_pressure_altitudes_are_corrected_by_the_pressure_at_sea_level() -> None:
    assert pressure_offset_m(1013.25) == 0.0
    assert pressure_offset_m(1003.25) == pytest.approx(-83.5, abs=0.5)
    table = table_at(*HOME, qnh_hpa=1003.25)
    SbsDecoder(table, "sbs").decode(sbs_lines(CRAFT), 0)
    assert table.tracks["a4c2f1"].altitude_amsl_m == pytest.approx(716.5, abs=4.0)


def test_one_aircraft_of_several_sources_is_one_track_of_one_source() -> None:
    table = table_at(*HOME)
    sbs, cot = SbsDecoder(table, "sbs"), CotTrackDecoder(table, "cot")
    sbs.decode(sbs_lines(CRAFT), 1_000_000)
    elsewhere = replace(CRAFT, lat_deg=36.41)
    cot.decode(cot_event(elsewhere), 2_000_000)
    assert [track.source for track in table.tracks.values()] == ["sbs"]
    assert table.tracks["a4c2f1"].lat_deg == pytest.approx(36.4)
    cot.decode(cot_event(elsewhere), 4_000_000)  # the first source has been silent
    assert [track.source for track in table.tracks.values()] == ["cot"]
    assert table.tracks["a4c2f1"].lat_deg == pytest.approx(36.41)


def test_unknown_altitudes_of_cot_are_not_used() -> None:
    table = table_at(*HOME)
    decoder = CotTrackDecoder(table, "cot")
    decoder.decode(cot_event(CRAFT).replace(b'hae="800.0"', b'hae="9999999.0"'), 0)
    decoder.decode(cot_event(CRAFT).replace(b"a-n-A-C-F", b"a-n-G-E-V"), 0)  # on the ground
    decoder.decode(b'<!DOCTYPE x [<!ENTITY a "b">]>' + cot_event(CRAFT), 0)
    assert list(table.tracks) == ["a4c2f1"], "a declaration before the element is not read"
    entity = cot_event(CRAFT).replace(b'callsign="N417EA"', b'callsign="&a;"')
    decoder.decode(b'<!DOCTYPE x [<!ENTITY a "b">]>' + entity, 0)
    assert decoder.rejected == 1


def test_the_times_of_cot_are_those_of_the_positions() -> None:
    table, now_us = table_at(*HOME), unix_us_of("2026-08-01T12:00:00Z")
    decoder = CotTrackDecoder(table, "cot")

    def received(lat_deg: float, age_s: float, at_us: int, stale_in_s: float = 30.0) -> None:
        sent_us = now_us + at_us - round(age_s * 1e6)
        event = cot_event(replace(CRAFT, lat_deg=lat_deg)).decode()
        event = event.replace("2026-08-01T12:00:00.000Z", zulu(sent_us))
        event = event.replace("2026-08-01T12:00:30.000Z", zulu(sent_us + round(stale_in_s * 1e6)))
        decoder.decode(event.encode(), at_us, now_us + at_us)

    received(36.4, 0.0, 10_000_000)
    received(36.401, 1.5, 12_000_000)
    track = table.tracks["a4c2f1"]
    assert track.confirmed
    assert (track.at_us, track.lat_deg) == (10_500_000, 36.401)
    received(36.402, -3.0, 13_000_000)  # the clock of the sender is fast
    assert (track.at_us, track.lat_deg) == (13_000_000, 36.402)
    received(36.401, 2.0, 14_000_000)  # overtaken on the way
    assert (track.at_us, track.lat_deg) == (13_000_000, 36.402)
    assert decoder.rejected == 0
    received(36.403, 10.0, 25_000_000, stale_in_s=4.0)
    received(36.403, 21.0, 45_000_000, stale_in_s=3600.0)
    assert (track.at_us, decoder.rejected) == (13_000_000, 2)
    received(36.403, 8.0, 25_000_000, stale_in_s=4.0)  # the clocks may differ by 5 s
    assert (track.at_us, track.lat_deg) == (17_000_000, 36.403)


@pytest.mark.parametrize("time", ["", "now", "0001-01-01T00:00:00+23:00", "9" * 99])
def test_an_event_of_cot_without_a_valid_time_is_rejected(time: str) -> None:
    table = table_at(*HOME)
    decoder = CotTrackDecoder(table, "cot")
    event = cot_event(CRAFT).replace(b"2026-08-01T12:00:00.000Z", time.encode())
    decoder.decode(event, 0, unix_us_of("2026-08-01T12:00:00Z"))
    assert (decoder.rejected, list(table.tracks)) == (1, [])


# Events of the table -------------------------------------------------------------------------


class Fix:
    def __init__(self, at_us: int, lat_deg: float = HOME[0]) -> None:
        self.at_us, self.lat_deg, self.lon_deg, self.altitude_amsl_m = (
            at_us,
            lat_deg,
            HOME[1],
            500.0,
        )


def events_at(reports: AircraftReports, at_us: int, fix: Fix | None = None) -> list[Any]:
    return list(reports.events_due({"hawk": fix or Fix(at_us)}, at_us))


def test_events_are_due_once_a_second_with_extrapolated_positions() -> None:
    reports = AircraftReports(SurveillanceSection())
    decoder = reports.decoder(AircraftSource(format="sbs", address="127.0.0.1:30003"))
    assert events_at(reports, 0) == [AircraftReported(0, "hawk", ())]
    decoder.decode(sbs_lines(CRAFT), 400_000)
    decoder.decode(sbs_lines(CRAFT), 500_000)
    assert events_at(reports, 900_000) == []
    (event,) = events_at(reports, 2_500_000)
    (state,) = event.aircraft
    assert state.age_s == 2.0
    assert state.lat_deg == pytest.approx(36.4 + 2.0 * 40.0 / M_PER_DEG, abs=2e-5)
    assert state.altitude_amsl_m == pytest.approx(805.2, abs=4.0)
    at_us = 3_000_000 + round(1e6 * MAX_AGE_S)
    assert events_at(reports, at_us) == [AircraftReported(at_us, "hawk", ())]
    assert events_at(reports, at_us + 1_000_000) == [], "no aircraft, as the last event states"


def test_a_vehicle_without_a_new_position_is_reported_as_such_once() -> None:
    reports = AircraftReports(SurveillanceSection())
    decoder = reports.decoder(AircraftSource(format="sbs", address="127.0.0.1:30003"))
    events_at(reports, 0)
    decoder.decode(2 * sbs_lines(CRAFT), 500_000)
    assert events_at(reports, 1_000_000)[0].aircraft
    assert events_at(reports, 7_000_000, Fix(1_000_000)) == [
        AircraftReported(7_000_000, "hawk", (), own_position_unknown=True)
    ]
    assert events_at(reports, 8_000_000, Fix(1_000_000)) == []
    decoder.decode(sbs_lines(CRAFT), 8_500_000)  # still tracked
    (event,) = events_at(reports, 9_000_000)
    assert [each.aircraft for each in event.aircraft] == ["a4c2f1"]
    assert not event.own_position_unknown


def test_at_most_fifty_aircraft_are_reported_the_nearest() -> None:
    reports = AircraftReports(SurveillanceSection())
    events_at(reports, 0)
    decoder = reports.decoder(AircraftSource(format="sbs", address="127.0.0.1:30003"))
    for number in range(80):
        craft = replace(CRAFT, address=number, lat_deg=HOME[0] + 0.001 * (80 - number))
        decoder.decode(2 * sbs_lines(craft), 1_000_000)
    (event,) = events_at(reports, 1_000_000)
    assert [each.aircraft for each in event.aircraft] == [f"{n:06x}" for n in range(30, 80)]


def test_an_aircraft_is_reported_after_two_positions_that_agree() -> None:
    reports = AircraftReports(SurveillanceSection())
    decoder = reports.decoder(AircraftSource(format="sbs", address="127.0.0.1:30003"))
    events_at(reports, 0)

    def shown(at_us: int, *positions: Aircraft) -> list[float]:
        for each in positions:
            decoder.decode(sbs_lines(each), at_us)
        own = OwnPosition("hawk", *HOME, 500.0)
        return [round(each.lat_deg, 2) for each in reports.table.near(own, at_us)]

    far = replace(CRAFT, lat_deg=36.5)
    assert shown(1_000_000, CRAFT) == []
    assert shown(2_000_000, far) == [], "the two positions contradict each other"
    assert shown(3_000_000, CRAFT) == []
    assert shown(4_000_000, CRAFT) == [36.4]
    assert shown(5_000_000, far) == [36.4], "a wrong position is not used"
    assert shown(5_000_000, CRAFT) == [36.4]
    assert shown(6_000_000, far, far, far, far) == [], "the track begins again"
    assert shown(7_000_000, far) == [36.5]


def test_without_the_table_there_are_no_events() -> None:
    assert events_at(AircraftReports(None), 0) == []


# Garbage ---------------------------------------------------------------------------------------


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return messages with one or more changed bytes, or a piece removed."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        found[rng.randrange(len(found))] = rng.randrange(256)
    cut = rng.randrange(len(found))
    return bytes(found[:cut] + found[cut + rng.choice([0, 0, 1, 5]) :])


def fed(make: Callable[[AircraftTable, str], AircraftDecoder], data: bytes) -> AircraftTable:
    table = table_at(*HOME)
    decoder = make(table, "source")
    decoder.decode(data, 0)
    decoder.decode(b"", 1_000_000)
    return table


@settings(max_examples=150, deadline=None)
@given(data=st.binary(max_size=400), form=st.sampled_from(sorted(DECODERS)))
def test_random_bytes_give_no_aircraft(data: bytes, form: str) -> None:
    assert not fed(DECODERS[form], data).tracks


@settings(max_examples=60, deadline=None)
@given(
    fields=st.lists(st.text(max_size=12) | st.floats().map(str), min_size=0, max_size=30),
    address=st.text(max_size=8),
)
def test_no_fields_of_a_line_raise_an_exception(fields: list[str], address: str) -> None:
    line = ",".join(["MSG", "3", "1", "1", address, *fields]).encode() + b"\n"
    for track in fed(SbsDecoder, line).tracks.values():
        assert all(map(math.isfinite, (track.lat_deg, track.altitude_amsl_m, track.north_m_s)))


@pytest.mark.parametrize("form", ["beast", "gdl90"])
def test_damaged_messages_with_a_checksum_give_no_wrong_position(form: str) -> None:
    rng = random.Random(7)
    for _ in range(300):
        table = fed(DECODERS[form], damaged(all_messages(form, CRAFT), rng))
        for key, track in table.tracks.items():
            assert key == "a4c2f1"
            assert (track.lat_deg, track.lon_deg) == pytest.approx((36.4, -84.1), abs=1e-4)


@pytest.mark.parametrize("form", sorted(DECODERS))
def test_messages_after_garbage_are_still_decoded(form: str) -> None:
    rng = random.Random(3)
    for _ in range(100):
        table = table_at(*HOME)
        decoder = DECODERS[form](table, "source")
        decoder.decode(rng.randbytes(rng.randint(1, 600)) + b"\n", 0)
        for _ in range(3):
            decoder.decode(all_messages(form, CRAFT), 1_000_000)
        assert "a4c2f1" in table.tracks


def test_long_garbage_is_not_collected() -> None:
    table = table_at(*HOME)
    for make in (SbsDecoder, CotTrackDecoder, BeastDecoder):
        decoder: Any = make(table, "source")
        for _ in range(50):
            decoder.decode(b"<" * 10_000, 0)
        assert len(decoder._rest) <= 70_000
