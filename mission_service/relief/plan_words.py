"""Describes the plan of a watch in words and as a table. Pure."""

from mission_service.relief.bottleneck import MAX_OF_KIND, Addition
from mission_service.relief.relief_plan import CONTINUED_S, TOO_FAR
from mission_service.relief.watch import NEVER_S, ReliefPlan, Watch, WatchAircraft

COLUMNS = "{:>8}  {:>8}  {:>8}  {:>8}  {:{aircraft}}  {:{battery}}  {}"


def clock(at_s: float) -> str:
    """Return a time as hours and minutes, such as "1:43"."""
    minutes = round(at_s / 60.0)
    return f"{minutes // 60}:{minutes % 60:02d}"


def length(time_s: float) -> str:
    """Return a duration, such as "40 s", "12 min", "1 h 40 min" or "12 h"."""
    if time_s < 59.5:
        return f"{time_s:.0f} s"
    hours, minutes = divmod(round(time_s / 60.0), 60)
    parts = [f"{hours} h"] * bool(hours) + [f"{minutes} min"] * bool(minutes)
    return " ".join(parts)


def summary(watch: Watch, plan: ReliefPlan, addition: Addition | None) -> str:
    """Return a summary: how long the watch is kept, the first lapse and what prevents it."""
    if not plan.lapses:
        kept = f"kept up for {length(watch.duration_s)}"
        if plan.short_handovers:
            kept += f", with {plan.short_handovers} reliefs whose overlap is shorter"
        return kept if _ends_the_search(watch, plan) else f"{kept}; {_afterwards(plan)}"
    first = plan.lapses[0]
    if first.reason == TOO_FAR:
        return f"not kept up at all: {first.reason}"
    others = ""
    if len(plan.lapses) > 1:
        total_s = sum(each.end_s - each.start_s for each in plan.lapses)
        others = f" ({len(plan.lapses)} lapses, {length(total_s)} in all)"
    remedy = f"{MAX_OF_KIND} more batteries, chargers and aircraft do not prevent this"
    if addition is not None:
        remedy = f"{addition.words} {addition.verb()} this"
    lasts = length(first.end_s - first.start_s)
    return f"lapses at {clock(first.start_s)} for {lasts}{others}: {first.reason}; {remedy}"


def _ends_the_search(watch: Watch, plan: ReliefPlan) -> bool:
    """Return whether the plan was not extended beyond the watch."""
    return watch.duration_s >= CONTINUED_S and plan.repeats_s is None


def _afterwards(plan: ReliefPlan) -> str:
    if plan.repeats_s is not None:
        return f"it repeats every {length(plan.repeats_s)} and can be kept up for any time"
    if plan.kept_until_s is not None:
        return f"if continued, it lapses at {clock(plan.kept_until_s)}"
    return f"if continued, it does not lapse within {length(CONTINUED_S)}"


def aircraft_line(watch: Watch, aircraft: WatchAircraft) -> str:
    """Return the times of an aircraft's sortie, or why the aircraft is not used."""
    if max(aircraft.out_s, aircraft.back_s) >= NEVER_S:
        return f"{aircraft.name}: not used, the wind prevents the flight to the task or back"
    times = f"{length(aircraft.out_s)} there, {length(aircraft.back_s)} back, "
    times += f"{length(aircraft.landing_s)} to land"
    if not watch.usable(aircraft):
        return f"{aircraft.name}: not used, too little time on task ({times})"
    return f"{aircraft.name}: {length(aircraft.max_on_task_s)} on task, {times}"


def table(plan: ReliefPlan) -> str:
    """Return a line per sortie, with its battery's charge; times count from the first takeoff."""
    widths = {
        "aircraft": max([8, *(len(each.aircraft) for each in plan.sorties)]),
        "battery": max([7, *(len(each.battery) for each in plan.sorties)]),
    }
    heads = ("takeoff", "on task", "leaves", "landing", "aircraft", "battery", "charging (charger)")
    lines = [COLUMNS.format(*heads, **widths)]
    for each in plan.sorties:
        later = (
            f"{clock(charge.start_s)} to {clock(charge.end_s)} ({charge.charger})"
            for charge in plan.charges
            if charge.battery == each.battery and charge.start_s >= each.landing_s
        )
        shown = next(later, "-")
        times = (each.takeoff_s, each.on_task_s, each.leaves_s, each.landing_s)
        names = (each.aircraft, each.battery, shown)
        lines.append(COLUMNS.format(*map(clock, times), *names, **widths).rstrip())
    return "\n".join(lines)
