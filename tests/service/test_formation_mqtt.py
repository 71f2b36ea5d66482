"""UAVs exchange messages over a real Mosquitto without blocking; bad ones are rejected."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, cast

import aiomqtt
import pytest

from benchmarks.mosquitto import MOSQUITTO, Mosquitto
from mission_service.config.mqtt_names import Broker, check_prefix, read_broker, site_of
from mission_service.errors import MissionServiceError
from mission_service.interfaces.mqtt.command_inbox import Inbox
from mission_service.interfaces.mqtt.peer_exchange import (
    MAX_WAITING,
    OVERTAKEN,
    Channel,
    Outbox,
    PeerExchange,
    UnfitError,
    decoded,
    encoded,
)
from mission_service.peer_messages import (
    AnyMessage,
    Difference,
    Digest,
    FireUpdate,
    Goal,
    Leaving,
    State,
)
from tests.patience import PATIENCE_S, until

needs_mosquitto = pytest.mark.skipif(
    MOSQUITTO is None, reason="no mosquitto: apt-get install mosquitto"
)
CELLS = 10_000
CHANNEL = Channel(Broker("127.0.0.1"), "test", "fire")
LATEST_US = 3_600_000_000


def state(sender: str, at_us: int) -> State:
    return State(at_us, sender, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, -150.0, 17.5, False)


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    mosquitto = Mosquitto(tmp_path)
    yield mosquitto
    mosquitto.kill()


class Peer:
    """One vehicle's end of the exchange, and the messages that it received."""

    def __init__(self, name: str, port: int) -> None:
        self.name = name
        self.received: list[AnyMessage] = []
        self.announcements: list[str] = []
        self.mission_us = 0
        self.contacts: list[bool] = []
        channel = Channel(Broker("127.0.0.1", port), "test", "fire")
        self.exchange = PeerExchange(channel, [name], LATEST_US)

    def passed(self, mission_us: int) -> None:
        self.mission_us = max(self.mission_us, mission_us)

    def on_message(self, message: AnyMessage) -> None:
        self.received.append(message)

    def on_link(self, there: bool) -> None:
        self.contacts.append(there)

    def announce(self, text: str, warning: bool) -> None:
        self.announcements.append(text)

    def broadcast(self, at_us: int) -> None:
        self.exchange.broadcast(state(self.name, at_us))


@asynccontextmanager
async def connected_peers(port: int, *names: str) -> AsyncIterator[list[Peer]]:
    peers = [Peer(name, port) for name in names]
    tasks = [asyncio.create_task(peer.exchange.run(cast(Any, peer))) for peer in peers]
    try:
        yield peers
        assert not any(task.done() for task in tasks)
    finally:
        for task in tasks:
            task.cancel()
        _, left = await asyncio.wait(tasks, timeout=PATIENCE_S)
        assert not left, "it does not end"


ALL_KINDS: tuple[AnyMessage, ...] = (
    state("hawk", 1),
    FireUpdate(2, "hawk", (3, 4), (5,)),
    Digest(3, "hawk", ((1, 99),), 0, 9),
    Difference(4, "hawk", ((7, 2, 3, True),), (1,)),
    Leaving(5, "hawk", "fuel"),
    Goal(6, "hawk", 1.0, 2.0),
)


@needs_mosquitto
def test_all_kinds_reach_the_others_and_no_peer_receives_its_own(broker: Mosquitto) -> None:
    async def exchange() -> None:
        async with connected_peers(broker.port, "hawk", "kite", "wren") as (hawk, kite, wren):
            await until(lambda: all(one.exchange.connected for one in (hawk, kite, wren)))
            for message in ALL_KINDS:
                hawk.exchange.broadcast(message)
            await until(lambda: len(kite.received) == len(wren.received) == len(ALL_KINDS))
            assert set(kite.received) == set(wren.received) == set(ALL_KINDS)
            assert hawk.received == []

    broker.start()
    asyncio.run(exchange())


