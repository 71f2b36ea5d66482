"""A state and those before it; which may follow which is data."""

from collections import deque
from collections.abc import Mapping
from enum import Enum
from typing import TypeVar

from autopilot_bridge.vehicle.transfer_states import InvalidTransitionError

State = TypeVar("State", bound=Enum)


def history_from(state: State) -> deque[State]:
    """A history that begins with a state; its last entry is the state now."""
    return deque([state], maxlen=20)


def enter(
    history: deque[State], state: State, allowed: Mapping[State, tuple[State, ...]], of: str
) -> None:
    """Append a state to a history, or raise InvalidTransitionError with the history ``of`` it."""
    if state not in allowed[history[-1]]:
        states = ", ".join(str(each.value) for each in history)
        raise InvalidTransitionError(f"{of} ({states}): {state.value} cannot follow")
    history.append(state)
