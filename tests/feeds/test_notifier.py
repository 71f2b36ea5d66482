"""Alarms reach a real mail server and a real web server, also after these have failed."""

import asyncio
import json
import socket
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from email import message_from_bytes
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import SMTP, Envelope, Session
from pydantic import ValidationError

from mission_service.config.service_section import (
    AlarmReceiverSection,
    MqttSection,
    ServiceSection,
)
from mission_service.errors import MissionServiceError
from mission_service.interfaces.notifications import alarm_dispatch
from mission_service.interfaces.notifications.notifier import alarm_notifier, apprise_delivery
from mission_service.runtime.run_context import RunContext
from tests.feeds.background import in_background
from tests.mqtt.stage import context_of
from tests.patience import PATIENCE_S, until


class Mailbox:
    """A handler of a mail server that stores the mails."""

    def __init__(self) -> None:
        self.mails: list[Any] = []

    async def handle_DATA(self, server: SMTP, session: Session, envelope: Envelope) -> str:  # noqa: N802
        self.mails.append(message_from_bytes(envelope.content or b""))  # type: ignore[arg-type]
        return "250 OK"


@contextmanager
def web_server(status: list[int]) -> Iterator[tuple[int, list[dict[str, Any]]]]:
    """Yield the port of a web server and the JSON bodies that it received.

    The server answers with the last of ``status``.
    """
    received: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["content-length"]))
            received.append(json.loads(body))
            self.send_response(status[-1])
            self.end_headers()

        def log_message(self, *args: Any) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.server_port, received
    finally:
        server.shutdown()
        thread.join(PATIENCE_S)
        server.server_close()


@asynccontextmanager
async def notifying(*receivers: AlarmReceiverSection) -> AsyncIterator[RunContext]:
    context = context_of(MqttSection(), lambda request: {})
    async with in_background(alarm_notifier(receivers, "east")(context)):
        yield context


def test_an_alarm_arrives_by_mail() -> None:
    box = Mailbox()
    with socket.create_server(("127.0.0.1", 0)) as found:
        port = found.getsockname()[1]
    controller = Controller(box, hostname="127.0.0.1", port=port)
    controller.start()
    try:
        url = f"mailto://127.0.0.1:{port}?from=service@east.example&to=chief@east.example"

        async def look() -> None:
            async with notifying(AlarmReceiverSection(name="chief", url=url)) as context:
                context.state_view.alarm("link/hawk", "hawk: link lost", "severe")
                await until(lambda: box.mails)
                context.state_view.clear_alarm("link/hawk")
                await until(lambda: len(box.mails) == 2)
                context.state_view.alarm("people/1", "fire near <a href='//x'>Bo</a>", "severe")
                await until(lambda: len(box.mails) == 3)

        asyncio.run(look())
    finally:
        controller.stop()
    first, last, named = box.mails
    assert first["subject"] == "east: 1 alarm"
    assert first["to"] == "chief@east.example"
    assert "ALARM: hawk: link lost" in first.as_string()
    assert "Ended: hawk: link lost" in last.as_string()
    # A name that other people chose is no markup.
    assert {each.get_content_type() for each in named.walk()} == {"text/plain"}
    assert "<a href='//x'>Bo</a>" in named.get_payload(decode=True).decode()


def test_a_webhook_that_fails_is_an_alarm_and_gets_the_message_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(alarm_dispatch, "FIRST_RETRY_S", 0.1)
    status = [500]
    with web_server(status) as (port, received):
        webhook = AlarmReceiverSection(name="hook", url=f"json://127.0.0.1:{port}/alarms")

        async def look() -> None:
            async with notifying(webhook) as context:
                view = context.state_view
                view.alarm("link/hawk", "hawk: link lost", "severe")
                await until(lambda: "notification/hook" in view.alarms)
                text = view.alarms["notification/hook"].text
                assert text.startswith("alarms are not delivered to hook: Failed to send JSON")
                status.append(200)
                await until(lambda: "notification/hook" not in view.alarms)
                assert view.announcements[-1].text == "sent to hook: east: 1 alarm"

        asyncio.run(look())
    assert len(received) >= 2
    assert received[-1]["title"] == "east: 1 alarm"
    assert received[-1]["message"] == "ALARM: hawk: link lost"


