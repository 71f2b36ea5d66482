"""A replay process, started as a user starts it."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.patience import PATIENCE_S

V1 = "/api/v1"


class Replay:
    """A replay in a separate process."""

    def __init__(self, out: Path, *words: str) -> None:
        command = [sys.executable, "-m", "mission_service.cli", "replay", "--out", str(out)]
        self.out = out
        words = words if "--speed" in words else (*words, "--speed", "1")
        self.process = subprocess.Popen(
            [*command, *words], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        assert self.process.stderr is not None
        line = self.process.stderr.readline()
        found = re.search(r"http://\S+?:\d+", line)
        assert found is not None, line + self.process.stderr.read()
        headers = {"authorization": f"Bearer {(out / 'token').read_text().strip()}"}
        self.http = httpx.Client(base_url=found[0], headers=headers, timeout=PATIENCE_S)

    def get(self, path: str) -> Any:
        answer = self.http.get(V1 + path)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def post(self, **body: Any) -> Any:
        answer = self.http.post(f"{V1}/replay", json=body)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def until(self, **expected: Any) -> Any:
        """Wait for a condition; return the state of the replay then."""
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            state = self.get("/replay")
            if all(state[key] == value for key, value in expected.items()):
                return state
            time.sleep(0.05)
        raise AssertionError(f"not {expected}: {state}")

    def end(self, number: int = signal.SIGINT) -> int:
        self.http.close()
        self.process.send_signal(number)
        return self.process.wait(timeout=PATIENCE_S)


@contextmanager
def replayed(out: Path, *words: str) -> Iterator[Replay]:
    """Run a replay of these logs with these options in a context."""
    replay = Replay(out, *words)
    try:
        yield replay
    finally:
        replay.http.close()
        if replay.process.poll() is None:
            replay.process.kill()
        replay.process.communicate(timeout=PATIENCE_S)
