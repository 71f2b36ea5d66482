"""The live stream: newest states in order, bounded memory, and disconnected clients."""

import asyncio
import gc
from typing import Any

import msgspec
import pytest

from mission_service.interfaces.api import live_stream
from mission_service.interfaces.api.access import guard
from mission_service.interfaces.api.live_stream import MAX_STREAMS, LiveStream
from mission_service.interfaces.api.server import Connection
from mission_service.runtime.published_states import TelemetryState
from tests.api.worlds import Served, World, client, listened_to, served, stream_of
from tests.patience import PATIENCE_S, until


def events_of(text: bytes) -> list[tuple[str, int, Any]]:
    """Return (event, id, data) of each event, without comment lines."""
    found = []
    for block in text.decode().split("\n\n"):
        if block and not block.startswith(":"):
            event, number, data = (line.split(": ", 1)[1] for line in block.split("\n"))
            found.append((event, int(number), msgspec.json.decode(data)))
    return found


class Reader:
    """A client of a stream without a network; it can stop reading and disconnect."""

    def __init__(self, service: Served, since: int = 0) -> None:
        user = service.app.api.tokens.user_of(service.tokens["look"])
        assert user is not None
        tokens = service.app.api.tokens
        self._response = LiveStream(service.app.api.streams, since, lambda: tokens.still(user))
        self.reads, self.disconnected = asyncio.Event(), asyncio.Event()
        self.reads.set()
        self.batches: list[bytes] = []
        self.ended = False
        self.task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        await self._response({"type": "http"}, self._receive, self._send)

    async def _receive(self) -> dict[str, str]:
        await self.disconnected.wait()
        return {"type": "http.disconnect"}

    async def _send(self, message: Any) -> None:
        await self.reads.wait()
        if message["type"] == "http.response.body":
            self.batches.append(message["body"])
            self.ended = not message.get("more_body", False)

    @property
    def events(self) -> list[tuple[str, int, Any]]:
        return events_of(b"".join(self.batches))

    async def until(self, count: int) -> None:
        """Wait until this number of batches has arrived."""
        await until(lambda: len(self.batches) >= count)


def moves(world: World, lat_deg: float) -> None:
    """Change the position of a vehicle."""
    state_view = world.context.state_view
    before = state_view.telemetry["hawk"]
    fields = {**msgspec.structs.asdict(before), "lat_deg": lat_deg}
    state_view.telemetry["hawk"] = TelemetryState(**fields)
    state_view._touch("telemetry/hawk")
    world.context.ring()


def test_a_new_client_gets_all_and_then_what_changes(flying: World) -> None:
    async def go() -> None:
        reader = Reader(served(flying))
        await reader.until(1)
        kinds = {event for event, _, _ in reader.events}
        assert kinds == {
            "vehicle", "telemetry", "mission", "fire", "sources", "burn", "airspace", "alarms",
            "announcements", "records", "status",
        }  # fmt: skip
        numbers = [number for _, number, _ in reader.events]
        assert numbers == sorted(numbers)
        moves(flying, 36.5)
        await reader.until(2)
        ((event, number, position),) = events_of(reader.batches[1])
        assert (event, number) == ("telemetry", flying.context.state_view.version)
        assert position["lat_deg"] == 36.5
        assert position == msgspec.to_builtins(flying.context.state_view.telemetry["hawk"])
        reader.disconnected.set()
        await reader.task

    asyncio.run(go())


def test_a_hundred_changes_are_one_for_a_client_that_did_not_read(flying: World) -> None:
    async def go() -> None:
        reader = Reader(served(flying), flying.context.state_view.version)
        moves(flying, 35.9)
        await reader.until(1)
        reader.reads.clear()
        for step in range(100):
            moves(flying, 36.0 + step / 1000.0)
            await asyncio.sleep(0.0005)
        reader.reads.set()
        await until(lambda: reader.events[-1][2]["lat_deg"] == 36.099)
        places = [position["lat_deg"] for _, _, position in reader.events[1:]]
        assert len(places) <= 3  # the batch that was being sent, and the newest batch
        assert places[-1] == 36.099
        reader.disconnected.set()
        await reader.task

    asyncio.run(go())


def test_a_reconnected_client_gets_what_it_missed_and_no_line_twice(flying: World) -> None:
    async def go() -> None:
        service, state_view = served(flying), flying.context.state_view
        for word in ("one", "two"):
            state_view.announce("hawk", word)
        since = state_view.version
        state_view.announce("hawk", "three")
        moves(flying, 36.4)
        reader = Reader(service, since)
        await reader.until(1)
        (announcements, moved) = reader.events
        assert [line["text"] for line in announcements[2]] == ["three"]
        assert moved[0] == "telemetry"
        # After a restart the versions begin again, so all states are sent again.
        late = Reader(service, state_view.version + 1000)
        await late.until(1)
        assert len(late.events) > 6
        for each in (reader, late):
            each.disconnected.set()
            await each.task

    asyncio.run(go())


