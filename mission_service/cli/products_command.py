"""Defines ``mission-service products``, which writes maps and GIS files for crews and staff.

Heavy modules are imported only when the command runs.
"""

import json
from datetime import datetime
from pathlib import Path

import click

from mission_service.cli.options import JSON, OUT_FOLDER, seconds_option
from mission_service.cli.output_folder import results_in


def aware_time(
    context: click.Context, parameter: click.Parameter, value: str | None
) -> datetime | None:
    """Return a time in ISO 8601 with a UTC offset; raise BadParameter for any other value."""
    if value is None:
        return None
    try:
        found = datetime.fromisoformat(value)
    except ValueError:
        found = None
    if found is None or found.tzinfo is None:
        raise click.BadParameter(
            f"{value!r}: give a date, a time and a UTC offset, such as 2026-08-01T14:00-06:00"
        )
    return found


@click.command()
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@OUT_FOLDER
@seconds_option("--at", "Mission time of the products (default: the end of the journal).")
@click.option(
    "--forecast",
    "forecast_h",
    type=click.FloatRange(0.0, 6.0),
    default=3.0,
    show_default=True,
    metavar="H",
    help="Length of the forecast in hours; 0 for none.",
)
@click.option(
    "--time-zero",
    callback=aware_time,
    metavar="TIME",
    help="Calendar time of mission time 0, with UTC offset, if the scenario has none.",
)
@JSON
def products(
    source: Path,
    out: Path,
    at_s: float | None,
    forecast_h: float,
    time_zero: datetime | None,
    as_json: bool,
) -> None:
    """Write maps (PDF, PNG), GIS files, KMZ, GeoTIFFs and a log of a run's fire to DIR.

    SOURCE is a journal or the folder of a run, which may still be running. Equal journals give
    identical files.
    """
    from mission_service.products.journal_incident import incident_in
    from mission_service.products.write import write_products
    from mission_service.replay.flights.journal_log import journal_in

    with results_in(out, "repeat the command") as made:
        incident = incident_in(journal_in(source), at_s, 3600.0 * forecast_h, time_zero)
        files = write_products(made, incident)
    if as_json:
        click.echo(json.dumps({"acres": round(incident.acres, 2), "files": files}))
    else:
        click.echo(
            f"{incident.name}, {incident.in_words(incident.at_s)}: {incident.acres:,.0f} acres"
        )
        click.echo(f"{', '.join(files)} in {out}/")
