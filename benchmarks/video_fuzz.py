"""Damage thermal video and its metadata at random, and check that only undamaged parts are used.

    python -m benchmarks.video_fuzz [COUNT] [SEED]

A quarter of the cases are packets of metadata with changed bytes, which must be refused. A quarter
are packets with random values and a right checksum, which must be refused or give finite places.
The others are transport streams: bits, bytes or transport packets are changed, left out, repeated
or exchanged, or random bytes are inserted. Each image that is returned must have the time and the
pose of an undamaged packet. The benchmark prints the number of each outcome. No case may raise
another exception than the documented ones. A sum of 16 bits cannot detect all damage: one changed
packet of 65,536 has the right sum. A transport stream has no checksum of its pictures; therefore
the benchmark also prints the number of images in which hot pixels differ.
"""

import sys
from collections import Counter
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np

from benchmarks.klv_video import (
    KEY,
    TEMPERATURES_C,
    VideoWriter,
    grey,
    length,
    packet,
    pose_values,
    signed,
)
from benchmarks.thermal_frames import pose_above, steep_landscape
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.fire_sections import ThermalVideoSection
from mission_service.sensors.thermal.camera_geometry import Lens
from mission_service.sensors.thermal.frame_cells import frame_cells
from mission_service.sensors.thermal.thermal_image import ThermalImage
from mission_service.sensors.video.video_metadata import FIELDS, VideoMetadataError, read_metadata
from mission_service.sensors.video.video_stream import VideoStream

TAKEN = datetime(2026, 7, 4, tzinfo=UTC)
PICTURES = 12
LENS = Lens(96, 80, 100.0)
SETTINGS = ThermalVideoSection(grey_level_range_c=TEMPERATURES_C)
TS_BYTES = 188
HOT_C = SETTINGS.hot_c
GEOREFERENCED = 0.1  # share of the unaltered images


class Original(NamedTuple):
    """An undamaged stream and what it contains."""

    landscape: Landscape
    stream: bytes
    packets: list[bytes]
    images: dict[datetime, ThermalImage]


def original() -> Original:
    """Return a stream with a moving hot square, in which each picture is due."""
    landscape = steep_landscape(30.0)
    writer = VideoWriter(LENS.width, LENS.height)
    packets = []
    for number in range(PICTURES):
        pose = pose_above(landscape, 100.0 + number, 100.0, 10.0 * number, -70.0)
        celsius = np.full((LENS.height, LENS.width), 25.0)
        celsius[20:40, 4 * number : 4 * number + 20] = 500.0
        packets.append(
            packet(TAKEN + timedelta(seconds=number), pose_values(landscape, pose, LENS))
        )
        writer.add(number / 30.0, grey(celsius), [packets[-1]])
    stream = writer.close()
    reader = VideoStream("fuzz", SETTINGS)
    images = {image.taken: image for image in reader.feed(stream) + reader.end()}
    assert len(images) == PICTURES
    return Original(landscape, stream, packets, images)


def fuzz(found: Original, count: int, rng: np.random.Generator) -> Counter[str]:
    """Process ``count`` damaged packets and streams; return the number of each outcome.

    Raises AssertionError if anything is used that is not in the original.
    """
    outcomes: Counter[str] = Counter()
    for number in range(count):
        whole = found.packets[int(rng.integers(len(found.packets)))]
        kind = number % 4
        if kind == 0:
            outcomes[_read(changed(whole, rng), whole)] += 1
        elif kind == 1:
            outcomes[_read(with_random_values(rng), None)] += 1
        else:
            outcomes.update(_fed(found, damaged(found.stream, rng), rng))
    return outcomes


