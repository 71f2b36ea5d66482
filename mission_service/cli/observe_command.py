"""Defines ``mission-service observe``: draws the observations in images and other files."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mission_service.cli.options import JSON, OUT_FOLDER, OVERRIDE, FiniteRange, echo
from mission_service.cli.output_folder import results_in

if TYPE_CHECKING:
    from firemodel.landscape.landscape import Landscape
    from mission_service.config.fire_sections import ThermalCameraSection
    from mission_service.config.scenario import Scenario
    from mission_service.sensors.thermal.frame_cells import FrameCells
    from mission_service.sensors.thermal.thermal_image import ThermalImage

MAX_IMAGES = 100  # maximum number of images from one video


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--scenario", required=True, help="Scenario with the landscape and the settings of the sensors."
)
@click.option(
    "--every",
    "every_s",
    type=FiniteRange(min=0.0, min_open=True),
    default=10.0,
    show_default=True,
    help="Seconds between two images of a video.",
)
@OUT_FOLDER
@OVERRIDE
@JSON
def observe(
    files: tuple[Path, ...],
    scenario: str,
    every_s: float,
    out: Path,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Show what FILES contribute to the estimate of a fire, without a run.

    Thermal images, including those in videos (.ts) with MISB ST 0601 metadata, are placed on the
    ground by their position and direction, and registered to the preceding images. Perimeters,
    satellite pixels and rasters are read as by the sensor observation_files. DIR/NAME.png shows the
    image and, on the map, the observed cells with their position error. The summary contains counts
    and errors.
    Files that cannot be used are listed with the reason; the exit code is then 1.
    """
    from mission_service.config.scenario import load_scenario
    from mission_service.fire.scenario_fire import landscape_of

    loaded = load_scenario(scenario, overrides)
    landscape = landscape_of(loaded)
    camera = _Camera(landscape, loaded.estimate.thermal_frames)
    images: list[dict[str, Any]] = []
    others: list[dict[str, Any]] = []
    with results_in(out, "repeat the command") as made:
        for number, path in enumerate(files):
            name = path.stem if len(files) == 1 else f"{number:03d}-{path.stem}"
            if _is_video(path):
                images += _video(path, made / name, loaded, landscape, every_s)
            elif _is_thermal(path):
                images.append(camera.observe(path, made / f"{name}.png"))
            else:
                others.append(_file(path, made / f"{name}.png", loaded, landscape))
    if as_json:
        echo({"images": images, "files": others}, True)
    else:
        for each in (*images, *others):
            click.echo(_line(each), err="error" in each)
    if any("error" in each for each in (*images, *others)):
        raise click.exceptions.Exit(1)


def _is_video(path: Path) -> bool:
    from mission_service.sensors.video.video_file import SUFFIXES

    return path.suffix.lower() in SUFFIXES


def _is_thermal(path: Path) -> bool:
    """Return whether a file is a camera image, not a georeferenced raster or another file."""
    from firemodel.errors import FireModelError
    from firemodel.landscape.readers.bands import bands_of
    from mission_service.sensors.files.observation_file import RASTERS
    from mission_service.sensors.thermal.thermal_image import SUFFIXES

    suffix = path.suffix.lower()
    if suffix not in RASTERS:
        return suffix in SUFFIXES
    try:
        return bands_of(path)[0].crs is None
    except FireModelError:
        return True  # the image reader reports the reason


class _Camera:
    """A camera whose images are registered to each other."""

    def __init__(self, landscape: "Landscape", settings: "ThermalCameraSection") -> None:
        from mission_service.sensors.thermal.frame_registration import FrameRegistration

        self._landscape, self._settings = landscape, settings
        self._registration = FrameRegistration(landscape)

    def observe(
        self, path: Path, picture: Path, image: "ThermalImage | None" = None
    ) -> dict[str, Any]:
        """Draw an image and return its summary; ``path`` is the image file, or its video."""
        from firemodel.errors import FireModelError
        from mission_service.errors import MissionServiceError
        from mission_service.sensors.thermal.draped_image import draped_image
        from mission_service.sensors.thermal.frame_cells import frame_cells
        from mission_service.sensors.thermal.frame_picture import draw_frame
        from mission_service.sensors.thermal.thermal_image import read_thermal_image

        try:
            image = image or read_thermal_image(path)
            found = frame_cells(image, self._landscape, self._settings, self._registration)
        except (MissionServiceError, FireModelError) as error:
            return {"file": str(path), "error": str(error)}
        draped = draped_image(image, found, self._settings)
        draw_frame(picture, self._landscape, image, found, draped)
        summary = _summary(image, found, self._landscape)
        return {"file": str(path)} | summary | {"picture": picture.name}


