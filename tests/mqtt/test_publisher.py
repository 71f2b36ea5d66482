"""Messages and commands over MQTT, with a real Mosquitto."""

import asyncio
import contextlib
import gc
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import aiomqtt
import pytest

from benchmarks.mosquitto import MOSQUITTO, Mosquitto
from mission_service.commands import Level
from mission_service.config.mqtt_names import Broker
from mission_service.config.service_section import MqttSection
from mission_service.errors import MissionServiceError
from mission_service.interfaces.mqtt import broker_connection, publisher
from mission_service.interfaces.mqtt.broker_connection import OPEN, BrokerAccess, tls_of
from mission_service.interfaces.mqtt.broker_site import access_for, site_in
from mission_service.interfaces.mqtt.peer_exchange import channel_of
from tests.mqtt.certificates import make_certificates
from tests.mqtt.stage import ROOT, Listener, Stage, listening, publishing
from tests.patience import PATIENCE_S, until

needs_mosquitto = pytest.mark.skipif(
    MOSQUITTO is None, reason="no mosquitto: apt-get install mosquitto"
)
PASSWORD = "correct-horse-battery"


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    mosquitto = Mosquitto(tmp_path)
    yield mosquitto
    mosquitto.kill()


def command(**more: Any) -> dict[str, Any]:
    return {"id": "a1", "by": "anna", "sent_at_unix_us": time.time_ns() // 1000} | more


@needs_mosquitto
def test_a_late_subscriber_gets_all_states_and_a_present_one_the_end(broker: Mosquitto) -> None:
    async def look() -> None:
        async with publishing(broker.port) as stage:
            state_view, hawk = stage.context.state_view, f"vehicle/{stage.name}"
            state_view.alarm("x", "something is wrong")
            stage.context.ring()
            async with listening(broker.port) as early:
                topics = ("status", f"{hawk}/state", f"{hawk}/mission", "fire/front", "alarm")
                await until(lambda: all(early.of(topic) for topic in topics))
            async with listening(broker.port) as late:
                await until(lambda: len(late.messages) >= 6)
                assert [m.topic.value for m in late.messages if not m.retain] == []
                schemas = [late.last(topic)["schema"] for topic in topics]
                assert schemas == ["status/1", "vehicle/1", "mission/1", "front/1", "alarms/1"]
                assert late.last("status")["online"] is True
                assert [each["text"] for each in late.last("alarm")["alarms"]] == [
                    "something is wrong"
                ]
                front = late.last("fire/front")
                assert (front["at_us"], front["geometry"]["type"]) == (300_000_000, "MultiPolygon")
                state_view.clear_alarm("x")
                stage.context.ring()
                await until(lambda: late.last("alarm")["alarms"] == [])
                stage.task.cancel()
                await asyncio.wait([stage.task])
                await until(lambda: late.last("status")["online"] is False)
                assert late.last("status")["why"] == "the service was stopped"
                assert len(late.of("status")) == 2  # no last will follows
            stage.task = asyncio.create_task(stage.publisher.run())

    broker.start()
    asyncio.run(look())


@needs_mosquitto
def test_positions_are_limited_to_the_configured_rate_and_lines_are_not(
    broker: Mosquitto,
) -> None:
    async def look() -> None:
        async with (
            listening(broker.port) as listener,
            publishing(broker.port, telemetry_hz=5.0) as stage,
        ):
            await until(lambda: stage.publisher.connected)
            topic, began_s = f"vehicle/{stage.name}/telemetry", time.monotonic()
            for at_us in range(100):
                stage.moves(at_us)
                stage.announce(f"line {at_us}")
                await asyncio.sleep(0.01)
            await until(lambda: (listener.last(topic) or {"at_us": 0})["at_us"] == 99)
            most = 5.0 * (time.monotonic() - began_s) + 2.0
            assert 4 <= len(listener.of(topic)) <= most
            await until(lambda: len(listener.of("event")) == 100)
            lines = [line["text"] for line in listener.of("event")]
            assert lines == [f"line {number}" for number in range(100)]
            assert not any(message.retain for message in listener.messages)
            listener.messages.clear()
            stage.context.state_view.fire_changed()
            stage.context.ring()
            await until(lambda: listener.of("fire/front") != [])

    broker.start()
    asyncio.run(look())


@needs_mosquitto
def test_a_killed_process_is_published_as_offline_by_the_broker(broker: Mosquitto) -> None:
    async def look(process: subprocess.Popen[bytes]) -> None:
        async with listening(broker.port) as listener:
            await until(lambda: listener.last("vehicle/hawk/telemetry") is not None)
            assert listener.last("status")["online"] is True
            process.send_signal(signal.SIGKILL)
            await until(lambda: listener.last("status")["online"] is False)
            assert listener.last("status")["why"] == "the connection was lost"
        async with listening(broker.port) as late:
            await until(lambda: listener.last("status") == late.last("status"))

    broker.start()
    command = [sys.executable, "-m", "tests.mqtt.publisher_process", str(broker.port)]
    with subprocess.Popen(command) as process:
        try:
            asyncio.run(look(process))
        finally:
            process.kill()


async def longest_gap_s(stage: Stage, seconds: float) -> float:
    """Return the longest time without another task while many messages were published."""
    longest_s, last_s = 0.0, time.monotonic()
    end_s, at_us = last_s + seconds, 0
    while last_s < end_s:
        at_us += 1
        stage.moves(at_us)
        stage.announce("x" * 1000)
        await asyncio.sleep(0.002)
        now_s = time.monotonic()
        longest_s, last_s = max(longest_s, now_s - last_s), now_s
    return longest_s


@needs_mosquitto
def test_without_a_broker_nothing_waits_and_then_the_latest_is_published(
    broker: Mosquitto, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(broker_connection, "ANSWER_S", PATIENCE_S)

    async def look() -> None:
        async with publishing(broker.port) as stage:
            state_view, topic = stage.context.state_view, f"vehicle/{stage.name}/telemetry"
            announced: list[str] = []  # the state view stores only the latest ones
            announce = stage.context.service.announce

            def collect(about: str, text: str, level: Level = "warning") -> None:
                announced.append(text)
                announce(about, text, level)

            monkeypatch.setattr(stage.context.service, "announce", collect)
            gaps_s = [await longest_gap_s(stage, 0.7)]  # the broker never existed
            assert "no MQTT broker at 127.0.0.1" in state_view.alarms["broker"].text
            for number in range(2):
                broker.start()
                await until(lambda: stage.publisher.connected)
                assert "broker" not in state_view.alarms
                assert stage.context.gauges["mqtt_connected"]() == 1.0
                async with listening(broker.port) as listener:
                    stage.moves(1_000_000 + number, lat_deg=36.365)
                    await until(lambda: (listener.last(topic) or {}).get("lat_deg") == 36.365)
                    await until(lambda: listener.last(f"vehicle/{stage.name}/mission") is not None)
                    if number == 0:
                        # The broker accepts what its sockets can buffer, and nothing more.
                        broker.freeze(True)
                        gaps_s.append(await longest_gap_s(stage, 0.7))
                        broker.freeze(False)
                broker.kill()
                # Immediately, even without a message to send.
                await until(lambda: not stage.publisher.connected)
                gaps_s.append(await longest_gap_s(stage, 0.3))
            assert max(gaps_s) < PATIENCE_S / 2, gaps_s  # otherwise the service waited for a reply
            # And the log does not contain a line for each attempt in a minute.
            lost, back = announced
            assert "no MQTT broker" in lost
            assert "reconnected to the broker" in back

    asyncio.run(look())


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Mosquitto]:
    """Start a broker that accepts the service and an observer by their passwords.

    A Mosquitto started by root drops the right to read these files.
    """
    passwords, rights = tmp_path / "passwords", tmp_path / "rights"
    for user in ("service", "observer"):
        create = ["-c"] if user == "service" else []
        command = ["mosquitto_passwd", *create, "-b", str(passwords), user, PASSWORD]
        subprocess.run(command, check=True)
    rights.write_text("user service\ntopic test/#\nuser observer\ntopic read test/#\n", "utf-8")
    settings = f"user root\nallow_anonymous false\npassword_file {passwords}\nacl_file {rights}"
    mosquitto = Mosquitto(tmp_path, settings)
    mosquitto.start()
    yield mosquitto
    mosquitto.kill()


@needs_mosquitto
def test_user_and_password_are_sent_only_to_the_broker(
    guarded: Mosquitto,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    attempts, client_to = [0], broker_connection.client_to

    def counted(*arguments: Any, **named: Any) -> Any:
        attempts[0] += 1
        return client_to(*arguments, **named)

    monkeypatch.setattr(publisher, "client_to", counted)
    secret, wrong = tmp_path / "secret", tmp_path / "wrong"
    secret.write_text(PASSWORD + "\n", "utf-8")
    wrong.write_text("wrong-" + PASSWORD, "utf-8")

    async def look() -> list[str]:
        lines = []
        account = {"username": "observer", "password": PASSWORD}
        async with listening(guarded.port, **account) as listener:
            async with publishing(guarded.port, user="service", password=f"file:{secret}") as stage:
                await until(lambda: listener.last("status") is not None)
                lines += [repr(stage.publisher.site), repr(stage.publisher.site.access)]
            listener.messages.clear()
            async with publishing(guarded.port, user="service", password=f"file:{wrong}") as stage:
                state_view = stage.context.state_view
                await until(lambda: "broker" in state_view.alarms)
                tried = attempts[0]
                await until(lambda: attempts[0] >= tried + 2)  # repeatedly
                assert not stage.publisher.connected
                (line,) = [line.text for line in state_view.announcements]
                assert "user or password is wrong" in line
                lines += [line, *(each.payload.decode() for each in listener.messages)]
            # The observer may not write; brokers do not report the refusal, and it has no effect.
            async with publishing(
                guarded.port, user="observer", password=f"file:{secret}", commands=True
            ) as stage:
                await until(lambda: stage.publisher.connected)
        return lines

    lines = asyncio.run(look())
    out = capfd.readouterr()
    assert PASSWORD not in "".join(lines) + out.out + out.err


@needs_mosquitto
@pytest.mark.filterwarnings("ignore:unclosed <ssl.SSLSocket:ResourceWarning")  # a warning of paho
def test_tls_with_an_authority_and_certificates_of_both_sides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(broker_connection, "ANSWER_S", 0.8)
    make_certificates(tmp_path)
    settings = [
        "user root",
        "allow_anonymous true",
        f"cafile {tmp_path}/ca.pem",
        f"certfile {tmp_path}/broker.pem",
        f"keyfile {tmp_path}/broker.key",
        "require_certificate true",
    ]
    broker = Mosquitto(tmp_path, "\n".join(settings))
    client = {"tls_certificate": tmp_path / "client.pem", "tls_key": tmp_path / "client.key"}
    tls = tls_of(tmp_path / "ca.pem", *client.values())

    async def why(**settings: Any) -> str:
        async with publishing(broker.port, **settings) as stage:
            alarms = stage.context.state_view.alarms
            await until(lambda: "broker" in alarms)
            await until(lambda: "certificate" in alarms["broker"].text)
            return alarms["broker"].text

    async def look() -> None:
        async with (
            listening(broker.port, tls_context=tls) as listener,
            publishing(broker.port, tls_ca=tmp_path / "ca.pem", commands=True, **client) as stage,
        ):
            await until(lambda: listener.last("status") is not None)
            for number in range(20):  # many frames in one TLS record
                await listener.publish("cmd/hold", command(id=str(number)))
            await until(lambda: len(listener.of("cmd/hold/reply")) == 20)
            assert len(stage.asked) == 20
        assert "verify failed" in await why(tls_ca=tmp_path / "other-ca.pem", **client)
        assert "certificate required" in await why(tls_ca=tmp_path / "ca.pem")

    broker.start()
    try:
        asyncio.run(look())
    finally:
        broker.kill()


@needs_mosquitto
def test_commands_are_done_once_and_answered_with_their_id(broker: Mosquitto) -> None:
    async def ask(listener: Listener, name: str, *payload: Any, **more: Any) -> dict[str, Any]:
        before = len(listener.of(f"cmd/{name}/reply"))
        await listener.publish(f"cmd/{name}", *payload, **more)
        await until(lambda: len(listener.of(f"cmd/{name}/reply")) > before)
        found: dict[str, Any] = listener.last(f"cmd/{name}/reply")
        return found

    async def look() -> None:
        async with listening(broker.port) as listener:
            await listener.publish(
                "cmd/return", command(), retain=True
            )  # before the service connects
            async with publishing(broker.port, commands=True) as stage:
                await until(lambda: listener.last("cmd/return/reply") is not None)
                assert "retained" in listener.last("cmd/return/reply")["error"]
                assert "retained" in (await ask(listener, "hold", command(), retain=True))["error"]
                assert "never" in (await ask(listener, "approve", command(hash="0" * 64)))["error"]
                old = command(sent_at_unix_us=time.time_ns() // 1000 - 31_000_000)
                assert "clock" in (await ask(listener, "hold", old))["error"]
                assert "cannot be read" in (await ask(listener, "hold", b"{"))["error"]
                large = command(text="x" * 70_000)
                assert "65536" in (await ask(listener, "hold", large))["error"]
                assert stage.asked == []

                hold = command(id="h1", vehicle="hawk")
                reply = await ask(listener, "hold", hold)
                assert (reply["schema"], reply["id"], reply["ok"]) == ("reply/1", "h1", True)
                assert reply["messages"] == ["done"]
                assert (await ask(listener, "hold", hold))["again"] is True
                assert [each["do"] for each in stage.asked] == ["hold"]
                reply = await ask(listener, "start", command(id="s1", vehicle="unknown"))
                assert (reply["id"], reply["ok"]) == ("s1", False)
                assert reply["error"] == "no vehicle 'unknown'"
                assert (await ask(listener, "abort", b""))["ok"] is True
                assert stage.asked[-1]["do"] == "abort"
                await listener.publish("cmd/hold", b"x" * 200_000)  # the broker does not deliver it
                assert (await ask(listener, "hold", command(id="h2")))["id"] == "h2"

    broker.start()
    asyncio.run(look())


@needs_mosquitto
def test_a_name_as_long_as_a_topic_may_be_has_no_effect(broker: Mosquitto) -> None:
    prefix = f"{ROOT}/cmd/"
    long = "cmd/" + "x" * (65_535 - len(prefix))  # the topic of a reply would be too long

    async def look() -> None:
        async with listening(broker.port) as listener:
            await listener.publish(long, command(), retain=True)  # before the service connects
            async with publishing(broker.port, commands=True) as stage:
                await until(lambda: stage.publisher._command_gate.unanswered == 1)
                await listener.publish(long, command())
                await until(lambda: stage.publisher._command_gate.unanswered == 2)
                await listener.publish("cmd/hold", command(id="h1"))
                await until(lambda: listener.last("cmd/hold/reply") is not None)
                assert listener.last("cmd/hold/reply")["id"] == "h1"
                assert "broker" not in stage.context.state_view.alarms

    broker.start()
    asyncio.run(look())


def test_a_reply_that_the_client_refuses_is_dropped() -> None:
    published: list[str] = []

    async def publish(path: str, *_: Any, **__: Any) -> None:
        published.append(path)
        if len(published) == 1:
            raise ValueError("Publish topic is too long.")

    async def look() -> None:
        async with publishing(1, commands=True) as stage:  # no broker listens on this port
            for name in ("hold", "resume"):
                body = json.dumps(command()).encode()
                topic = f"{ROOT}/cmd/{name}"
                stage.publisher._handle(aiomqtt.Message(topic, body, 1, False, 0, None))
            client: Any = SimpleNamespace(publish=publish)
            sending = asyncio.create_task(stage.publisher._send_replies(client))
            await until(lambda: len(published) == 2)
            assert not sending.done()
            sending.cancel()

    asyncio.run(look())


CONNECTED = bytes([0x20, 3, 0, 0, 0])
SUBSCRIBED = CONNECTED + bytes([0x90, 4, 0, 1, 0, 1])
STRANGE = (
    b"",
    b"HTTP/1.1 400 Bad Request\r\n\r\n",
    bytes(range(256)),
    b"\x20\x03\x00\x87\x00",  # not authorised
    b"\x20\xff\xff\xff\x7f",  # the start of a packet of 256 MB
    CONNECTED + b"\x90\x04\x00\x09\x00\x01",  # a reply without a request
    SUBSCRIBED + b"\x30\x04\x00\x02\xff\xfe",  # a topic that is not valid UTF-8
    SUBSCRIBED + b"\x30\x03\x00\x09a",  # a topic that is longer than its packet
    SUBSCRIBED + b"\x30\x0a\x00\x03a/#\x00{}{}",
    SUBSCRIBED + b"\xe0\x02\x89\x00",  # server busy
)


def test_no_message_of_a_broker_ends_the_service(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name, seconds in (("MIN_WAIT_S", 0.01), ("MAX_WAIT_S", 0.01), ("ANSWER_S", 0.1)):
        monkeypatch.setattr(broker_connection, name, seconds)
    opened = closed = 0

    async def be_strange(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal opened, closed
        message, opened = STRANGE[opened % len(STRANGE)], opened + 1
        try:
            with contextlib.suppress(ConnectionError):  # the service may have disconnected already
                await reader.read(4096)
                for part in (message[:5], message[5:]):
                    writer.write(part)
                    await writer.drain()
                    await asyncio.sleep(0.03)  # read separately if the machine is fast enough
                writer.close()
                await writer.wait_closed()
        finally:
            writer.close()
            closed += 1

    async def look() -> None:
        server = await asyncio.start_server(be_strange, "127.0.0.1", 0)
        async with server:
            async with publishing(server.sockets[0].getsockname()[1], commands=True) as stage:
                await until(lambda: opened > len(STRANGE) + 2)
                assert stage.asked == []
                lines = [line.text for line in stage.context.state_view.announcements]
                assert len(lines) <= 2, lines
            await until(lambda: closed == opened)  # the unusual server also ends
        gc.collect()  # exceptions that were never retrieved are logged at this point

    asyncio.run(look())
    assert caplog.records == []


def test_received_commands_are_done_though_the_broker_is_disconnected_by_then() -> None:
    def message(name: str, payload: dict[str, Any]) -> aiomqtt.Message:
        body = json.dumps(payload).encode()
        return aiomqtt.Message(f"{ROOT}/cmd/{name}", body, 1, False, 0, None)

    async def disconnected(*_: Any, **__: Any) -> None:
        raise aiomqtt.MqttError("disconnected")

    async def look() -> None:
        async with publishing(1, commands=True) as stage:  # no broker listens on this port
            inbox = stage.publisher._inbox
            for number in range(8):
                inbox.put_nowait(message("hold", command(id=f"h{number}")))
            inbox.put_nowait(message("abort", {}))
            client: Any = SimpleNamespace(subscribe=disconnected, publish=disconnected)
            with pytest.raises(aiomqtt.MqttError, match="disconnected"):
                await stage.publisher._use(client)
            assert [each["do"] for each in stage.asked] == ["abort", *["hold"] * 8]

    asyncio.run(look())


def test_aborts_come_first_and_what_waits_is_bounded() -> None:
    def message(name: str, number: int) -> aiomqtt.Message:
        return aiomqtt.Message(f"test/cmd/{name}", str(number).encode(), 1, False, 0, None)

    inbox = publisher._inbox()
    for number in range(2 * publisher.MAX_UNREAD):
        inbox.put_nowait(message("hold", number))
    for number in range(2):
        inbox.put_nowait(message("abort", number))
    got = [inbox.get_nowait() for _ in range(inbox.qsize())]
    received = [(each.topic.value.rpartition("/")[2], int(each.payload)) for each in got]
    holds = [("hold", number) for number in range(publisher.MAX_UNREAD - 2)]
    assert received == [("abort", 0), ("abort", 1), *holds]
    for number in range(2 * publisher.MAX_UNREAD):
        inbox.put_nowait(message("abort", number))
    assert inbox.qsize() == publisher.MAX_UNREAD
    inbox.get_nowait()
    inbox.put_nowait(message("hold", 0))
    assert [inbox.get_nowait() for _ in range(publisher.MAX_UNREAD)][
        -1
    ].topic.value == "test/cmd/hold"


@needs_mosquitto
def test_commands_are_off_by_default(broker: Mosquitto) -> None:
    async def look() -> None:
        async with listening(broker.port) as listener, publishing(broker.port) as stage:
            await until(lambda: listener.last("status") is not None)
            assert listener.last("status")["commands"] is False
            await listener.publish("cmd/abort", command())
            stage.announce("later")
            await until(lambda: listener.last("event") is not None)
            assert stage.asked == []
            assert listener.of("cmd/abort/reply") == []

    broker.start()
    asyncio.run(look())


def test_what_the_settings_name_is_read_at_once(tmp_path: Path) -> None:
    def refused(words: str, **settings: Any) -> None:
        with pytest.raises(MissionServiceError, match=words) as caught:
            site_in(MqttSection(**settings), "default")
        assert PASSWORD not in str(caught.value)

    refused("set `user`", password="env:NOBODY")
    refused("variable NOBODY is not set", user="u", password="env:NOBODY")
    refused("cannot be loaded: No such file", tls_ca=tmp_path / "none.pem")
    (tmp_path / "ca.pem").write_text(PASSWORD, "utf-8")
    refused("ca.pem: cannot be loaded", tls_ca=tmp_path / "ca.pem")
    refused(
        "the certificate and key cannot be loaded", tls=True, tls_certificate=tmp_path / "none.pem"
    )
    site = site_in(MqttSection(broker="b", tls=True), "Eight UAVs")
    assert (site.broker, site.topic) == (Broker("b", 8883), "mission-service/v1/Eight-UAVs")
    assert site.access.tls is not None
    assert site.access.tls.check_hostname
    assert PASSWORD not in repr(BrokerAccess("u", PASSWORD))


def test_vehicles_in_processes_of_their_own_are_the_same_user_to_the_same_broker(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("WORD", PASSWORD)
    settings = MqttSection(broker="b", user="u", password="env:WORD")
    assert access_for(Broker("b"), settings) == BrokerAccess("u", PASSWORD)
    assert access_for(Broker("c"), settings) == access_for(Broker("b"), None) == OPEN
    assert channel_of("b:1883", "x", "fire", settings).access.user == "u"


def test_a_cancellation_that_meets_a_refused_attempt_ends_the_connection() -> None:
    class Refused:
        """A client that suppresses a cancellation, as ``asyncio.wait_for`` may."""

        async def __aenter__(self) -> None:
            try:
                await asyncio.sleep(PATIENCE_S)
            except asyncio.CancelledError:
                raise aiomqtt.MqttError("refused") from None

        async def __aexit__(self, *error: object) -> None: ...

    async def unused(client: Any) -> None: ...

    async def end() -> None:
        refused: Any = Refused
        connecting = broker_connection.keep_connected(
            lambda logger: refused(), unused, lambda why: None
        )
        task = asyncio.create_task(connecting)
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        task.cancel()
        _, left = await asyncio.wait([task], timeout=PATIENCE_S)
        task.cancel()
        assert not left

    asyncio.run(end())
