"""Writes the report on runs as one page with embedded pictures, and all figures as files."""

import base64
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from mission_service.core.autopilot_reports import LINK_CAUSES
from mission_service.replay.flights import pictures
from mission_service.replay.flights.run_analysis import RunAnalysis, VehicleAnalysis
from mission_service.replay.flights.run_figures import figures_of, table
from mission_service.replay.flights.utc_time import utc

LONG_US = 30_000_000  # a shorter flight against the planner's direction is part of a reversal
FEW_MISSIONS = 8  # up to this number, missions count as main events
MAX_EVENTS = 400  # maximum number of lines; the page states the number of omitted lines


class ReportLine(NamedTuple):
    """A line of the report's list of events; ``at_s`` is the time since the flight began."""

    at_s: float
    vehicle: str
    text: str
    is_main: bool = False


def write_report(out: Path, runs: Sequence[RunAnalysis]) -> list[str]:
    """Write report.html, the pictures and figures.json to ``out``; returns the files' names."""
    figures = [figures_of(run) for run in runs]
    images: dict[str, bytes] = {}
    for name, drawn in _drawn(runs):  # one figure at a time, because each takes megabytes
        if drawn is not None:
            images[name] = pictures.png(drawn)
    for name, data in images.items():
        (out / f"{name}.png").write_bytes(data)
    (out / "figures.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    (out / "report.html").write_text(_page(runs, figures, images), encoding="utf-8")
    return ["report.html", "figures.json", *(f"{name}.png" for name in images)]


def _drawn(runs: Sequence[RunAnalysis]) -> Iterator[tuple[str, Any]]:
    for run in runs:
        suffix = f"-{run.name}" if len(runs) > 1 else ""
        yield f"map{suffix}", pictures.draw_map(run)
        yield f"timeline{suffix}", pictures.draw_timeline(run)
        yield f"heights{suffix}", pictures.draw_heights(run)
    yield "knowledge", pictures.draw_knowledge(runs)
    yield "changes", pictures.draw_changes(runs)


def _page(
    runs: Sequence[RunAnalysis], figures: Sequence[dict[str, Any]], images: dict[str, bytes]
) -> str:
    environment = Environment(
        loader=PackageLoader("mission_service.replay.flights"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    embedded = {name: base64.b64encode(data).decode("ascii") for name, data in images.items()}
    shown = [_values(run, len(runs) > 1) for run in runs]
    page = environment.get_template("report.html")
    return page.render(runs=shown, table=table(figures), images=embedded)


def _values(run: RunAnalysis, several: bool) -> dict[str, Any]:
    events = sorted(_events(run))
    fire = run.fire
    begun = None if run.offset_us is None else utc(run.zero_us + run.offset_us)
    return {
        "name": run.name,
        "logs": run.logs,
        "damage": run.damage,
        "warnings": [] if fire is None else fire.warnings,
        "begun": begun,
        "from_s": run.since_s(run.begin_us),
        "to_s": run.since_s(run.end_us),
        "mission_s": run.mission.of(run.zero_us) / 1e6,
        "rule": None if fire is None else fire.scenario.planner.rule,
        "scenario": None if fire is None else fire.scenario.name,
        "open_loop": fire is not None and fire.open_loop,
        "main_events": [each for each in events if each.is_main][:MAX_EVENTS],
        "events": events[:MAX_EVENTS],
        "more": max(len(events) - MAX_EVENTS, 0),
        "suffix": f"-{run.name}" if several else "",
    }


def _events(run: RunAnalysis) -> list[ReportLine]:
    """Return the lines of the list of events."""
    lines: list[ReportLine] = []
    for vehicle in run.vehicles.values():
        lines += _events_of(run, vehicle)
    fire = run.fire
    if fire is None:
        return lines

    def add(mission_us: int, name: str, text: str, is_main: bool) -> None:
        lines.append(ReportLine(run.since_s(run.log_us(mission_us)), name, text, is_main))

    if fire.reached_edge_us is not None:
        add(fire.reached_edge_us, "fire", fire.warnings[-1], True)
    for name, record in fire.record.vehicles.items():
        for at_us, link, cause in record.sortie.links.changes:
            add(at_us, name, f"messages are now sent over {link}: {LINK_CAUSES[cause]}", True)
        for at_us, lat, lon in record.reversals:
            add(at_us, name, f"planner decides to turn back at {lat:.5f}, {lon:.5f}", False)
        for drop in record.drops:
            text = f"drop {drop.number + 1} ordered at {drop.lat_deg:.6f}, {drop.lon_deg:.6f}: "
            add(drop.at_us, name, text + drop.outcome, drop.outcome != "done")
    for line in fire.log:
        add(line.at_us, line.vehicle, line.text, line.by_operator)
    for sent in fire.uploads:
        if sent.outcome not in ("accepted", "under way"):
            text = f"mission of {sent.items} items {sent.outcome} ({sent.why})"
            add(sent.at_us, sent.vehicle, text, True)
    return lines


def _events_of(run: RunAnalysis, vehicle: VehicleAnalysis) -> list[ReportLine]:
    flown = vehicle.flown
    lines: list[ReportLine] = []

    def add(at_us: int, text: str, is_main: bool) -> None:
        lines.append(ReportLine(run.since_s(at_us), vehicle.name, text, is_main))

    for at_us, mode, armed in flown.modes:
        add(at_us, f"{mode or 'unknown mode'}{', armed' if armed else ''}", False)
    for at_us, items in flown.missions:
        is_main = len(flown.missions) <= FEW_MISSIONS
        add(at_us, f"has a new mission of {len(items)} items", is_main)
    for turn in vehicle.turned_back:
        text = f"turns back: {turn.how} (at {turn.lat_deg:.5f}, {turn.lon_deg:.5f})"
        add(turn.at_us, text, True)
    for at_us, silent_us in flown.silences:
        add(at_us, f"link lost for {silent_us / 1e6:.1f} s", True)
    for each in vehicle.drops:
        if each.done is not None:
            off = "" if each.off_m is None else f", {each.off_m:.1f} m from its planned position"
            output = "gripper" if each.done.output == 0 else f"servo {each.done.output}"
            text = f"{output} opens at {each.done.lat_deg:.6f}, {each.done.lon_deg:.6f}{off}"
            add(each.done.at_us, text, True)
    for span in vehicle.differs:
        length_us = span.to_us - span.from_us
        text = f"flies against the planner's direction for {length_us / 1e6:.0f} s"
        add(span.from_us, text, length_us >= LONG_US)
    return lines
