"""The base error of the package."""


class BridgeError(Exception):
    """Base of this package's errors; the message states the fault, its place and the remedy."""