def _video(
    path: Path, picture: Path, scenario: "Scenario", landscape: "Landscape", every_s: float
) -> Iterator[dict[str, Any]]:
    """Draw the images in a video, and yield their summaries."""
    from mission_service.errors import MissionServiceError
    from mission_service.sensors.video.thermal_video import check_libraries
    from mission_service.sensors.video.video_file import images_in

    check_libraries()
    settings = scenario.estimate.thermal_video
    camera = _Camera(landscape, settings)
    taken = enumerate(images_in(path, settings, every_s))
    for count, image in islice(taken, MAX_IMAGES):
        if isinstance(image, MissionServiceError):
            yield {"file": str(path), "error": str(image)}
        else:
            yield camera.observe(path, picture.with_name(f"{picture.name}-{count:03d}.png"), image)
    if next(taken, None) is not None:
        text = f"{path}: has more than {MAX_IMAGES} images; increase --every"
        yield {"file": str(path), "error": text}


def _summary(image: "ThermalImage", found: "FrameCells", landscape: "Landscape") -> dict[str, Any]:
    cells = "".join(found.window.cells)
    lat_deg, lon_deg = landscape.lat_lon_of(*landscape.xy_of(*found.centre))
    return {
        "taken": image.taken.isoformat(),
        "values": image.kind,
        "hot_pixels": found.hot_pixels,
        "burned_cells": cells.count("b"),
        "unburned_cells": cells.count("u"),
        "matches": found.matches,
        "inexact": round(found.inexact, 3),
        "position_sd_m": round(found.position_sd_m, 2),
        "ellipse": {
            "major_m": round(found.ellipse.major_m, 2),
            "minor_m": round(found.ellipse.minor_m, 2),
            "major_from_deg": round(
                float(landscape.true_deg(found.ellipse.major_from_grid_north_deg)) % 180.0, 1
            ),
            "lat_deg": round(float(lat_deg), 7),
            "lon_deg": round(float(lon_deg), 7),
        },
    }


def _file(
    path: Path, picture: Path, scenario: "Scenario", landscape: "Landscape"
) -> dict[str, Any]:
    """Draw the observations in a file that is not an image or video, and return a summary."""
    import numpy as np

    from firemodel.assimilation.observation import BURNED, UNBURNED
    from firemodel.errors import FireModelError
    from mission_service.errors import MissionServiceError
    from mission_service.sensors.files.file_contents import utc_of
    from mission_service.sensors.files.observation_file import read_observation_file
    from mission_service.sensors.files.observation_folder import settings_of
    from mission_service.sensors.files.observation_picture import draw_contents, states_of

    try:
        contents = read_observation_file(path, landscape, settings_of(scenario))
    except (MissionServiceError, FireModelError) as error:
        return {"file": str(path), "error": str(error)}
    draw_contents(picture, landscape, path.name, contents)
    state = states_of(contents, landscape)
    return {
        "file": str(path),
        "kind": contents.kind,
        "burned_cells": int(np.count_nonzero(state == BURNED)),
        "unburned_cells": int(np.count_nonzero(state == UNBURNED)),
        "observations": [
            {
                "state": getattr(each, "state", "cells"),
                "seen": utc_of(each.seen_unix_s),
                "source": each.source,
                "position_sd_m": each.position_sd_m,
            }
            for each in contents.observations
        ],
        "notes": list(contents.notes),
        "picture": picture.name,
    }


def _line(each: dict[str, Any]) -> str:
    if "error" in each:
        return f"{each['error']}"
    cells = f"{each['burned_cells']} cells burned, {each['unburned_cells']} unburned"
    if "hot_pixels" in each:
        share = each["inexact"]
        inexact = f"; {share:.0%} of the pixels exceed max_position_sd_m" if share else ""
        return (
            f"{each['file']}: {each['hot_pixels']} hot pixels; {cells}; position ± "
            f"{each['position_sd_m']} m{inexact}; {each['matches']} matches; {each['picture']}"
        )
    notes = "".join(f"\n  not used: {note}" for note in each["notes"])
    seen = "".join(
        f"\n  {seen['seen']}: {seen['state']}, {seen['source']}, position ± "
        f"{seen['position_sd_m']:g} m"
        for seen in each["observations"]
    )
    return f"{each['file']}: {each['kind']}; {cells}; {each['picture']}{seen}{notes}"
