"""Compares alert levels and times to violation with the gold output of NASA's DAIDALUS.

``FOLDER`` is a copy of the public repository nasa/daidalus. The gold output contains two runs of
the scenario H1 (every second) and one state for each of several configurations. The positions are
projected as DAIDALUS does: onto the tangent plane of a sphere with 60 nmi to a degree.
"""

import csv
import math
import re
from pathlib import Path
from typing import NamedTuple

import click

from mission_service.ground_distance import M_PER_FT, M_PER_NMI
from mission_service.surveillance.alerting import (
    ALERT_SETS,
    AlertHistory,
    AlertLevel,
    AlertSet,
)
from mission_service.surveillance.well_clear import Encounter, WellClearVolume, violation

RADIUS_M = 180.0 * 60.0 * M_PER_NMI / math.pi
M_S_PER_KNOT, M_S_PER_FPM = M_PER_NMI / 3600.0, M_PER_FT / 60.0
STEP_S = 10.0  # velocities are projected by the positions now and after this time
EDGE_M = 1e-6  # in DAIDALUS the edge does not belong to the cylinder
# DAIDALUS's configuration CD3D: a cylinder of 5 nmi and 1000 ft, without tau and hysteresis.
CYLINDER = AlertSet(
    (
        AlertLevel(
            WellClearVolume(5.0 * M_PER_NMI - EDGE_M, 1000.0 * M_PER_FT - EDGE_M), 180.0, 180.0
        ),
    ),
    enough=0,
    of=0,
)
MAX_ERROR_S = 0.01  # of the time to violation; the examples print two decimals


class State(NamedTuple):
    """An aircraft of a scenario: position in radians and metres, velocity in m/s."""

    lat: float
    lon: float
    up_m: float
    east_m_s: float
    north_m_s: float
    up_m_s: float


def _plane(lat: float, lon: float, centre: State) -> tuple[float, float]:
    """Return a position on the tangent plane at ``centre``: metres east and north."""
    apart = lon - centre.lon
    east = math.cos(lat) * math.sin(apart)
    north = math.sin(lat) * math.cos(centre.lat) - math.cos(lat) * math.sin(centre.lat) * math.cos(
        apart
    )
    return RADIUS_M * east, RADIUS_M * north


def _later(state: State) -> tuple[float, float]:
    """Return the latitude and longitude after ``STEP_S`` on a great circle."""
    angle = STEP_S * math.hypot(state.east_m_s, state.north_m_s) / RADIUS_M
    track = math.atan2(state.east_m_s, state.north_m_s)
    lat = math.asin(
        math.sin(state.lat) * math.cos(angle)
        + math.cos(state.lat) * math.sin(angle) * math.cos(track)
    )
    lon = state.lon + math.atan2(
        math.sin(track) * math.sin(angle) * math.cos(state.lat),
        math.cos(angle) - math.sin(state.lat) * math.sin(lat),
    )
    return lat, lon


def encounter_of(own: State, other: State) -> Encounter:
    """Return the projected encounter of two aircraft."""
    (x0, y0), (x1, y1) = (_plane(each.lat, each.lon, own) for each in (own, other))
    (u0, w0), (u1, w1) = (_plane(*_later(each), own) for each in (own, other))
    east_m_s, north_m_s = (u1 - x1 - u0 + x0) / STEP_S, (w1 - y1 - w0 + y0) / STEP_S
    up_m, up_m_s = other.up_m - own.up_m, other.up_m_s - own.up_m_s
    return Encounter(x1 - x0, y1 - y0, up_m, east_m_s, north_m_s, up_m_s)


def _state(fields: dict[str, float]) -> State:
    if "vx" in fields:
        east, north, up = fields["vx"], fields["vy"], fields["vz"]
    else:
        track = math.radians(fields["trk"])
        east, north = fields["gs"] * math.sin(track), fields["gs"] * math.cos(track)
        up = fields["vs"]
    return State(
        math.radians(fields["lat"]),
        math.radians(fields["lon"]),
        fields["alt"] * M_PER_FT,
        east * M_S_PER_KNOT,
        north * M_S_PER_KNOT,
        up * M_S_PER_FPM,
    )


