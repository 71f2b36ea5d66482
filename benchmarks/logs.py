"""Speed of reading logs: ``python -m benchmarks.logs LOG...``.

Each log is repeated to 100 MB (with the same timestamps) and read in a separate process. The
benchmark prints messages a second, the time to the first event, peak memory, and the speed of
pymavlink for the same .tlog or .bin, or of pyulog for the .ulg. The exit code is 1 if a limit is
exceeded: 100,000 messages a second (.tlog, .bin), 0.5 s to the first event, 300 MiB.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import click
from pymavlink import mavutil
from pyulog import ULog

from autopilot_bridge.logs.reading import open_log

BYTES = 100_000_000
MIN_PER_S, MAX_FIRST_S, MAX_MIB = 100_000, 0.5, 300


def measured(path: Path) -> dict[str, Any]:
    """Read a log in this process; return speed, memory and number of damaged parts."""
    began_s = time.perf_counter()
    log = open_log(path)
    first_s, events = 0.0, 0
    for _ in log.entries():
        first_s = first_s or time.perf_counter() - began_s
        events += 1
    taken_s = time.perf_counter() - began_s
    return {
        "mb": round(path.stat().st_size / 1e6),
        "messages_per_s": round(log.messages / taken_s),
        "events": events,
        "first_event_s": round(first_s, 3),
        "max_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "damage": len(log.damage),
    }


def peer_per_s(path: Path) -> int:
    """Return the messages a second that pymavlink or pyulog reads."""
    began_s, count = time.perf_counter(), 0
    if path.suffix.lower() == ".ulg":
        count = sum(len(topic.data["timestamp"]) for topic in ULog(str(path)).data_list)
    else:
        reader = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
        while reader.recv_msg() is not None:
            count += 1
        getattr(reader, "filehandle", reader).close()
    return round(count / (time.perf_counter() - began_s))


def repeated(path: Path, folder: Path) -> Path:
    """Write a log repeated to ``BYTES``; of a .ulg only the data after the header is repeated."""
    data, target = path.read_bytes(), folder / path.name
    body = data[16:] if path.suffix.lower() == ".ulg" else data
    with target.open("wb") as file:
        file.write(data)
        for _ in range(max(BYTES // len(data) - 1, 0)):
            file.write(body)
    return target


def main() -> int:
    """Print one line for each log; return 1 if a limit is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        click.echo(json.dumps(measured(given.logs[0])), nl=False)
        return 0
    beyond = False
    for path in given.logs:
        with tempfile.TemporaryDirectory() as folder:
            large = repeated(path, Path(folder))
            command = [sys.executable, "-m", "benchmarks.logs", "--one", str(large)]
            found = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
        found["peer_per_s"] = peer_per_s(path)
        click.echo(f"{path.name}: {json.dumps(found)}")
        slow = path.suffix.lower() != ".ulg" and found["messages_per_s"] < MIN_PER_S
        late = found["first_event_s"] > MAX_FIRST_S
        beyond |= slow or late or found["max_mib"] > MAX_MIB
    return int(beyond)


if __name__ == "__main__":
    sys.exit(main())
