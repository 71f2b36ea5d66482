"""Writes small logs of a few messages by the specifications of the formats."""

import math
import struct
from collections.abc import Iterable
from typing import Any

BEGIN_US = 1_790_000_000_000_000
FORMATS = {
    "POS": ("QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "XKF1": ("QBffff", "TimeUS,C,VN,VE,VD,dPD"),
    "XKF2": ("QBcc", "TimeUS,C,VWN,VWE"),
    "ATT": ("QccC", "TimeUS,Roll,Pitch,Yaw"),
    "GPS": ("QBBIHBfffff", "TimeUS,I,Status,GMS,GWk,NSats,Alt,Spd,GCrs,VZ,Yaw"),
    "CTUN": ("Qff", "TimeUS,As,ThO"),
    "MODE": ("QMB", "TimeUS,Mode,ModeNum"),
    "ARM": ("QB", "TimeUS,ArmState"),
    "MSG": ("QZ", "TimeUS,Message"),
    "CMD": ("QHHHffffLLfB", "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame"),
    "MISE": ("QHH", "TimeUS,CTot,CNum"),
    "RCOU": ("QHHH", "TimeUS,C1,C2,C3"),
    "BAT": ("QBffB", "TimeUS,Inst,Volt,Curr,RemPct"),
    "IMU": ("Qfff", "TimeUS,GyrX,GyrY,GyrZ"),
}
LETTERS = {
    **{letter: letter for letter in "bBhHiIfdqQ"},
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "M": "B",
}
SCALED = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 10_000_000}


def dataflash(messages: Iterable[tuple[Any, ...]]) -> bytes:
    """Return a .bin file; each message is a name of ``FORMATS`` with values."""
    numbers = {name: 129 + number for number, name in enumerate(FORMATS)}
    parts = [_described(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    parts += [_described(numbers[name], name, *columns) for name, columns in FORMATS.items()]
    for name, *values in messages:
        letters = FORMATS[name][0]
        raw = [
            round(value * SCALED[letter]) if letter in SCALED else value
            for letter, value in zip(letters, values, strict=True)
        ]
        raw = [value.encode() if isinstance(value, str) else value for value in raw]
        parts.append(b"\xa3\x95" + bytes((numbers[name],)) + _struct(letters).pack(*raw))
    return b"".join(parts)


def _struct(letters: str) -> struct.Struct:
    return struct.Struct("<" + "".join(LETTERS[letter] for letter in letters))


def _described(number: int, name: str, letters: str, columns: str) -> bytes:
    texts = (name.encode(), letters.encode(), columns.encode())
    packed = struct.pack("<BB4s16s64s", number, _struct(letters).size + 3, *texts)
    return b"\xa3\x95\x80" + packed


TOPICS = {
    "vehicle_global_position": "uint64_t timestamp;double lat;double lon;float alt;"
    "bool lat_lon_valid;uint8_t[3] _padding0",
    "vehicle_local_position": "uint64_t timestamp;float vx;float vy;float vz",
    "home_position": "uint64_t timestamp;float alt",
    "vehicle_attitude": "uint64_t timestamp;float[4] q",
    "wind": "uint64_t timestamp;float windspeed_north;float windspeed_east",
    "vehicle_status": "uint64_t timestamp;uint8_t nav_state;uint8_t arming_state;"
    "uint8_t vehicle_type",
    "mission_result": "uint64_t timestamp;uint32_t mission_id;int32_t seq_reached;"
    "uint16_t seq_current",
    "gripper": "uint64_t timestamp;int8_t command",
    "sensor_gps": "uint64_t timestamp;uint64_t time_utc_usec;uint8_t fix_type;"
    "uint8_t satellites_used",
    "cpuload": "uint64_t timestamp;float load;extra[2] more",
    "extra": "uint8_t a;float b",
}
C_TYPES = {
    "uint64_t": "Q",
    "double": "d",
    "float": "f",
    "bool": "?",
    "uint8_t": "B",
    "int8_t": "b",
    "int32_t": "i",
    "uint32_t": "I",
    "uint16_t": "H",
    "extra": "Bf",
}


def ulog(messages: Iterable[tuple[Any, ...]], system_id: int = 3) -> bytes:
    """Return a .ulg file; a message is a topic with values, or ``L`` with level, time, text."""
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000), _record("B", bytes(40))]
    parts += [_record("F", f"{name}:{fields};".encode()) for name, fields in TOPICS.items()]
    key = b"int32_t MAV_SYS_ID"
    parts.append(_record("P", bytes((len(key),)) + key + struct.pack("<i", system_id)))
    numbers = {name: number for number, name in enumerate(TOPICS)}
    for name, number in numbers.items():
        parts.append(_record("A", struct.pack("<BH", 0, number) + name.encode()))
    for name, *values in messages:
        if name == "L":
            level, at_us, text = values
            parts.append(_record("L", struct.pack("<BQ", level, at_us) + text.encode()))
            continue
        letters = "".join(_letters(field) for field in TOPICS[name].split(";"))
        body = struct.pack("<H", numbers[name]) + struct.pack("<" + letters, *values)
        parts.append(_record("D", body))
    return b"".join(parts)


def _letters(field: str) -> str:
    kind, _, name = field.partition(" ")
    kind, _, count = kind.rstrip("]").partition("[")
    return "" if name.startswith("_padding") else C_TYPES[kind] * int(count or 1)


