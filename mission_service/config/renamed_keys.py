"""Earlier keys and values of scenario files, for errors that state the current key or value."""

from collections.abc import Iterator, Mapping
from typing import Any

# Renamed keys by table; ``[[vehicles]]`` is a list of tables.
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
# Renamed values by table and key.
RENAMED_VALUES: Mapping[tuple[str, str], Mapping[str, str]] = {
    ("planner", "rule"): {"damped": "islam_hu_damped", "literal": "islam_hu"},
    ("landscape", "source"): {"geotiff": "files"},
}


def renamed_keys(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each earlier key or value in a scenario, with the current key or value.

    Args:
        data: The content of the scenario's TOML file.

    Yields:
        ``TABLE.OLD: was renamed in version 0.2; write NEW``, or a similar line for a value.
    """
    for table, names in RENAMED.items():
        found = data.get(table)
        sections = {table: found}
        if isinstance(found, list):
            sections = {f"{table}.{place}": section for place, section in enumerate(found)}
        for where, section in sections.items():
            if not isinstance(section, dict):
                continue
            for old in sorted(names.keys() & section.keys()):
                yield f"{where}.{old}: was renamed in version 0.2; write {names[old]}"
    for (table, key), values in RENAMED_VALUES.items():
        section = data.get(table)
        value = section.get(key) if isinstance(section, dict) else None
        if isinstance(value, str) and value in values:
            yield f'{table}.{key} = "{value}": was renamed; write "{values[value]}"'
