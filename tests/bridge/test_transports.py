"""Links over real sockets on loopback and over pseudo-terminals."""

import asyncio
import contextlib
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.streams import MAX_UNSENT_BYTES
from tests.bridge.transport_helpers import (
    Peer,
    clock_us,
    free_port,
    receive_exactly,
    run,
    text,
    udp_socket,
)
from tests.patience import PATIENCE_S

NOISE = b"\x00noise\xfd\x40\x00\x01 and \xfe more"


class Server:
    """A TCP server that can stop and start again on its port."""

    def __init__(self) -> None:
        self.port = free_port(socket.SOCK_STREAM)
        self.link = f"tcp:127.0.0.1:{self.port}"
        self._server: asyncio.Server | None = None
        self._calls: asyncio.Queue[tuple[asyncio.StreamReader, asyncio.StreamWriter]]

    async def come(self) -> None:
        self._calls = asyncio.Queue()

        async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._calls.put_nowait((reader, writer))

        self._server = await asyncio.start_server(take, "127.0.0.1", self.port)

    async def called(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await self._calls.get()

    def go(self) -> None:
        assert self._server is not None
        self._server.close()


# UDP ------------------------------------------------------------------------------------------


def test_torn_datagrams_of_two_remotes_do_not_spoil_each_other() -> None:
    async def exchange() -> None:
        port, peer = free_port(), Peer()
        link = f"udpin:127.0.0.1:{port}"
        async with Connection(link, peer, clock_us) as connection:
            with udp_socket() as one, udp_socket() as two:
                where = ("127.0.0.1", port)
                first, second = text("first of one"), text("second of two")
                one.sendto(first[:12], where)
                two.sendto(second[:15], where)
                one.sendto(first[12:], where)
                two.sendto(NOISE, where)  # the frame of this remote is lost
                two.sendto(text("third of two"), where)
                await receive_exactly(connection, peer, "first of one", "third of two")

    run(exchange)


def test_noise_and_frames_in_one_datagram() -> None:
    async def exchange() -> None:
        port, peer = free_port(), Peer()
        async with Connection(f"udpin:127.0.0.1:{port}", peer, clock_us) as connection:
            with udp_socket() as one:
                one.sendto(NOISE + text("a") + NOISE + text("b"), ("127.0.0.1", port))
                one.sendto(text("c"), ("127.0.0.1", port))
                await receive_exactly(connection, peer, "a", "b", "c")

    run(exchange)


def test_udpin_answers_all_senders_of_frames_and_no_others() -> None:
    async def exchange() -> None:
        port, peer = free_port(), Peer()
        where = ("127.0.0.1", port)
        async with Connection(f"udpin:127.0.0.1:{port}", peer, clock_us) as connection:
            with udp_socket() as one, udp_socket() as two, udp_socket() as stranger:
                one.sendto(text("one"), where)
                two.sendto(text("two"), where)
                stranger.sendto(b"GET / HTTP/1.0", where)
                one.sendto(text("three"), where)
                await receive_exactly(connection, peer, "one", "two", "three")
                peer.outgoing = [text("answer")]
                connection.flush()
                assert one.recv(300) == two.recv(300) == text("answer")
                stranger.settimeout(0.1)
                with pytest.raises(TimeoutError):
                    stranger.recv(300)

    run(exchange)


def test_udpout_survives_a_port_that_is_not_yet_open() -> None:
    async def exchange() -> None:
        peer = Peer()
        with udp_socket() as other:
            port = other.getsockname()[1]
        async with Connection(f"udpout:127.0.0.1:{port}", peer, clock_us) as connection:
            for _ in range(3):
                peer.outgoing = [text("hello?")]
                connection.flush()
                await asyncio.sleep(0.01)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
                other.bind(("127.0.0.1", port))
                other.settimeout(PATIENCE_S)
                peer.outgoing = [text("hello")]
                connection.flush()
                data, where = other.recvfrom(300)
                assert data == text("hello")
                other.sendto(text("here"), where)
                await receive_exactly(connection, peer, "here")

    run(exchange)


def test_a_burst_waits_in_the_socket_while_the_program_is_busy() -> None:
    limit = Path("/proc/sys/net/core/rmem_max")
    if not limit.exists() or int(limit.read_text()) < 2_000_000:
        pytest.skip("this machine grants no large receive buffers")

    async def exchange() -> None:
        port, peer = free_port(), Peer()
        async with Connection(f"udpin:127.0.0.1:{port}", peer, clock_us) as connection:
            with udp_socket() as one:
                names = [str(index) for index in range(1500)]  # a usual buffer contains about 280
                for name in names:
                    one.sendto(text(name), ("127.0.0.1", port))
                await receive_exactly(connection, peer, *names)

    run(exchange)


# TCP ------------------------------------------------------------------------------------------


def test_frames_torn_over_tcp_come_whole() -> None:
    async def exchange() -> None:
        server, peer = Server(), Peer()
        await server.come()
        async with Connection(server.link, peer, clock_us) as connection:
            _, writer = await server.called()
            for piece in (text("one")[:9], text("one")[9:] + NOISE + text("two")[:1]):
                writer.write(piece)
                await writer.drain()
                await asyncio.sleep(0.02)  # so that each part is read separately
            writer.write(text("two")[1:] + text("three" * 9) + bytes(100))
            await receive_exactly(connection, peer, "one", "two", "three" * 9)
            writer.close()
        server.go()

    run(exchange)


def test_a_server_that_goes_away_and_comes_back_is_called_again() -> None:
    async def exchange() -> None:
        server, peer = Server(), Peer()
        async with Connection(server.link, peer, clock_us) as connection:
            await asyncio.sleep(0.05)  # no client is connected yet
            await server.come()
            for name in ("first", "second", "third"):
                reader, writer = await server.called()
                writer.write(text(name))
                await receive_exactly(
                    connection, peer, *("first", "second", "third")[: len(peer.received) + 1]
                )
                peer.outgoing = [text("received " + name)]
                connection.flush()
                assert await reader.readexactly(len(text("received " + name))) == text(
                    "received " + name
                )
                writer.write(text("torn")[:8])  # must not be joined to later bytes
                await writer.drain()
                writer.close()
                if name == "first":
                    server.go()
                    await asyncio.sleep(0.4)
                    peer.outgoing = [text("lost")]
                    connection.flush()
                    await server.come()
        server.go()

    run(exchange)


def test_tcpin_serves_several_and_answers_all() -> None:
    async def exchange() -> None:
        port, peer = free_port(socket.SOCK_STREAM), Peer()
        async with Connection(f"tcpin:127.0.0.1:{port}", peer, clock_us) as connection:
            one_in, one = await asyncio.open_connection("127.0.0.1", port)
            two_in, two = await asyncio.open_connection("127.0.0.1", port)
            for writer, piece in (
                (one, text("a")[:11]),
                (two, text("b")[:5]),
                (one, text("a")[11:]),
            ):
                writer.write(piece)
                await writer.drain()
                await asyncio.sleep(0.02)
            two.write(text("b")[5:])
            await receive_exactly(connection, peer, "a", "b")
            peer.outgoing = [text("to both")]
            connection.flush()
            for reader in (one_in, two_in):
                assert await reader.readexactly(len(text("to both"))) == text("to both")
            one.close()
            await one.wait_closed()
            two.write(text("c"))
            await receive_exactly(connection, peer, "a", "b", "c")
            peer.outgoing = [text("to you")]
            connection.flush()
            assert await two_in.readexactly(len(text("to you"))) == text("to you")
        assert await two_in.read() == b""  # the connection was closed
        two.close()

    run(exchange)


def test_what_a_remote_does_not_read_is_dropped_in_whole_frames() -> None:
    async def exchange() -> None:
        port, peer = free_port(socket.SOCK_STREAM), Peer()
        frame = text("x" * 50)
        async with Connection(f"tcpin:127.0.0.1:{port}", peer, clock_us) as connection:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(text("hello"))
            await receive_exactly(connection, peer, "hello")
            for _ in range(1000):
                peer.outgoing = [frame] * 300
                connection.flush()
            (stream,) = connection.ports[0].transport._streams  # type: ignore[attr-defined]
            waiting = stream.out.get_write_buffer_size()
            assert MAX_UNSENT_BYTES < waiting < MAX_UNSENT_BYTES + 300 * len(frame)
            closing = asyncio.create_task(stream.close())
            got = await reader.read(-1)
            await closing
            assert len(got) > waiting
            assert len(got) % len(frame) == 0
            writer.close()

    run(exchange)


def test_leaving_does_not_wait_for_a_remote_that_does_not_read() -> None:
    async def exchange() -> None:
        port, peer = free_port(socket.SOCK_STREAM), Peer()
        with contextlib.ExitStack() as stack:
            async with Connection(f"tcpin:127.0.0.1:{port}", peer, clock_us) as connection:
                deaf = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
                deaf.send(text("hello"))
                await receive_exactly(connection, peer, "hello")
                peer.outgoing = [text("x" * 50)] * 200_000
                connection.flush()

    run(exchange)


def test_a_tcp_port_in_use_is_named() -> None:
    async def twice() -> None:
        link = f"tcpin:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        async with Connection(link, Peer(), clock_us), Connection(link, Peer(), clock_us):
            pass

    with pytest.raises(BridgeError, match=r"tcpin:127\.0\.0\.1:\d+: .*another program"):
        run(twice)


@pytest.mark.parametrize("kind", ["tcp", "udpout", "udpin", "tcpin"])
def test_a_host_that_cannot_be_is_named(kind: str) -> None:
    async def call() -> None:
        async with Connection(f"{kind}:no..host:5760", Peer(), clock_us):
            pass

    with pytest.raises(BridgeError, match=r"no\.\.host") as caught:
        run(call)
    assert "\n" not in str(caught.value)


# Serial lines ---------------------------------------------------------------------------------


@contextlib.contextmanager
def line_at(path: Path) -> Iterator[int]:
    """Return the other end of a pseudo-terminal that is connected as ``path``."""
    master, device = os.openpty()
    path.unlink(missing_ok=True)
    path.symlink_to(os.ttyname(device))
    os.close(device)
    try:
        yield master
    finally:
        os.close(master)


async def read_exactly(descriptor: int, count: int) -> bytes:
    os.set_blocking(descriptor, False)
    data = b""
    while len(data) < count:
        with contextlib.suppress(BlockingIOError):
            data += os.read(descriptor, count - len(data))
        await asyncio.sleep(0.005)
    return data


def test_a_serial_line_carries_frames_both_ways_and_is_opened_again(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    device = tmp_path / "ttyRADIO"

    async def exchange() -> None:
        peer = Peer()
        with line_at(device) as line:
            connection = Connection(f"serial:{device}:57600", peer, clock_us)
            await connection.__aenter__()
            every_byte = bytes(range(256))  # no byte may be interpreted as a control character
            os.write(line, every_byte + text("torn")[:6])
            await asyncio.sleep(0.03)
            os.write(line, text("torn")[6:] + bytes(300))
            await receive_exactly(connection, peer, "torn")
            frame = text("\r\n\x03\x04\x11 raw")
            peer.outgoing = [frame]
            connection.flush()
            assert await read_exactly(line, len(frame)) == frame
        device.unlink()  # disconnected
        await asyncio.sleep(0.4)
        peer.outgoing = [text("lost")]
        connection.flush()
        with line_at(device) as line:
            peer.received.clear()
            while not peer.received:  # opening discards earlier data
                os.write(line, text("back"))
                await asyncio.sleep(0.05)
            assert peer.received[0] == "back"
            await connection.__aexit__(None, None, None)

    run(exchange)


def test_a_device_that_is_not_there_is_named(tmp_path: Path) -> None:
    pytest.importorskip("serial")

    async def call(link: str) -> None:
        async with Connection(link, Peer(), clock_us):
            pass

    with pytest.raises(BridgeError, match=r"ttyNONE:57600: .*No such file.*connected") as caught:
        run(lambda: call(f"serial:{tmp_path}/ttyNONE:57600"))
    assert "\n" not in str(caught.value)
    (tmp_path / "file").write_text("no terminal")
    with pytest.raises(BridgeError, match=r"file:57600: cannot be opened"):
        run(lambda: call(f"serial:{tmp_path}/file:57600"))


def test_two_programs_do_not_share_a_serial_line(tmp_path: Path) -> None:
    pytest.importorskip("serial")
    link = f"serial:{tmp_path}/tty:57600"

    async def twice() -> None:
        async with Connection(link, Peer(), clock_us), Connection(link, Peer(), clock_us):
            pass

    with line_at(tmp_path / "tty"), pytest.raises(BridgeError, match="no other program"):
        run(twice)


def test_without_pyserial_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)

    async def call() -> None:
        async with Connection("serial:/dev/ttyACM0:57600", Peer(), clock_us):
            pass

    with pytest.raises(BridgeError, match="pip install pyserial"):
        run(call)
