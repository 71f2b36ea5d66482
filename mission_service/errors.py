"""What the service tells its user when something is wrong: one line, what, where, what to do."""


class MissionServiceError(Exception):
    """Base of the errors a user can act on; the command line prints it and exits with 1."""


class ScenarioError(MissionServiceError):
    """A scenario file cannot be used; the message names file, key and value."""


class JournalError(MissionServiceError):
    """A journal cannot be written or read; the message names the file and line."""


class RequestError(MissionServiceError):
    """Somebody asked for what cannot be done; the message says what is wrong with it."""


class ControlError(MissionServiceError):
    """The control socket of a run cannot be made or reached; the message says what to do."""


class StateError(MissionServiceError):
    """A state file cannot be used; the message says why. The journal tells the same."""


class RefusedEventError(MissionServiceError):
    """An event that cannot be journalled or handled: nothing of it is done or written down."""


class UnhandledLineError(JournalError):
    """A line of a journal that a restart cannot handle; the message names file and line."""


class NotRecordedError(MissionServiceError):
    """Nothing was done, since it could not be written down."""


class FlightError(MissionServiceError):
    """A logged flight cannot be replayed; the message says why and what to do."""