@needs_mosquitto
def test_impossible_messages_are_left_out_and_reported_once(broker: Mosquitto) -> None:
    async def exchange() -> None:
        async with (
            connected_peers(broker.port, "kite") as (kite,),
            aiomqtt.Client("127.0.0.1", broker.port) as stranger,
        ):
            await until(lambda: kite.exchange.connected)
            topic = CHANNEL.topic("hawk", "fireupdate")
            for payload in (b"", b"\xff{", b'{"type":"State"}', encoded(state("wren", 1))[1]):
                await stranger.publish(topic, payload)
            await stranger.publish(CHANNEL.topic("hawk", "odd"), b"x")
            await stranger.publish(topic, encoded(state("hawk", 9))[1])
            await until(lambda: bool(kite.received))
            assert kite.received == [state("hawk", 9)]
            assert kite.exchange.refused == {"hawk": 5}
            assert len([line for line in kite.announcements if "are ignored" in line]) == 1

    broker.start()
    asyncio.run(exchange())


@needs_mosquitto
def test_mission_time_is_the_latest_there_is_and_a_joining_peer_gets_it_at_once(
    broker: Mosquitto,
) -> None:
    async def exchange() -> None:
        async with connected_peers(broker.port, "hawk", "kite") as (hawk, kite):
            await until(lambda: hawk.exchange.connected and kite.exchange.connected)
            hawk.mission_us = 600_000_000
            await until(lambda: kite.mission_us == 600_000_000)
            async with connected_peers(broker.port, "wren") as (wren,):
                await until(lambda: wren.exchange.connected)
                await until(lambda: wren.mission_us == 600_000_000)
            async with aiomqtt.Client("127.0.0.1", broker.port) as stranger:
                absurd = (b"", b"-1", b"nan", b"9" * 17, str(LATEST_US + 1).encode())
                for number, payload in enumerate(absurd, start=1):
                    await stranger.publish(CHANNEL.topic("crow", "time"), payload)
                    await until(lambda number=number: hawk.exchange.refused["crow"] == number)  # type: ignore[misc]
            assert hawk.mission_us == 600_000_000

    broker.start()
    asyncio.run(exchange())


@needs_mosquitto
def test_a_broker_that_comes_late_dies_and_comes_again(broker: Mosquitto) -> None:
    async def exchange() -> None:
        async with connected_peers(broker.port, "hawk", "kite") as (hawk, kite):
            for at_us in range(1000):  # without a subscriber only the newest state is stored
                hawk.broadcast(at_us)
            await until(lambda: any("no broker" in line for line in hawk.announcements))
            broker.start()
            await until(lambda: hawk.exchange.connected and kite.exchange.connected)
            await until(lambda: hawk.exchange.sent["state"] == 1)
            hawk.broadcast(1000)
            await until(lambda: state("hawk", 1000) in kite.received)
            assert set(kite.received) <= {state("hawk", 999), state("hawk", 1000)}
            for number in range(2):
                broker.kill()
                await until(lambda: not hawk.exchange.connected and not kite.exchange.connected)
                hawk.broadcast(2000 + number)
                broker.start()
                await until(lambda: hawk.exchange.connected and kite.exchange.connected)
                hawk.broadcast(3000 + number)
                last = state("hawk", 3000 + number)
                await until(lambda last=last: last in kite.received)  # type: ignore[misc]
            assert len(hawk.announcements) <= 6, hawk.announcements
            assert hawk.contacts == []  # never as long as all of them need to return
            await until(lambda: hawk.contacts == kite.contacts == [True])
            broker.kill()
            await until(lambda: hawk.contacts == kite.contacts == [True, False])

    asyncio.run(exchange())


@needs_mosquitto
def test_a_frozen_broker_stops_nothing_else(broker: Mosquitto) -> None:
    async def exchange() -> None:
        async with connected_peers(broker.port, "hawk", "kite") as (hawk, kite):
            await until(lambda: hawk.exchange.connected and kite.exchange.connected)
            broker.freeze(True)
            longest_s, last_s = 0.0, time.monotonic()
            cells = tuple(range(CELLS))
            for number in range(200):  # about 10 MB, more than sockets buffer
                hawk.broadcast(number)
                hawk.exchange.broadcast(FireUpdate(number, "hawk", cells))
                await asyncio.sleep(0.005)
                now_s = time.monotonic()
                longest_s, last_s = max(longest_s, now_s - last_s), now_s
            # This would take for ever if anything waited for the broker.
            assert longest_s < PATIENCE_S / 2
            assert hawk.exchange.sent["fireupdate"] < 200  # other messages wait or are dropped
            broker.freeze(False)
            hawk.broadcast(1000)
            await until(lambda: state("hawk", 1000) in kite.received)

    broker.start()
    asyncio.run(exchange())


