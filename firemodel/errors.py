"""Define the error class of this package, for invalid landscapes, weather and ignitions."""


class FireModelError(ValueError):
    """The base class of this package's errors, whose messages name the file, cell and value."""
