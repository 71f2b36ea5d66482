"""Send random invalid input to the interfaces of a daemon: MAVLink, HTTP, MQTT."""

import random
import socket
import subprocess
from collections.abc import Iterable
from contextlib import suppress

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autopilot_bridge.links.codec import Codec

PATHS = ("/", "/healthz", "/api/v1/state", "/api/v1/wind", "/api/v1/live?since=x", "/metrics")
COMMANDS = (
    "hold",
    "status",
    "wind",
    "correct",
    "..",
    "x" * 200,
)  # abort is excluded, because it accepts any payload


def send_invalid_mavlink(rng: random.Random, ports: Iterable[int]) -> None:
    """Send noise, damaged and truncated frames, and valid frames with unusual content."""
    codec = Codec(rng.randrange(1, 255), 1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for port in ports:
            for _ in range(30):
                frame = bytearray(codec.encode(_strange(rng)))
                match rng.randrange(4):
                    case 0:
                        frame = bytearray(rng.randbytes(rng.randrange(1, 400)))
                    case 1:
                        frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
                    case 2:
                        del frame[rng.randrange(1, len(frame)) :]
                    case _:
                        pass
                with suppress(OSError):
                    sock.sendto(bytes(frame), ("127.0.0.1", port))


def _strange(rng: random.Random) -> mavlink.MAVLink_message:
    """Return a message that no autopilot sends."""
    big = rng.randrange(-(1 << 31), 1 << 31)
    match rng.randrange(4):
        case 0:
            return mavlink.MAVLink_mission_request_int_message(255, 190, 65_535, 255)
        case 1:
            return mavlink.MAVLink_command_ack_message(rng.randrange(65_536), 250)
        case 2:
            return mavlink.MAVLink_mission_ack_message(0, 0, 77, 13)
        case _:
            return mavlink.MAVLink_statustext_message(6, b"\xff\x00%s%n" * 5, big & 0xFFFF, 3)


def send_invalid_http(rng: random.Random, port: int) -> None:
    """Send noise, incomplete requests, wrong tokens and lengths, and endless headers.

    The responses are discarded.
    """
    path = rng.choice(PATHS)
    sent = (
        rng.randbytes(rng.randrange(1, 2000)),
        f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer wrong\r\n\r\n".encode(),
        f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999\r\n\r\n{{".encode(),
        f"GET {path} HTTP/1.1\r\nHost: evil.example\r\nOrigin: http://evil.example\r\n\r\n".encode(),
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"X: " + b"y" * 200_000,
        b"GET " + b"/" * 100_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
    )
    for content in sent:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=2) as sock:
            sock.sendall(content)
            if rng.random() < 0.5:
                sock.settimeout(0.2)
                sock.recv(100)


def publish_invalid_mqtt(rng: random.Random, port: int, site: str) -> None:
    """Publish payloads that are not valid commands; has no effect without a broker."""
    for _ in range(5):
        topic = f"mission-service/v1/{site}/cmd/{rng.choice(COMMANDS)}"
        payload = rng.choice(
            (
                rng.randbytes(300),
                b"",
                b"{" * 5000,
                b"[" * 100_000,
                b'{"id": 1, "command": null}',
                b'{"id": "' + b"x" * 60_000 + b'"}',
                b'{"id": "a", "by": "nobody", "vehicle": "nobody", "lat_deg": 1e999}',
            )
        )
        command = ["mosquitto_pub", "-p", str(port), "-t", topic, "-q", "1", "-s"]
        with suppress(OSError, subprocess.TimeoutExpired):
            subprocess.run(command, input=payload, capture_output=True, timeout=3, check=False)
