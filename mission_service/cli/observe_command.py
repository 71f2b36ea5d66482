"""Defines ``mission-service observe``: what images and other files show of a landscape."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mission_service.cli.options import JSON, OUT_FOLDER, OVERRIDE, echo
from mission_service.cli.output_folder import results_in

if TYPE_CHECKING:
    from firemodel.landscape.landscape import Landscape
    from mission_service.config.fire_sections import ThermalFramesSection
    from mission_service.config.scenario import Scenario
    from mission_service.sensors.frame_registration import FrameRegistration


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--scenario", required=True, help="Its landscape and the settings of its sensors.")
@OUT_FOLDER
@OVERRIDE
@JSON
def observe(
    files: tuple[Path, ...], scenario: str, out: Path, overrides: tuple[str, ...], as_json: bool
) -> None:
    """Show what FILES contribute to the estimate of a fire; no run is needed.

    Thermal images are placed on the ground by their position and direction, and registered to the
    images before. Perimeters, satellite pixels and rasters are read as by the sensor
    observation_files. DIR/NAME.png shows the observed
    cells on the map with the error of their place, and the summary contains counts and errors.
    Files that cannot be used are listed with the reason; the exit code is then 1.
    """
    from firemodel.errors import FireModelError
    from mission_service.config.scenario import load_scenario
    from mission_service.errors import MissionServiceError
    from mission_service.fire.scenario_fire import landscape_of
    from mission_service.sensors.frame_cells import stated_errors
    from mission_service.sensors.frame_registration import FrameRegistration

    loaded = load_scenario(scenario, overrides)
    landscape = landscape_of(loaded)
    settings = loaded.estimate.thermal_frames
    registration = FrameRegistration(landscape, stated_errors(settings))
    images: list[dict[str, Any]] = []
    others: list[dict[str, Any]] = []
    with results_in(out, "repeat the command") as made:
        for number, path in enumerate(files):
            name = f"{path.stem}.png" if len(files) == 1 else f"{number:03d}-{path.stem}.png"
            thermal = _is_thermal(path)
            try:
                if thermal:
                    found = _image(path, made / name, settings, landscape, registration)
                else:
                    found = _file(path, made / name, loaded, landscape)
                summary = {"file": str(path)} | found | {"picture": name}
            except (MissionServiceError, FireModelError) as error:
                summary = {"file": str(path), "error": str(error)}
            (images if thermal else others).append(summary)
            if not as_json:
                click.echo(_line(summary), err="error" in summary)
    if as_json:
        echo({"images": images, "files": others}, True)
    if any("error" in each for each in (*images, *others)):
        raise click.exceptions.Exit(1)


def _is_thermal(path: Path) -> bool:
    """Return whether a file is an image of a camera, and not a georeferenced raster or another."""
    from firemodel.errors import FireModelError
    from firemodel.landscape.readers.bands import bands_of
    from mission_service.sensors.observation_file import RASTERS
    from mission_service.sensors.thermal_image import SUFFIXES

    suffix = path.suffix.lower()
    if suffix not in RASTERS:
        return suffix in SUFFIXES
    try:
        return bands_of(path)[0].crs is None
    except FireModelError:
        return True  # its reader has the reason


def _image(
    path: Path,
    picture: Path,
    settings: "ThermalFramesSection",
    landscape: "Landscape",
    registration: "FrameRegistration",
) -> dict[str, Any]:
    """Draw a thermal image, and return its summary."""
    from mission_service.sensors.frame_cells import frame_cells
    from mission_service.sensors.frame_picture import draw_frame
    from mission_service.sensors.thermal_image import read_thermal_image

    image = read_thermal_image(path)
    found = frame_cells(image, landscape, settings, registration)
    draw_frame(picture, landscape, image, found)
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
    """Draw the observations in another file, and return its summary."""
    import numpy as np

    from firemodel.assimilation.observation import BURNED, UNBURNED
    from mission_service.sensors.file_contents import utc_of
    from mission_service.sensors.observation_file import read_observation_file
    from mission_service.sensors.observation_folder import settings_of
    from mission_service.sensors.observation_picture import draw_contents, states_of

    contents = read_observation_file(path, landscape, settings_of(scenario))
    draw_contents(picture, landscape, path.name, contents)
    state = states_of(contents, landscape)
    return {
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
    }


def _line(each: dict[str, Any]) -> str:
    if "error" in each:
        return f"{each['error']}"
    cells = f"{each['burned_cells']} cells burned, {each['unburned_cells']} unburned"
    if "hot_pixels" in each:
        inexact = f"; {each['inexact']:.0%} of the pixels too inexact" if each["inexact"] else ""
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
