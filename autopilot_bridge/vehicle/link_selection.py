"""Measures the quality of a vehicle's links, and selects the link to use. Pure.

waiting --frame--> up --loss--> degraded --less loss--> up
any --no frame for ``SILENT_US``--> silent --frame--> up

The loss is measured from gaps in the sequence numbers of the vehicle's frames, over ``WINDOW_US``:
autopilots number the frames of each of their telemetry ports separately (ArduPilot and PX4), and
routers forward the numbers unchanged. Only the loss from the vehicle to this station is measured;
the loss in the other direction is unknown.

The links have an order of preference. A silent link is left at once, and a degraded link as soon as
another link is better. A link of higher preference is used again after it has been up for
``RETURN_AFTER_US``; this time doubles each time the link fails within ``UNSTABLE_US``.
"""

from collections import deque
from dataclasses import dataclass
from typing import Literal

State = Literal["waiting", "up", "degraded", "silent"]
Cause = Literal["", "silent", "loss", "recovered"]

SILENT_US = 3_000_000
WINDOW_US = 10_000_000
BUCKET_US = 1_000_000
MIN_FRAMES = 20  # minimum number of received and lost frames for computing a loss
DEGRADED_LOSS, GOOD_LOSS = 0.3, 0.15
# A degraded link is left for another, even a degraded one, if the loss there is smaller by this.
BETTER_LOSS = 0.2
DWELL_US = 5_000_000  # minimum time between two switches because of loss
RETURN_AFTER_US, MAX_RETURN_AFTER_US = 10_000_000, 160_000_000
UNSTABLE_US = 60_000_000
# A gap is at most half of the 256 numbers; a frame with an earlier number was late or repeated.
HALF = 128
RESTARTED_AFTER_US = 1_000_000  # earlier numbers after this silence begin a new sequence
MAX_EARLIER = 20  # this many earlier numbers in succession begin a new sequence
STATE_RANK: dict[State, int] = {"up": 0, "degraded": 1, "silent": 2, "waiting": 2}


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """The quality of one link; ``loss_share`` is None until enough frames have arrived."""

    link: str
    state: State
    loss_share: float | None
    received_us: int | None  # time of the last frame; None before the first


class LinkQuality:
    """The frames of one vehicle on one link."""

    def __init__(self, began_us: int) -> None:
        self.received_us: int | None = None
        self.up_since_us: int | None = None  # None: not up
        self.state: State = "waiting"
        self._began_us = began_us
        self._next_seq: int | None = None
        self._missing: set[int] = set()
        self._earlier = 0
        self._buckets: deque[list[int]] = deque()  # [index of the bucket, received, lost]

    def on_frame(self, seq: int, now_us: int) -> None:
        """Record a frame of the vehicle's autopilot with its sequence number."""
        before_us, self.received_us = self.received_us, now_us
        gap = 0 if self._next_seq is None else (seq - self._next_seq) % 256
        if before_us is not None and now_us - before_us >= SILENT_US:
            gap = 0  # the number of lost frames is unknown
        if gap >= HALF:
            self._on_earlier(seq, now_us, before_us)
            return
        self._earlier = 0
        if gap or self._missing:
            missing = self._missing | {(seq - back) % 256 for back in range(1, gap + 1)}
            self._missing = {each for each in missing if 0 < (seq - each) % 256 < HALF}
        self._next_seq = (seq + 1) % 256
        self._count(1, gap, now_us)

    def on_other_component(self, seq: int) -> None:
        """Record a frame of another component, which may share the autopilot's numbering."""
        if self._next_seq == seq:
            self._next_seq = (seq + 1) % 256

    def _on_earlier(self, seq: int, now_us: int, before_us: int | None) -> None:
        """Record a frame that is late, repeated or the first of a new sequence."""
        if seq in self._missing:
            self._missing.discard(seq)
            self._count(1, -1, now_us)
            return
        self._earlier += 1
        silent = before_us is not None and now_us - before_us >= RESTARTED_AFTER_US
        if silent or self._earlier >= MAX_EARLIER:
            self._next_seq, self._earlier = (seq + 1) % 256, 0
            self._missing.clear()
            self._count(1, 0, now_us)

    def _count(self, received: int, lost: int, now_us: int) -> None:
        number = now_us // BUCKET_US
        if not self._buckets or self._buckets[-1][0] < number:
            self._buckets.append([number, 0, 0])
        self._buckets[-1][1] += received
        self._buckets[-1][2] += lost

    def loss_share(self, now_us: int) -> float | None:
        """Return the share of frames lost in the last seconds; None if there are too few."""
        oldest = (now_us - WINDOW_US) // BUCKET_US
        while self._buckets and self._buckets[0][0] <= oldest:
            self._buckets.popleft()
        received = sum(bucket[1] for bucket in self._buckets)
        lost = max(sum(bucket[2] for bucket in self._buckets), 0)
        return lost / (received + lost) if received + lost >= MIN_FRAMES else None

    def renew_state(self, now_us: int) -> bool:
        """Update ``state``; return whether it has changed."""
        before, self.state = self.state, self._state(now_us)
        if self.state != "up":
            self.up_since_us = None
        elif self.up_since_us is None:
            self.up_since_us = now_us
        return self.state != before

    def _state(self, now_us: int) -> State:
        since_us = self._began_us if self.received_us is None else self.received_us
        if now_us - since_us >= SILENT_US:
            return "silent"
        if self.received_us is None:
            return "waiting"
        loss = self.loss_share(now_us)
        if loss is None:
            return "degraded" if self.state == "degraded" else "up"
        limit = GOOD_LOSS if self.state == "degraded" else DEGRADED_LOSS
        return "degraded" if loss > limit else "up"


