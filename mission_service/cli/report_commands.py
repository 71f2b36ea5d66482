"""``mission-service report``: one page that compares runs. Heavy imports are lazy."""

import json
from pathlib import Path

import click

from mission_service.cli.options import JSON, OUT_REQUIRED, OVERRIDE, folder, seconds_option


@click.command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@OUT_REQUIRED
@click.option(
    "--scenario", metavar="SCENARIO", help="Scenario for logs; a journal contains its own."
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
    """Write report.html, its pictures and figures.json to OUT.

    A RUN is a journal, the folder of a run, a log, or logs of one flight joined by +. Each RUN has
    a column in the table.
    """
    from mission_service.replay.flights.batch import called, distinct, story_of, story_with_fire
    from mission_service.replay.flights.flight_logs import flight_of, path_of, survey
    from mission_service.replay.flights.journal_log import JournalLog
    from mission_service.replay.flights.report_page import write_report
    from mission_service.replay.flights.run_figures import figures_of
    from mission_service.replay.flights.scenario_pairing import Asked, replaying, scenario_asked
    from mission_service.runtime.clocks import now_text

    words = [run.split("+") for run in runs]
    names = distinct([called([path_of(log) for log in each]) for each in words])
    flights = [flight_of(each) for each in words]
    made = folder(out)
    stories = []
    for name, flight in zip(names, flights, strict=True):
        if scenario is None or isinstance(flight.logs[0], JournalLog):
            stories.append(story_of(name, flight))
            continue
        found = scenario_asked(flight, Asked(scenario, None, at_s, overrides))
        assert found is not None
        what = replaying(flight, survey(flight), found[0], at_s)
        stories.append(story_with_fire(name, what, None, now_text()))
    files = write_report(made, stories)
    if as_json:
        click.echo(json.dumps([figures_of(story) for story in stories]))
    else:
        click.echo(f"{', '.join(files)} in {out}/")
