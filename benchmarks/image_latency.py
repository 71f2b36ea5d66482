"""Measure the time from an image file to the changed mission on the vehicle, in real time.

    python -m benchmarks.image_latency [TRIALS] [--stack px4|ardupilot]

The daemon runs as its own process and flies a mock plane around a fire, over UDP on loopback. In
each trial, the image of a thermal camera shows new fire on the path of the mission on board. The
time ends when the mock has a mission that avoids this fire. Between the trials the camera takes an
image every three seconds.
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

import click
import numpy as np
import shapely

from autopilot_bridge.items import place_of
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.serving import serve
from firemodel.landscape.landscape import Landscape
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import load_scenario, scenario_path
from mission_service.fire.scenario_fire import fire_of, landscape_of
from mission_service.runtime.clocks import clock_us
from mission_service.sensors.camera_geometry import CameraPose, Lens, focal_px_of
from mission_service.simulation.sim import mock_of
from mission_service.simulation.thermal_images import rendered, write_frame

LENS = Lens(160, 128, focal_px_of(100.0, 160))
RADIUS_M, AHEAD_M = 75.0, 80.0  # of the new fire, and its distance along the path
SETTLED_S, BETWEEN_S, LONGEST_S, IMAGE_EVERY_S = 60.0, 24.0, 20.0, 3.0
LINK = "127.0.0.1:14739"


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

    def photograph(self, mock: MockAutopilot, path: Path) -> float:
        """Write an image from the position of the mock, and return the time of the file."""
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
        return time.monotonic()


async def trial(mock: MockAutopilot, fires: Fires, path: Path) -> float | None:
    """Return the time to a mission that avoids new fire; None after ``LONGEST_S``."""
    line = mission_line(mock, fires.land)
    position = fires.land.xy_of_lat_lon(*mock.flight.frame.global_position(mock.flight.motion))
    ahead = line.interpolate(line.project(shapely.Point(*position)) + AHEAD_M)
    fires.light(ahead)
    began_s = fires.photograph(mock, path)
    until_s = began_s + LONGEST_S
    while time.monotonic() < until_s:
        await asyncio.sleep(0.01)
        if mission_line(mock, fires.land).distance(ahead) > RADIUS_M / 2.0:
            return time.monotonic() - began_s
    return None


async def _follow(mock: MockAutopilot, fires: Fires, prefix: Path, seconds: float) -> None:
    """Take images for some time."""
    for number in range(round(seconds / IMAGE_EVERY_S)):
        fires.photograph(mock, Path(f"{prefix}-{number:03d}.tif"))
        await asyncio.sleep(IMAGE_EVERY_S)


async def measured(folder: Path, trials: int, stack: str) -> list[float | None]:
    """Fly, and return the time of each trial in s."""
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
        found: list[float | None] = []
        while not mock.flight.airborne:
            await asyncio.sleep(0.5)
            if daemon.poll() is not None:
                raise SystemExit(f"the daemon ended with code {daemon.returncode}")
        for number in range(trials):
            await _follow(
                mock, fires, frames / f"before-{number}", BETWEEN_S if number else SETTLED_S
            )
            found.append(await trial(mock, fires, frames / f"trial-{number}.tif"))
            shown = "no mission" if found[-1] is None else f"{found[-1]:.2f} s"
            click.echo(f"trial {number}: {shown}")
        return found
    finally:
        flight.cancel()
        daemon.terminate()
        daemon.wait(timeout=30)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the time of each trial, and their median and maximum."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", type=int, nargs="?", default=10)
    parser.add_argument("--stack", choices=("px4", "ardupilot"), default="px4")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        found = asyncio.run(measured(Path(folder), given.trials, given.stack))
    times = [each for each in found if each is not None]
    if times:
        click.echo(
            f"{len(times)} of {len(found)}: median {np.median(times):.2f} s, max {max(times):.2f} s"
        )


if __name__ == "__main__":
    main()
