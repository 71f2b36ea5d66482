"""Measure what thermal video costs the service.

    python -m benchmarks.video_stream [SECONDS]

Another process sends video of 640 x 512 pixels with 30 pictures and 30 packets of metadata a second
over UDP on loopback. The sensor uses one image a second. The benchmark prints the share of a core
that the sensor's process uses, and the largest delays of an event loop in this process, which also
calls the sensor ten times a second. The limits are 50 % of a core and 50 ms. The delays of the same
loop without the sensor show the contribution of other programs on this machine.
"""

import asyncio
import multiprocessing
import socket
import sys
import time
from datetime import UTC, datetime, timedelta

import numpy as np

from benchmarks.klv_video import (
    RATE,
    TEMPERATURES_C,
    VideoWriter,
    grey,
    packet,
    pose_values,
)
from benchmarks.thermal_frames import pose_above
from mission_service.config.scenario import load_scenario
from mission_service.events import Observed, Telemetry
from mission_service.fire.scenario_fire import landscape_of
from mission_service.sensors.video.thermal_video import ThermalVideo
from mission_service.simulation.thermal_images import LENS, rendered

FIX = Telemetry(7_200_000_000, "hawk", 36.36, -84.15, 600.0, 120.0, 20.0, 0.0, 0.0)
SETTLE_S = 3.0  # not measured: the first image compiles and loads
TICK_S = 0.005
DATAGRAM = 7 * 188


def film(seconds: int) -> list[bytes]:
    """Return the stream of each picture. The stamps begin a minute ago."""
    landscape = landscape_of(load_scenario("default", ()))
    lens = LENS._replace(distortion=(0.0,) * 5)
    arrival_s = np.tile(3600.0 + 20.0 * (np.arange(landscape.shape[1]) - 100.0), (200, 1))
    writer, parts = VideoWriter(lens.width, lens.height), []
    begun = datetime.now(UTC) - timedelta(seconds=60)
    rng = np.random.default_rng(1)
    for number in range(seconds * RATE):
        if number % RATE == 0:
            pose = pose_above(landscape, 100.0 - number / 900.0, 100.0, 45.0, -60.0)
            picture = grey(rendered(landscape, arrival_s, 3600.0, pose, rng, lens))
            values = pose_values(landscape, pose, lens)
        noisy = np.clip(picture + rng.integers(-4, 5, picture.shape), 0, 255).astype(np.uint8)
        taken = begun + timedelta(seconds=number / RATE)
        writer.add(number / RATE, noisy, [packet(taken, values)])
        parts.append(writer.taken())
    return parts


def send(parts: list[bytes], port: int) -> None:
    """Send the stream in real time."""
    begun_s = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number, part in enumerate(parts):
            time.sleep(max(begun_s + number / RATE - time.monotonic(), 0.0))
            for start in range(0, len(part), DATAGRAM):
                sender.sendto(part[start : start + DATAGRAM], ("127.0.0.1", port))


async def delays_ms(
    seconds: float, sensor: ThermalVideo | None, found: list[Observed]
) -> list[float]:
    """Return the delays of an event loop that wakes every ``TICK_S``."""
    delays: list[float] = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        due_s = time.monotonic() + TICK_S
        await asyncio.sleep(TICK_S)
        if sensor is not None and len(delays) % 20 == 0:
            image = sensor.observe(FIX)
            found += [image] if image is not None else []
        delays.append(1e3 * (time.monotonic() - due_s))
    return delays


def _line(name: str, delays: list[float]) -> str:
    worst, most = max(delays), float(np.percentile(delays, 99.0))
    return f"{name}: delay of the event loop {worst:.1f} ms at most, {most:.1f} ms in 99 %\n"


def main() -> None:
    """Print the share of a core and the delays."""
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    settings = (
        f'estimate.thermal_video.source="udpin:127.0.0.1:{port}"',
        f"estimate.thermal_video.grey_level_range_c={list(TEMPERATURES_C)}",
    )
    scenario = load_scenario("default", settings)
    parts = film(seconds + int(SETTLE_S))
    rate = 8e-6 * sum(map(len, parts)) / (len(parts) / RATE)
    sensor, found = ThermalVideo(scenario, landscape_of(scenario)), list[Observed]()
    sys.stdout.write(_line("without video", asyncio.run(delays_ms(5.0, None, found))))
    sensor.observe(FIX)
    sender = multiprocessing.get_context("spawn").Process(target=send, args=(parts, port))
    sender.start()
    while not sensor._stream.counts.size:
        time.sleep(0.01)
    asyncio.run(delays_ms(SETTLE_S, sensor, found))
    images, used_s, begun_s = len(found), time.process_time(), time.monotonic()
    delays = asyncio.run(delays_ms(seconds - 1.0, sensor, found))
    share = (time.process_time() - used_s) / (time.monotonic() - begun_s)
    sender.join(seconds + 10.0)
    sys.stdout.write(_line("with video", delays))
    sys.stdout.write(
        f"{rate:.1f} Mbit/s; {len(found) - images} images used in {seconds - 1} s; "
        f"{100.0 * share:.0f} % of a core (limit 50 %)\n"
    )
    if sensor.problem:
        sys.stdout.write(f"problem: {sensor.problem}\n")


if __name__ == "__main__":
    main()