def test_a_silent_server_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mission_service.interfaces.notifications.notifier.ANSWER_S", 0.2)

    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"json://127.0.0.1:{silent.getsockname()[1]}?cto=1&rto=1"
        deliver = apprise_delivery(AlarmReceiverSection(name="slow", url=url))
        message = alarm_dispatch.AlarmMessage("title", "body", (), ())
        assert asyncio.run(deliver(message)) == "no answer within 0 s"


def test_an_exception_of_apprise_is_an_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    def raise_error(*_: Any, **__: Any) -> None:
        raise RuntimeError("json://user:password@host")

    monkeypatch.setattr("apprise.Apprise.notify", raise_error)

    async def look() -> None:
        async with notifying(AlarmReceiverSection(name="hook", url="json://host")) as context:
            view = context.state_view
            view.alarm("link/hawk", "hawk: link lost", "severe")
            await until(lambda: "notification/hook" in view.alarms)
            text = view.alarms["notification/hook"].text
            assert text == "alarms are not delivered to hook: Apprise failed with RuntimeError"

    asyncio.run(look())


@contextmanager
def endless_server() -> Iterator[int]:
    """Yield the port of a server that never ends its answer."""
    ended = threading.Event()

    def answer(peer: socket.socket) -> None:
        with peer, suppress(OSError):
            peer.recv(65536)
            peer.sendall(b"HTTP/1.1 200 OK\r\n")
            while not ended.wait(0.2):
                peer.sendall(b"x")

    def accept(server: socket.socket) -> None:
        with suppress(OSError):
            while True:
                threading.Thread(target=answer, args=(server.accept()[0],)).start()

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=accept, args=(server,))
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            ended.set()
            server.shutdown(socket.SHUT_RDWR)
            thread.join(PATIENCE_S)


def test_a_server_that_never_ends_its_answer_does_not_delay_the_end_of_the_process() -> None:
    code = (
        "import asyncio\n"
        "from mission_service.config.service_section import AlarmReceiverSection\n"
        "from mission_service.interfaces.notifications import notifier\n"
        "from mission_service.interfaces.notifications.alarm_dispatch import AlarmMessage\n"
        "notifier.ANSWER_S = 0.2\n"
        "deliver = notifier.apprise_delivery(AlarmReceiverSection(name='slow', url='{url}'))\n"
        "print(asyncio.run(deliver(AlarmMessage('title', 'body', (), ()))))\n"
    )
    with endless_server() as port:
        ran = subprocess.run(
            [sys.executable, "-c", code.replace("{url}", f"json://127.0.0.1:{port}")],
            capture_output=True,
            text=True,
            timeout=30.0,
        )
    assert ran.stdout == "no answer within 0 s\n"


def test_deliveries_without_an_end_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mission_service.interfaces.notifications.notifier.ANSWER_S", 0.05)
    monkeypatch.setattr("mission_service.interfaces.notifications.notifier.MAX_UNFINISHED", 2)
    message = alarm_dispatch.AlarmMessage("title", "body", (), ())

    async def look(url: str) -> list[str]:
        deliver = apprise_delivery(AlarmReceiverSection(name="slow", url=url))
        return [await deliver(message) for _ in range(3)]

    with endless_server() as port:
        answers = asyncio.run(look(f"json://127.0.0.1:{port}"))
    assert answers == [
        *["no answer within 0 s"] * 2,
        "the server has not answered 2 earlier deliveries",
    ]


@pytest.mark.parametrize(
    ("url", "problem"),
    [
        ("nonsense", "is not an address that Apprise supports"),
        ("env:NO_SUCH_VARIABLE_HERE", "environment variable NO_SUCH_VARIABLE_HERE is not set"),
        ("file:/no/such/file", "No such file"),
    ],
)
def test_an_unusable_address_is_refused_before_the_run(url: str, problem: str) -> None:
    with pytest.raises(MissionServiceError, match=problem) as error:
        alarm_notifier([AlarmReceiverSection(name="ann", url=url)], "east")
    assert "\n" not in str(error.value)


def test_an_address_is_read_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "url"
    path.write_text("json://127.0.0.1:9/secret\n", encoding="utf-8")
    apprise_delivery(AlarmReceiverSection(name="ann", url=f"file:{path}"))


def test_two_receivers_with_one_name_are_refused() -> None:
    receivers = [AlarmReceiverSection(name="ann", url=f"json://{host}") for host in "ab"]
    with pytest.raises(ValidationError, match="two receivers have the name 'ann'"):
        ServiceSection(alarm_receivers=tuple(receivers))