@needs_mosquitto
def test_it_ends_though_the_broker_takes_no_farewell(broker: Mosquitto) -> None:
    async def exchange() -> None:
        try:
            async with connected_peers(broker.port, "hawk") as (hawk,):
                await until(lambda: hawk.exchange.connected)
                broker.freeze(True)
                for number in range(200):  # until the sockets accept no more data
                    hawk.exchange.broadcast(FireUpdate(number, "hawk", tuple(range(CELLS))))
                    await asyncio.sleep(0.005)
        finally:  # otherwise a blocked call would also block here
            broker.kill()

    broker.start()
    asyncio.run(exchange())


def test_a_slow_peer_receives_only_the_newest_state_of_each() -> None:
    inbox = Inbox(3, newest=OVERTAKEN)
    for at_us in range(50):
        for name in ("hawk", "kite"):
            payload = encoded(state(name, at_us))[1]
            inbox.put_nowait(
                aiomqtt.Message(CHANNEL.topic(name, "state"), payload, 0, False, 0, None)
            )
    update = aiomqtt.Message(CHANNEL.topic("hawk", "fireupdate"), b"1", 0, False, 0, None)
    inbox.put_nowait(update)
    got = [inbox.get_nowait() for _ in range(inbox.qsize())]
    assert [each.payload for each in got[:2]] == [
        encoded(state(name, 49))[1] for name in ("hawk", "kite")
    ]
    for _ in range(5):
        inbox.put_nowait(update)
    assert inbox.qsize() == 3


def test_newer_states_overtake_and_the_rest_is_bounded() -> None:
    outbox = Outbox()
    for at_us in range(MAX_WAITING * 3):
        outbox.put(state("hawk", at_us))
        outbox.put(Digest(at_us, "hawk", ()))
        outbox.put(FireUpdate(at_us, "hawk", (1,)))
    taken = []
    while (message := outbox.pop()) is not None:
        taken.append(message)
    last_us = MAX_WAITING * 3 - 1
    assert taken[0] == state("hawk", last_us)
    assert taken[-1] == Digest(last_us, "hawk", ())
    updates = [message.at_us for message in taken if isinstance(message, FireUpdate)]
    assert updates == list(range(MAX_WAITING * 2, MAX_WAITING * 3))
    assert not outbox.is_not_empty.is_set()


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (state("kite", 1), "the message contains another sender, kite"),
        (state("hawk", LATEST_US + 1), "mission time 3600 s is after"),
        (Difference(1, "hawk", ((1, 1, 61_000_002, True),)), "observation time 61 s"),
        (FireUpdate(1, "hawk", (-1,)), "cannot be read"),
    ],
)
def test_messages_that_would_do_harm_are_named(message: AnyMessage, words: str) -> None:
    with pytest.raises(UnfitError, match=words):
        decoded("hawk", encoded(message)[1], LATEST_US)


@pytest.mark.parametrize("message", ALL_KINDS)
def test_messages_come_back_as_they_were(message: AnyMessage) -> None:
    assert decoded("hawk", encoded(message)[1], LATEST_US) == message


def test_names_of_brokers_and_topics() -> None:
    assert read_broker("broker.local") == Broker("broker.local", 1883)
    assert str(read_broker("127.0.0.1:1884")) == "127.0.0.1:1884"
    assert read_broker("[::1]:1884") == Broker("::1", 1884)
    for text in ("", "a:b", "a:0", "a:70000", "mqtt://a", "a b", "a..b"):
        with pytest.raises(MissionServiceError, match="HOST:PORT"):
            read_broker(text)
    assert check_prefix("uav/east") == "uav/east"
    for text in ("", "/a", "a/", "a/#", "+", "a b", "$SYS"):
        with pytest.raises(MissionServiceError, match="topic"):
            check_prefix(text)
    assert site_of("Eight UAVs / #1") == "Eight-UAVs-1"
    assert site_of("/") == "site"
    assert CHANNEL.topic("hawk", "+") == "test/v1/fire/formation/hawk/+"
