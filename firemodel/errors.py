"""Define the error and the warning class of this package."""


class FireModelError(ValueError):
    """The base class of this package's errors, whose messages name the file, cell and value."""


class FireModelWarning(UserWarning):
    """A warning of ``burn`` about a probably unintended input, or about fire at the edge."""
