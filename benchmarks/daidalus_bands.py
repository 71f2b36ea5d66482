"""Compares altitude bands with the gold output of NASA's DAIDALUS.

``FOLDER`` is a copy of the public repository nasa/daidalus. A band is a range of new altitudes with
the same highest violated level, on the way or afterwards (NEAR: 3, MID: 2, NONE: 0). The gold
output contains the bands of one state for each of several configurations, and of the scenario H1
every second. In the scenario, the bands are filtered (2 of the last 4 seconds) as in DAIDALUS. The
comparison ends at the first recovery band: recovery bands are not implemented.
"""

import re
from collections import deque
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import click

from benchmarks.daidalus_alerts import (
    CYLINDER,
    M_S_PER_FPM,
    State,
    encounter_of,
    example_states,
    scenario_of,
)
from mission_service.ground_distance import M_PER_FT
from mission_service.surveillance.alerting import ALERT_SETS, AlertSet
from mission_service.surveillance.altitude_change import AltitudeChange, VerticalLimits, violates
from mission_service.surveillance.well_clear import violation

MIN_FT, MAX_FT, STEP_FT = 100, 50_000, 100
ALTITUDES_FT = range(MIN_FT, MAX_FT + 1, STEP_FT)
KINEMATIC = VerticalLimits(500.0 * M_S_PER_FPM, 0.25 * 9.80665)
INSTANT = VerticalLimits(0.0, 0.0)
REGIONS = {"NONE": 0, "MID": 2, "NEAR": 3}


class Band(NamedTuple):
    """A range of altitudes and the level that is violated in it; 0: none."""

    low_ft: float
    high_ft: float
    level: int


def levels_of(own: State, other: State, alerts: AlertSet, limits: VerticalLimits) -> list[int]:
    """Return the highest level that each of ``ALTITUDES_FT`` violates (CYLINDER: level 3)."""
    encounter = encounter_of(own, other)
    found = [0] * len(ALTITUDES_FT)
    numbered = [(REGIONS["MID"], alerts.levels[-2])] if len(alerts.levels) > 1 else []
    for number, level in [*numbered, (REGIONS["NEAR"], alerts.levels[-1])]:
        now = violation(encounter, level.volume, alerts.lookahead_s)
        is_conflict = now is not None and now[0] < level.alerting_s
        horizon_s = alerts.lookahead_s if is_conflict else level.alerting_s
        for i, altitude_ft in enumerate(ALTITUDES_FT):
            change = AltitudeChange(altitude_ft * M_PER_FT - own.up_m, own.up_m_s, limits)
            ends_s = (horizon_s, alerts.lookahead_s)
            if violates(encounter, change, own.up_m_s, level.volume, *ends_s):
                found[i] = number
    return found


def bands_of(levels: list[int]) -> list[Band]:
    """Return the bands; two neighbours that violate a level include the altitude between them."""
    inner = list(levels)
    for i in range(1, len(levels) - 1):
        inner[i] = max(levels[i], min(levels[i - 1], levels[i + 1]))
    spans = [max(pair) for pair in pairwise(inner)]
    bands: list[Band] = []
    for i, level in enumerate(spans):
        low_ft, high_ft = float(ALTITUDES_FT[i]), float(ALTITUDES_FT[i + 1])
        if bands and bands[-1].level == level:
            bands[-1] = bands[-1]._replace(high_ft=high_ft)
        else:
            bands.append(Band(low_ft, high_ft, level))
    return bands


def _gold_bands(rows: list[tuple[str, str, str]]) -> list[Band]:
    return [Band(round(float(a), 1), round(float(b), 1), REGIONS[name]) for a, b, name in rows]


def of_example(folder: Path, name: str, alerts: AlertSet, limits: VerticalLimits) -> bool:
    """Compare the bands of one state."""
    gold = (folder / f"Regression/gold/DaidalusExample-{name}.out").read_text()
    table = re.search(r"^Altitude Bands.*\n((?:  \w+:.*\n)+)", gold, re.MULTILINE)
    assert table is not None, f"{name}: no bands"
    rows = re.findall(r"(\w+):\t\[(\S+), (\S+)\]", table[1])
    ours = bands_of(levels_of(*example_states(gold), alerts, limits))
    return ours == _gold_bands([(low, high, region) for region, low, high in rows])


def of_scenario(folder: Path) -> tuple[int, int]:
    """Compare the bands of H1; return the number of equal seconds and of compared seconds."""
    alerts = ALERT_SETS["do_365_en_route"]
    gold = (folder / "Regression/gold/DaidalusBatch-no_sum.out").read_text()
    states = scenario_of(folder / "Scenarios/H1.daa")
    last: deque[list[int]] = deque(maxlen=alerts.of)
    equal = compared = 0
    for block in re.split(r"^Time: ", gold, flags=re.MULTILINE)[1:]:
        table = re.search(r"^Altitude Bands:\n((?:  \[.*\n)+)", block, re.MULTILINE)
        assert table is not None, "no bands"
        rows = re.findall(r"\[(\S+) \[ft\], (\S+) \[ft\]\] (\w+)", table[1])
        if any(region == "RECOVERY" for _, _, region in rows):
            break
        now = levels_of(*states[float(block.split()[0])], alerts, KINEMATIC)
        last.extend([now] * (1 if last else alerts.enough))
        filtered = [
            sorted(values, reverse=True)[alerts.enough - 1] for values in zip(*last, strict=True)
        ]
        equal += bands_of(filtered) == _gold_bands(rows)
        compared += 1
    return equal, compared


@click.command(help=__doc__)
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Print the agreement; exit with code 1 if a band differs."""
    examples = [
        ("no_sum", ALERT_SETS["do_365_en_route"], KINEMATIC),
        ("nom_a", ALERT_SETS["buffered_en_route"], KINEMATIC),
        ("nom_b", ALERT_SETS["buffered_en_route"], KINEMATIC),
        ("cd3d", CYLINDER, INSTANT),
    ]
    agree = []
    for name, alerts, limits in examples:
        agree.append(of_example(folder, name, alerts, limits))
        click.echo(f"example, {name}: bands {'equal' if agree[-1] else 'differ'}")
    equal, compared = of_scenario(folder)
    click.echo(f"H1, DO-365B no SUM: bands equal in {equal} of {compared} seconds")
    raise SystemExit(not (all(agree) and equal == compared > 0))


if __name__ == "__main__":
    main()