class LinkSelection:
    """The links of one vehicle; ``in_use`` is the link over which this station sends."""

    def __init__(self, order: tuple[int, ...], now_us: int) -> None:
        """Begin with the first link of ``order``, which has the preferred links first."""
        self.order = order
        self.in_use = order[0]
        self.cause: Cause = ""  # of the last switch
        self.switched_us: int | None = None
        self.quality = {link: LinkQuality(now_us) for link in order}
        self._returned_us: int | None = None
        self._return_after_us = RETURN_AFTER_US

    def renew_states(self, now_us: int) -> bool:
        """Update the states of all links; return whether one has changed."""
        changed = [quality.renew_state(now_us) for quality in self.quality.values()]
        return any(changed)

    def switch(self, busy: bool, now_us: int) -> bool:
        """Switch to another link if necessary; return whether ``in_use`` has changed.

        While the station is ``busy`` with a transfer or a command, a working link is not left for a
        more preferred one, and a degraded link only for one with a much smaller loss, because a
        transfer begins again over the new link.
        """
        best = min(self.order, key=self._rank)
        usable, best_usable = self._usable(self.in_use), self._usable(best)
        if self.quality[self.in_use].state == "silent" and best_usable < STATE_RANK["silent"]:
            return self._use(best, "silent", now_us)
        if usable == STATE_RANK["degraded"]:
            gain = self._loss(self.in_use) - self._loss(best)
            better = best_usable < usable and not busy
            if (better or gain >= BETTER_LOSS) and self._dwelt(now_us):
                return self._use(best, "loss", now_us)
        if usable == STATE_RANK["up"] and not busy:
            for link in self.order[: self.order.index(self.in_use)]:
                since_us = self.quality[link].up_since_us
                if since_us is not None and now_us - since_us >= self._return_after_us:
                    self._returned_us = now_us
                    return self._use(link, "recovered", now_us)
        return False

    def _dwelt(self, now_us: int) -> bool:
        return self.switched_us is None or now_us - self.switched_us >= DWELL_US

    def _usable(self, link: int) -> int:
        return STATE_RANK[self.quality[link].state]

    def _loss(self, link: int) -> float:
        newest_us = self.quality[link].received_us
        loss = None if newest_us is None else self.quality[link].loss_share(newest_us)
        return 1.0 if loss is None else loss

    def _rank(self, link: int) -> tuple[int, float]:
        usable = self._usable(link)
        return usable, self._loss(link) if usable == STATE_RANK["degraded"] else 0.0

    def _use(self, link: int, cause: Cause, now_us: int) -> bool:
        if cause != "recovered":
            unstable = self._returned_us is not None and now_us - self._returned_us < UNSTABLE_US
            after_us = 2 * self._return_after_us if unstable else RETURN_AFTER_US
            self._return_after_us = min(after_us, MAX_RETURN_AFTER_US)
        self.in_use, self.cause, self.switched_us = link, cause, now_us
        return True
