"""Pass the image files of a simulated camera to a run by video, HTTP or MQTT, for ``image_files``.

``video`` encodes the images as a thermal video with MISB ST 0601 metadata, which the sensor
``thermal_video`` decodes. ``http`` and ``mqtt`` are a detector, which finds the burned cells in
each image and sends them as a raster: as a POST to the HTTP interface, or as an MQTT command.
"""

import asyncio
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np

from benchmarks.klv_video import RATE, TEMPERATURES_C, VideoWriter, grey, packet, pose_values
from firemodel.assimilation.observation import UNSEEN
from firemodel.landscape.landscape import Landscape
from mission_service.events import AnyEvent, Observed, Telemetry
from mission_service.fire.observed_window import LETTERS, in_letters, states_in
from mission_service.fire.sensors import Sensors
from mission_service.interfaces.mqtt.command_gate import CommandGate
from mission_service.sensors.thermal.arrived_images import ArrivedImages
from mission_service.sensors.thermal.ground_projections import PoseProjection, projection_of
from mission_service.sensors.thermal.thermal_image import ThermalImage, read_thermal_image
from mission_service.sensors.video.thermal_video import ThermalVideo
from mission_service.simulation.image_writer import SIMULATED_ZERO
from tests.api.worlds import World, client, served

FINER = 2  # cells of a detector's raster in each axis of a cell of the landscape
APART_S = 0.1  # between images of the video; a camera may take two images at once
PATH = "/api/v1/fire/observations/raster"


class Relay(Protocol):
    """Passes new image files on."""

    def pass_on(self, now_s: float) -> None:
        """Pass the files on that have arrived by a mission time."""


class ReadOnce:
    """The image files in a folder, each of which is read once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: set[str] = set()

    def new(self) -> list[ThermalImage]:
        """Return the images that have arrived since the last call, in the order of their names."""
        paths = sorted(self._folder.glob("*.tif"))
        found = [read_thermal_image(each) for each in paths if each.name not in self._read]
        self._read |= {each.name for each in paths}
        return found


class Video:
    """A sensor that receives the images as a video stream."""

    def __init__(self, world: World, folder: Path) -> None:
        estimate = world.context.scenario.estimate
        settings = {"source": "udpin:127.0.0.1:5600", "grey_level_range_c": TEMPERATURES_C}
        section = estimate.thermal_video.model_copy(update=settings)
        with_source = estimate.model_copy(update={"thermal_video": section})
        scenario = world.context.scenario.model_copy(update={"estimate": with_source})
        self._land, self._settings = world.context.landscape, estimate.thermal_frames
        self._files = ReadOnce(folder)
        self._sensor = ThermalVideo(scenario, self._land)  # its thread is not started
        self._writer: VideoWriter | None = None
        self._shown_s = 0.0
        world.simulation.service.sensors = Sensors({"thermal_video": self}, self._land.shape)

    def pass_on(self, now_s: float) -> None:
        """Encode the new images, and pass the stream to the sensor."""
        for image in self._files.new():
            rows, cols = image.values.shape
            if self._writer is None:
                self._writer = VideoWriter(cols, rows)
            taken_s = (image.taken - SIMULATED_ZERO).total_seconds()
            at_s = round(max(taken_s, self._shown_s + APART_S) * RATE) / RATE
            self._shown_s = at_s
            projection = projection_of(image, self._land, self._settings)
            assert isinstance(projection, PoseProjection)
            values = pose_values(self._land, projection.pose, projection.lens)
            for number in range(2):  # the second picture ends the first
                later_s = number / RATE
                metadata = packet(image.taken + timedelta(seconds=later_s), values)
                self._writer.add(at_s + later_s, grey(image.values), [metadata])
            self._sensor.use(self._writer.taken(), mission_time(now_s))

    def observe(self, fix: Telemetry) -> Observed | None:
        """Return the next image."""
        now_s = mission_time(fix.at_us / 1e6).timestamp()
        return self._sensor._images.next_observed(fix, now_s)

    def on_event(self, event: AnyEvent) -> None:
        """Ignore the events of the run."""


class Detector:
    """A program that sends the burned cells in each image as a raster."""

    def __init__(self, world: World, folder: Path) -> None:
        self._land = world.context.landscape
        self._files = ReadOnce(folder)
        self._images = ArrivedImages(
            self._land, world.context.scenario.estimate.thermal_frames, refuse
        )
        self.refused = 0
        world.simulation.service.sensors = Sensors({}, self._land.shape)

    def rasters(self, now_s: float) -> list[dict[str, Any]]:
        """Return the requests for the new images at a mission time."""
        for image in self._files.new():
            self._images.add_image(image, mission_time(now_s))
        found, now = [], Telemetry(round(now_s * 1e6), "", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        while (
            seen := self._images.next_observed(now, mission_time(now_s).timestamp())
        ) is not None:
            found.append(raster_of(seen, now_s, self._land))
        return found


class OverHttp(Detector):
    """A detector that uses the HTTP interface."""

    def __init__(self, world: World, folder: Path) -> None:
        super().__init__(world, folder)
        self._service = served(world)

    def pass_on(self, now_s: float) -> None:
        """Send the new images."""
        if rasters := self.rasters(now_s):
            asyncio.run(self._send(rasters))

    async def _send(self, rasters: list[dict[str, Any]]) -> None:
        async with client(self._service.app) as sender:
            for raster in rasters:
                reply = await sender.post(PATH, json=raster, headers=self._service.headers())
                self.refused += reply.status_code != 200


class OverMqtt(Detector):
    """A detector that sends commands, as they arrive from a broker."""

    def __init__(self, world: World, folder: Path) -> None:
        super().__init__(world, folder)
        self._gate = CommandGate(world.context.request_handler.ask)
        self._sent = 0

    def pass_on(self, now_s: float) -> None:
        """Send the new images."""
        unix_us = round(mission_time(now_s).timestamp() * 1e6)
        for raster in self.rasters(now_s):
            self._sent += 1
            command = {"id": f"{self._sent}", "by": "detector", "sent_at_unix_us": unix_us}
            payload = msgspec.json.encode(command | raster)
            reply = self._gate.accept("raster", payload, False, round(now_s * 1e6), now_s, unix_us)
            self.refused += reply is None or not reply.ok


RELAYS: dict[str, Callable[[World, Path], Relay]] = {
    "video": Video,
    "http": OverHttp,
    "mqtt": OverMqtt,
}


def refuse(name: str, reason: str) -> None:
    """Stop the benchmark: the images of the simulated camera are usable."""
    raise AssertionError(f"{name}: {reason}")


def mission_time(at_s: float) -> datetime:
    """Return the time of the simulated camera's clock at a mission time."""
    return SIMULATED_ZERO + timedelta(seconds=at_s)


