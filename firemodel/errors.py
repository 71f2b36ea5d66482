"""Error class of this package, for invalid landscapes, weather streams and ignitions."""


class FireModelError(ValueError):
    """Base class of the errors of this package; the message names file, cell and value."""
