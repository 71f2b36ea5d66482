"""What can be wrong with a link or a plan file, in one line."""


class BridgeError(Exception):
    """Base of the errors of this package; the message states what, where and what to do."""
