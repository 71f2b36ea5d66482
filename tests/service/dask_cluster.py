"""A Dask cluster on this machine, for tests."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.service.test_live import free_port

ROOT = Path(__file__).parents[2]


class Cluster(NamedTuple):
    """The address of a scheduler, and the processes of its workers."""

    address: str
    workers: list[subprocess.Popen[bytes]]


@contextmanager
def cluster(workers: int) -> Iterator[Cluster]:
    """Start a scheduler and worker processes; all end with the context."""
    address = f"tcp://127.0.0.1:{free_port()}"
    dask = [sys.executable, "-m", "dask"]
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    port = address.rpartition(":")[2]
    commands = [["scheduler", "--host", "127.0.0.1", "--port", port]]
    commands += [["worker", address, "--nthreads", "1", "--no-nanny"]] * workers
    begun: list[subprocess.Popen[bytes]] = []
    try:
        for command in commands:
            begun.append(
                subprocess.Popen(
                    [*dask, *command, "--no-dashboard"],
                    env=there,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
            )
        yield Cluster(address, begun[1:])
    finally:
        for process in begun:
            process.kill()
        for process in begun:
            process.wait()
