"""Plans a watch: the best of a few greedy schedules, its lapses and its period. Pure."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, product
from math import inf, prod

from mission_service.relief.relief_schedule import Choice, Late, ReliefSchedule
from mission_service.relief.watch import Lapse, PlannedSortie, ReliefPlan, Watch

CONTINUED_S = 7 * 24 * 3600  # a plan without a lapse is extended to here to find the first one
MAX_SMALLER = 1000  # maximum number of smaller watches that are compared
TOO_FAR = (
    "no aircraft can stay on task: its endurance is too short for the flights there and back and "
    "for the overlap"
)


def plan_watch(watch: Watch) -> ReliefPlan:
    """Return the plan of a watch with the latest first lapse, and then the largest coverage.

    A greedy schedule can become worse with more batteries, chargers or aircraft. Therefore, if
    there is a lapse, the result is the best plan among those for the watch and all smaller watches
    (if there are at most ``MAX_SMALLER``).
    """
    best = _best(watch)
    if not best.lapses:
        return best
    return max([best, *map(_best, _smaller(watch))], key=_merit)


def is_kept(watch: Watch) -> bool:
    """Return whether a watch can be kept for its whole duration without a late relief."""
    return any(_never_late(ReliefSchedule(watch, choice)) for choice in _choices(watch))


def _never_late(schedule: ReliefSchedule) -> bool:
    """Return whether a schedule has no late relief within its watch."""
    states: dict[tuple[object, ...], int] = {}
    while not schedule.late and schedule.plan_next(schedule.watch.duration_s):
        schedule.forget_old_movements()
        if _period_s(schedule, states) is not None:
            return True
    return not schedule.late


def _choices(watch: Watch) -> list[Choice]:
    staggered = (False, True) if watch.on_task > 1 else (False,)
    return [Choice(*each) for each in product((False, True), staggered)]


def _best(watch: Watch) -> ReliefPlan:
    """Return the best plan over all choices."""
    return max((planned(watch, choice) for choice in _choices(watch)), key=_merit)


def _smaller(watch: Watch) -> Iterator[Watch]:
    """Yield the watches with fewer aircraft (without the last ones), batteries or chargers."""
    counts = [range(1, count + 1) for _, count in watch.batteries]
    sizes = [range(1, len(watch.aircraft) + 1), range(watch.chargers + 1), *counts]
    if prod(map(len, sizes)) > MAX_SMALLER:
        return
    for aircraft, chargers, *batteries in product(*sizes):
        pools = (pool for pool, _ in watch.batteries)
        yield replace(
            watch,
            aircraft=watch.aircraft[:aircraft],
            chargers=chargers,
            batteries=tuple(zip(pools, batteries, strict=True)),
        )


def _merit(plan: ReliefPlan) -> tuple[float, ...]:
    """Return the quality of a plan: first lapse, coverage, overlaps, time until a later lapse."""
    first_s = plan.lapses[0].start_s - plan.begins_s if plan.lapses else inf
    later_s = inf if plan.kept_until_s is None else plan.kept_until_s - plan.begins_s
    return first_s, plan.coverage, -plan.short_handovers, later_s


def planned(watch: Watch, choice: Choice) -> ReliefPlan:
    """Return the plan of a watch for one choice."""
    schedule = ReliefSchedule(watch, choice)
    if not schedule.landed_s:
        lapse = Lapse(0, watch.duration_s, TOO_FAR)
        return ReliefPlan(0, (), (), (lapse,), 0.0, 0, None, 0)
    states: dict[tuple[object, ...], int] = {}
    repeats_s = None
    while schedule.plan_next(watch.duration_s):
        schedule.forget_old_movements()
        repeats_s = repeats_s or _period_s(schedule, states)
    count, short = len(schedule.sorties), schedule.short_handovers
    lapses = _lapses(watch, schedule.sorties, schedule.late)
    while not schedule.late and repeats_s is None and schedule.plan_next(CONTINUED_S):
        schedule.forget_old_movements()
        repeats_s = _period_s(schedule, states)
    return _shifted(watch, schedule, count, short, lapses, repeats_s)


def _period_s(schedule: ReliefSchedule, states: dict[tuple[object, ...], int]) -> int | None:
    """Return the time since the schedule was in the same state; None if the state is new."""
    if schedule.late or len(schedule.sorties) < schedule.watch.on_task:
        return None
    now_s = min(schedule.free_s)
    before_s = states.setdefault(schedule.relative_state(), now_s)
    return now_s - before_s if before_s < now_s else None


def _lapses(watch: Watch, sorties: list[PlannedSortie], late: list[Late]) -> list[Lapse]:
    """Return the periods of the watch with too few aircraft on task."""
    changes = sorted(
        [(max(each.on_task_s, 0), 1) for each in sorties]
        + [(each.leaves_s, -1) for each in sorties]
    )
    steps = [(0, 0), *changes, (watch.duration_s, 0)]
    found: list[tuple[int, int]] = []
    present = 0
    for (at_s, change), (next_s, _) in pairwise(steps):
        present += change
        end_s = min(next_s, watch.duration_s)
        if present >= watch.on_task or end_s <= at_s:
            continue
        if found and found[-1][1] == at_s:
            found[-1] = found[-1][0], end_s
        else:
            found.append((at_s, end_s))
    return [Lapse(start_s, end_s, _reason_at(start_s, late)) for start_s, end_s in found]


def _reason_at(at_s: int, late: list[Late]) -> str:
    """Return why a relief is missing at a given time."""
    return next(each.reason for each in late if each.free_s <= at_s < each.arrival_s)


def _shifted(
    watch: Watch,
    schedule: ReliefSchedule,
    count: int,
    short: int,
    lapses: list[Lapse],
    repeats_s: int | None,
) -> ReliefPlan:
    """Return the plan of the first ``count`` sorties, with times relative to the first takeoff."""
    sorties = sorted(schedule.sorties[:count], key=lambda each: each.takeoff_s)
    begins_s = -min((each.takeoff_s for each in sorties), default=0)
    uncovered_s = sum(each.end_s - each.start_s for each in lapses)
    later_s = lapses[0].start_s if lapses else None
    if not lapses and schedule.late and schedule.late[0].free_s >= watch.duration_s:
        later_s = schedule.late[0].free_s
    return ReliefPlan(
        begins_s,
        tuple(
            each._replace(
                takeoff_s=each.takeoff_s + begins_s,
                on_task_s=each.on_task_s + begins_s,
                leaves_s=each.leaves_s + begins_s,
                landing_s=each.landing_s + begins_s,
            )
            for each in sorties
        ),
        tuple(
            each._replace(start_s=each.start_s + begins_s, end_s=each.end_s + begins_s)
            for each in sorted(schedule.charges[:count], key=lambda each: each.start_s)
        ),
        tuple(
            each._replace(start_s=each.start_s + begins_s, end_s=each.end_s + begins_s)
            for each in lapses
        ),
        1.0 - uncovered_s / watch.duration_s,
        short,
        repeats_s,
        None if later_s is None else later_s + begins_s,
    )