def _record(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def bin_flight() -> bytes:
    """Return the log of a plane that takes off and flies to its second item."""
    items = [(0, 16, 36.3, -84.2, 300.0), (1, 22, 36.3, -84.2, 50.0), (2, 16, 36.31, -84.2, 90.0)]
    messages: list[tuple[Any, ...]] = [("MSG", 1_000_000, "ArduPlane V4.6.2 (deadbeef)")]
    messages += [
        ("CMD", 1_000_000, 3, number, command, 0.0, 0.0, 0.0, 0.0, lat, lon, height, 3)
        for number, command, lat, lon, height in items
    ]
    messages += [("MODE", 1_000_100, 10, 10), ("ARM", 1_000_200, 1)]
    for number in range(40):
        at_us = 1_100_000 + 100_000 * number
        messages += [
            ("IMU", at_us, 0.1, 0.2, 0.3),
            ("GPS", at_us, 0, 3, 100_000 + number * 100, 2445, 10, 300.0, 15.0, 90.0, -2.0, 0.0),
            ("XKF1", at_us, 0, 0.5, 14.5, -2.0, 0.0),
            ("XKF1", at_us, 1, 9.0, 9.0, 9.0, 9.0),
            ("XKF2", at_us, 0, 3.0, -4.0),
            ("CTUN", at_us, 17.0, 60.0),
            ("ATT", at_us, 1.5, 12.25, 271.5),
            ("POS", at_us, 36.3, -84.2 + number * 1e-4, 300.0 + number, float(number), 0.0),
            ("RCOU", at_us, 1500, 1900 if number > 20 else 1100, 1000),
            ("BAT", at_us, 0, 12.5, 3.0, 98),
        ]
    messages += [("MISE", 1_200_000, 3, 1), ("MISE", 4_900_000, 3, 2), ("ARM", 5_300_000, 0)]
    return dataflash(sorted(messages, key=lambda each: each[1]))


def ulg_flight() -> bytes:
    """Return the log of a PX4 plane that drops an object during its flight."""
    messages: list[tuple[Any, ...]] = [
        ("L", ord("6"), 1_000_000, "logging\t"),
        ("home_position", 1_000_000, 300.0),
        ("vehicle_status", 1_000_000, 4, 1, 2),
        ("sensor_gps", 1_500_000, BEGIN_US + 1_500_000, 3, 12),
        ("vehicle_status", 2_000_000, 3, 2, 2),
    ]
    for number in range(40):
        at_us = 2_100_000 + 100_000 * number
        messages += [
            ("cpuload", at_us, 0.5, 1, 2.0, 3, 4.0),
            ("vehicle_local_position", at_us, 10.0, 5.0, -1.0),
            ("vehicle_attitude", at_us, math.cos(0.5), 0.0, 0.0, math.sin(0.5)),
            ("vehicle_global_position", at_us, 36.3 + number * 1e-4, -84.2, 350.0, True),
            ("wind", at_us, 0.0, -4.0),
        ]
    messages += [
        ("mission_result", 3_000_000, 7, -1, 0),
        ("mission_result", 5_000_000, 7, 0, 1),
        ("gripper", 5_500_000, 1),
        ("vehicle_global_position", 6_200_000, 0.0, 0.0, 0.0, False),
        ("vehicle_status", 6_300_000, 3, 1, 2),
    ]
    return ulog(sorted(messages, key=lambda each: each[2] if each[0] == "L" else each[1]))


def round_flight(
    turns_at_s: float = 100.0, end_s: float = 160.0, lat_deg: float = 36.35, lon_deg: float = -84.16
) -> bytes:
    """Return the log of a plane that circles a place at 400 m and 15 m/s.

    It flies clockwise, turns back, and drops two objects.
    """
    radius_m, speed_m_s, per_deg = 400.0, 15.0, 111_195.0
    items = [(0, 16, lat_deg, lon_deg, 300.0), (1, 16, lat_deg, lon_deg, 100.0)]
    messages: list[tuple[Any, ...]] = [("MSG", 1_000_000, "ArduPlane V4.6.2 (deadbeef)")]
    messages += [
        ("CMD", 1_000_000, 4, number, command, 0.0, 0.0, 0.0, 0.0, lat, lon, height, 3)
        for number, command, lat, lon, height in items
    ]
    messages += [
        ("CMD", 1_000_000, 4, 2, 183, 3.0, 1900.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3),
        ("CMD", 1_000_000, 4, 3, 16, 0.0, 0.0, 0.0, 0.0, lat_deg, lon_deg, 100.0, 3),
        ("MODE", 1_000_100, 10, 10),
        ("ARM", 1_000_200, 1),
    ]
    for number in range(round(end_s * 4)):
        at_s, at_us = number / 4.0, 1_250_000 + 250_000 * number
        flown_s = min(at_s, 2.0 * turns_at_s - at_s)
        way = 1.0 if at_s <= turns_at_s else -1.0
        angle = flown_s * speed_m_s / radius_m
        north, east = radius_m * math.cos(angle), radius_m * math.sin(angle)
        lat = lat_deg + north / per_deg
        lon = lon_deg + east / (per_deg * math.cos(math.radians(lat_deg)))
        height = min(100.0, 5.0 * at_s)
        velocity = (-speed_m_s * math.sin(angle) * way, speed_m_s * math.cos(angle) * way)
        messages += [
            ("XKF1", at_us, 0, *velocity, 0.0, 0.0),
            ("POS", at_us, lat, lon, 300.0 + height, height, 0.0),
            ("RCOU", at_us, 1500, 1500, 1900 if at_s >= 50.0 else 1100),
        ]
    return dataflash(sorted(messages, key=lambda each: each[1]))
