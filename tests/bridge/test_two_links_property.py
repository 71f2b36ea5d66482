"""Two links with random losses, delays, duplicates and interruptions: what must always hold."""

from collections import Counter
from itertools import pairwise
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot_bridge.items import Items
from autopilot_bridge.missions.read_back import as_read_back
from autopilot_bridge.stacks.stacks import Stack, stack_named
from autopilot_bridge.vehicle.client_events import (
    CommandFinished,
    LinksChanged,
    ModeChanged,
    Position,
    Rebooted,
    Text,
    TransferFinished,
)
from tests.bridge.helpers import SECOND, line_of, mock_of
from tests.bridge.two_links import LTE, RADIO, TwoLinks, lines, random_cuts

SECONDS = 90
PX4, PLANE = stack_named("px4", "plane"), stack_named("ardupilot", "plane")


def world(stack: Stack, random: Random) -> TwoLinks:
    pairs = [
        lines(
            random.randrange(10**6),
            loss=random.choice([0.0, 0.1, 0.3]),
            delay_us=random.choice([10_000, 100_000, 600_000]),
            jitter_us=random.choice([0, 50_000]),
            duplication=random.choice([0.0, 0.1]),
        )
        for _ in range(2)
    ]
    return TwoLinks(mock_of(stack), pairs, routed=random.random() < 0.3)


@pytest.mark.parametrize("stack", [PX4, PLANE], ids=lambda s: s.name)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_what_must_hold_over_two_links(stack: Stack, seed: int) -> None:
    random = Random(seed)
    air = world(stack, random)
    air.run_for(8.0)
    began_us = air.now_us
    cuts = random_cuts(random, SECONDS)
    kinds = random.choices(["upload", "text", "mode"], k=12)
    due: list[tuple[float, object]] = [(at_s, (link, cut)) for at_s, link, cut in cuts]
    due += [(random.uniform(0.0, SECONDS), kind) for kind in kinds]
    sent: dict[int, Items] = {}
    mode = "hold"
    for at_s, action in sorted(due, key=lambda each: each[0]):
        air.run_for(max(at_s - (air.now_us - began_us) / SECOND, 0.0))
        match action:
            case (int() as link, bool() as is_cut):
                air.cut(link, is_cut)
            case "upload":
                items = line_of(random.randrange(5, 40), first=random.randrange(1, 100))
                by_file = random.random() < 0.5
                sent[air.client.upload(items, air.now_us, by_file=by_file)] = items
            case "text":
                air.mock.flight.texts.append((4, f"text at {at_s}"))
            case _:
                mode = "return" if mode == "hold" else "hold"
                air.client.command(mode, air.now_us)
    air.run_for(60.0)
    for link in (RADIO, LTE):
        air.cut(link, is_cut=False)
    for transfer_id in sent:
        air.result_of(transfer_id, 900.0)
    check(air, sent)
    minutes = (air.now_us - began_us) / SECOND / 60.0
    assert len([event for event in air.of(LinksChanged) if event.cause]) <= len(cuts) + 4 * minutes


def check(air: TwoLinks, sent: dict[int, Items]) -> None:
    stack = air.mock.stack
    assert not air.of(Rebooted)
    assert all(us >= 3 * SECOND for us in air.silences_us)
    texts = [event.text for event in air.of(Text) if event.text.startswith("text at")]
    assert max(Counter(texts).values(), default=0) <= 1
    boots = [position.boot_us for position in air.of(Position)]
    assert all(early < late for early, late in pairwise(boots))
    modes = [event.name for event in air.of(ModeChanged)]
    assert all(early != late for early, late in pairwise(modes))
    # An autopilot that receives no heartbeat of the station may return by itself.
    assert len(modes) <= 1 + len(air.of(CommandFinished)) + 2 * len(air.silences_us)
    ended = {event.transfer_id: event.result for event in air.of(TransferFinished)}
    assert ended.keys() == sent.keys()
    newest = max((key for key in sent if ended[key].outcome != "superseded"), default=None)
    if newest is not None and ended[newest].outcome == "accepted":
        held = air.mock.missions.items[1 if stack.item_0_is_home else 0 :]
        assert held == [as_read_back(item, stack) for item in sent[newest]]
