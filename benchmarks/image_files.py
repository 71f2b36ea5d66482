"""Measure the front of an estimate that receives only image files: ``benchmarks.image_files``.

    python -m benchmarks.image_files FIRST LAST [--stack px4|ardupilot] [--telemetry]
        [--by files|video|http|mqtt] [--minutes 25]

A mock plane circles the fire of the default scenario in virtual time. Its missions trigger its
camera every 40 m, and its simulated camera writes a thermal image with EXIF and XMP (with
``--telemetry``: with its time only) into a folder. Nothing else passes from the simulated fire to
the estimate. With ``--by video``, ``http`` or ``mqtt`` the service does not read these files;
another program passes them on (``benchmarks.image_relays``). Wind, moisture and spread rate of the
simulated fire differ from the estimate's model as in ``benchmarks.flown_estimate``. In the last ten
minutes, once a minute, the front of the estimate is compared with the true front near the places
where the aircraft flew in the last minute, and the mean distance of points of the true front from
the estimated front is printed. Persistence is the true front at takeoff; the model alone receives
no images.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import shapely

from benchmarks.flown_estimate import wrong_scenario
from benchmarks.image_relays import RELAYS, relay_of
from firemodel.arrays import Floats
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import Scenario
from mission_service.fire.scenario_fire import fire_of, landscape_of
from tests.api.worlds import world_in

NEAR_M = 100.0  # of the track; the camera shows 180 m on each side
SPACING_M = 5.0  # between points of the true front
MEASURED_S, EVERY_S, STEP_S = 600.0, 60.0, 5.0
TRIGGER_M = 40.0


def scenario_for(seed: int, folder: Path, stack: str, poses_in_files: bool) -> Scenario:
    """Return a scenario whose simulated fire reaches the estimate by files in a folder."""
    found = wrong_scenario(seed, 24)
    frames = found.estimate.thermal_frames.model_copy(
        update={
            "folder": str(folder),
            "field_of_view_deg": None if poses_in_files else found.vehicles[0].camera_fov_deg,
        }
    )
    camera = found.simulation.camera.model_copy(update={"poses_in_files": poses_in_files})
    plane = found.vehicles[0].model_copy(
        update={"stack": stack, "camera_trigger_m": TRIGGER_M, "gimbal_pitch_deg": -90.0}
    )
    estimate = found.estimate.model_copy(
        update={"sensors": ("thermal_frames",), "thermal_frames": frames}
    )
    return found.model_copy(
        update={
            "seed": seed,
            "start_s": found.deploy_at_s,
            "vehicles": (plane,),
            "estimate": estimate,
            "simulation": found.simulation.model_copy(update={"camera": camera}),
        }
    )


def front_of(fire: Fire) -> Any:
    """Return the front of a fire as lines in metres."""
    return fire.front(fire.time_s).boundary


def behind_m(true: Any, other: Any, track: Sequence[tuple[float, float]]) -> float:
    """Return the mean distance of the true front near a track from another front; NaN if none."""
    near = shapely.LineString(track).buffer(NEAR_M)
    part = shapely.intersection(true, near)
    if part.is_empty:
        return float("nan")
    return mean_distance_m(part, other)


def mean_distance_m(true: Any, other: Any) -> float:
    """Return the mean distance of points of a front from another front."""
    points = shapely.get_coordinates(shapely.segmentize(true, SPACING_M))
    return float(np.mean(shapely.distance(shapely.points(points), other)))


def flown(scenario: Scenario, minutes: float, out: Path, way: str) -> tuple[Floats, int]:
    """Return the errors (times, methods: estimate, persistence, model) and the number of images."""
    landscape = landscape_of(scenario)
    folder = Path(scenario.estimate.thermal_frames.folder or "")
    world = world_in(out, scenario)
    flight, relay = world.simulation, relay_of(way, world, folder)
    assert flight.true_fire is not None
    model = fire_of(scenario, landscape)
    flight.true_fire.advance(round(scenario.start_s * 1e6))
    before = front_of(flight.true_fire.fire)
    track: list[tuple[float, float]] = []
    errors = []
    at_s, end_s = scenario.start_s, scenario.start_s + 60.0 * minutes
    while at_s < end_s:
        at_s += STEP_S
        flight.run_until(at_s)
        if relay is not None:
            relay.pass_on(flight.clock.now_us / 1e6)
        mock = flight.rigs[0].mock.flight
        x_m, y_m = landscape.xy_of_lat_lon(*mock.frame.global_position(mock.motion))
        track = [*track, (float(x_m), float(y_m))][-round(EVERY_S / STEP_S) - 1 :]
        if at_s > end_s - MEASURED_S and at_s % EVERY_S < STEP_S:
            flight.service.advance_fire(flight.clock.now_us)
            flight.true_fire.advance(flight.clock.now_us)
            model.advance(flight.clock.now_us / 1e6)
            true = front_of(flight.true_fire.fire)
            others = (front_of(flight.estimate.fire), before, front_of(model))
            errors.append([behind_m(true, other, track) for other in others])
    flight.service.recording.journal.close()
    return np.array(errors), len(list(folder.iterdir()))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the errors of each seed, and their means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--stack", choices=("px4", "ardupilot"), default="px4")
    parser.add_argument("--telemetry", action="store_true")
    parser.add_argument("--by", choices=("files", *RELAYS), default="files")
    parser.add_argument("--minutes", type=float, default=25.0)
    given = parser.parse_args(arguments)
    click.echo("seed  images  mean distance of the front in m: estimate  persistence  model alone")
    every = []
    for seed in range(given.first, given.last + 1):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) / "frames"
            folder.mkdir()
            scenario = scenario_for(seed, folder, given.stack, not given.telemetry)
            errors, images = flown(scenario, given.minutes, Path(name), given.by)
        every.append(np.nanmean(errors, axis=0))
        click.echo(f"{seed:4}  {images:6}  " + "  ".join(f"{each:7.1f}" for each in every[-1]))
    mean = np.mean(every, axis=0)
    click.echo("mean          " + "  ".join(f"{each:7.1f}" for each in mean))


if __name__ == "__main__":
    main()
