"""Defines ``mission-service observe``: what images of thermal cameras show of a landscape."""

from itertools import islice
from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import JSON, OUT_FOLDER, OVERRIDE, echo
from mission_service.cli.output_folder import results_in

MAX_IMAGES = 100  # of one video


@click.command()
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--scenario",
    required=True,
    help="Its landscape, [estimate.thermal_frames] and [estimate.thermal_video].",
)
@click.option(
    "--every",
    "every_s",
    type=click.FloatRange(min=0.0, min_open=True),
    default=10.0,
    show_default=True,
    help="Seconds between two images of a video.",
)
@OUT_FOLDER
@OVERRIDE
@JSON
def observe(
    images: tuple[Path, ...],
    scenario: str,
    every_s: float,
    out: Path,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Show what thermal IMAGES contribute to the estimate of a fire; no run is needed.

    Each image is placed on the ground by its position and direction. DIR/NAME.png shows the
    observed cells on the map with the error ellipse of their place, and the summary contains
    counts and errors. Images that cannot be used are listed with the reason; the exit code is
    then 1. Images are also taken from videos (.ts) with MISB ST 0601 metadata.
    """
    from mission_service.config.scenario import load_scenario
    from mission_service.fire.scenario_fire import landscape_of
    from mission_service.sensors.thermal_video import check_libraries
    from mission_service.sensors.video_file import images_in

    loaded = load_scenario(scenario, overrides)
    landscape = landscape_of(loaded)
    if any(_is_video(path) for path in images):
        check_libraries()
    summaries: list[dict[str, Any]] = []
    with results_in(out, "repeat the command") as made:
        for number, path in enumerate(images):
            name = path.stem if len(images) == 1 else f"{number:03d}-{path.stem}"
            if not _is_video(path):
                summaries.append(
                    _observed(path, made / f"{name}.png", landscape, loaded.estimate.thermal_frames)
                )
                continue
            settings = loaded.estimate.thermal_video
            taken = enumerate(images_in(path, settings, every_s))
            for count, image in islice(taken, MAX_IMAGES):
                picture = made / f"{name}-{count:03d}.png"
                summaries.append(_observed(path, picture, landscape, settings, image))
            if next(taken, None) is not None:
                text = f"{path}: has more than {MAX_IMAGES} images; increase --every"
                summaries.append({"file": str(path), "error": text})
    if as_json:
        echo({"images": summaries}, True)
    else:
        for each in summaries:
            click.echo(_line(each), err="error" in each)
    if any("error" in each for each in summaries):
        raise click.exceptions.Exit(1)


def _is_video(path: Path) -> bool:
    from mission_service.sensors.video_file import SUFFIXES

    return path.suffix.lower() in SUFFIXES


def _observed(
    path: Path, picture: Path, landscape: Any, settings: Any, image: Any = None
) -> dict[str, Any]:
    """Draw what an image shows, and return its summary.

    ``image`` is an image of a video or its error; without it ``path`` is read.
    """
    from firemodel.errors import FireModelError
    from mission_service.errors import MissionServiceError
    from mission_service.sensors.frame_cells import frame_cells
    from mission_service.sensors.frame_picture import draw_frame
    from mission_service.sensors.thermal_image import read_thermal_image

    try:
        if isinstance(image, MissionServiceError):
            raise image
        image = read_thermal_image(path) if image is None else image
        found = frame_cells(image, landscape, settings)
    except (MissionServiceError, FireModelError) as error:
        return {"file": str(path), "error": str(error)}
    draw_frame(picture, landscape, image, found)
    return _summary(path, image, found, landscape) | {"picture": picture.name}


def _summary(path: Path, image: Any, found: Any, landscape: Any) -> dict[str, Any]:
    cells = "".join(found.window.cells)
    lat_deg, lon_deg = landscape.lat_lon_of(*landscape.xy_of(*found.centre))
    return {
        "file": str(path),
        "taken": image.taken.isoformat(),
        "values": image.kind,
        "hot_pixels": found.hot_pixels,
        "burned_cells": cells.count("b"),
        "unburned_cells": cells.count("u"),
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


def _line(each: dict[str, Any]) -> str:
    if "error" in each:
        return f"{each['error']}"
    return (
        f"{each['file']}: {each['hot_pixels']} hot pixels; {each['burned_cells']} cells burned, "
        f"{each['unburned_cells']} unburned; position ± {each['position_sd_m']} m; "
        f"{each['picture']}"
    )
