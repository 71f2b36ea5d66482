"""Writes radiometric JPEGs as FLIR cameras do, as far as ExifTool documents the format."""

import struct
from io import BytesIO

import numpy as np
from PIL import Image

from firemodel.arrays import Floats

R1, R2, B, F, O = 14364.633, 0.1, 1385.4, 1.0, -5753  # noqa: E741  # of Planck's law, see ExifTool
KELVIN_C = 273.15
RAW_DATA, CAMERA_INFO = 1, 32  # types of records
DIRECTORY, ENTRIES = 64, 6  # offset, and the number of entries that flyr reads from offset 0
CAMERA_BYTES = 900


def flir_jpeg(celsius: Floats, exif: Image.Exif, xmp: bytes) -> bytes:
    """Return a JPEG with a grey picture and the temperatures (y, x), at most 65,000 bytes."""
    picture = BytesIO()
    grey = np.clip(celsius, 0.0, 255.0).astype(np.uint8)
    Image.fromarray(grey).resize((320, 256)).save(picture, "JPEG", exif=exif, xmp=xmp)
    data = b"FLIR\0\x01\0\0" + _records(celsius)
    segment = b"\xff\xe1" + struct.pack(">H", len(data) + 2) + data
    return b"\xff\xd8" + segment + picture.getvalue()[2:]


def _records(celsius: Floats) -> bytes:
    rows, cols = celsius.shape
    raw = R1 / R2 / (np.exp(B / (celsius + KELVIN_C)) - F) - O
    pixels = struct.pack("<HHH", 2, cols, rows).ljust(32, b"\0") + raw.astype("<u2").tobytes()
    camera = bytearray(CAMERA_BYTES)
    # Emissivity, distance, reflected, air and window temperature, transmission of the window.
    struct.pack_into("<6f", camera, 32, 1.0, 0.0, 293.15, 293.15, 293.15, 1.0)
    struct.pack_into("<f", camera, 60, 0.5)  # relative humidity
    struct.pack_into("<3f", camera, 88, R1, B, F)
    struct.pack_into("<5f", camera, 112, 0.006569, 0.01262, -0.002276, -0.00667, 1.9)
    struct.pack_into("<if", camera, 776, O, R2)
    at = 32 * ENTRIES
    head = b"FFF\0test".ljust(20, b"\0") + struct.pack(">III", 100, DIRECTORY, ENTRIES)
    entries = _entry(CAMERA_INFO, at, len(camera)) + _entry(RAW_DATA, at + len(camera), len(pixels))
    return head.ljust(DIRECTORY, b"\0") + entries.ljust(at - DIRECTORY, b"\0") + camera + pixels


def _entry(kind: int, offset: int, length: int) -> bytes:
    return struct.pack(">HHIIII", kind, 1, 100, 1, offset, length).ljust(32, b"\0")
