"""Checks the transitions of a state machine against a table; an error shows the history."""

from collections.abc import Mapping, MutableSequence
from enum import Enum
from typing import TypeVar

State = TypeVar("State", bound=Enum)


class InvalidTransitionError(RuntimeError):
    """A defect: a transition that the table does not allow; the message shows the history."""


def enter(
    history: MutableSequence[State],
    state: State,
    allowed: Mapping[State, tuple[State, ...]],
    of: str,
) -> None:
    """Append a state to the history of a state machine.

    Args:
        history: The states so far, at least one; the last entry is the current state.
        state: The state to enter.
        allowed: For each state, the states that may follow; a state without an entry is final.
        of: The object to which the state machine belongs, for the error message.

    Raises:
        InvalidTransitionError: The state may not follow the current state.
    """
    if state not in allowed.get(history[-1], ()):
        states = ", ".join(str(each.value) for each in history)
        raise InvalidTransitionError(
            f"{of} ({states}): a transition to {state.value} is not allowed"
        )
    history.append(state)