def scenario_of(path: Path) -> dict[float, tuple[State, State]]:
    """Return the own and the other aircraft of a scenario, by time in s."""
    names: list[str] | None = None
    found: dict[float, list[State]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        cells = re.split(r"[,\s]+", line.strip())
        if cells[0] == "NAME":
            names = cells
        elif names is not None and cells[0] and not cells[0].startswith(("#", "[", "unitless")):
            fields = {key: float(cell) for key, cell in zip(names[1:], cells[1:], strict=True)}
            found.setdefault(fields["time"], []).append(_state(fields))
    return {at_s: (states[0], states[1]) for at_s, states in found.items()}


class Agreement:
    """Counts equal levels and the largest difference of the times to violation."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.levels = self.equal_levels = self.times = 0
        self.max_error_s = 0.0

    def level(self, ours: int, gold: int) -> None:
        """Compare an alert level."""
        self.levels += 1
        self.equal_levels += ours == gold

    def time(self, ours_s: float, gold_s: float) -> None:
        """Compare a time to violation; infinity means none."""
        self.times += 1
        if math.isinf(ours_s) != math.isinf(gold_s):
            self.max_error_s = math.inf
        elif not math.isinf(ours_s):
            self.max_error_s = max(self.max_error_s, abs(ours_s - gold_s))

    @property
    def holds(self) -> bool:
        """Whether all levels are equal, and all times within ``MAX_ERROR_S``."""
        return self.levels == self.equal_levels and self.max_error_s <= MAX_ERROR_S

    def __str__(self) -> str:
        return (
            f"{self.name:<34} levels {self.equal_levels} of {self.levels}, "
            f"{self.times} times, largest difference {self.max_error_s:.6f} s"
        )


def _time_in_s(encounter: Encounter, alerts: AlertSet, number: int) -> float:
    found = violation(encounter, alerts.levels[number - 1].volume, alerts.lookahead_s)
    return math.inf if found is None else found[0]


def _gold_s(text: str) -> float:
    return math.inf if text == "infty" else float(text)


def of_table(folder: Path) -> Agreement:
    """Compare with the table of DaidalusAlerting: H1 every second, DO-365B without SUM."""
    found, alerts = Agreement("H1, DO-365B no SUM (table)"), ALERT_SETS["do_365_en_route"]
    states, history = scenario_of(folder / "Scenarios/H1.daa"), AlertHistory()
    gold = folder / "Regression/gold/DaidalusqAlerting-no_sum.csv"
    for row in list(csv.reader(gold.read_text().splitlines(), skipinitialspace=True))[2:]:
        at_s = float(row[0])
        encounter = encounter_of(*states[at_s])
        found.level(history.add_encounter(alerts, encounter, round(at_s * 1e6)), int(row[4]))
        for number in (1, 2, 3):
            found.time(_time_in_s(encounter, alerts, number), _gold_s(row[4 + number]))
    return found


def of_batch(folder: Path) -> Agreement:
    """Compare with the levels of DaidalusBatch: H1 every second, DO-365B without SUM."""
    found, alerts = Agreement("H1, DO-365B no SUM (batch)"), ALERT_SETS["do_365_en_route"]
    gold = (folder / "Regression/gold/DaidalusBatch-no_sum.out").read_text()
    levels = [int(each) for each in re.findall(r"^Alert Level (-?\d+) with", gold, re.MULTILINE)]
    history = AlertHistory()
    states = scenario_of(folder / "Scenarios/H1.daa")
    for level, (at_s, pair) in zip(levels, states.items(), strict=False):
        found.level(history.add_encounter(alerts, encounter_of(*pair), round(at_s * 1e6)), level)
    return found


def example_states(gold: str) -> tuple[State, State]:
    """Return the own and the other aircraft in the output of DaidalusExample."""
    lines = re.search(r"^NAME.*\n.*\n(?:\w.*,.*\n)+", gold, re.MULTILINE)
    assert lines is not None, "the output contains no states"
    names, _, own, other = lines[0].splitlines()[:4]
    states = []
    for line in (own, other):
        cells = [each.strip() for each in line.split(",")]
        states.append(_state(dict(zip(names.split()[1:], map(float, cells[1:]), strict=True))))
    return states[0], states[1]


def of_example(folder: Path, name: str, alerts: AlertSet) -> Agreement:
    """Compare with one state of DaidalusExample, for a configuration."""
    found = Agreement(f"example, {name}")
    path = folder / f"Regression/gold/DaidalusExample-{name}.out"
    gold = path.read_text()
    encounter = encounter_of(*example_states(gold))
    for number, text in re.findall(r"Thresholds at Level (\d) with \w+: (\S+)", gold):
        found.time(_time_in_s(encounter, alerts, int(number)), _gold_s(text))
    level = re.search(r"^Alert Level (\d) with", gold, re.MULTILINE)
    assert level is not None, f"{path}: no alert level"
    found.level(AlertHistory().add_encounter(alerts, encounter, 0), int(level[1]))
    return found


def compared(folder: Path) -> list[Agreement]:
    """Return the agreement with each gold output whose definitions are implemented."""
    return [
        of_table(folder),
        of_batch(folder),
        of_example(folder, "no_sum", ALERT_SETS["do_365_en_route"]),
        of_example(folder, "nom_a", ALERT_SETS["buffered_en_route"]),
        of_example(folder, "nom_b", ALERT_SETS["buffered_en_route"]),
        of_example(folder, "cd3d", CYLINDER),
    ]


@click.command(help=__doc__)
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Print the agreement; exit with code 1 if a level differs."""
    found = compared(folder)
    for each in found:
        click.echo(each)
    raise SystemExit(not all(each.holds for each in found))


if __name__ == "__main__":
    main()
