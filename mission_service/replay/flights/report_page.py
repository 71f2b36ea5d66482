"""Writes the report of runs as one self-contained page, and its figures as files."""

import base64
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from mission_service.replay.flights import pictures
from mission_service.replay.flights.run_analysis import RunAnalysis, VehicleAnalysis
from mission_service.replay.flights.run_figures import figures_of, table
from mission_service.replay.flights.utc_time import utc

LONG_US = 30_000_000  # a shorter flight against the planner's direction is part of a turn
FEW_MISSIONS = 8  # up to this number each mission has a line
MAX_HAPPENED = 400  # lines; for a long flight the page states the number left out


class Happened(NamedTuple):
    """A line of the report's list of events, in seconds since the flight began."""

    at_s: float
    vehicle: str
    text: str
    matters: bool = False


def write_report(out: Path, runs: Sequence[RunAnalysis]) -> list[str]:
    """Write report.html, its pictures and figures.json into ``out``; returns the files' names.

    The first run is reported in full; the others are columns of the table and curves in figures.
    """
    figures = [figures_of(run) for run in runs]
    images: dict[str, bytes] = {}
    for name, drawn in _drawn(runs):  # one by one: a figure takes megabytes
        images |= {} if drawn is None else {name: pictures.png(drawn)}
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
    told = [_told(run, len(runs) > 1) for run in runs]
    page = environment.get_template("report.html")
    return page.render(runs=told, figures=figures, table=table(figures), images=embedded)


def _told(run: RunAnalysis, several: bool) -> dict[str, Any]:
    happened = sorted(_happened(run))
    fire = run.fire
    begun = None if run.offset_us is None else utc(run.zero_us + run.offset_us)
    return {
        "name": run.name,
        "logs": run.logs,
        "damage": run.damage,
        "begun": begun,
        "from_s": run.since_s(run.begin_us),
        "to_s": run.since_s(run.end_us),
        "mission_s": run.mission.of(run.zero_us) / 1e6,
        "rule": None if fire is None else fire.scenario.planner.rule,
        "scenario": None if fire is None else fire.scenario.name,
        "open_loop": fire is not None and fire.open_loop,
        "headlines": [each for each in happened if each.matters][:MAX_HAPPENED],
        "happened": happened[:MAX_HAPPENED],
        "more": max(len(happened) - MAX_HAPPENED, 0),
        "suffix": f"-{run.name}" if several else "",
    }


def _happened(run: RunAnalysis) -> list[Happened]:
    """Return the lines of the list of events, in order of time."""
    lines: list[Happened] = []
    for vehicle in run.vehicles.values():
        lines += _of_vehicle(run, vehicle)
    fire = run.fire
    if fire is None:
        return lines
    for name, record in fire.record.vehicles.items():
        for at_us, lat, lon in record.reversals:
            text = f"planner decides to turn back at {lat:.5f}, {lon:.5f}"
            lines.append(Happened(run.since_s(run.log_us(at_us)), name, text))
        lines += [
            Happened(
                run.since_s(run.log_us(drop.at_us)),
                name,
                f"drop {drop.number + 1} ordered at {drop.lat_deg:.6f}, {drop.lon_deg:.6f}: "
                f"{drop.outcome}",
                drop.outcome != "done",
            )
            for drop in record.drops
        ]
    for sent in fire.uploads:
        if sent.outcome not in ("accepted", "under way"):
            at_s = run.since_s(run.log_us(sent.at_us))
            text = f"mission of {sent.items} items {sent.outcome} ({sent.why})"
            lines.append(Happened(at_s, sent.vehicle, text, True))
    return lines


def _of_vehicle(run: RunAnalysis, vehicle: VehicleAnalysis) -> list[Happened]:
    flown, name = vehicle.flown, vehicle.name
    lines = [
        Happened(run.since_s(at_us), name, f"{mode or 'unknown mode'}{', armed' if armed else ''}")
        for at_us, mode, armed in flown.modes
    ]
    lines += [
        Happened(
            run.since_s(at_us),
            name,
            f"has a new mission of {len(items)} items",
            len(flown.missions) <= FEW_MISSIONS,
        )
        for at_us, items in flown.missions
    ]
    lines += [
        Happened(
            run.since_s(turn.at_us),
            name,
            f"turns back: {turn.how} (at {turn.lat_deg:.5f}, {turn.lon_deg:.5f})",
            True,
        )
        for turn in vehicle.turned_back
    ]
    lines += [
        Happened(run.since_s(at_us), name, f"link lost for {silent_us / 1e6:.1f} s", True)
        for at_us, silent_us in flown.silences
    ]
    for each in vehicle.drops:
        if each.done is not None:
            off = "" if each.off_m is None else f", {each.off_m:.1f} m from its planned place"
            what = "gripper" if each.done.output == 0 else f"servo {each.done.output}"
            text = f"{what} opens at {each.done.lat_deg:.6f}, {each.done.lon_deg:.6f}{off}"
            lines.append(Happened(run.since_s(each.done.at_us), name, text, True))
    lines += [
        Happened(
            run.since_s(span.from_us),
            name,
            f"flies against the planner's direction for {(span.to_us - span.from_us) / 1e6:.0f} s",
            span.to_us - span.from_us >= LONG_US,
        )
        for span in vehicle.differs
    ]
    return lines
