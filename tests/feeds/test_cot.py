"""Cursor on Target: the contents of events, and their transmission by each transport."""

import asyncio
import contextlib
import re
import shutil
import socket
import ssl
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from pydantic import ValidationError

from mission_service.config.service_section import CotSection, MqttSection
from mission_service.interfaces.cot import cot_sender as cot_sender
from mission_service.interfaces.cot.cot_events import (
    MAX_CORNERS,
    fire_events,
    mission_event,
    vehicle_event,
    zulu,
)
from mission_service.interfaces.cot.cot_sender import cot_interface
from mission_service.runtime.published_states import (
    ItemState,
    Mission,
    MissionState,
    TelemetryState,
)
from mission_service.runtime.run_context import RunContext
from tests.feeds.background import in_background
from tests.mqtt.certificates import make_certificates
from tests.mqtt.stage import context_of, fix
from tests.patience import PATIENCE_S, until

UNIX_US = 1_795_304_000_250_000


def test_a_vehicle_is_at_its_reported_position_and_grows_stale() -> None:
    state = TelemetryState(7, "hawk", 36.5, -84.25, 560.4, 250.0, 149.6, 40.0, 18.25, 43.2)
    event = ElementTree.fromstring(vehicle_event(state, "plane", "east", UNIX_US, 6_000_000))
    assert (event.get("uid"), event.get("type")) == ("east.hawk", "a-f-A-M-F-Q")
    assert (event.get("version"), event.get("how")) == ("2.0", "m-g")
    assert event.get("time") == event.get("start") == "2026-11-21T23:33:20.250Z"
    assert event.get("stale") == "2026-11-21T23:33:26.250Z"
    point, track = event.find("point"), event.find("detail/track")
    assert point is not None
    assert track is not None
    assert (point.get("lat"), point.get("lon")) == ("36.5000000", "-84.2500000")
    assert point.get("hae") == "9999999.0"  # not the height above sea level
    assert (track.get("course"), track.get("speed")) == ("43.2", "18.25")
    assert event.findtext("detail/remarks") == "560 m above sea level, 150 m above ground"
    copter = vehicle_event(state, "copter", "east", UNIX_US, 1)
    assert ElementTree.fromstring(copter).get("type") == "a-f-A-M-H-Q"


def test_times_are_written_with_milliseconds() -> None:
    assert zulu(0) == "1970-01-01T00:00:00.000Z"
    assert zulu(1_999) == "1970-01-01T00:00:00.001Z"


def front_of(*rings: list[tuple[float, float]]) -> dict[str, Any]:
    geometry = {"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}
    return {"geometry": geometry, "properties": {"area_ha": 12.34}}


def test_the_fire_is_closed_shapes_the_largest_first_with_corners_enough_for_a_datagram() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 3001)
    wiggle = 0.01 + 0.0002 * np.sin(40.0 * angles)
    round_ = [
        (-84 + r * np.sin(a), 36 + r * np.cos(a)) for r, a in zip(wiggle, angles, strict=True)
    ]
    round_[-1] = round_[0]
    small = [(-85.0, 36.0), (-84.999, 36.0), (-84.999, 36.001), (-85.0, 36.0)]
    large, little = (
        ElementTree.fromstring(event)
        for event in fire_events(front_of(small, round_), "east", UNIX_US, 1)
    )
    assert (large.get("uid"), little.get("uid")) == ("east.fire.1", "east.fire.2")
    assert (large.get("type"), large.get("how")) == ("u-d-f", "m-s")
    for event, most in ((large, MAX_CORNERS), (little, 4)):
        links = [link.get("point") for link in event.iterfind("detail/link")]
        assert 4 <= len(links) <= most
        assert links[0] == links[-1]  # the connection is closed
        assert re.fullmatch(r"3[56]\.\d{6},-8[345]\.\d{6}", str(links[0]))
        assert len(ElementTree.tostring(event)) < 20_000
    assert "12.3 ha" in (large.findtext("detail/remarks") or "")
    assert list(fire_events(front_of(), "east", UNIX_US, 1)) == []


@asynccontextmanager
async def sending(url: str, **more: Any) -> AsyncIterator[RunContext]:
    context = context_of(MqttSection(), lambda request: {})
    run_interface = cot_interface(CotSection(url=url, every_s=0.1, **more), "Fire & more")
    async with in_background(run_interface(context)):
        yield context


def test_events_are_sent_by_udp_and_only_for_vehicles_with_a_new_position() -> None:
    async def look() -> None:
        loop = asyncio.get_running_loop()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.bind(("127.0.0.1", 0))
            sock.setblocking(False)
            async with sending(f"udp://127.0.0.1:{sock.getsockname()[1]}") as context:
                context.state_view.apply(fix(1), [])
                async with asyncio.timeout(PATIENCE_S):
                    uids = []
                    while "Fire-more.hawk" not in uids or "Fire-more.fire.1" not in uids:
                        event = ElementTree.fromstring(await loop.sock_recv(sock, 65_536))
                        uids.append(event.get("uid"))
                    # In later rounds the part is not sent any more.
                    fires = 0
                    while fires < 3:
                        data = await loop.sock_recv(sock, 65_536)
                        assert b"hawk" not in data
                        fires += b"Fire-more.fire.1" in data

    asyncio.run(look())


