"""Defines ``mission-service observe``: what images of thermal cameras show of a landscape."""

from pathlib import Path
from typing import Any

import click

from mission_service.cli.options import JSON, OUT_FOLDER, OVERRIDE, echo
from mission_service.cli.output_folder import results_in


@click.command()
@click.argument("images", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--scenario", required=True, help="Its landscape and [estimate.thermal_frames].")
@OUT_FOLDER
@OVERRIDE
@JSON
def observe(
    images: tuple[Path, ...], scenario: str, out: Path, overrides: tuple[str, ...], as_json: bool
) -> None:
    """Show what thermal IMAGES contribute to the estimate of a fire; no run is needed.

    Each image is placed on the ground by its position and direction, and registered to the images
    before. DIR/NAME.png shows the
    observed cells on the map with the error ellipse of their place, and the summary contains
    counts and errors. Images that cannot be used are listed with the reason; the exit code is
    then 1.
    """
    from firemodel.errors import FireModelError
    from mission_service.config.scenario import load_scenario
    from mission_service.errors import MissionServiceError
    from mission_service.fire.scenario_fire import landscape_of
    from mission_service.sensors.frame_cells import frame_cells, stated_errors
    from mission_service.sensors.frame_picture import draw_frame
    from mission_service.sensors.frame_registration import FrameRegistration
    from mission_service.sensors.thermal_image import read_thermal_image

    loaded = load_scenario(scenario, overrides)
    landscape, settings = landscape_of(loaded), loaded.estimate.thermal_frames
    registration = FrameRegistration(landscape, stated_errors(settings))
    summaries: list[dict[str, Any]] = []
    with results_in(out, "repeat the command") as made:
        for number, path in enumerate(images):
            try:
                image = read_thermal_image(path)
                found = frame_cells(image, landscape, settings, registration)
            except (MissionServiceError, FireModelError) as error:
                summaries.append({"file": str(path), "error": str(error)})
                continue
            name = f"{path.stem}.png" if len(images) == 1 else f"{number:03d}-{path.stem}.png"
            draw_frame(made / name, landscape, image, found)
            summaries.append(_summary(path, image, found, landscape) | {"picture": name})
    if as_json:
        echo({"images": summaries}, True)
    else:
        for each in summaries:
            click.echo(_line(each), err="error" in each)
    if any("error" in each for each in summaries):
        raise click.exceptions.Exit(1)


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


def _line(each: dict[str, Any]) -> str:
    if "error" in each:
        return f"{each['error']}"
    inexact = f"; {each['inexact']:.0%} of the pixels too inexact" if each["inexact"] else ""
    return (
        f"{each['file']}: {each['hot_pixels']} hot pixels; {each['burned_cells']} cells burned, "
        f"{each['unburned_cells']} unburned; position ± {each['position_sd_m']} m"
        f"{inexact}; {each['matches']} matches; {each['picture']}"
    )
