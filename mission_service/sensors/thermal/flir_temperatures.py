"""Reads the temperatures in radiometric JPEGs of FLIR cameras, in a separate process.

The library flyr decodes such a file in Python. Decoding a damaged file can take hours; therefore,
the process has limits (``worker_process``). The process runs ``main`` of this module.
"""

import sys
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from mission_service.errors import MissionServiceError
from mission_service.sensors.one_line import one_line
from mission_service.sensors.worker_process import limit_process, output_of

MODULE = "mission_service.sensors.thermal.flir_temperatures"
SEGMENT = b"FLIR\0"  # the beginning of the APP1 segments that contain the temperatures
RANGE_C = (-273.15, 5000.0)  # a pixel with less radiance than the air in front is the coldest


class Decoded(msgspec.Struct, tag="decoded"):
    """Temperatures in °C: 32-bit floats, row by row."""

    rows: int
    cols: int
    celsius: bytes


class Undecoded(msgspec.Struct, tag="undecoded"):
    """The reason why a file cannot be decoded."""

    reason: str


def flir_celsius(path: Path) -> NDArray[np.float32]:
    """Return the temperatures (y, x) in °C of a radiometric JPEG.

    The camera's own settings for emissivity, distance and air apply. The picture in the JPEG may
    have more pixels than there are temperatures.

    Raises MissionServiceError if flyr is not installed, and for a file that cannot be decoded.
    """
    if find_spec("flyr") is None:
        raise MissionServiceError(
            f"{path}: temperatures of FLIR cameras require flyr; run: pip install "
            "'mission-service[flir]'"
        )
    try:
        answer = output_of(MODULE, path.read_bytes())
        found = msgspec.msgpack.decode(answer, type=Decoded | Undecoded)
    except (OSError, msgspec.DecodeError, msgspec.ValidationError) as error:
        raise MissionServiceError(
            f"{path}: its FLIR temperatures cannot be read: {error}"
        ) from None
    if isinstance(found, Undecoded):
        raise MissionServiceError(f"{path}: its FLIR temperature data are corrupt: {found.reason}")
    return np.frombuffer(found.celsius, dtype=np.float32).reshape(found.rows, found.cols)


def decoded(data: bytes) -> Decoded | Undecoded:
    """Decode the content of a file in this process."""
    import flyr

    try:
        with np.errstate(all="ignore"):
            celsius = flyr.unpack(BytesIO(data)).celsius
        rows, cols = celsius.shape
        celsius = np.clip(np.nan_to_num(celsius, nan=RANGE_C[0]), *RANGE_C)
        return Decoded(rows, cols, celsius.astype(np.float32).tobytes())
    except MemoryError:
        return Undecoded("they need too much memory")
    except Exception as error:  # flyr does not check the file; any error may follow
        return Undecoded(one_line(f"{type(error).__name__}: {error}"))


def main() -> None:
    """Decode the file on standard input, within memory and time limits."""
    limit_process()
    sys.stdout.buffer.write(msgspec.msgpack.encode(decoded(sys.stdin.buffer.read())))


if __name__ == "__main__":
    main()
