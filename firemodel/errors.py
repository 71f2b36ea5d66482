"""Define the error and the warning of this package, for landscapes, weather and ignitions."""


class FireModelError(ValueError):
    """The base class of this package's errors, whose messages name the file, cell and value."""


class FireModelWarning(UserWarning):
    """The warning of ``burn`` for valid inputs that are probably unintended, and at the edge."""
