"""Defines ``mission-service report``, which writes a page with a comparison of runs.

Heavy modules are imported only when the command runs.
"""

import json
from pathlib import Path

import click

from mission_service.cli.options import (
    JSON,
    OUT_REQUIRED,
    OVERRIDE,
    seconds_option,
)
from mission_service.cli.output_folder import output_folder


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

    words = [run.split("+") for run in runs]
    names = distinct([run_name([path_of(log) for log in each]) for each in words])
    flights = [flight_of(each) for each in words]
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
        click.echo(f"{', '.join(files)} in {out}/")
