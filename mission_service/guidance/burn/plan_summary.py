"""Describes plans and the state of a burn for crews, in figures and text. Pure."""

from typing import Any

from mission_service.errors import RequestError
from mission_service.ground_distance import M_PER_FT
from mission_service.ignition_plan import IgnitionPlan
from mission_service.mission_time import clock_text


def in_feet(metres: float) -> int:
    """Convert metres to whole feet."""
    return round(metres / M_PER_FT)


def describe_plan(plan: IgnitionPlan, name: str) -> list[str]:
    """Describe a plan for its approver, with one topic per line."""
    skipped = f"; {len(plan.skipped)} places skipped as unsafe" if plan.skipped else ""
    altitudes_m = [point.altitude_amsl_m for point in plan.path] or [float("nan")]
    low_m, high_m, margin_m = min(altitudes_m), max(altitudes_m), plan.distance_margin_m
    drop_m, safe_m = plan.drop_height_m, plan.safe_height_m
    return [
        f"plan      {name}",
        f"line      {plan.line}, {plan.vehicle}: {len(plan.drops)} drops{skipped}",
        f"time      {plan.duration_s:.0f} s from mission time {clock_text(plan.begin_us)}; "
        f"to be approved by {clock_text(plan.valid_until_us)}",
        f"drops at  {drop_m:.0f} m ({in_feet(drop_m)} ft) above the ground, "
        f"{plan.speed_m_s:g} m/s ({plan.speed_m_s * 2.23694:.0f} mph)",
        f"altitude  {low_m:.0f} to {high_m:.0f} m ({in_feet(low_m)} to {in_feet(high_m)} ft) MSL; "
        f"safe height {safe_m:.0f} m ({in_feet(safe_m)} ft) above the ground",
        f"wind      {plan.wind_speed_m_s:.1f} m/s ({plan.wind_speed_m_s * 2.23694:.0f} mph) from "
        f"{plan.wind_from_deg:.0f}°",
        f"margins   fire at least {plan.min_time_margin_s:.0f} s away "
        f"(required {plan.time_margin_s:.0f} s and {margin_m:.0f} m, {in_feet(margin_m)} ft)",
        f"spheres   {plan.spheres_left} left after the line",
    ]


def describe_status(status: dict[str, Any]) -> list[str]:
    """Describe the state of a burn for a control socket reply, with one topic per line.

    Raises RequestError if the run is not a burn.
    """
    if "plans" not in status:
        raise RequestError("this run is not a burn")
    phase, at_us = status["guidance"]["phase"], round(status["at_s"] * 1e6)
    lines = [f"{status['scenario']}  mission time {clock_text(at_us)}, {phase}"]
    open_items = status["open_items"]
    state = f"{len(open_items)} open" if open_items else f"all {len(status['items'])} GO"
    lines.append(f"GO list   {state}")
    lines += [f"          open: {item}" for item in open_items]
    for name, vehicle in status["vehicles"].items():
        lines.append(f"{name:<9} {_describe_vehicle(vehicle)}")
    for entry in status["plans"]:
        approved = entry["approved"]
        state = (
            f"approved by {approved['by']} at {approved['station']}"
            if approved
            else f"not approved: {entry['why_not']}"
        )
        figures = f"line {entry['plan']['line']}, {len(entry['plan']['drops'])} drops"
        ordered = f", {len(entry['ordered'])} ordered" if entry["ordered"] else ""
        lines.append(f"plan      {entry['plan_hash'][:12]}  {figures}{ordered}; {state}")
    if not status["plans"]:
        lines.append("plan      none proposed")
    return lines


def _describe_vehicle(vehicle: dict[str, Any]) -> str:
    battery, position, height = vehicle["battery_pct"], vehicle["position"], "no position"
    if position is not None:
        height_m = position["altitude_relative_m"]
        height = f"{height_m:.0f} m ({in_feet(height_m)} ft) above home"
    return ", ".join(
        [
            "link" if vehicle["linked"] else "NO LINK",
            f"{'armed' if vehicle['armed'] else 'disarmed'} in mode {vehicle['mode'] or 'unknown'}",
            height,
            "fix" if vehicle["fix_good"] else "NO FIX",
            "battery unknown" if battery is None else f"battery {battery:.0f} %",
            f"{vehicle['spheres_left']} spheres",
        ]
    )
