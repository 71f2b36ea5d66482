"""Defines the base class of the package's errors."""


class BridgeError(Exception):
    """The base class of the package's errors; messages state the fault, place and remedy."""
