"""Defines the base class of the package's errors."""


class BridgeError(Exception):
    """The base class of the package's errors; a message states fault, place and remedy."""
