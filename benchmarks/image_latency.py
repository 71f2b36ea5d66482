"""Measure the time from an image to the changed mission on the vehicle, in real time.

    python -m benchmarks.image_latency [TRIALS] [--stack px4|ardupilot]

The daemon runs as its own process and flies a mock plane around a fire, over UDP on loopback. A
camera takes an image every three seconds; in each trial the image shows new fire on the path of the
mission on board. The journal contains the time of the image, of the position with which the daemon
used it, and of the acceptance of the changed mission by the vehicle. The last two times are those
of the latest position, which may be up to 0.25 s old.
"""

import argparse
import asyncio
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import shapely

from autopilot_bridge.items import place_of
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.serving import serve
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service.commands import UploadMission
from mission_service.config.scenario import load_scenario, scenario_path
from mission_service.events import Observed, Telemetry, UploadFinished
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.journal.journal_file import SegmentReader
from mission_service.runtime.clocks import clock_us
from mission_service.sensors.thermal.camera_geometry import CameraPose, Lens, focal_px_of
from mission_service.simulation.sim import mock_of
from mission_service.simulation.thermal_images import rendered, write_frame

LENS = Lens(160, 128, focal_px_of(100.0, 160))
RADIUS_M, AHEAD_M = 75.0, 80.0  # of the new fire, and its distance along the path
SETTLED_S, BETWEEN_S, IMAGE_EVERY_S, ENDED_AFTER_S = 60.0, 18.0, 3.0, 5.0
LINK = "127.0.0.1:14739"


class Times(NamedTuple):
    """The times from an image to its use and to the changed mission on the vehicle, in s."""

    used_s: float
    changed_s: float


def mission_line(mock: MockAutopilot, land: Landscape) -> shapely.LineString:
    """Return the path of the mission on board in metres."""
    places = [place for item in mock.missions.items if (place := place_of(item)) is not None]
    first = 1 if mock.stack.item_0_is_home else 0
    return shapely.LineString([land.xy_of_lat_lon(*each) for each in places[first:]])


class Fires:
    """The fire of the model with the new fires of the trials."""

    def __init__(self, fire: Fire, start_s: float) -> None:
        self.land, self._fire, self._start_s, self._began_s = (
            *(fire.landscape, fire, start_s),
            time.monotonic(),
        )
        rows, cols = self.land.shape
        self._x, self._y = self.land.xy_of(
            *np.meshgrid(np.arange(rows), np.arange(cols), indexing="ij")
        )
        self._new = np.zeros(self.land.shape, dtype=bool)

    def light(self, place: shapely.Point) -> None:
        """Light a disc around a place."""
        self._new |= np.hypot(self._x - place.x, self._y - place.y) <= RADIUS_M

    def photograph(self, mock: MockAutopilot, path: Path) -> None:
        """Write an image from the position of the mock."""
        at_s = self._start_s + time.monotonic() - self._began_s
        self._fire.advance(at_s)
        arrival_s = np.where(self._new, at_s - 60.0, self._fire.arrival_time_s)
        motion = mock.flight.motion
        x_m, y_m = self.land.xy_of_lat_lon(*mock.flight.frame.global_position(motion))
        yaw_deg = float(self.land.grid_deg(np.degrees(motion.heading_rad)))
        pose = CameraPose(float(x_m), float(y_m), motion.altitude_m, yaw_deg, -90.0)
        celsius = rendered(self.land, arrival_s, at_s, pose, np.random.default_rng(1), LENS)
        part = path.with_suffix(".part")
        write_frame(part, self.land, pose, celsius, datetime.now(UTC), LENS)
        part.rename(path)


def trial(mock: MockAutopilot, fires: Fires, path: Path) -> None:
    """Write an image of new fire on the path of the mission on board."""
    line = mission_line(mock, fires.land)
    position = fires.land.xy_of_lat_lon(*mock.flight.frame.global_position(mock.flight.motion))
    fires.light(line.interpolate(line.project(shapely.Point(*position)) + AHEAD_M))
    fires.photograph(mock, path)


