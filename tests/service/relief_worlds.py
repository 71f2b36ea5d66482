"""Watches for tests of the relief, and an exhaustive search over all plans of small watches."""

from functools import cache
from itertools import product

from mission_service.relief.watch import Watch, WatchAircraft

MIN_S = 60  # a step of the search


def aircraft(name: str = "hawk", **changes: object) -> WatchAircraft:
    """Return an aircraft: 5 min there, 5 min back, 2 min landing, 40 min of 50 on task."""
    given: dict[str, object] = {
        "name": name,
        "pool": "plane",
        "home": 0,
        "out_s": 300,
        "back_s": 300,
        "landing_s": 0,
        "endurance_s": 3000,
        "reserve_s": 0,
    }
    return WatchAircraft(**{**given, **changes})  # type: ignore[arg-type]


def watch(count: int, batteries: int, chargers: int, **changes: object) -> Watch:
    """Return a watch of equal aircraft for 12 h: charging 60 min, swap 5 min, no overlap."""
    given: dict[str, object] = {
        "aircraft": tuple(aircraft(f"hawk-{n + 1}") for n in range(count)),
        "batteries": (("plane", batteries),),
        "chargers": chargers,
        "charge_s": 3600,
        "swap_s": 300,
        "overlap_s": 0,
        "spacing_s": 0,
        "on_task": 1,
        "duration_s": 12 * 3600,
    }
    return Watch(**{**given, **changes})  # type: ignore[arg-type]


# The search: time goes in steps of one minute, and in each step each aircraft on the ground may
# take off and each on task may leave. A state is the multiset of aircraft (phase, remaining steps)
# and of batteries (steps until charged, or waiting for a charger after some steps).


def best_coverage(small: Watch) -> tuple[int, int]:
    """Return the best possible time (s) of the first lapse, and the best covered time (s).

    All aircraft must be equal, and times be whole minutes. At the start they have just arrived, or
    are on the ground.
    """
    one = small.aircraft[0]
    out, back = one.out_s // MIN_S, (one.back_s + one.landing_s) // MIN_S
    on_task = one.max_on_task_s // MIN_S
    charge, swap = small.charge_s // MIN_S, small.swap_s // MIN_S
    steps = small.duration_s // MIN_S
    Crew = tuple[tuple[str, int], ...]

    def landed(crew: Crew, batteries: tuple[int, ...], waiting: tuple[int, ...]) -> tuple:
        """Let all times advance by one step."""
        new_crew, new_waiting = [], [max(each - 1, 0) for each in waiting]
        for phase, left in crew:
            if phase == "out" and left == 1:
                new_crew.append(("task", on_task))
            elif phase == "back" and left == 1:
                new_crew.append(("ground", swap))
                new_waiting.append(swap)
            else:
                new_crew.append((phase, max(left - 1, 0)))
        return new_crew, [max(each - 1, 0) for each in batteries], sorted(new_waiting)

    def charging(batteries: list[int], waiting: list[int]) -> tuple[list[int], list[int]]:
        """Put waiting batteries on free chargers; their time includes the later swap."""
        busy = sum(each > swap for each in batteries)
        while waiting and waiting[0] == 0 and busy < small.chargers:
            waiting.pop(0)
            batteries.append(charge + swap)
            busy += 1
        return batteries, waiting

    @cache
    def covered(step: int, crew: Crew, batteries: tuple[int, ...], waiting: tuple[int, ...]):
        """Return the best (steps until the first lapse, covered steps) separately."""
        if step == steps:
            return 0, 0
        best_first = best_total = 0
        moves = []
        for phase, left in crew:
            if phase == "ground" and left == 0:
                moves.append(("stay", "take off"))
            elif phase == "task":
                moves.append(("leave",) if left == 0 else ("stay", "leave"))
            else:
                moves.append(("stay",))
        for chosen in set(tuple(each) for each in product(*moves)):
            ready = sum(each == 0 for each in batteries)
            takeoffs = chosen.count("take off")
            if takeoffs > ready:
                continue
            now = []
            for (phase, left), move in zip(crew, chosen, strict=True):
                now.append(
                    ("out", out)
                    if move == "take off"
                    else ("back", back)
                    if move == "leave"
                    else (phase, left)
                )
            left_batteries = sorted(batteries)[takeoffs:]
            present = sum(phase == "task" for phase, _ in now) >= small.on_task
            then, charged, queue = landed(tuple(now), tuple(left_batteries), waiting)
            charged, queue = charging(charged, queue)
            first, total = covered(
                step + 1, tuple(sorted(then)), tuple(sorted(charged)), tuple(queue)
            )
            best_first = max(best_first, 1 + first if present else 0)
            best_total = max(best_total, present + total)
        return best_first, best_total

    flying = min(small.on_task, len(small.aircraft), small.batteries[0][1])
    crew = [("task", on_task)] * flying + [("ground", 0)] * (len(small.aircraft) - flying)
    ready = (0,) * (small.batteries[0][1] - flying)
    first, total = covered(0, tuple(sorted(crew)), ready, ())
    return first * MIN_S, total * MIN_S
