"""The table of a transfer's phases: allowed transitions, and invariants between events."""

import pytest

from autopilot_bridge.missions.download import MissionClear
from autopilot_bridge.missions.transfer import Address, TransferResult, TransferTiming
from autopilot_bridge.transitions import InvalidTransitionError
from autopilot_bridge.vehicle.transfer_states import (
    PROTOCOLS,
    TRANSITIONS,
    Action,
    Job,
    Phase,
)

CLEAR = MissionClear(Address((255, 190), (1, 1)), TransferTiming())


def test_an_impossible_transition_raises_with_the_history() -> None:
    job = Job(7, "clear", "mission")
    job.enter(Phase.CLEARING, CLEAR)
    with pytest.raises(InvalidTransitionError, match=r"clear 7 .*queued, clearing.*sending items"):
        job.enter(Phase.SENDING_ITEMS)
    job.enter(Phase.ENDED)
    job.validate_state()
    with pytest.raises(InvalidTransitionError):
        job.enter(Phase.CLEARING, CLEAR)


@pytest.mark.parametrize("action", TRANSITIONS)
def test_every_phase_can_be_reached_and_ends(action: Action) -> None:
    table = TRANSITIONS[action]
    reached = {phase for following in table.values() for phase in following}
    assert reached == {*table, Phase.ENDED} - {Phase.QUEUED}
    assert set(table) - {Phase.QUEUED} <= set(PROTOCOLS)
    ending = {Phase.ENDED}
    for _ in table:
        ending |= {phase for phase, following in table.items() if ending & set(following)}
    assert ending == {*table, Phase.ENDED}


def test_contradictions_of_a_state_are_found() -> None:
    job = Job(1, "upload", "mission")
    job.validate_state()
    job.uploaded = TransferResult("accepted", "")
    with pytest.raises(AssertionError):
        job.validate_state()
    job.uploaded, job.reread = None, True
    with pytest.raises(AssertionError, match="reread"):
        job.validate_state()
    job.reread, job.exchange = False, CLEAR
    with pytest.raises(AssertionError):
        job.validate_state()
