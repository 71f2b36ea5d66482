"""Defines ``mission-service request satellite-pixels``, which reports satellite detections."""

import json
from pathlib import Path
from typing import Any

import click

from mission_service.cli.request_commands import only_station, user_options


@click.command("satellite-pixels")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--footprints",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="GEOJSON",
    help="Also write the footprints of the pixels on the landscape.",
)
@user_options
def satellite_pixels(
    out: Path, by: str, station: str | None, as_json: bool, file: Path, footprints: Path | None
) -> None:
    """Report the detections of VIIRS or MODIS in FILE (a CSV file of FIRMS) to a run.

    Pixels outside the landscape of the run are left out. The fire may burn anywhere in a pixel. A
    report that differs from the estimated front by less than this position error changes nothing.
    If the run refuses a report, for example because the report is too old, the other reports are
    still sent, and the exit code is 1.
    """
    from datetime import UTC, datetime

    from mission_service.errors import MissionServiceError, RequestError
    from mission_service.interfaces.control.control_client import ControlClient
    from mission_service.journal.reader import JournalReader
    from mission_service.sensors.files import satellite_pixels as satellite
    from mission_service.sensors.files.file_contents import degrees_around

    with ControlClient(out) as client:
        station = station or only_station(client)
        landscape = JournalReader(out / "journal.jsonl").landscape
        pixels, count = satellite.read_satellite_pixels(file, degrees_around(landscape))
        inside = [
            each
            for each in pixels
            if landscape.contains(*landscape.xy_of_lat_lon(each.lat_deg, each.lon_deg))
        ]
        if footprints is not None:
            try:
                footprints.write_text(json.dumps(satellite.footprints(inside)), encoding="utf-8")
            except OSError as error:
                raise MissionServiceError(f"{footprints}: {error.strerror}") from None
        results: list[dict[str, Any]] = []
        for each in satellite.reports_of(inside, datetime.now(UTC)):
            result = {"source": each["source"], "pixels": len(each["points"])}
            try:
                client.ask(by=by, station=station, **each)
                results.append(result)
            except RequestError as error:
                results.append(result | {"error": str(error)})
    refused = [each for each in results if "error" in each]
    if as_json:
        click.echo(json.dumps({"pixels": count, "on_landscape": len(inside), "reports": results}))
    else:
        click.echo(f"{len(inside)} of {count} pixels lie on the landscape")
        for each in results:
            words = f"not used: {each['error']}" if "error" in each else "accepted"
            click.echo(f"{each['source']}, {each['pixels']} pixels: {words}", err="error" in each)
    if refused:
        raise click.exceptions.Exit(1)
