"""The mock replies as the recorded autopilots did."""

from functools import cache

import pytest

from autopilot_bridge.stacks.stacks import Stack, stack_named
from tests.bridge.helpers import mock_of
from tests.bridge.transcripts import FLIGHTS, FOLDER, GROUND, play_flights, play_ground

STACKS = {
    "arduplane": stack_named("ardupilot", "plane"),
    "arducopter": stack_named("ardupilot", "copter"),
    "px4_fixedwing": stack_named("px4", "plane"),
    "px4_multicopter": stack_named("px4", "copter"),
}
ONLY_PX4 = ("upload_feasibility_rejected", "upload_loiter_turns_rejected")
recorded = pytest.mark.skipif(not FOLDER.exists(), reason="no recordings on this machine")


@cache
def ground(name: str) -> dict[str, list[str]]:
    stack: Stack = STACKS[name]
    return play_ground(mock_of(stack), FOLDER / name)


@cache
def flights(name: str) -> dict[str, list[str]]:
    stack = STACKS[name]
    airspeed_m_s = 18.0 if stack.vehicle == "plane" else 6.0  # close to the recorded ones
    return play_flights(mock_of(stack, airspeed_m_s=airspeed_m_s), FOLDER / name)


@recorded
@pytest.mark.parametrize("name", STACKS)
@pytest.mark.parametrize("case", FLIGHTS)
def test_the_mock_flies_as_recorded(name: str, case: str) -> None:
    assert flights(name)[case] == [], "\n".join(flights(name)[case])


@recorded
@pytest.mark.parametrize("name", STACKS)
@pytest.mark.parametrize("case", [case for case, _ in GROUND])
def test_the_mock_answers_as_recorded(name: str, case: str) -> None:
    found = ground(name)
    if case in ONLY_PX4 and name.startswith("ardu"):
        assert case not in found
    else:
        assert found[case] == [], "\n".join(found[case])
