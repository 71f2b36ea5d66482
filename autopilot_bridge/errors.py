"""Defines the base error of the package."""


class BridgeError(Exception):
    """The base of this package's errors; a message states the fault, its place and the remedy."""
