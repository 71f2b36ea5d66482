"""Computes when the fire reaches people and values at risk, and raises alarms."""

import asyncio
from collections.abc import Sequence
from datetime import UTC

from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from firemodel.landscape.time_zone import time_zone_of
from mission_service.config.service_section import FireArrivalSection
from mission_service.fire.forecast import LONGEST_S
from mission_service.fire_arrival.arrival_times import (
    SHARES,
    ArrivalAlarm,
    ArrivalAlarms,
    FireArrival,
    fire_arrivals,
)
from mission_service.fire_arrival.places import Place, person_places, values_in
from mission_service.runtime.clocks import wall_us
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.state_view import StateView

ALARM = "fire_arrival"
COMPARED_S = 3.0  # duration of the first comparison of mission time and wall clock
REAL_TIME_SHARE = 0.2  # largest difference between clock rates that count as equal


def values_of(section: FireArrivalSection, landscape: Landscape) -> list[Place]:
    """Return the values at risk in the files of a section. Raises ScenarioError."""
    found: list[Place] = []
    stems = [path.stem for path in section.values]
    for number, path in enumerate(section.values, start=1):
        # Keys are unique: files with equal names in different folders are numbered.
        group = path.stem if stems.count(path.stem) == 1 else f"{path.stem}-{number}"
        found += values_in(path, landscape, section.distance_m, group)
    return found


async def watch_fire_arrival(
    context: RunContext, section: FireArrivalSection, values: Sequence[Place]
) -> None:
    """Compute the arrivals regularly until cancelled, and publish them and their alarms."""
    zone = time_zone_of(context.landscape) or UTC
    alarms = ArrivalAlarms(60.0 * section.warn_min, 60.0 * section.severe_min, zone)
    view, clocks = context.state_view, ClockComparison(context.clock.now_us, wall_us())
    await asyncio.sleep(COMPARED_S)
    while True:
        try:
            arrivals = await _arrivals(context, section, values, clocks)
            context.arrivals = arrivals
            _show(view, alarms.present(arrivals))
        except FireModelError as error:
            view.alarm(ALARM, f"no fire arrival times: {error}")
        context.ring()
        await asyncio.sleep(section.every_s)


async def _arrivals(
    context: RunContext,
    section: FireArrivalSection,
    values: Sequence[Place],
    clocks: "ClockComparison",
) -> list[FireArrival]:
    """Return the current arrivals at people and values. Raises FireModelError."""
    unix_us, now_us = wall_us(), context.clock.now_us
    people = context.people.current(unix_us)
    land, distance_m = context.landscape, section.distance_m
    near = await asyncio.to_thread(person_places, people, land, distance_m)
    places = [*near, *values]
    if not places:
        return []
    cells = [each.cells for each in places]
    until_s, times_s = await context.forecasts.arrival_quantiles_s(cells, SHARES, LONGEST_S)
    at = (now_us, unix_us if clocks.is_real_time(now_us, unix_us) else None)
    return fire_arrivals(places, times_s, at, round(until_s * 1e6))


class ClockComparison:
    """Compares mission time with the wall clock since the start of the watch."""

    def __init__(self, now_us: int, unix_us: int) -> None:
        """Start at a mission time and a wall-clock time."""
        self._began_us, self._began_unix_us = now_us, unix_us

    def is_real_time(self, now_us: int, unix_us: int) -> bool:
        """Return whether mission time passes in real time; simulated flights may be faster."""
        rate = (now_us - self._began_us) / max(unix_us - self._began_unix_us, 1)
        return abs(rate - 1.0) < REAL_TIME_SHARE


def _show(view: StateView, alarms: dict[str, ArrivalAlarm]) -> None:
    """Raise the current alarms, clear the others, and mark the arrivals as changed."""
    raised = {f"{ALARM}/{key}": alarm for key, alarm in alarms.items()}
    for key in [key for key in view.alarms if key.partition("/")[0] == ALARM]:
        if key not in raised:
            view.clear_alarm(key)
    for key, alarm in raised.items():
        view.alarm(key, alarm.text, alarm.severity)
    view.arrivals_changed()
