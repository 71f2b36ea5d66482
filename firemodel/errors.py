"""Define the error and the warning class of this package."""


class FireModelError(ValueError):
    """The base class of this package's errors; messages name the file, the cell and the value."""


class FireModelWarning(UserWarning):
    """A warning from ``burn`` about a probably unintended input or a fire that reached the edge."""
