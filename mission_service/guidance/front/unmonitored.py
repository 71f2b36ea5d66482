"""Reports the part of the front that is no longer monitored when a vehicle leaves.

The module is pure: it uses no clock, network or random numbers.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mission_service.commands import Announce, AnyCommand, ClearAlarm, RaiseAlarm
from mission_service.events import AnyEvent, Observed
from mission_service.guidance.fire_map import BEARINGS, EAST, NORTH, FireMap
from mission_service.guidance.front.front_path import bearing_deg
from mission_service.guidance.protocol import Steered
from mission_service.vehicles.availability import VehicleAvailability

Floats = NDArray[np.float64]

ALARM = "front"


def front_map_of(planner: Steered) -> FireMap | None:
    """Return the on-board map of a front planner; None for other planners."""
    found = getattr(planner, "map", None)
    return found if isinstance(found, FireMap) else None


def nearest_bearings(own_deg: float, others_deg: list[float]) -> NDArray[np.int64]:
    """Return the whole-degree bearings to which none of ``others_deg`` is nearer than ``own_deg``.

    The bearings are in clockwise order. If there are none, the result is ``own_deg``, rounded.
    """
    bearings = np.arange(BEARINGS)

    def away(deg: float) -> Floats:
        return np.asarray(np.abs((bearings - deg + 180.0) % 360.0 - 180.0), dtype=np.float64)

    nearest = np.ones(BEARINGS, dtype=bool)
    for other_deg in others_deg:
        nearest &= away(own_deg) <= away(other_deg)
    found = np.flatnonzero(nearest)
    if not found.size:
        return np.array([round(own_deg) % BEARINGS])
    if found.size == BEARINGS:
        return found
    gap = int(np.argmax(np.diff(found, append=found[0] + BEARINGS)))
    return np.roll(found, -gap - 1)


def describe_sector(fire: FireMap, bearings: NDArray[np.int64], cell_m: float) -> str:
    """Return a description of the bearings and the length of a part of the front.

    Bearings are measured from the fire's centre.
    """
    outer, _ = fire.filled_outer()
    north, east = outer * NORTH, outer * EAST
    steps = np.hypot(np.roll(north, -1) - north, np.roll(east, -1) - east)
    length_km = cell_m * float(steps[bearings].sum()) / 1e3
    if bearings.size == BEARINGS:
        return f"the whole front, {length_km:.1f} km"
    arc = f"bearing {bearings[0]}° clockwise to {bearings[-1]}°, seen from the fire's centre"
    return f"the front from {arc}, {length_km:.1f} km"


def observes_front(event: AnyEvent) -> bool:
    """Return whether an event is a camera's observation of both burned and unburned cells."""
    if not isinstance(event, Observed) or event.corrects:
        return False
    cells = "".join(event.cells)
    return "b" in cells and "u" in cells


class FrontMonitor:
    """A record of the vehicles that monitor a front, and of the alarm when no vehicle does."""

    def __init__(self, planners: Mapping[str, Steered], cell_m: float) -> None:
        self._planners = planners
        self._cell_m = cell_m
        self._watching: set[str] = set()
        self._alarm: RaiseAlarm | None = None  # about the last vehicle that left the front

    def standing_alarms(self) -> list[AnyCommand]:
        """Return the active alarm, if any, to be sent again after a restart of the service."""
        return [] if self._alarm is None else [self._alarm]

    def update(
        self,
        name: str,
        available: bool,
        observes: bool,
        availability: Mapping[str, VehicleAvailability],
    ) -> list[AnyCommand]:
        """Return reports that a part of the front is no longer monitored, or is monitored again.

        A vehicle monitors the front from its first observation of the front (``observes``) for as
        long as it follows its planner (``available``).
        """
        watches = available and (observes or name in self._watching)
        if watches == (name in self._watching):
            return []
        fire = front_map_of(self._planners[name])
        if fire is None or bool(np.isnan(fire.outer).all()):
            return []
        if watches:
            self._watching.add(name)
            raised, self._alarm = self._alarm, None
            return [] if raised is None else [ClearAlarm(raised.vehicle, ALARM)]
        self._watching.discard(name)
        part = describe_sector(fire, self._left(name, fire, availability), self._cell_m)
        if self._watching:
            left = ", ".join(sorted(self._watching))
            words = f"no longer monitors {part}; {left} must monitor it"
            return [Announce(name, words, "warning")]
        self._alarm = RaiseAlarm(name, ALARM, f"no vehicle monitors {part}", "severe")
        return [self._alarm]

    def _left(
        self, name: str, fire: FireMap, availability: Mapping[str, VehicleAvailability]
    ) -> NDArray[np.int64]:
        """Return the bearings to which no other vehicle on the same map is nearer than ``name``."""
        places = {
            each: fix
            for each in (name, *sorted(self._watching))
            if (fix := availability[each].fix) is not None
            and front_map_of(self._planners[each]) is fire
        }
        if name not in places:
            return np.arange(BEARINGS)
        degrees = {each: bearing_deg(fire, fix.row, fix.col) for each, fix in places.items()}
        own_deg = degrees.pop(name)
        return nearest_bearings(own_deg, list(degrees.values()))
