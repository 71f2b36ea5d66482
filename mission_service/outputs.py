"""What a run leaves in its folder: GeoJSON of fronts and tracks, a PNG map, a summary."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from firemodel.devs8 import Devs8Fire
from firemodel.landscape import Landscape
from firemodel.writers import write_perimeters
from mission_service.config import Scenario
from mission_service.record import Record, VehicleRecord

FRONT_EVERY_S = 1800.0
VEHICLE_COLOURS = ("#0b3c8c", "#7a0177", "#00695c", "#4e342e")


def front_times_s(end_s: float) -> list[float]:
    """Every half hour of mission time, and the end."""
    return [*np.arange(FRONT_EVERY_S, end_s - 1.0, FRONT_EVERY_S).tolist(), end_s]


def summary_of(scenario: Scenario, record: Record, fire: Devs8Fire) -> dict[str, Any]:
    """The run in figures."""
    burned = int(np.count_nonzero(fire.arrival_time_s <= fire.time_s))
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "mission_time_s": record.at_us / 1e6,
        "burned_area_ha": burned * fire.landscape.cell_size_m**2 / 1e4,
        "telemetry": record.telemetry,
        "observations": record.observations,
        "planner": {"rule": scenario.planner.rule, "alpha": scenario.planner.alpha},
        "vehicles": [
            {
                "name": name,
                "decisions": vehicle.decisions,
                "reversals": len(vehicle.reversals),
                "uploads": dict(sorted(vehicle.uploads.items())),
                "upload_reasons": dict(sorted(vehicle.upload_reasons.items())),
            }
            for name, vehicle in record.vehicles.items()
        ],
    }


def tracks_geojson(record: Record) -> dict[str, Any]:
    """Tracks as LineStrings and reversals as Points (RFC 7946: longitude, latitude, height)."""
    features: list[dict[str, Any]] = []
    for name, vehicle in record.vehicles.items():
        if len(vehicle.track) > 1:
            features.append(
                {
                    "type": "Feature",
                    "properties": {
                        "vehicle": name,
                        "from_s": vehicle.track[0][0] / 1e6,
                        "to_s": vehicle.track[-1][0] / 1e6,
                    },
                    "geometry": {
                        "type": "LineString",
                        "coordinates": [
                            [round(lon, 7), round(lat, 7), round(altitude, 1)]
                            for _, lat, lon, altitude in vehicle.track
                        ],
                    },
                }
            )
        features += [
            {
                "type": "Feature",
                "properties": {"vehicle": name, "kind": "reversal", "at_s": at_us / 1e6},
                "geometry": {"type": "Point", "coordinates": [round(lon, 7), round(lat, 7)]},
            }
            for at_us, lat, lon in vehicle.reversals
        ]
    return {"type": "FeatureCollection", "features": features}


def write_outputs(out: Path, scenario: Scenario, record: Record, fire: Devs8Fire) -> dict[str, Any]:
    """Write everything into ``out``; returns the summary."""
    summary = summary_of(scenario, record, fire)
    (out / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    tracks = json.dumps(tracks_geojson(record))
    (out / "tracks.geojson").write_text(tracks + "\n", encoding="utf-8")
    write_perimeters(
        out / "perimeters.geojson",
        fire.arrival_time_s,
        fire.landscape,
        front_times_s(fire.time_s),
    )
    draw_map(out / "map.png", scenario, record, fire)
    return summary


def draw_map(path: Path, scenario: Scenario, record: Record, fire: Devs8Fire) -> None:
    """A north-up map: hillshade and fuel, the fire by hour of arrival, tracks and reversals."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import LightSource
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    land = fire.landscape
    extent = _extent_km(land)
    figure = Figure(figsize=(9.5, 9), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    north, east = 2.0 * land.gradient  # exaggerated
    normals = np.dstack([-east, -north, np.ones(land.shape)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    shade = LightSource(315, 45).shade_normals(normals)
    axes.imshow(shade, cmap="gray", extent=extent, vmin=-0.4, vmax=1.1, interpolation="bilinear")
    fuel = np.ma.masked_where(land.fuel_model > 90, land.fuel_model)
    axes.imshow(fuel, cmap="YlGn_r", extent=extent, alpha=0.25, interpolation="nearest")
    hours = np.where(fire.arrival_time_s <= fire.time_s, fire.arrival_time_s / 3600.0, np.nan)
    burned = axes.imshow(
        np.ma.masked_invalid(hours), cmap="autumn_r", extent=extent, alpha=0.75, vmin=0.0
    )
    figure.colorbar(burned, ax=axes, label="time of arrival of the fire (h)", shrink=0.7)
    handles = []
    for colour, (name, vehicle) in zip(
        VEHICLE_COLOURS * len(record.vehicles), record.vehicles.items(), strict=False
    ):
        _draw_vehicle(axes, vehicle, land, colour)
        label = f"{name}: track, {len(vehicle.reversals)} reversals"
        handles.append(Line2D([], [], color=colour, marker="o", markersize=4, label=label))
    frame = _frame_km(land, record, fire)
    axes.set(
        xlabel="east of the west edge (km)",
        ylabel="north of the south edge (km)",
        xlim=frame[:2],
        ylim=frame[2:],
        title=(
            f"{scenario.name}: {scenario.planner.rule} rule, α = {scenario.planner.alpha:g}, "
            f"{record.at_us / 3.6e9:.1f} h"
        ),
    )
    axes.legend(handles=handles, loc="upper left")
    figure.savefig(path)


def _extent_km(land: Landscape) -> tuple[float, float, float, float]:
    rows, cols = land.shape
    return 0.0, cols * land.cell_size_m / 1e3, 0.0, rows * land.cell_size_m / 1e3


def _frame_km(
    land: Landscape, record: Record, fire: Devs8Fire
) -> tuple[float, float, float, float]:
    """The part of the landscape where something happened, square, with a margin."""
    rows, cols = np.nonzero(fire.arrival_time_s <= fire.time_s)
    x_m, y_m = land.xy_of(rows, cols)
    flown = [point[1:3] for vehicle in record.vehicles.values() for point in vehicle.track]
    if flown:
        flown_x_m, flown_y_m = land.xy_of_lat_lon(*np.array(flown).T)
        x_m, y_m = np.concatenate([x_m, flown_x_m]), np.concatenate([y_m, flown_y_m])
    south_m = land.north_m - land.shape[0] * land.cell_size_m
    east_km, north_km = (x_m - land.west_m) / 1e3, (y_m - south_m) / 1e3
    half = 0.55 * max(np.ptp(east_km), np.ptp(north_km), 1.0)
    east, north = (east_km.max() + east_km.min()) / 2, (north_km.max() + north_km.min()) / 2
    return east - half, east + half, north - half, north + half


def _draw_vehicle(axes: Any, vehicle: VehicleRecord, land: Landscape, colour: str) -> None:
    south_m = land.north_m - land.shape[0] * land.cell_size_m
    for points, style in (
        ([point[1:3] for point in vehicle.track], {"linewidth": 0.7, "alpha": 0.8}),
        ([point[1:3] for point in vehicle.reversals], {"linestyle": "", "marker": "o"}),
    ):
        if points:
            lat, lon = np.array(points).T
            x_m, y_m = land.xy_of_lat_lon(lat, lon)
            axes.plot(
                (x_m - land.west_m) / 1e3,
                (y_m - south_m) / 1e3,
                color=colour,
                markersize=3.5,
                markeredgecolor="white",
                markeredgewidth=0.5,
                **style,
            )
