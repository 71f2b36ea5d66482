"""Schedules the sorties of a watch by greedy choices, event by event. Pure.

Each of the ``on_task`` stations of the watch is a chain of sorties. The station that becomes free
first is served next: its next aircraft takes off as late as possible to arrive ``overlap_s`` before
the departure of the current one or, if this is impossible, as early as possible. It takes the
battery that was charged first and stays as long as its endurance permits; its battery then goes to
the charger that is free first. The watch begins at time 0; takeoff times before that are negative.
"""

from bisect import insort
from dataclasses import dataclass, field
from typing import NamedTuple

from mission_service.relief.home_movements import HomeMovements
from mission_service.relief.watch import (
    MIN_USEFUL_S,
    NEVER_S,
    BatteryCharge,
    PlannedSortie,
    Watch,
    WatchAircraft,
)

NO_AIRCRAFT, NO_BATTERY = "no aircraft ready", "no charged battery"
SPACING = "takeoffs and landings too close to each other"


@dataclass(frozen=True, slots=True)
class Choice:
    """How a schedule decides where the greedy rule leaves a choice.

    Attributes:
        longest: Take the aircraft that can stay longest instead of the one that landed first.
        staggered: Relieve the first aircraft early, so that the stations are not all relieved at
            the same time.
    """

    longest: bool
    staggered: bool


class Late(NamedTuple):
    """A relief that arrives after the departure of the previous aircraft."""

    free_s: int
    arrival_s: int
    reason: str


class _Option(NamedTuple):
    """A sortie that an aircraft could fly next."""

    number: int  # of the aircraft
    battery: tuple[int, str]  # time when charged, name
    takeoff_s: int
    arrival_s: int
    leaves_s: int


