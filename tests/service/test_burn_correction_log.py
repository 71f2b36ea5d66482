"""Corrections in effect, compared with a model that stores whole histories."""

import random

from hypothesis import given, settings
from hypothesis import strategies as st

from mission_service.events import Corrected, Erased, OperatorHeartbeat, Redone, Undone
from mission_service.fire.correction_log import CorrectionLog, Held

OPERATOR_FIELDS = (1, "ann", "alpha")
DEG_PER_M = 1.0 / 111_195.0


def point(east_m: float, at_us: int = 1) -> Corrected:
    return Corrected(at_us, "ann", "alpha", "burning", "point", ((0.0, east_m * DEG_PER_M),), 0)


def erased(east_m: float, radius_m: float) -> Erased:
    return Erased(2, "bob", "bravo", 0.0, east_m * DEG_PER_M, radius_m)


def places(log: CorrectionLog) -> list[int]:
    return [round(held.correction.points[0][1] / DEG_PER_M) for held in log.held()]


def log_of(*events: Corrected | Erased | Undone | Redone | OperatorHeartbeat) -> CorrectionLog:
    log = CorrectionLog()
    for event in events:
        log.apply(event)
    return log


def test_drawing_erasing_undo_and_redo() -> None:
    drawn = (point(0), point(10), point(20))
    wiped = erased(10, 9.9)
    undone, redone = Undone(*OPERATOR_FIELDS), Redone(*OPERATOR_FIELDS)
    assert places(log_of(*drawn, wiped)) == [0, 20]
    assert places(log_of(*drawn, wiped, undone)) == [0, 10, 20]
    assert places(log_of(*drawn, wiped, undone, undone)) == [0, 10]
    assert places(log_of(*drawn, wiped, undone, undone, redone, redone)) == [0, 20]
    assert places(log_of(*drawn, wiped, undone, redone, redone)) == [0, 20]
    assert places(log_of(*drawn, undone, point(30), redone)) == [0, 10, 30]
    assert places(log_of(*drawn, wiped, point(10))) == [0, 20, 10]
    assert places(log_of(undone, redone, undone, *drawn)) == [0, 10, 20]


def test_a_line_that_is_erased_in_part_names_what_erased_it() -> None:
    line = Corrected(7, "cy", "bravo", "unburned", "line", ((0.0, 0.0), (0.0, 1e-3)), 9_000_000)
    before, after = erased(0, 5), erased(50, 5)
    assert log_of(before, line, after).held() == (Held(line, (after,)),)
    (entry,) = log_of(before, line, after).status()
    assert (entry["by"], entry["station"], entry["at_s"]) == ("cy", "bravo", 7e-6)
    assert (entry["marked_at_s"], entry["erasures"]) == (9.0, 1)


def test_it_reports_what_changed() -> None:
    log = CorrectionLog()
    assert not log.apply(Undone(*OPERATOR_FIELDS))
    assert not log.apply(Redone(*OPERATOR_FIELDS))
    assert not log.apply(OperatorHeartbeat(*OPERATOR_FIELDS))
    assert log.apply(point(0))
    assert log.apply(Undone(*OPERATOR_FIELDS))
    assert log.apply(Redone(*OPERATOR_FIELDS))


def model(events: list[Corrected | Erased | Undone | Redone]) -> list[tuple[Corrected, ...]]:
    """Return the corrections in effect after each event: a list of states, and an index in it."""
    states: list[tuple[Corrected, ...]] = [()]
    place = 0
    seen = [states[0]]
    for event in events:
        if isinstance(event, Undone):
            place = max(0, place - 1)
        elif isinstance(event, Redone):
            place = min(len(states) - 1, place + 1)
        else:
            held = states[place]
            if isinstance(event, Corrected):
                held = (*held, event)
            else:
                far_deg = event.radius_m * DEG_PER_M
                held = tuple(
                    mark for mark in held if abs(mark.points[0][1] - event.lon_deg) > far_deg
                )
            states = [*states[: place + 1], held]
            place += 1
        seen.append(states[place])
    return seen


@settings(max_examples=200)
@given(st.integers(0, 2**32))
def test_any_order_of_them_is_as_a_naive_model_has_it(seed: int) -> None:
    chance = random.Random(seed)
    events: list[Corrected | Erased | Undone | Redone] = []
    for number in range(chance.randrange(25)):
        east_m = 10 * chance.randrange(6)
        kind = chance.randrange(8)
        if kind < 3:
            events.append(point(east_m, at_us=number))
        elif kind == 3:
            events.append(erased(east_m, chance.choice([5.0, 15.0, 100.0])))
        else:
            events.append(Undone(*OPERATOR_FIELDS) if kind < 7 else Redone(*OPERATOR_FIELDS))
    log = CorrectionLog()
    for event, held in zip(events, model(events)[1:], strict=True):
        log.apply(event)
        assert tuple(each.correction for each in log.held()) == held