def test_a_stream_without_events_sends_keepalives_and_ends_with_its_token(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_stream, "SENT_EVERY_S", 0.02)

    async def go() -> None:
        service = served(flying)
        reader = Reader(service, flying.context.state_view.version)
        await reader.until(3)
        assert set(reader.batches) == {b": \n\n"}
        service.app.api.tokens._users = ()
        await asyncio.wait_for(reader.task, PATIENCE_S)
        assert reader.ended
        assert service.app.api.streams.count == 0

    asyncio.run(go())


def test_a_busy_stream_ends_with_its_token_too(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_stream, "SENT_EVERY_S", 0.05)

    async def go() -> None:
        service = served(flying)
        reader = Reader(service, flying.context.state_view.version)
        service.app.api.tokens._users = ()
        async with asyncio.timeout(PATIENCE_S):
            step = 0
            while not reader.ended:
                step += 1
                moves(flying, 36.0 + step % 100 / 1000.0)
                await asyncio.sleep(0.005)

    asyncio.run(go())


def test_states_are_encoded_once_for_all(flying: World, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    async def go() -> None:
        service = served(flying)
        frames = service.app.api.frames
        state = frames._state

        def counted(kind: str, name: str) -> Any:
            made.append(kind)
            return state(kind, name)

        monkeypatch.setattr(frames, "_state", counted)
        readers = [Reader(service, flying.context.state_view.version) for _ in range(5)]
        await until(lambda: service.app.api.streams.count == 5)
        moves(flying, 36.7)
        for reader in readers:
            await reader.until(1)
            reader.disconnected.set()
            await reader.task

    asyncio.run(go())
    assert made == ["telemetry"]


def test_there_are_so_many_streams_and_no_more(flying: World) -> None:
    async def go() -> None:
        service = served(flying)
        readers = [Reader(service) for _ in range(MAX_STREAMS)]
        for reader in readers:
            await reader.until(1)
        async with client(service.app) as http:
            answer = await http.get("/api/v1/live", headers=service.headers())
        assert answer.status_code == 503
        assert "32 live streams" in answer.json()["error"]
        for reader in readers:
            reader.disconnected.set()
            await reader.task
        assert service.app.api.streams.count == 0

    asyncio.run(go())


def test_telemetry_is_sent_at_once_and_not_with_the_next_beat(
    flying: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    took_s = []

    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address:
            reader, writer = await stream_of(service, address)
            loop = asyncio.get_running_loop()
            for step in range(40):
                await reader.read(2**20)
                began_s = loop.time()
                moves(flying, 36.0 + step / 1000.0)
                await reader.readuntil(b"telemetry/1")
                took_s.append(loop.time() - began_s)
                await asyncio.sleep(0.002)
            writer.close()

    monkeypatch.setattr(live_stream, "SENT_EVERY_S", 2 * PATIENCE_S)
    asyncio.run(go())
    assert sorted(took_s)[len(took_s) // 2] < PATIENCE_S  # benchmarks.load measures the delay


def test_a_client_that_does_not_read_is_disconnected_and_holds_no_memory(
    standing: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "SEND_WITHIN_S", 0.4)
    most = 0

    async def go() -> None:
        nonlocal most
        service = served(standing)
        streams, announcements = service.app.api.streams, standing.context.state_view
        async with listened_to(service) as address:
            _, writer = await stream_of(service, address, limit=1024)
            found = [each for each in gc.get_objects() if isinstance(each, Connection)]

            def buffered() -> int:
                return sum(each.transport.get_write_buffer_size() for each in found)

            writer.transport.pause_reading()  # type: ignore[attr-defined]
            async with asyncio.timeout(PATIENCE_S):
                while streams.count:
                    for _ in range(20):
                        announcements.announce("hawk", "x" * 5000)
                    standing.context.ring()
                    await asyncio.sleep(0.002)
                    most = max(most, buffered())
            assert streams.count == 0
            # Batches that the client did not read are discarded.
            await until(lambda: buffered() == 0)
            writer.close()

    asyncio.run(go())
    assert (
        0 < most < 3_000_000
    )  # 500 announcements of 5 kB, and the data that the transport may buffer


def test_a_disconnected_client_is_noticed(flying: World) -> None:
    async def go() -> None:
        service = served(flying)
        async with listened_to(service) as address:
            _, writer = await stream_of(service, address)
            assert service.app.api.streams.count == 1
            writer.transport.abort()
            await until(lambda: service.app.api.streams.count == 0)

    asyncio.run(go())
