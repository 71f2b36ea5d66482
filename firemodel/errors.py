"""The errors of this package: invalid landscapes, weather streams and ignitions."""


class FireModelError(ValueError):
    """Base class of the errors of this package; the message names file, cell and value."""