@dataclass(slots=True)
class ReliefSchedule:
    """The state of a schedule: the times at which stations, aircraft and chargers are free."""

    watch: Watch
    choice: Choice
    free_s: list[int] = field(init=False)  # of each station: departure of its last aircraft
    landed_s: dict[int, int] = field(init=False)  # of each usable aircraft
    charged_s: dict[str, list[tuple[int, str]]] = field(init=False)  # batteries of each pool
    chargers_s: list[tuple[int, int]] = field(init=False)  # time when free, number
    movements: list[HomeMovements] = field(init=False)
    sorties: list[PlannedSortie] = field(default_factory=list)
    charges: list[BatteryCharge] = field(default_factory=list)
    late: list[Late] = field(default_factory=list)
    short_handovers: int = 0

    def __post_init__(self) -> None:
        watch = self.watch
        usable = [n for n, each in enumerate(watch.aircraft) if watch.usable(each)]
        self.free_s = [0] * watch.on_task
        self.landed_s = dict.fromkeys(usable, -NEVER_S)
        self.charged_s = {
            pool: [(-NEVER_S, f"{pool} {n + 1}") for n in range(count)]
            for pool, count in watch.batteries
        }
        self.chargers_s = [(-NEVER_S, n + 1) for n in range(watch.chargers)]
        homes = 1 + max((each.home for each in watch.aircraft), default=-1)
        self.movements = [HomeMovements(watch.spacing_s) for _ in range(homes)]

    def plan_next(self, until_s: int) -> bool:
        """Plan the next sortie; return False if it would arrive at or after ``until_s``."""
        station = min(range(len(self.free_s)), key=lambda each: (self.free_s[each], each))
        free_s = self.free_s[station]
        if free_s >= until_s:
            return False
        first = len(self.sorties) < self.watch.on_task and free_s == 0
        target_s = 0 if first else free_s - self.watch.overlap_s
        options = [found for n in self.landed_s if (found := self._option(n, target_s, free_s))]
        best = min(options, key=lambda each: self._order(each, target_s, free_s), default=None)
        arrival_s = NEVER_S if best is None else best.arrival_s
        if arrival_s > free_s:
            self.late.append(Late(free_s, arrival_s, self._reason(free_s)))
        if best is None or best.arrival_s >= until_s:
            self.free_s[station] = until_s
            return True
        self.short_handovers += target_s < arrival_s <= free_s
        if first and self.choice.staggered:
            best = self._relieved_early(best, station)
        self._fly(best)
        self.free_s[station] = best.leaves_s
        return True

    def _relieved_early(self, option: _Option, station: int) -> _Option:
        """Return a station's first sortie, ended early by a share that differs between stations."""
        aircraft = self.watch.aircraft[option.number]
        share_s = (option.leaves_s - option.arrival_s) * (station + 1) // self.watch.on_task
        leaves_s = min(option.leaves_s, max(option.arrival_s, 0) + share_s)
        latest_s = leaves_s + aircraft.back_s + aircraft.landing_s
        landing_s = self._latest_landing(aircraft, option.takeoff_s, 0, latest_s)
        if landing_s is None:
            return option
        return option._replace(leaves_s=landing_s - aircraft.landing_s - aircraft.back_s)

    def _option(self, index: int, target_s: int, free_s: int) -> _Option | None:
        """Return the next sortie of an aircraft; None if no battery fits or it adds nothing."""
        watch, aircraft = self.watch, self.watch.aircraft[index]
        batteries = self.charged_s[aircraft.pool]
        if not batteries:
            return None
        ready_s = max(self.landed_s[index], batteries[0][0]) + watch.swap_s
        if ready_s >= NEVER_S:
            return None
        movements = self.movements[aircraft.home]
        takeoff_s = movements.latest(target_s - aircraft.out_s, ready_s)
        if takeoff_s is None:
            takeoff_s = movements.earliest(max(ready_s, target_s - aircraft.out_s))
        max_s = aircraft.max_flight_s
        landing_s = self._latest_landing(aircraft, takeoff_s, free_s, takeoff_s + max_s)
        while landing_s is None:
            takeoff_s = movements.earliest(takeoff_s + 1 + watch.spacing_s // 4)
            landing_s = self._latest_landing(aircraft, takeoff_s, free_s, takeoff_s + max_s)
        arrival_s = takeoff_s + aircraft.out_s
        leaves_s = landing_s - aircraft.landing_s - aircraft.back_s
        return _Option(index, batteries[0], takeoff_s, arrival_s, leaves_s)

    def _latest_landing(
        self, aircraft: WatchAircraft, takeoff_s: int, free_s: int, latest_s: int
    ) -> int | None:
        """Return the latest free landing time with which a sortie serves the watch."""
        arrival_s = takeoff_s + aircraft.out_s
        min_leaves_s = max(arrival_s + self.watch.overlap_s, free_s) + MIN_USEFUL_S
        shortest_s = min_leaves_s + aircraft.back_s + aircraft.landing_s
        from_s = max(shortest_s, takeoff_s + self.watch.spacing_s)
        return self.movements[aircraft.home].latest(latest_s, from_s)

    def _order(self, option: _Option, target_s: int, free_s: int) -> tuple[int, ...]:
        """Return the sort key of options: by least delay, then according to the choice."""
        late_s = max(option.arrival_s - free_s, 0)
        short_s = max(option.arrival_s - target_s, 0)
        by_choice = -option.leaves_s if self.choice.longest else self.landed_s[option.number]
        return late_s, short_s, by_choice, option.number

    def _fly(self, option: _Option) -> None:
        """Add a sortie, and the charge of its battery."""
        aircraft = self.watch.aircraft[option.number]
        landing_s = option.leaves_s + aircraft.back_s + aircraft.landing_s
        name = option.battery[1]
        times_s = (option.takeoff_s, option.arrival_s, option.leaves_s, landing_s)
        self.sorties.append(PlannedSortie(aircraft.name, name, *times_s))
        self.movements[aircraft.home].occupy(option.takeoff_s)
        self.movements[aircraft.home].occupy(landing_s)
        self.landed_s[option.number] = landing_s
        batteries = self.charged_s[aircraft.pool]
        batteries.remove(option.battery)
        if self.chargers_s:
            free_s, number = self.chargers_s.pop(0)
            start_s = max(free_s, landing_s + self.watch.swap_s)
            end_s = start_s + self.watch.charge_s
            insort(self.chargers_s, (end_s, number))
            insort(batteries, (end_s, name))
            self.charges.append(BatteryCharge(name, number, start_s, end_s))

    def _reason(self, free_s: int) -> str:
        """Return why no aircraft arrives by the departure of the previous one."""
        watch = self.watch
        crews = [(n, watch.aircraft[n]) for n in self.landed_s]
        takeoffs = [(n, each, free_s - each.out_s - watch.swap_s) for n, each in crews]
        landed = {n for n, _, by_s in takeoffs if self.landed_s[n] <= by_s}
        charged = {
            n
            for n, each, by_s in takeoffs
            if self.charged_s[each.pool] and self.charged_s[each.pool][0][0] <= by_s
        }
        if landed & charged:
            return SPACING
        if landed:
            return NO_BATTERY
        return NO_AIRCRAFT if charged else f"{NO_AIRCRAFT} and {NO_BATTERY}"

    def forget_old_movements(self) -> None:
        """Remove the takeoffs and landings that no later movement can depend on."""
        before_s = min(self.free_s) - self._lookback_s
        for each in self.movements:
            each.forget_before(before_s)

    @property
    def _lookback_s(self) -> int:
        """The longest time between an aircraft's takeoff and its relief of a station."""
        watch = self.watch
        out_s = max((watch.aircraft[n].out_s for n in self.landed_s), default=0)
        crowd = 2 * len(watch.aircraft) + 2
        return out_s + watch.overlap_s + watch.swap_s + 2 * watch.spacing_s * crowd

    def relative_state(self) -> tuple[object, ...]:
        """Return the state on which the further schedule depends, relative to the next relief.

        The batteries of a pool are interchangeable, and so are the chargers. Times long past count
        as equal.
        """
        now_s = min(self.free_s)
        oldest_s = now_s - self._lookback_s

        def since(at_s: int) -> int:
            return max(at_s, oldest_s) - now_s

        landed = sorted((at_s, n) for n, at_s in self.landed_s.items())
        return (
            tuple(free_s - now_s for free_s in self.free_s),
            tuple((n, since(at_s)) for at_s, n in landed),
            tuple(
                tuple(since(at_s) for at_s, _ in batteries) for batteries in self.charged_s.values()
            ),
            tuple(since(at_s) for at_s, _ in self.chargers_s),
            tuple(tuple(since(at_s) for at_s in each.times_s) for each in self.movements),
        )
