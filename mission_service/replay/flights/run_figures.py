"""Computes the figures of a run, for JSON and for a table that compares runs."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mission_service.ground_distance import distance_m
from mission_service.replay.flights.fire_analysis import FireAnalysis, circles_one_front
from mission_service.replay.flights.run_analysis import RunAnalysis, VehicleAnalysis

Row = tuple[str, str, Callable[[dict[str, Any]], Any]]  # label, unit, from the figures

FIRE_ROWS: tuple[Row, ...] = (
    ("burned at the end", "ha", lambda of: of["area_ha"]),
    ("front observed at the end, by bearing", "%", lambda of: of["seen_pct"]),
    ("front observed within ten minutes, mean", "%", lambda of: of["recent_pct"]),
    ("age of the observed front, mean", "s", lambda of: of["age_mean_s"]),
    ("age of the observed front, maximum", "s", lambda of: of["age_worst_s"]),
    ("time between visits to a place, median", "s", lambda of: of["revisit_median_s"]),
    ("time between visits to a place, 95th percentile", "s", lambda of: of["revisit_p95_s"]),
)
VEHICLE_ROWS: tuple[Row, ...] = (
    ("autopilot", "", lambda of: of["autopilot"]),
    ("distance flown", "km", lambda of: round(of["flown_m"] / 1e3, 2)),
    ("maximum speed", "m/s", lambda of: of["max_speed_m_s"]),
    ("maximum height above the start", "m", lambda of: of["highest_above_start_m"]),
    ("minimum height above terrain, in the air", "m", lambda of: of["lowest_above_terrain_m"]),
    ("reversals flown", "", lambda of: len(of["turned_back"])),
    ("reversals decided by the planner", "", lambda of: of["decided_reversals"]),
    ("flown against the planner's direction", "s", lambda of: of["differs_s"]),
    ("distance error, mean", "m", lambda of: of["distance_error_mean_m"]),
    ("distance error, maximum over bearings", "m", lambda of: of["distance_error_worst_m"]),
    ("missions loaded", "", lambda of: len(of["missions"])),
    ("missions replaced, items not in the log", "", lambda of: of["missions_replaced"] or None),
    ("missions sent, accepted", "", lambda of: _of_two(of, "missions_sent", "accepted")),
    ("time from upload to acceptance, median", "s", lambda of: of["mission_latency_median_s"]),
    ("time from upload to acceptance, maximum", "s", lambda of: of["mission_latency_worst_s"]),
    ("positions", "per s", lambda of: of["positions_hz"]),
    ("longest gap between positions", "s", lambda of: of["longest_gap_s"]),
    ("link losses", "", lambda of: of["links_lost"]),
    ("changes of the active link", "", lambda of: of["link_switches"]),
    ("frames lost on each link, mean", "%", lambda of: _loss_of(of["links"])),
    ("drops planned, done", "", lambda of: _of_two(of, "drops_planned", "drops_done")),
    (
        "distance of drops from their planned positions, mean",
        "m",
        lambda of: of["drops_off_mean_m"],
    ),
)


def _of_two(of: dict[str, Any], one: str, other: str) -> str | None:
    return None if of[one] is None else f"{of[one]}, {of[other]}"


def _loss_of(links: list[dict[str, Any]]) -> str | None:
    """Return the mean loss of each link in percent; None if no link was reported."""
    words = [
        f"{each['link']}: {'unknown' if each['mean_loss_pct'] is None else each['mean_loss_pct']}"
        for each in links
    ]
    return ", ".join(words) or None


def figures_of(run: RunAnalysis) -> dict[str, Any]:
    """Return all figures of a run; times are in s since the flight began, None is unknown."""
    return {
        "name": run.name,
        "logs": run.logs,
        "damage": run.damage,
        "duration_s": round((run.end_us - run.begin_us) / 1e6, 1),
        "fire": None if run.fire is None else _fire(run.fire),
        "vehicles": [_vehicle(run, each) for each in run.vehicles.values()],
    }


def _fire(fire: FireAnalysis) -> dict[str, Any]:
    samples, closest = fire.samples, fire.record.closest
    revisits_s = np.array(fire.revisits_s)
    return {
        "scenario": fire.scenario.name,
        "rule": fire.scenario.planner.rule,
        "area_ha": round(fire.area_ha, 2),
        "seen_pct": round(100.0 * samples[-1].seen_share, 1) if samples else None,
        "recent_pct": _mean([100.0 * each.recent_share for each in samples]),
        "age_mean_s": _mean([each.age_mean_s for each in samples]),
        "age_worst_s": _worst([each.age_worst_s for each in samples]),
        "revisit_median_s": round(float(np.median(revisits_s)), 1) if revisits_s.size else None,
        "revisit_p95_s": (
            round(float(np.percentile(revisits_s, 95)), 1) if revisits_s.size else None
        ),
        "closest_pair_m": None if closest is None else round(closest.distance_m, 1),
        "warnings": fire.warnings,
    }


def _vehicle(run: RunAnalysis, vehicle: VehicleAnalysis) -> dict[str, Any]:
    fire, name = run.fire, vehicle.name
    flown = vehicle.flown.figures()
    errors = [] if fire is None else fire.errors_m.get(name, [])
    on_front = fire is not None and fire.follows_front
    decided = fire.record.vehicles[name].reversal_count if fire is not None and on_front else None
    heights_m = above_terrain_m(vehicle)
    differs_us = sum(span.to_us - span.from_us for span in vehicle.differs)
    has_direction = fire is not None and circles_one_front(fire.scenario)
    return {
        **flown,
        "positions_hz": round(flown["positions"] / max(flown["duration_s"], 1e-3), 2),
        "lowest_above_terrain_m": _lowest(heights_m),
        "turned_back": [
            {
                "at_s": round(run.since_s(each.at_us), 1),
                "lat_deg": round(each.lat_deg, 7),
                "lon_deg": round(each.lon_deg, 7),
                "how": each.how,
            }
            for each in vehicle.turned_back
        ],
        "decided_reversals": decided,
        "differs": [
            [round(run.since_s(span.from_us), 1), round(run.since_s(span.to_us), 1)]
            for span in vehicle.differs
        ],
        "differs_s": round(differs_us / 1e6, 1) if has_direction else None,
        "distance_error_mean_m": _mean([mean for _, mean, _ in errors]),
        "distance_error_worst_m": _worst([worst for _, _, worst in errors]),
        **_links(fire, name),
        **_missions(fire, name),
        **_drops(fire, vehicle),
    }


def _links(fire: FireAnalysis | None, name: str) -> dict[str, Any]:
    """Return the figures of the links; autopilot logs contain none."""
    statistics = None if fire is None else fire.record.vehicles.get(name)
    links = [] if statistics is None else statistics.sortie.links.of_links()
    switches = statistics.sortie.links.switches.total() if statistics and links else None
    return {"links": links, "link_switches": switches}


def above_terrain_m(vehicle: VehicleAnalysis) -> Any:
    """Return the height above terrain along the track, or None without a landscape.

    The height is NaN for points off the landscape.
    """
    if vehicle.terrain_amsl_m is None:
        return None
    return vehicle.track[:, 3] - vehicle.terrain_amsl_m


def _lowest(heights_m: Any) -> float | None:
    """Return the minimum height between the first and last point above half the maximum height."""
    if heights_m is None or not np.isfinite(heights_m).any():
        return None
    # On the ground, errors of the landscape may place the terrain above the vehicle.
    max_m = float(np.nanmax(heights_m))
    up = np.flatnonzero(heights_m >= min(max_m, max_m / 2.0))
    return round(float(np.nanmin(heights_m[up[0] : up[-1] + 1])), 1)


def _missions(fire: FireAnalysis | None, name: str) -> dict[str, Any]:
    """Return the numbers of sent and accepted missions, and the times from upload to acceptance.

    The values are None in an open-loop replay.
    """
    if fire is None or fire.open_loop:
        sent, latencies_s, accepted = None, [], None
    else:
        uploads = [each for each in fire.uploads if each.vehicle == name]
        done = [each for each in uploads if each.outcome == "accepted"]
        sent, accepted = len(uploads), len(done)
        latencies_s = [
            (each.finished_us - each.at_us) / 1e6 for each in done if each.finished_us is not None
        ]
    return {
        "missions_sent": sent,
        "accepted": accepted,
        "mission_latency_median_s": _round(np.median(latencies_s)) if latencies_s else None,
        "mission_latency_worst_s": _worst(latencies_s),
    }


def _drops(fire: FireAnalysis | None, vehicle: VehicleAnalysis) -> dict[str, Any]:
    """Count the drops: in a burn from its plans, in other flights from missions and outputs."""
    record = None if fire is None else fire.record.vehicles[vehicle.name]
    if record is not None and record.plans:
        flown = {drop.plan_hash for drop in record.drops}
        planned_count = sum(len(record.plans[key].drops) for key in flown)
        done = [drop for drop in record.drops if drop.outcome == "done"]
        off_m = []
        for drop in done:
            place = record.plans[drop.plan_hash].drops[drop.number]
            off_m.append(distance_m((place.lat_deg, place.lon_deg), drop.lat_lon))
        return _counted(planned_count, len(done), off_m)
    pairs = vehicle.drops
    if not pairs:
        return _counted(None, None, [])
    planned_count = sum(each.planned is not None for each in pairs)
    done_count = sum(each.done is not None for each in pairs)
    return _counted(planned_count, done_count, [each.off_m for each in pairs if each.off_m])


def _counted(planned: int | None, done: int | None, off_m: Sequence[float]) -> dict[str, Any]:
    return {"drops_planned": planned, "drops_done": done, "drops_off_mean_m": _mean(off_m)}


def _mean(values: Sequence[float]) -> float | None:
    return _round(np.mean(values)) if len(values) else None


def _worst(values: Sequence[float]) -> float | None:
    return _round(max(values)) if len(values) else None


def _round(value: Any) -> float:
    return round(float(value), 2)


def table(runs: Sequence[dict[str, Any]]) -> list[tuple[str, list[tuple[str, str, list[Any]]]]]:
    """Return a table of runs: sections of rows (label, unit, a value for each run).

    Rows without any value are omitted.
    """
    flight: list[tuple[str, str, list[Any]]] = [
        ("duration", "s", [run["duration_s"] for run in runs]),
    ]
    fires = [run["fire"] for run in runs]
    flight += [("rule", "", [None if fire is None else fire["rule"] for fire in fires])]
    flight += _rows(FIRE_ROWS, fires)
    if any(fire is not None and fire["closest_pair_m"] for fire in fires):
        pairs = [None if fire is None else fire["closest_pair_m"] for fire in fires]
        flight.append(("closest two vehicles", "m", pairs))
    sections = [("Flight and fire", [row for row in flight if any(v is not None for v in row[2])])]
    names = list(dict.fromkeys(each["name"] for run in runs for each in run["vehicles"]))
    for name in names:
        found = [
            next((each for each in run["vehicles"] if each["name"] == name), None) for run in runs
        ]
        sections.append((name, _rows(VEHICLE_ROWS, found)))
    return sections


def in_text(runs: Sequence[dict[str, Any]]) -> str:
    """Return the table as text, with the damaged parts of logs and the vehicles' reversals."""
    lines = [f"DAMAGED: {each}" for run in runs for each in run["damage"]]
    fires = [run["fire"] for run in runs if run["fire"] is not None]
    lines += [f"Warning: {each}" for fire in fires for each in fire["warnings"]]
    for name, rows in table(runs):
        lines.append(name)
        for label, unit, values in rows:
            shown = ("–" if value is None else f"{value} {unit}".rstrip() for value in values)
            lines.append(f"  {label:<48} {'  '.join(f'{each:>16}' for each in shown)}")
    for run in runs:
        for vehicle in run["vehicles"]:
            lines += [
                f"{vehicle['name']} turned back at {turn['at_s']:.1f} s: {turn['how']}"
                for turn in vehicle["turned_back"]
            ]
    return "\n".join(lines)


def _rows(rows: Sequence[Row], of: Sequence[Any]) -> list[tuple[str, str, list[Any]]]:
    found = [
        (label, unit, [None if each is None else value(each) for each in of])
        for label, unit, value in rows
    ]
    return [row for row in found if any(value is not None for value in row[2])]