def raster_of(seen: Observed, now_s: float, land: Landscape) -> dict[str, Any]:
    """Return a request with the cells of an image, on a grid of latitude and longitude."""
    state = states_in(seen.cells)
    rows, cols = state.shape
    corners = [
        land.lat_lon_of(*land.xy_of(seen.row + row - 0.5, seen.col + col - 0.5))
        for row in (0, rows)
        for col in (0, cols)
    ]
    lats, lons = (sorted(float(each[axis]) for each in corners) for axis in (0, 1))
    south, north, west, east = lats[0], lats[-1], lons[0], lons[-1]
    lat = np.linspace(north, south, 2 * FINER * rows + 1)[1::2, None]
    lon = np.linspace(west, east, 2 * FINER * cols + 1)[None, 1::2]
    lat, lon = np.broadcast_arrays(lat, lon)
    places = land.row_col_of(*land.xy_of_lat_lon(lat, lon))
    row, col = (
        np.rint(each).astype(np.int64) - first
        for each, first in zip(places, (seen.row, seen.col), strict=True)
    )
    inside = (row >= 0) & (row < rows) & (col >= 0) & (col < cols)
    found = np.full(inside.shape, UNSEEN, dtype=np.uint8)
    found[inside] = state[row[inside], col[inside]]
    return {
        "south_deg": south,
        "west_deg": west,
        "north_deg": north,
        "east_deg": east,
        "rows": in_letters(LETTERS[found]),
        "age_s": max(now_s - seen.at_us / 1e6, 0.0),
        "position_sd_m": seen.position_sd_m,
        "missed_pct": 100.0 * seen.missed,
        "false_alarms_pct": 100.0 * seen.false_alarms,
        "source": "thermal detector",
    }


def relay_of(way: str, world: World, folder: Path) -> Relay | None:
    """Return the relay of a way; None if the service reads the files itself."""
    return None if way == "files" else RELAYS[way](world, folder)
