"""A client and a mock with two channels, connected by two links in virtual time."""

from dataclasses import dataclass, field
from random import Random
from typing import Any

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.links.framing import frames_of, message_id_of
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.vehicle.client_events import (
    ClientEvent,
    LinkLost,
    LinksChanged,
)
from tests.bridge.helpers import SECOND, Noting, ReceivedEvents

RADIO, LTE = 0, 1
NAMES = ("radio", "lte")


def lines(
    seed: int, loss: float = 0.0, delay_us: int = 20_000, **more: Any
) -> tuple[Noting, Noting]:
    """Return both directions of a link, with the loss of each direction."""
    up, down = (
        Noting(loss=loss, delay_us=delay_us, seed=seed + number, **more) for number in (0, 1)
    )
    return up, down


@dataclass
class TwoLinks(ReceivedEvents):
    """A vehicle over one or two links; ``lines`` are the directions (up, down) of each link."""

    mock: MockAutopilot
    lines: list[tuple[Noting, Noting]]
    routed: bool = False  # a router sends all frames of the first channel over all links
    now_us: int = 500_000 * SECOND
    events: list[ClientEvent] = field(default_factory=list)
    remotes: tuple[str, ...] = ("air", "air")
    heartbeat_us: int = 0  # arrival of the last heartbeat over any link
    silences_us: list[int] = field(default_factory=list)  # before each loss of the link

    def __post_init__(self) -> None:
        count = len(self.lines)
        self.link = SharedLink(NAMES[:count], expects=True)
        self.client: NativeClient = self.link.expect(1, links=tuple(range(count)))
        self.mock.open_channels(1 if self.routed else count)

    def cut(self, link: int, is_cut: bool = True) -> None:
        for line in self.lines[link]:
            line.cut = is_cut

    def run_for(self, seconds: float) -> None:
        end_us = self.now_us + round(seconds * SECOND)
        while True:
            timers: list[int | None] = [self.link.next_timer(), self.mock.next_timer()]
            timers += [line.next_timer() for pair in self.lines for line in pair]
            due_us = max(min(each for each in timers if each is not None), self.now_us)
            if due_us > end_us:
                self.now_us = end_us
                return
            self.now_us = due_us
            self.exchange()

    def exchange(self) -> None:
        now_us = self.now_us
        for link, (up, _) in enumerate(self.lines):
            for datagram in up.receive(now_us):
                self.mock.receive_on_channel(0 if self.routed else link, datagram, now_us)
        self.mock.handle_timer(now_us)
        for channel, datagram in self.mock.channel_data_to_send():
            for link in range(len(self.lines)) if self.routed else (channel,):
                self.lines[link][1].send(datagram, now_us)
        for link, (_, down) in enumerate(self.lines):
            for datagram in down.receive(now_us):
                if message_id_of(datagram) == 0:
                    self.heartbeat_us = now_us
                self.link.receive_frames(self.remotes[link], frames_of(datagram), now_us, link)
        self.link.handle_timer(now_us)
        while (event := self.client.next_event()) is not None:
            self.events.append(event)
            if isinstance(event, LinkLost):
                self.silences_us.append(now_us - self.heartbeat_us)
        for link, _, datagram in self.link.addressed_to_send():
            self.lines[link][0].send(datagram, now_us)
        self.client.validate_state()

    @property
    def in_use(self) -> str:
        changes = self.of(LinksChanged)
        return changes[-1].in_use if changes else NAMES[0]

    @property
    def states(self) -> tuple[str, ...]:
        return tuple(status.state for status in self.of(LinksChanged)[-1].links)


def random_cuts(random: Random, seconds: float) -> list[tuple[float, int, bool]]:
    """Return the times at which links are cut and restored."""
    found = []
    for link in (RADIO, LTE):
        at_s = random.uniform(1.0, 20.0)
        while at_s < seconds:
            found.append((at_s, link, True))
            at_s += random.uniform(1.0, 25.0)
            found.append((at_s, link, False))
            at_s += random.uniform(2.0, 40.0)
    return sorted(found)
