"""MAVSDK, an independent client, on the mock: it must take the mock for an autopilot."""

import json
import socket
import subprocess
import sys

import pytest

# In a process of its own: MAVSDK is a C library with threads.
CLIENT = """
import json, sys
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
from mavsdk.plugins.mission_raw.mission_raw import MissionItem

link, first = sys.argv[1], int(sys.argv[2])
kind = ComponentType.GROUND_STATION
client = Mavsdk(Configuration.create_with_component_type(kind))
client.add_any_connection(link)
missions = MissionRaw(client.first_autopilot(15.0))
sent = [
    MissionItem(seq, 0, 16, int(seq == first), 1, 0, 0, 0, 0, 363000000 + seq, -842000000, 400.0)
    for seq in range(8)
]
missions.upload_mission(sent)
read = missions.download_mission()
missions.clear_mission()
left = missions.download_mission()
print(json.dumps([[(i.command, i.x, i.y, i.z) for i in items] for items in (sent, read, left)]))
"""


@pytest.mark.parametrize(("stack", "hidden"), [("px4", 0), ("ardupilot", 1)])
def test_mavsdk_uploads_downloads_and_clears_on_the_mock(stack: str, hidden: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        port = sock.getsockname()[1]
    mock = [sys.executable, "-m", "mission_service.cli", "mock", "--stack", stack]
    mock += ["--home", "36.3,-84.2,300", "--link", f"udpout:127.0.0.1:{port}"]
    process = subprocess.Popen(mock, stdout=subprocess.DEVNULL)
    try:
        client = subprocess.run(
            [sys.executable, "-c", CLIENT, f"udpin://127.0.0.1:{port}", str(hidden)],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        process.kill()
        process.wait(timeout=10)
    assert client.returncode == 0, client.stderr
    sent, read, left = json.loads(client.stdout.splitlines()[-1])
    assert read[hidden:] == sent[hidden:]  # ArduPilot's item 0 is its home
    assert len(left) == hidden
