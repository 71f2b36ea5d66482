"""Measures the fraction of the states sent by other UAVs that are received.

While many messages are lost, each UAV flies in an altitude layer of its own (``Agent``).
"""

import math

from mission_service.peer_messages import State

WINDOW_S = 20.0  # older messages count less
MIN_SENT = 10.0  # the fraction is unknown until this many states have been sent
MAX_GAP = 120  # a longer gap does not count as a loss: the sender was out of range, or restarted
LOSSY, GOOD = 0.6, 0.8  # fractions at which links become lossy, and good again


class LinkQuality:
    """The fraction of sent states that are received; ``lossy`` is true while many are lost."""

    def __init__(self) -> None:
        self.lossy = False
        self._last: dict[str, int] = {}  # number of each sender's last state
        self._sent = self._received = 0.0
        self._at_us = 0

    def store(self, state: State) -> None:
        """Count a received state, and all states sent by its sender since the previous one."""
        gap = state.number - self._last.get(state.sender, state.number)
        if gap < 0 and gap > -MAX_GAP:
            return  # the messages have arrived out of order
        self._last[state.sender] = state.number
        if not 0 < gap <= MAX_GAP:
            return
        kept = math.exp(-max(state.at_us - self._at_us, 0) / 1e6 / WINDOW_S)
        self._at_us = max(self._at_us, state.at_us)
        self._sent = kept * self._sent + gap
        self._received = kept * self._received + 1.0
        if self._sent >= MIN_SENT:
            limit = GOOD if self.lossy else LOSSY
            self.lossy = self._received < limit * self._sent
