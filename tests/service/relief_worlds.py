"""Watches for tests of the relief, and an exhaustive search over all plans of small watches."""

from functools import cache
from itertools import product
from typing import Any

from mission_service.relief.watch import Watch, WatchAircraft

MIN_S = 60  # a step of the search

Crew = tuple[tuple[str, int], ...]  # phase and remaining steps of each aircraft
Times = tuple[int, ...]  # remaining steps of each battery


def aircraft(name: str = "hawk", **changes: Any) -> WatchAircraft:
    """Return an aircraft: 5 min there, 40 min on task, 5 min back, no landing and no reserve."""
    given = {"pool": "battery", "home": 0, "out_s": 300, "back_s": 300, "landing_s": 0}
    given |= {"endurance_s": 3000, "reserve_s": 0}
    return WatchAircraft(name=name, **{**given, **changes})


def watch(count: int, batteries: int, chargers: int, **changes: Any) -> Watch:
    """Return a watch of equal aircraft for 12 h: charge 60 min, swap 5 min, no overlap."""
    given = {
        "aircraft": tuple(aircraft(f"hawk{n + 1}") for n in range(count)),
        "batteries": (("battery", batteries),),
        "chargers": chargers,
        "charge_s": 3600,
        "swap_s": 300,
        "overlap_s": 0,
        "spacing_s": 0,
        "on_task": 1,
        "duration_s": 12 * 3600,
    }
    return Watch(**{**given, **changes})


class Search:
    """All plans of a small watch, in steps of one minute.

    In each step each aircraft on the ground that is ready may take off with a charged battery, and
    each aircraft on task may leave. The watch begins with the required aircraft on task, as far as
    there are that many. All aircraft are equal; overlap and spacing are 0.
    """

    def __init__(self, small: Watch) -> None:
        one = small.aircraft[0]
        self.watch = small
        self.out, self.back = one.out_s // MIN_S, (one.back_s + one.landing_s) // MIN_S
        self.on_task = one.max_on_task_s // MIN_S
        self.charge, self.swap = small.charge_s // MIN_S, small.swap_s // MIN_S
        self.best = cache(self._best)

    def optimum(self) -> tuple[int, int]:
        """Return the latest possible first lapse (s) and the largest covered time (s)."""
        count, batteries = len(self.watch.aircraft), self.watch.batteries[0][1]
        flying = min(self.watch.on_task, count, batteries)
        crew = [("task", self.on_task)] * flying + [("ground", 0)] * (count - flying)
        steps = self.watch.duration_s // MIN_S
        first, total = self.best(steps, tuple(sorted(crew)), (0,) * (batteries - flying), ())
        return first * MIN_S, total * MIN_S

    def _best(self, steps: int, crew: Crew, batteries: Times, waiting: Times) -> tuple[int, int]:
        """Return the most steps until the first lapse, and the most covered steps.

        ``batteries`` has the steps until each battery is charged and exchanged, ``waiting`` the
        steps until each of the other batteries can be charged.
        """
        if steps == 0:
            return 0, 0
        first = total = 0
        for moves in {tuple(sorted(each)) for each in product(*map(self._moves, crew))}:
            takeoffs = sum(each == ("out", self.out) for each in moves) - sum(
                each == ("out", self.out) for each in crew
            )
            if takeoffs > batteries.count(0):
                continue
            present = sum(phase == "task" for phase, _ in moves) >= self.watch.on_task
            then = self._after(moves, tuple(sorted(batteries)[takeoffs:]), waiting)
            later_first, later_total = self.best(steps - 1, *then)
            first = max(first, 1 + later_first if present else 0)
            total = max(total, present + later_total)
        return first, total

    def _moves(self, state: tuple[str, int]) -> list[tuple[str, int]]:
        """Return what an aircraft may do now."""
        phase, left = state
        if phase == "ground" and left == 0:
            return [state, ("out", self.out)]
        if phase == "task":
            return [("back", self.back)] if left == 0 else [state, ("back", self.back)]
        return [state]

    def _after(self, crew: Crew, batteries: Times, waiting: Times) -> tuple[Crew, Times, Times]:
        """Return the state after a step, in which free chargers take waiting batteries."""
        queue = sorted(max(each - 1, 0) for each in waiting)
        then = []
        for phase, left in crew:
            if phase == "out" and left == 1:
                then.append(("task", self.on_task))
            elif phase == "back" and left == 1:
                then.append(("ground", self.swap))
                queue = sorted([*queue, self.swap])
            else:
                then.append((phase, max(left - 1, 0)))
        charged = [max(each - 1, 0) for each in batteries]
        while queue and queue[0] == 0:
            if sum(each > self.swap for each in charged) >= self.watch.chargers:
                break
            queue.pop(0)
            charged.append(self.charge + self.swap)
        return tuple(sorted(then)), tuple(sorted(charged)), tuple(queue)
