"""Small logs to be read: what autopilots write, by the specifications, a few messages long."""

import struct
from collections.abc import Iterable
from typing import Any

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
    """A .bin file: a name of ``FORMATS`` and its values for each message."""
    numbers = {name: 129 + number for number, name in enumerate(FORMATS)}
    parts = [_described(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    parts += [_described(numbers[name], name, *told) for name, told in FORMATS.items()]
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
    told = struct.pack("<BB4s16s64s", number, _struct(letters).size + 3, *texts)
    return b"\xa3\x95\x80" + told


TOPICS = {
    "vehicle_global_position": "uint64_t timestamp;double lat;double lon;float alt;"
    "bool lat_lon_valid;uint8_t[3] _padding0",
    "vehicle_local_position": "uint64_t timestamp;float vx;float vy;float vz",
    "home_position": "uint64_t timestamp;float alt",
    "vehicle_attitude": "uint64_t timestamp;float[4] q",
    "wind": "uint64_t timestamp;float windspeed_north;float windspeed_east",
    "vehicle_status": "uint64_t timestamp;uint8_t nav_state;uint8_t arming_state;"
    "uint8_t vehicle_type",
    "mission_result": "uint64_t timestamp;int32_t seq_reached;uint16_t seq_current",
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
    "uint16_t": "H",
    "extra": "Bf",
}


def ulog(messages: Iterable[tuple[Any, ...]], system_id: int = 3) -> bytes:
    """A .ulg file: a topic and its values for each message, or ``L``, level, time and text."""
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