def test_positions_from_the_journal_are_not_sent_after_a_restart() -> None:
    async def look() -> None:
        tak = bytearray()

        async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            while data := await reader.read(65_536):
                tak.extend(data)
            writer.close()

        context = context_of(MqttSection(), lambda request: {})
        context.state_view.apply(fix(1), [])  # as from the journal
        server = await asyncio.start_server(take, "127.0.0.1", 0)
        url = f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        run_interface = cot_interface(CotSection(url=url, every_s=0.1), "Fire & more")
        async with server, in_background(run_interface(context)):
            await until(lambda: b"Fire-more.fire.1" in tak)  # after the positions of its round
            assert b"Fire-more.hawk" not in tak
            context.state_view.apply(fix(2), [])
            await until(lambda: b"Fire-more.hawk" in tak)

    asyncio.run(look())


def test_a_mission_at_one_place_is_not_a_line() -> None:
    state = MissionState(0, "hawk")
    here = ItemState(16, "", 3, 36.3, -84.1, 100.0, (0.0,) * 4)
    for items in ((here, here), (here, here, here)):
        state.on_board = Mission(1, 0, "", "accepted", "", "", items)
        assert mission_event(state, "site", 0, 1) is None
    there = ItemState(16, "", 3, 36.4, -84.1, 100.0, (0.0,) * 4)
    for items in ((here, there), (here, there, here)):
        state.on_board = Mission(1, 0, "", "accepted", "", "", items)
        event = mission_event(state, "site", 0, 1)
        assert event is not None
        assert event.count(b"<link") == len(items)


def test_a_server_may_come_late_go_and_come_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cot_sender, "MIN_WAIT_S", 0.1)
    got = bytearray()

    async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"<event/>" * 100)  # data of the server, which the client ignores
        got.extend(await reader.readuntil(b"</event>"))
        writer.close()  # the connection is closed

    async def look() -> None:
        with socket.socket() as sock:
            sock.bind(("127.0.0.1", 0))
            port = sock.getsockname()[1]
        async with sending(f"tcp://127.0.0.1:{port}") as context:
            await until(lambda: "cot" in context.state_view.alarms)
            assert f"no CoT to tcp://127.0.0.1:{port}" in context.state_view.alarms["cot"].text
            async with await asyncio.start_server(take, "127.0.0.1", port):
                for number in range(2):
                    context.state_view.apply(fix(number + 1), [])
                    await until(lambda: bool(got))
                    assert ElementTree.fromstring(bytes(got)).tag == "event"
                    got.clear()
                    await until(lambda: "cot" in context.state_view.alarms)
                await until(lambda: "cot" not in context.state_view.alarms)

    asyncio.run(look())


def test_tls_accepts_only_the_configured_authority(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    server_tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server_tls.load_cert_chain(tmp_path / "broker.pem", tmp_path / "broker.key")
    got = bytearray()

    async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        got.extend(await reader.read(65_536))
        writer.close()

    async def look() -> None:
        server = await asyncio.start_server(take, "127.0.0.1", 0, ssl=server_tls)
        async with server:
            url = f"tls://127.0.0.1:{server.sockets[0].getsockname()[1]}"
            async with sending(url, tls_ca=tmp_path / "other-ca.pem") as context:
                await until(lambda: "verify failed" in str(context.state_view.alarms.get("cot")))
            assert not got
            async with sending(url, tls_ca=tmp_path / "ca.pem"):
                await until(lambda: got.startswith(b"<event"))

    asyncio.run(look())


def test_a_refused_certificate_is_reported_and_replaced_without_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cot_sender, "MIN_WAIT_S", 0.1)
    monkeypatch.setattr(cot_sender, "MAX_WAIT_S", 0.2)
    make_certificates(tmp_path)
    server_tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=tmp_path / "ca.pem")
    server_tls.verify_mode = ssl.CERT_REQUIRED
    server_tls.load_cert_chain(tmp_path / "broker.pem", tmp_path / "broker.key")
    own = {"tls_certificate": tmp_path / "own.pem", "tls_key": tmp_path / "own.key"}
    got = bytearray()
    listener = socket.create_server(("127.0.0.1", 0))

    def install(name: str) -> None:
        for end in ("pem", "key"):
            shutil.copy(tmp_path / f"{name}.{end}", tmp_path / f"own.{end}")

    def serve() -> None:
        """Serve until the listener is closed; asyncio's server would not send TLS alerts."""
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                with (
                    contextlib.suppress(OSError),
                    server_tls.wrap_socket(client, server_side=True) as connection,
                ):
                    while data := connection.recv(65_536):
                        got.extend(data)

    async def look() -> None:
        install("other-ca")  # signed by an authority that the server does not trust
        url = f"tls://127.0.0.1:{listener.getsockname()[1]}"
        async with sending(url, tls_ca=tmp_path / "ca.pem", **own) as context:
            alarms = context.state_view.alarms
            await until(lambda: "unknown ca" in str(alarms.get("cot")).lower())
            assert not got
            (tmp_path / "own.pem").write_text("damaged", encoding="utf-8")
            await until(
                lambda: "the certificate and key cannot be loaded" in str(alarms.get("cot"))
            )
            install("client")
            await until(lambda: got.startswith(b"<event") and "cot" not in alarms)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        asyncio.run(look())
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(PATIENCE_S)


@pytest.mark.parametrize(
    "url", ["http://a:1", "udp://a", "tcp://a:0", "tcp://a:70000", "tcp://a b:1", "tcp://a..b:1"]
)
def test_invalid_urls_are_reported(url: str) -> None:
    with pytest.raises(ValidationError, match="write it as"):
        CotSection(url=url)


def test_a_url_in_its_parts() -> None:
    section = CotSection(url="tls://[::1]:8089")
    assert (section.scheme, section.host, section.port) == ("tls", "::1", 8089)
