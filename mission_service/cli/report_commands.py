"""Defines ``report`` (a page that compares runs), ``products`` (maps, files) and ``docs``.

Heavy modules are imported only when the command runs.
"""

import json
from datetime import datetime
from pathlib import Path

import click

from mission_service.cli.options import (
    JSON,
    LOCAL_PORT,
    OUT_FOLDER,
    OUT_REQUIRED,
    OVERRIDE,
    FiniteRange,
    aware_time,
    refuse_given,
    seconds_option,
)
from mission_service.cli.output_folder import output_folder, refuse_run_folder, results_in


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@OUT_REQUIRED
@click.option(
    "--scenario", metavar="SCENARIO", help="Scenario for logs; a journal contains a scenario."
)
@seconds_option("--at", "Mission time at which these logs begin.")
@OVERRIDE
@JSON
def report(
    runs: tuple[str, ...],
    out: Path,
    scenario: str | None,
    at_s: float | None,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write report.html, the pictures and figures.json to OUT.

    A RUN is a journal, the folder of a run, a log, or logs of one flight joined by +. The table has
    a column for each RUN.
    """
    from mission_service.replay.flights.batch import (
        analysis_of,
        analysis_with_fire,
        distinct,
        run_name,
    )
    from mission_service.replay.flights.flight_logs import flight_of, path_of, survey
    from mission_service.replay.flights.journal_log import JournalLog
    from mission_service.replay.flights.report_page import write_report
    from mission_service.replay.flights.run_figures import figures_of
    from mission_service.replay.flights.scenario_pairing import (
        ScenarioChoice,
        chosen_scenario,
        pair,
    )
    from mission_service.runtime.clocks import now_text

    words = [[run] if Path(run).exists() else run.split("+") for run in runs]
    names = distinct([run_name([path_of(log) for log in each]) for each in words])
    refuse_run_folder(out, [path_of(word) for each in words for word in each])
    flights = [flight_of(each) for each in words]
    if scenario is None:
        refuse_given("at_s", "overrides", reason="without --scenario")
    elif all(isinstance(flight.logs[0], JournalLog) for flight in flights):
        refuse_given(
            *("scenario", "at_s", "overrides"),
            reason="on journals, which contain their scenarios",
        )
    made = output_folder(out)
    analyses = []
    for name, flight in zip(names, flights, strict=True):
        if scenario is None or isinstance(flight.logs[0], JournalLog):
            analyses.append(analysis_of(name, flight))
            continue
        found = chosen_scenario(flight, ScenarioChoice(scenario, None, at_s, overrides))
        assert found is not None
        pairing = pair(flight, survey(flight), found[0], at_s)
        analyses.append(analysis_with_fire(name, pairing, None, now_text()))
    files = write_report(made, analyses)
    if as_json:
        click.echo(json.dumps([figures_of(analysis) for analysis in analyses]))
    else:
        click.echo(f"Wrote {', '.join(files)} to {out}/")


@click.command()
@click.argument("source", type=click.Path(exists=True, path_type=Path))
@OUT_FOLDER
@seconds_option("--at", "Mission time of the products (default: the end of the journal).")
@click.option(
    "--forecast",
    "forecast_h",
    type=FiniteRange(0.0, 6.0),
    default=3.0,
    show_default=True,
    metavar="H",
    help="Length of the forecast in hours; 0 for none.",
)
@click.option(
    "--time-zero",
    callback=aware_time,
    metavar="TIME",
    help="Calendar time of mission time 0, with UTC offset (default: time_zero of the scenario).",
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
    from mission_service.errors import RequestError
    from mission_service.products.journal_incident import incident_in
    from mission_service.products.write import write_products
    from mission_service.replay.flights.journal_log import journal_in

    journal = journal_in(source)
    if not journal.is_file():
        raise RequestError(
            f"{source}: contains no {journal.name}; specify the folder or the journal of run, "
            "demo, sim or replay"
        )
    refuse_run_folder(out, [journal])
    with results_in(out, "repeat the command") as made:
        incident = incident_in(journal, at_s, 3600.0 * forecast_h, time_zero)
        files = write_products(made, incident)
    if as_json:
        click.echo(json.dumps({"acres": round(incident.acres, 2), "files": files}))
    else:
        click.echo(
            f"{incident.name}, {incident.in_words(incident.at_s)}: {incident.acres:,.0f} acres"
        )
        click.echo(f"Wrote {', '.join(files)} to {out}/")


@click.command()
@LOCAL_PORT
@click.option("--no-browser", is_flag=True, help="Print the address only.")
def docs(port: int, no_browser: bool) -> None:
    """Serve the documentation on this machine, without a network, until Ctrl-C."""
    import contextlib
    import tempfile
    import webbrowser

    from mission_service.interfaces.manual import LOOPBACK, site_server, unpack_site

    with tempfile.TemporaryDirectory(prefix="mission-service-docs-") as made:
        unpack_site(Path(made))
        with site_server(port, Path(made)) as server, contextlib.suppress(KeyboardInterrupt):
            address = f"http://{LOOPBACK}:{server.server_port}/"
            click.echo(f"documentation: {address}")
            if not no_browser:
                webbrowser.open(address)
            server.serve_forever()
