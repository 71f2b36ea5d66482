"""What is wrong with a landscape, a weather stream or an ignition, in one line."""


class FireModelError(ValueError):
    """Base of the errors of this package; the message names file, cell and value."""
