"""State machines whose allowed transitions are data, with the history in the error."""

from collections.abc import Mapping, MutableSequence
from enum import Enum
from typing import TypeVar

State = TypeVar("State", bound=Enum)


class InvalidTransitionError(RuntimeError):
    """A transition that the table does not allow, which is a defect; the text has the history."""


def enter(
    history: MutableSequence[State],
    state: State,
    allowed: Mapping[State, tuple[State, ...]],
    of: str,
) -> None:
    """Append a state to the history of a state machine.

    Args:
        history: The states so far, at least one; the last entry is the present state.
        state: The state to enter.
        allowed: The states that may follow each state; a state without an entry is final.
        of: The object whose state it is, for the error.

    Raises:
        InvalidTransitionError: If the state may not follow the present one.
    """
    if state not in allowed.get(history[-1], ()):
        states = ", ".join(str(each.value) for each in history)
        raise InvalidTransitionError(f"{of} ({states}): {state.value} cannot follow")
    history.append(state)