def times_in(journal: Path) -> list[Times | None]:
    """Return the times of each image in a journal.

    The changed mission is the first one that the service sent and the vehicle accepted after the
    use of the image, however late; None if there was none.
    """
    found: list[Times | None] = []
    waiting: dict[int, tuple[int, int, int]] = {}  # per image: its time, line, time of its use
    latest_us, sent = 0, dict[int, int]()  # the line at which each mission was sent
    for line, entry in enumerate(SegmentReader(journal), 1):
        content = entry.content
        if isinstance(content, Observed) and content.source:
            waiting[len(found)] = content.at_us, line, 0
            found.append(None)
        elif isinstance(content, Telemetry):
            latest_us = content.at_us
            for number, (at_us, seen_line, used_us) in waiting.items():
                waiting[number] = at_us, seen_line, used_us or latest_us
        elif isinstance(content, UploadMission):
            sent[content.mission_id] = line
        elif isinstance(content, UploadFinished) and content.outcome == "accepted":
            for number, (at_us, seen_line, used_us) in list(waiting.items()):
                if seen_line < sent[content.mission_id]:
                    found[number] = Times((used_us - at_us) / 1e6, (content.at_us - at_us) / 1e6)
                    del waiting[number]
    return found


async def _follow(mock: MockAutopilot, fires: Fires, prefix: Path, seconds: float) -> None:
    """Take images for some time."""
    for number in range(round(seconds / IMAGE_EVERY_S)):
        fires.photograph(mock, Path(f"{prefix}-{number:03d}.tif"))
        await asyncio.sleep(IMAGE_EVERY_S)


async def measured(folder: Path, trials: int, stack: str) -> list[Times | None]:
    """Fly, and return the times of each trial."""
    frames = folder / "frames"
    frames.mkdir()
    text = (
        scenario_path("default")
        .read_text()
        .replace(
            "[simulation.fire]",
            "[estimate]\n"
            'sensors = ["thermal_frames"]\n[estimate.thermal_frames]\n'
            f'folder = "{frames}"\n',
        )
    )
    file = folder / "scenario.toml"
    file.write_text(text)
    changes = (
        *("start_s=3600", "deploy_at_s=3600", "planner.rule=circling"),
        *(f"vehicles.0.stack={stack}", f"vehicles.0.link=udpin:{LINK}"),
    )
    scenario = load_scenario(str(file), changes)
    land = landscape_of(scenario)
    mock = mock_of(scenario.vehicles[0], land)
    command = [
        sys.executable,
        "-m",
        "mission_service.cli",
        "run",
        str(file),
        "--out",
        str(folder / "out"),
    ]
    for change in changes:
        command += ["--set", change]
    fires = Fires(fire_of(scenario, land), scenario.start_s)
    daemon = subprocess.Popen(command, stdout=subprocess.DEVNULL)  # noqa: ASYNC220  # one short call
    flight = asyncio.create_task(serve(mock, f"udpout:{LINK}", 1.0, clock_us))
    try:
        while not mock.flight.airborne:
            await asyncio.sleep(0.5)
            if daemon.poll() is not None:
                raise SystemExit(f"the daemon ended with code {daemon.returncode}")
        for number in range(trials):
            seconds = BETWEEN_S if number else SETTLED_S
            await _follow(mock, fires, frames / f"{number:03d}-0", seconds)
            trial(mock, fires, frames / f"{number:03d}-1.tif")
            await asyncio.sleep(IMAGE_EVERY_S)
        await asyncio.sleep(ENDED_AFTER_S)
    finally:
        flight.cancel()
        daemon.terminate()
        daemon.wait(timeout=30)
    found = times_in(folder / "out" / "journal.jsonl")
    images = sorted(frames.glob("*.tif"))
    if len(found) != len(images):
        raise SystemExit(f"{len(found)} of {len(images)} images were used")
    return [each for each, path in zip(found, images, strict=True) if path.stem.endswith("-1")]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the time of each trial, and their median and maximum."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", type=int, nargs="?", default=10)
    parser.add_argument("--stack", choices=("px4", "ardupilot"), default="px4")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        found = asyncio.run(measured(Path(folder), given.trials, given.stack))
    for each in found:
        click.echo(
            "no new mission" if each is None else f"{each.used_s:.2f} s {each.changed_s:.2f} s"
        )
    times = np.array([each for each in found if each is not None])
    if times.size:
        median, highest = np.median(times, axis=0), times.max(axis=0)
        click.echo(f"{len(times)} of {len(found)} images of new fire changed the mission")
        click.echo(f"used after {median[0]:.2f} s (median), {highest[0]:.2f} s (maximum)")
        click.echo(f"new mission on the vehicle after {median[1]:.2f} s, {highest[1]:.2f} s")


if __name__ == "__main__":
    main()
