"""Combines the parts that handle the links of one vehicle. Pure.

The set selects the link over which this station sends (``link_selection.py``), discards duplicates
(``duplicate_filter.py``), and requests the message rates on each link, because autopilots have
separate rates for each of their telemetry ports.
"""

from autopilot_bridge.links.codec import Message
from autopilot_bridge.stacks.stacks import Stack
from autopilot_bridge.vehicle.client_events import LinksChanged
from autopilot_bridge.vehicle.duplicate_filter import DuplicateFilter
from autopilot_bridge.vehicle.link_selection import Cause, LinkSelection, LinkStatus
from autopilot_bridge.vehicle.message_rates import MessageRates, RatesHz

CHECK_EVERY_US = 500_000
REPORT_EVERY_US = 10_000_000  # minimum time between two reports of a changed loss
LOSS_CHANGED = 0.05


class LinkSet:
    """The links of one vehicle; there may be only one.

    Args:
        names: The addresses of the links, by link number.
        order: The numbers of this vehicle's links, the preferred link first.
        own: This station's system and component id.
        rates_hz: Message rates to request on each of several links; on a single link the client
            requests the rates itself.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        order: tuple[int, ...],
        own: tuple[int, int],
        rates_hz: RatesHz,
    ) -> None:
        self.order = order
        self._names = names
        self._selection: LinkSelection | None = None  # None before the first frame
        self._duplicates = DuplicateFilter()
        self._rates = {link: MessageRates(own, rates_hz) for link in order if len(order) > 1}
        self._target: tuple[Stack, tuple[int, int]] | None = None
        self._due_us: int | None = None
        self._reported: tuple[LinkStatus, ...] = ()
        self._reported_us = 0

    @property
    def in_use(self) -> int:
        """The number of the link over which this station sends."""
        return self.order[0] if self._selection is None else self._selection.in_use

    def on_frame(self, message: Message, link: int, own_component: bool, now_us: int) -> None:
        """Record a frame of the vehicle before duplicates are discarded.

        ``own_component`` is False for components other than the autopilot.
        """
        if self._selection is None:
            self._selection = LinkSelection(self.order, now_us)
            self._due_us = now_us + CHECK_EVERY_US
        quality = self._selection.quality[link]
        if own_component:
            quality.on_frame(message.get_seq(), now_us)
        else:
            quality.on_other_component(message.get_seq())

    def is_usable(self, message: Message, link: int, now_us: int) -> bool:
        """Return whether to use a message, i.e. whether it is not a duplicate."""
        if len(self.order) == 1:
            return True
        return self._duplicates.is_usable(message, link, self.in_use, now_us)

    def request_rates(self, stack: Stack, target: tuple[int, int], now_us: int) -> list[Message]:
        """Request the message rates on all links that are not silent."""
        self._target = (stack, target)
        requests = []
        for link in self._rates:
            if self._selection is None or self._selection.quality[link].state != "silent":
                requests += self._request_rates(link, now_us)
        return requests

    def _request_rates(self, link: int, now_us: int) -> list[Message]:
        if self._target is None:
            return []
        return _over(link, self._rates[link].begin(*self._target, now_us))

    def continue_rates(self, message: Message, link: int, now_us: int) -> list[Message]:
        """Record a message on a link; return the next request after an acknowledgement."""
        rates = self._rates.get(link)
        return [] if rates is None else _over(link, rates.receive(message, now_us))

    def next_timer(self) -> int | None:
        """Return the time of the next ``handle_timer`` call; None before the first frame."""
        return self._due_us

    def handle_timer(self, busy: bool, now_us: int) -> tuple[list[Message], LinksChanged | None]:
        """Select the link to use, and request message rates on links that work again.

        Args:
            busy: Whether a transfer or a command is in progress.
            now_us: Time in microseconds.

        Returns:
            The requests to send, and the changes; ``LinksChanged.cause`` is set after a switch.
        """
        selection = self._selection
        if selection is None or self._due_us is None or now_us < self._due_us:
            return [], None
        self._due_us = now_us + CHECK_EVERY_US
        before = {link: quality.state for link, quality in selection.quality.items()}
        changed = selection.renew_states(now_us)
        requests: list[Message] = []
        for link, rates in self._rates.items():
            state = selection.quality[link].state
            if state in ("up", "degraded") and before[link] in ("silent", "waiting"):
                requests += self._request_rates(link, now_us)
            elif state != "silent":
                requests += _over(link, rates.handle_timer(now_us))
        switched = selection.switch(busy, now_us)
        if switched:
            self._duplicates.link_switched(now_us)
        return requests, self._report(changed, switched, now_us)

    def _report(self, changed: bool, switched: bool, now_us: int) -> LinksChanged | None:
        assert self._selection is not None
        statuses = tuple(
            LinkStatus(
                self._names[link], quality.state, quality.loss_share(now_us), quality.received_us
            )
            for link, quality in self._selection.quality.items()
        )
        may_repeat = now_us - self._reported_us >= REPORT_EVERY_US
        due = may_repeat and _losses_differ(statuses, self._reported or statuses)
        if not (changed or switched or due):
            return None
        self._reported, self._reported_us = statuses, now_us
        cause: Cause = self._selection.cause if switched else ""
        return LinksChanged(now_us, statuses, self._names[self.in_use], cause)


def _losses_differ(now: tuple[LinkStatus, ...], before: tuple[LinkStatus, ...]) -> bool:
    """Return whether the loss of a link has become known or has changed much."""
    for new, old in zip(now, before, strict=True):
        if new.loss_share is None or old.loss_share is None:
            if new.loss_share is not old.loss_share:
                return True
        elif abs(new.loss_share - old.loss_share) >= LOSS_CHANGED:
            return True
    return False


def _over(link: int, messages: list[Message]) -> list[Message]:
    """Mark the messages to be sent over ``link``, whichever link is in use, and return them."""
    for message in messages:
        message.over_link = link
    return messages
