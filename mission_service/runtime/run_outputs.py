"""Writes a run's fronts and tracks (GeoJSON), map (PNG), summary (JSON) and drops (CSV)."""

import csv
import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import (
    frame_around,
    save_map,
    set_title,
    start_map,
    status_line,
)
from firemodel.outputs.front_files import write_fronts
from firemodel.outputs.graticule import km_of
from firemodel.outputs.layer_legends import arrival_layer_of
from firemodel.spread.fire_scheme import Fire
from mission_service.config.scenario import Scenario
from mission_service.runtime.run_statistics import RunStatistics, VehicleStatistics
from mission_service.runtime.track import feature

FRONT_EVERY_S = 1800.0
DROP_COLUMNS = (
    *("at_s", "vehicle", "line", "drop", "outcome", "lat_deg", "lon_deg"),
    *("planned_lat_deg", "planned_lon_deg", "plan_hash"),
)
VEHICLE_COLOURS = (
    "#0b3c8c", "#7a0177", "#00695c", "#4e342e", "#6a1b9a", "#01579b", "#33691e", "#ad1457",
)  # fmt: skip
LEGEND_INSIDE = 4  # with more vehicles, the legend is drawn below the map


def front_times_s(end_s: float) -> list[float]:
    """Return the times in s of the fronts to write: every half hour of mission time and the end."""
    return [*np.arange(FRONT_EVERY_S, end_s - 1.0, FRONT_EVERY_S).tolist(), end_s]


def summary_of(scenario: Scenario, record: RunStatistics, fire: Fire) -> dict[str, Any]:
    """Return the figures of the run for ``summary.json``."""
    closest = record.closest
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "mission_time_s": record.at_us / 1e6,
        "burned_area_ha": fire.burned_ha,
        "telemetry": record.telemetry,
        "observations": record.observations,
        "sources": {
            name: {
                "kind": each.kind,
                "observations": each.observations,
                "not_used": each.not_used,
                "burned_cells": each.burned_cells,
                "unburned_cells": each.unburned_cells,
            }
            for name, each in sorted(record.sources.contributions.items())
        },
        "closest_pair_m": None if closest is None else round(closest.distance_m, 1),
        "separation_m": scenario.mission.separation_m,
        "requests": dict(sorted(record.requests.items())),
        "service_restarts": record.restarts,
        "alarms": dict(sorted(record.alarms.items())),
        "planner": {"rule": scenario.planner.rule, "alpha": scenario.planner.alpha},
        "vehicles": [
            {
                "name": name,
                **vehicle.sortie.figures(),
                "decisions": vehicle.decisions,
                "reversals": vehicle.reversal_count,
                "uploads": dict(sorted(vehicle.uploads.items())),
                "upload_reasons": dict(sorted(vehicle.upload_reasons.items())),
                "orders": dict(sorted(vehicle.orders.items())),
                **_burn_of(vehicle),
            }
            for name, vehicle in record.vehicles.items()
        ],
    }


def _burn_of(vehicle: VehicleStatistics) -> dict[str, Any]:
    """Return a vehicle's numbers of plans, lines and drops; empty without plans."""
    if not vehicle.plans:
        return {}
    flown = {drop.plan_hash for drop in vehicle.drops}
    return {
        "plans": len(vehicle.plans),
        "lines": len(flown),
        "drops": dict(sorted(Counter(drop.outcome for drop in vehicle.drops).items())),
    }


