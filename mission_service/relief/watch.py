"""Describes a continuous watch, and its plan: sorties, charges and lapses. Pure.

All times are in whole seconds; in a plan, they count from the first takeoff.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

MIN_USEFUL_S = 60  # a sortie adds at least this much time on task
NEVER_S = 10**9  # time of an event that does not occur


@dataclass(frozen=True, slots=True)
class WatchAircraft:
    """An aircraft in the watch.

    Attributes:
        name: The name of the vehicle.
        pool: The pool of batteries that fit; aircraft with the same pool share them.
        home: The index of its home; at each home one aircraft takes off or lands at a time.
        out_s: Time from takeoff to the task; ``NEVER_S`` if the wind prevents the flight.
        back_s: Time from the task to overhead home; ``NEVER_S`` if the wind prevents the flight.
        landing_s: Time from there to touchdown.
        endurance_s: Maximum time in the air.
        reserve_s: Remaining endurance on arrival over home.
    """

    name: str
    pool: str
    home: int
    out_s: int
    back_s: int
    landing_s: int
    endurance_s: int
    reserve_s: int

    @property
    def max_flight_s(self) -> int:
        """Maximum time from takeoff to touchdown; the reserve covers at least the landing."""
        return self.endurance_s - max(self.reserve_s, self.landing_s) + self.landing_s

    @property
    def max_on_task_s(self) -> int:
        """Maximum time on task; 0 or less if the flights there and back need all the energy."""
        return self.max_flight_s - self.out_s - self.back_s - self.landing_s


@dataclass(frozen=True, slots=True)
class Watch:
    """A watch with ``on_task`` aircraft at all times, and its aircraft, batteries and chargers.

    Attributes:
        aircraft: The aircraft, all on the ground with a charged battery or without any.
        batteries: The number of batteries in each pool, all charged at the start.
        chargers: Number of chargers; each charges one battery at a time.
        charge_s: Duration of a charge. Every battery that has flown is fully charged.
        swap_s: Time on the ground from landing, or from the end of the new battery's charge if
            later, to takeoff. The battery that was taken out can be charged after this time.
        overlap_s: Time between the arrival of an aircraft and the departure of the relieved one.
        spacing_s: Minimum time between two takeoffs or landings at a home.
        on_task: Number of aircraft that must be on task.
        duration_s: Duration of the watch.
    """

    aircraft: tuple[WatchAircraft, ...]
    batteries: tuple[tuple[str, int], ...]
    chargers: int
    charge_s: int
    swap_s: int
    overlap_s: int
    spacing_s: int
    on_task: int
    duration_s: int

    def usable(self, aircraft: WatchAircraft) -> bool:
        """Return whether an aircraft can stay on task long enough for its relief."""
        long_enough = aircraft.max_on_task_s >= self.overlap_s + MIN_USEFUL_S
        return long_enough and aircraft.max_flight_s >= self.spacing_s

    def with_more(self, batteries: dict[str, int], chargers: int, aircraft: list[int]) -> "Watch":
        """Return the watch with additional batteries, chargers and copies of some aircraft."""
        copies = (
            replace(self.aircraft[index], name=f"{self.aircraft[index].name}-{number + 2}")
            for number, index in enumerate(aircraft)
        )
        return replace(
            self,
            aircraft=(*self.aircraft, *copies),
            batteries=tuple((pool, n + batteries.get(pool, 0)) for pool, n in self.batteries),
            chargers=self.chargers + chargers,
        )


class PlannedSortie(NamedTuple):
    """A sortie of an aircraft with a battery (such as "plane 2")."""

    aircraft: str
    battery: str
    takeoff_s: int
    on_task_s: int  # arrival at the task
    leaves_s: int
    landing_s: int


class BatteryCharge(NamedTuple):
    """The charge of a battery after a sortie."""

    battery: str
    charger: int  # from 1
    start_s: int
    end_s: int


class Lapse(NamedTuple):
    """A period with fewer aircraft on task than required."""

    start_s: int
    end_s: int
    reason: str


@dataclass(frozen=True, slots=True)
class ReliefPlan:
    """The plan of a watch.

    Attributes:
        begins_s: The time when all required aircraft are first on task.
        sorties: The sorties that serve the watch, by takeoff.
        charges: The charges of their batteries, by start.
        lapses: The lapses within the duration, by start.
        coverage: The share of the duration in which all required aircraft are on task.
        short_handovers: Number of reliefs without a lapse that overlap less than required.
        repeats_s: The period with which the plan repeats without a lapse; None if no period was
            found.
        kept_until_s: The first lapse, even if after the end of the watch; None if there is none as
            far as the plan was extended.
    """

    begins_s: int
    sorties: tuple[PlannedSortie, ...]
    charges: tuple[BatteryCharge, ...]
    lapses: tuple[Lapse, ...]
    coverage: float
    short_handovers: int
    repeats_s: int | None
    kept_until_s: int | None
