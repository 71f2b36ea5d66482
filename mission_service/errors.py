"""Defines the errors of the service. Each error text is one line with place, cause and remedy."""

from collections.abc import Iterable
from difflib import get_close_matches

MAX_COMPARED = 80  # characters of an unknown name that are compared with known names


class MissionServiceError(Exception):
    """Base class of errors that a user can resolve; the command line exits with 1."""


class ScenarioError(MissionServiceError):
    """A scenario file cannot be used; the message names file, key and value."""


class OptionError(ScenarioError):
    """An option (--set, --vary) has a wrong value; the command line exits with 2."""


class PlannerError(MissionServiceError):
    """A planner rule from a separate package failed; the message names rule and package."""


class JournalError(MissionServiceError):
    """A journal cannot be written or read; the message names the journal's file and line."""


class RequestError(MissionServiceError):
    """A request cannot be carried out; the message states the reason."""


class ControlError(MissionServiceError):
    """The control socket of a run cannot be created or reached; the message states the remedy."""


class StateError(MissionServiceError):
    """A snapshot cannot be used; the message states the reason.

    The state can then be computed again from the journal.
    """


class RefusedEventError(MissionServiceError):
    """An event cannot be journalled or handled; the event has no effect and no journal line."""


class UnhandledLineError(JournalError):
    """A journal line cannot be handled in a restart; the message names the file and the line."""


class NotRecordedError(MissionServiceError):
    """A request had no effect, because the journal could not be written."""


class FlightError(MissionServiceError):
    """A logged flight cannot be replayed; the message states the reason and the remedy."""


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """Return ``; did you mean NAME?`` with the known name that is most similar to ``given``.

    Args:
        given: An unknown name.
        known: The names that are valid in its place.

    Returns:
        Text to append to an error, or an empty text if no known name is similar. Case is ignored.
    """
    names = {name.casefold(): name for name in known}
    found = get_close_matches(given[:MAX_COMPARED].casefold(), names, n=1)
    return f"; did you mean {names[found[0]]}?" if found else ""


def in_words(error: BaseException) -> str:
    """Return the type and text of an exception on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())