def write_drops(path: Path, record: RunStatistics) -> None:
    """Write the drops as CSV: planned position, actual position and outcome."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(DROP_COLUMNS)
        for name, vehicle in record.vehicles.items():
            for drop in vehicle.drops:
                plan = vehicle.plans[drop.plan_hash]
                planned = plan.drops[drop.number]
                rows.writerow(
                    [
                        *(drop.at_us / 1e6, name, plan.line, drop.number + 1, drop.outcome),
                        *(f"{drop.lat_deg:.7f}", f"{drop.lon_deg:.7f}"),
                        *(f"{planned.lat_deg:.7f}", f"{planned.lon_deg:.7f}", drop.plan_hash),
                    ]
                )


def tracks_geojson(record: RunStatistics) -> dict[str, Any]:
    """Return tracks as GeoJSON LineStrings, and reversals and drops as Points (lon, lat)."""
    features: list[dict[str, Any]] = []
    for name, vehicle in record.vehicles.items():
        if len(vehicle.track) > 1:
            times = {"from_s": vehicle.track[0][0] / 1e6, "to_s": vehicle.track[-1][0] / 1e6}
            line = [
                [round(lon, 7), round(lat, 7), round(altitude, 1)]
                for _, lat, lon, altitude in vehicle.track
            ]
            features.append(feature("LineString", line, vehicle=name, **times))
        features += [
            _point(lat, lon, vehicle=name, kind="reversal", at_s=at_us / 1e6)
            for at_us, lat, lon in vehicle.reversals
        ]
        for drop in vehicle.drops:
            shown = {"kind": "drop", "at_s": drop.at_us / 1e6, "outcome": drop.outcome}
            features.append(_point(drop.lat_deg, drop.lon_deg, vehicle=name, **shown))
    return {"type": "FeatureCollection", "features": features}


def _point(lat_deg: float, lon_deg: float, **properties: Any) -> dict[str, Any]:
    return feature("Point", [round(lon_deg, 7), round(lat_deg, 7)], **properties)


def write_outputs(
    out: Path, scenario: Scenario, record: RunStatistics, fire: Fire
) -> dict[str, Any]:
    """Write all results to the folder ``out``; returns the summary."""
    summary = summary_of(scenario, record, fire)
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    tracks = json.dumps(tracks_geojson(record))
    (out / "tracks.geojson").write_text(tracks + "\n", encoding="utf-8")
    times_s, is_burn = front_times_s(fire.time_s), scenario.burn_flown is not None
    path, named = out / "perimeters.geojson", (scenario.name, scenario.time_zero)
    write_fronts(path, fire, times_s, *named, prescribed=is_burn)
    if is_burn:
        write_drops(out / "drops.csv", record)
    draw_map(out / "map.png", scenario, record, fire)
    return summary


def draw_map(path: Path, scenario: Scenario, record: RunStatistics, fire: Fire) -> None:
    """Draw a map of the fire with tracks, reversals and drops."""
    from matplotlib.lines import Line2D

    land = fire.landscape
    flown = [point[1:3] for vehicle in record.vehicles.values() for point in vehicle.track]
    flown_xy_m = np.stack(land.xy_of_lat_lon(*np.array(flown).T), axis=1) if flown else None
    arrival_s = fire.burned_arrival_s()
    frame = frame_around(land, arrival_s, flown_xy_m)
    layer = arrival_layer_of(fire, scenario.time_zero)
    figure, axes = start_map(land, arrival_s, frame, layer=layer)
    handles = []
    for colour, (name, vehicle) in zip(
        VEHICLE_COLOURS * len(record.vehicles), record.vehicles.items(), strict=False
    ):
        _draw_vehicle(axes, vehicle, land, colour)
        label = f"{name}: track, {vehicle.reversal_count} reversals"
        if vehicle.plans:
            label = f"{name}: {len(vehicle.drops)} drops"
        elif vehicle.orders:
            label = name
        handles.append(Line2D([], [], color=colour, marker="o", markersize=4, label=label))
    facts = status_line(fire, scenario.time_zero)
    set_title(axes, f"{scenario.name}: planner {scenario.planner.rule}", facts)
    below = {"ncols": 4, "loc": "upper center", "bbox_to_anchor": (0.5, -0.07)}
    placement = below if len(handles) > LEGEND_INSIDE else {"loc": "upper left"}
    axes.legend(handles=handles, **placement)
    save_map(figure, path)


def _draw_vehicle(axes: Any, vehicle: VehicleStatistics, land: Landscape, colour: str) -> None:
    from matplotlib.patheffects import withStroke

    # The halo makes lines visible even on dark red.
    halo = withStroke(linewidth=2.0, foreground="white", alpha=0.5)
    dots = {"linestyle": "", "marker": "o"}
    for points, style in (
        ([point[1:3] for point in vehicle.track], {"linewidth": 0.8, "path_effects": [halo]}),
        ([point[1:3] for point in vehicle.reversals], dots),
        ([(each.lat_deg, each.lon_deg) for each in vehicle.drops], dots),
    ):
        if points:
            lat, lon = np.array(points).T
            axes.plot(
                *km_of(land, lat, lon),
                color=colour,
                markersize=3.5,
                markeredgecolor="white",
                markeredgewidth=0.5,
                **style,
            )