def changed(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with one to eight of them changed."""
    values = bytearray(data)
    for place in rng.integers(len(values), size=int(rng.integers(1, 9))):
        values[place] ^= int(rng.integers(1, 256))
    return bytes(values)


def with_random_values(rng: np.random.Generator) -> bytes:
    """Return a packet with the right checksum, whose tags, lengths and values are random."""
    items = [(2, int((TAKEN.timestamp() + 1.0) * 1e6).to_bytes(8, "big"))]
    tags = list(FIELDS) if rng.random() < 0.8 else list(range(1, 143))
    for tag in rng.permutation(tags)[: int(rng.integers(1, len(tags) + 1))]:
        size = int(rng.integers(0, 10)) if rng.random() < 0.1 else _usual_size(int(tag))
        items.append(
            (int(tag), rng.bytes(size) if rng.random() < 0.8 else (b"\x80" + bytes(size))[:size])
        )
    body = b"".join(
        (bytes([tag]) if tag < 128 else bytes([0x81, tag & 0x7F])) + bytes([len(data)]) + data
        for tag, data in items
    )
    return signed(KEY + length(len(body) + 4) + body + b"\x01\x02")


def _usual_size(tag: int) -> int:
    return 4 if tag in (13, 14, 18, 19, 20, 23, 24, 90, 91, *range(82, 90)) else 2


def _read(data: bytes, whole: bytes | None) -> str:
    """Return the outcome of reading a packet."""
    try:
        metadata = read_metadata(data, SETTINGS)
    except VideoMetadataError:
        return "metadata refused"
    if whole is not None:
        same = metadata == read_metadata(whole, SETTINGS)
        return "metadata unchanged" if same else "metadata with the right sum by chance"
    if metadata.pose is not None:
        assert np.isfinite(metadata.pose).all()
    if metadata.corners is not None:
        assert np.isfinite(metadata.corners.lat_lon_deg).all()
    return "random metadata read"


def damaged(stream: bytes, rng: np.random.Generator) -> bytes:
    """Return a stream with one to four faults."""
    for _ in range(int(rng.integers(1, 5))):
        parts = [stream[start : start + TS_BYTES] for start in range(0, len(stream), TS_BYTES)]
        one, other = (int(each) for each in rng.integers(len(parts), size=2))
        fault = int(rng.integers(6))
        if fault == 0:
            stream = changed(stream, rng)
        elif fault == 1:
            stream = stream[: int(rng.integers(1, max(len(stream), 2)))]  # at least one byte
        elif fault == 2:
            stream = b"".join(parts[:one] + parts[one + int(rng.integers(1, 20)) :]) or stream
        elif fault == 3:
            stream = b"".join(parts[:one] + parts[one : one + 8] + parts[one:])
        elif fault == 4:
            parts[one], parts[other] = parts[other], parts[one]
            stream = b"".join(parts)
        else:
            at = int(rng.integers(len(stream)))
            stream = stream[:at] + rng.bytes(int(rng.integers(1, 500))) + stream[at:]
    return stream


def _fed(found: Original, stream: bytes, rng: np.random.Generator) -> Counter[str]:
    """Return the outcomes of a damaged stream that arrives in parts."""
    outcomes = Counter({"streams": 1})
    reader = VideoStream("fuzz", SETTINGS)
    images, at = [], 0
    while at < len(stream):
        size = int(rng.integers(1, 3000))
        images += reader.feed(stream[at : at + size])
        at += size
    images += reader.end()
    for image in images:
        true = found.images[image.taken]  # no other time
        assert image[3:] == true[3:], "the pose is that of an undamaged packet"
        outcomes["images"] += 1
        altered = bool(((image.values >= HOT_C) != (true.values >= HOT_C)).any())
        outcomes["images with other hot pixels"] += altered
        if not altered and rng.random() > GEOREFERENCED:
            continue
        try:
            frame_cells(image, found.landscape, SETTINGS)
        except FireModelError:
            outcomes["images refused"] += 1
    counts = reader.counts
    if len(images) < PICTURES:
        outcomes["streams with fewer images"] += 1
        reported = counts.lost or counts.damaged_metadata or counts.bad_pictures or counts.refused
        outcomes["of these without a count of damage"] += not reported
    return outcomes


def main() -> None:
    """Print the outcomes."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    outcomes = fuzz(original(), count, rng)
    for name, number in sorted(outcomes.items()):
        sys.stdout.write(f"{number:9,d}  {name}\n")


if __name__ == "__main__":
    main()
