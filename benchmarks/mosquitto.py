"""A real Mosquitto on a free port, for tests and benchmarks."""

import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

from benchmarks.link_shared import free_tcp_port

MOSQUITTO = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")


class Mosquitto:
    """A broker that can be killed, restarted and frozen."""

    def __init__(self, folder: Path, settings: str = "allow_anonymous true") -> None:
        """Write the configuration; ``settings`` are its lines on authentication and access."""
        self.port = free_tcp_port()
        self._config = folder / "mosquitto.conf"
        self._config.write_text(
            f"listener {self.port} 127.0.0.1\n{settings}\npersistence false\n", "utf-8"
        )
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        """Address for the option --broker."""
        return f"127.0.0.1:{self.port}"

    def start(self) -> None:
        """Start the broker and wait until it accepts connections."""
        if MOSQUITTO is None:
            raise RuntimeError("mosquitto is not installed: apt-get install mosquitto")
        self._process = subprocess.Popen(
            [MOSQUITTO, "-c", str(self._config)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for _ in range(200):
            with socket.socket() as sock:
                if sock.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            time.sleep(0.02)
        raise RuntimeError(f"mosquitto does not listen on {self.port}")

    def kill(self) -> None:
        """Kill the broker at once, as in a power cut."""
        if self._process is not None:
            self._process.send_signal(signal.SIGCONT)
            self._process.kill()
            self._process.wait(timeout=10)
            self._process = None

    def freeze(self, frozen: bool) -> None:
        """Stop the process without closing its connections, or continue it."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP if frozen else signal.SIGCONT)
