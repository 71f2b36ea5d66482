"""Finds keys of version 0.1 in scenario files, so that an error can state the present key."""

from collections.abc import Iterator, Mapping
from typing import Any

# By table; ``[[vehicles]]`` is a list of tables.
RENAMED: Mapping[str, Mapping[str, str]] = {
    "planner": {
        "worst_age_s": "max_revisit_s",
        "unseen_advance_m": "max_unseen_advance_m",
        "least_gain_cells": "min_gain_cells",
    },
    "mission": {"lead_m": "lookahead_m", "least_upload_interval_s": "min_upload_interval_s"},
    "formation": {"apart_by_height_m": "vertical_separation_m", "talks": "peer_messaging"},
    "burn": {
        "most_drops_per_min": "max_drops_per_min",
        "miss_m": "max_miss_m",
        "crew_silent_s": "approver_timeout_s",
        "least_battery_pct": "min_battery_pct",
    },
    "vehicles": {
        "least_airspeed_m_s": "min_airspeed_m_s",
        "most_airspeed_m_s": "max_airspeed_m_s",
        "least_leg_m": "min_leg_m",
    },
    "service": {"keep": "journal"},
}
RENAMED_RULES: Mapping[str, str] = {"damped": "islam_hu_damped", "literal": "islam_hu"}


def renamed_keys(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield the keys of version 0.1 in a scenario, each as a line with the present key.

    Args:
        data: The scenario as parsed from TOML.

    Yields:
        ``TABLE.OLD: was renamed in version 0.2; write NEW``.
    """
    for table, names in RENAMED.items():
        found = data.get(table)
        for section in found if isinstance(found, list) else [found]:
            if not isinstance(section, dict):
                continue
            for old in sorted(names.keys() & section.keys()):
                yield f"{table}.{old}: was renamed in version 0.2; write {names[old]}"
    planner = data.get("planner")
    rule = planner.get("rule") if isinstance(planner, dict) else None
    if isinstance(rule, str) and rule in RENAMED_RULES:
        yield f'planner.rule = "{rule}": was renamed in version 0.2; write "{RENAMED_RULES[rule]}"'
