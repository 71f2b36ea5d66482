"""Writes thermal video with MISB ST 0601 metadata, for tests and benchmarks.

Metadata are encoded by the rules of the standard: a value of n bytes maps its range linearly to
integers; signed fields are symmetric, and their lowest integer marks an error. The packet begins
with the time stamp and ends with the checksum, the sum of its 16-bit words.
"""

import io
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from fractions import Fraction
from typing import Any, NamedTuple

import av
import numpy as np
from numpy.typing import NDArray

from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
TICKS, RATE = Fraction(1, 90_000), 30  # pictures a second
TEMPERATURES_C = (0.0, 640.0)  # of the grey levels 0 and 255 in rendered video


class Range(NamedTuple):
    """The length and the range of a value; a signed field has the range -high to high."""

    size: int
    low: float
    high: float
    signed: bool = False

    def encoded(self, value: float | None) -> bytes:
        """Return the bytes of a value; None is the mark of an error in a signed field."""
        bits = 8 * self.size
        if self.signed:
            most: int = 2 ** (bits - 1) - 1
            number = -most - 1 if value is None else round(value / self.high * most)
        else:
            assert value is not None
            most = 2**bits - 1
            number = round((value - self.low) / (self.high - self.low) * most)
        return number.to_bytes(self.size, "big", signed=self.signed)


LATITUDE, LONGITUDE = Range(4, -90.0, 90.0, True), Range(4, -180.0, 180.0, True)
ALTITUDE, OFFSET = Range(2, -900.0, 19_000.0), Range(2, -0.075, 0.075, True)
RANGES = {
    5: Range(2, 0.0, 360.0),
    6: Range(2, -20.0, 20.0, True),
    7: Range(2, -50.0, 50.0, True),
    13: LATITUDE,
    14: LONGITUDE,
    15: ALTITUDE,
    16: Range(2, 0.0, 180.0),
    17: Range(2, 0.0, 180.0),
    18: Range(4, 0.0, 360.0),
    19: Range(4, -180.0, 180.0, True),
    20: Range(4, 0.0, 360.0),
    21: Range(4, 0.0, 5_000_000.0),
    22: Range(2, 0.0, 10_000.0),
    23: LATITUDE,
    24: LONGITUDE,
    25: ALTITUDE,
    **dict.fromkeys(range(26, 34), OFFSET),
    65: Range(1, 0.0, 255.0),
    75: ALTITUDE,
    **dict.fromkeys((82, 84, 86, 88), LATITUDE),
    **dict.fromkeys((83, 85, 87, 89), LONGITUDE),
    90: Range(4, -90.0, 90.0, True),
    91: Range(4, -90.0, 90.0, True),
}


def packet(taken: datetime, values: Mapping[int, float | bytes | None]) -> bytes:
    """Return a packet with a time and values by tag; bytes are stored as they are."""
    items = [(2, round((taken - EPOCH).total_seconds() * 1e6).to_bytes(8, "big"))]
    items += [
        (tag, value if isinstance(value, bytes) else RANGES[tag].encoded(value))
        for tag, value in values.items()
    ]
    body = b"".join(bytes([tag, len(data)]) + data for tag, data in items)
    return signed(KEY + length(len(body) + 4) + body + b"\x01\x02")


def length(size: int) -> bytes:
    """Return a length in the basic encoding rules."""
    return (
        bytes([size])
        if size < 128
        else (b"\x81" + bytes([size]) if size < 256 else b"\x82" + size.to_bytes(2, "big"))
    )


def signed(unsigned: bytes) -> bytes:
    """Return a packet with its checksum."""
    words = np.frombuffer(unsigned + b"\0" * (len(unsigned) % 2), dtype=">u2")
    return unsigned + (int(words.sum()) & 0xFFFF).to_bytes(2, "big")


def pose_values(
    landscape: Landscape, pose: CameraPose, lens: Lens
) -> dict[int, float | bytes | None]:
    """Return the values of a camera whose gimbal turns it on a level aircraft that heads north."""
    lat_deg, lon_deg = (float(each) for each in landscape.lat_lon_of(pose.x_m, pose.y_m))
    fields = [
        2.0 * np.degrees(np.arctan(side / 2.0 / lens.focal_px))
        for side in (lens.width, lens.height)
    ]
    return {
        5: 0.0,
        6: 0.0,
        7: 0.0,
        13: lat_deg,
        14: lon_deg,
        15: pose.altitude_amsl_m,
        16: float(fields[0]),
        17: float(fields[1]),
        18: float(landscape.true_deg(pose.yaw_deg)) % 360.0,
        19: pose.pitch_deg,
        20: pose.roll_deg % 360.0,
        65: 17.0,
    }


def grey(celsius: NDArray[Any]) -> NDArray[np.uint8]:
    """Return temperatures as grey levels of ``TEMPERATURES_C``."""
    low_c, high_c = TEMPERATURES_C
    return np.rint(np.clip((celsius - low_c) / (high_c - low_c), 0.0, 1.0) * 255.0).astype(np.uint8)


class VideoWriter:
    """A transport stream with one video and, unless ``metadata`` is false, ST 0601 metadata."""

    def __init__(
        self, width: int, height: int, codec: str = "libx264", metadata: bool = True
    ) -> None:
        """Open the stream in memory."""
        self._file = io.BytesIO()
        self._container: Any = av.open(self._file, "w", format="mpegts")
        video: Any = self._container.add_stream(codec, rate=RATE)
        self._video = video
        self._video.width, self._video.height, self._video.pix_fmt = width, height, "yuv420p"
        self._video.codec_context.gop_size = RATE
        self._video.codec_context.thread_count = 1
        if codec == "libx264":
            self._video.options = {"preset": "ultrafast", "tune": "zerolatency", "crf": "18"}
        self._data: Any = self._container.add_data_stream("klv") if metadata else None

    def add(self, at_s: float, picture: NDArray[np.uint8], packets: Sequence[bytes] = ()) -> None:
        """Add a picture (y, x) or (y, x, 3), and packets of metadata, at a presentation time."""
        for each in packets:
            self.add_metadata(at_s, each)
        shape = "gray" if picture.ndim == 2 else "rgb24"
        frame = av.VideoFrame.from_ndarray(picture, format=shape).reformat(format="yuv420p")
        frame.pts, frame.time_base = round(at_s * RATE), Fraction(1, RATE)
        self._container.mux(self._video.encode(frame))

    def add_metadata(self, at_s: float, data: bytes) -> None:
        """Add a packet of metadata at a presentation time."""
        ticks = round(at_s / TICKS)
        unit = av.Packet(data)
        unit.stream, unit.pts, unit.dts, unit.time_base = self._data, ticks, ticks, TICKS
        self._container.mux(unit)

    def taken(self) -> bytes:
        """Return the bytes of the stream since the last call."""
        data = self._file.getvalue()
        self._file.seek(0)
        self._file.truncate()
        return data

    def close(self) -> bytes:
        """End the stream, and return its last bytes."""
        self._container.mux(self._video.encode(None))
        self._container.close()
        return self.taken()
