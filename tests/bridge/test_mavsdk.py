"""MAVSDK, an independent client, detects the mock as an autopilot and controls it."""

import json
import subprocess
import sys
from dataclasses import astuple

import pytest

from autopilot_bridge.items import MissionItem
from autopilot_bridge.missions.read_back import same_as_sent
from autopilot_bridge.stacks.stacks import stack_named
from tests.bridge.mock_process import free_port, mock_process, short_mission
from tests.patience import PATIENCE_S

STACKS = [("px4", "plane"), ("ardupilot", "plane"), ("ardupilot", "copter")]

# In a separate process, because MAVSDK is a C library with threads.
CLIENT = """
import json, sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.telemetry import FlightMode, Telemetry

link, first, items = sys.argv[1], int(sys.argv[2]), json.loads(sys.argv[3])
patience_s = float(sys.argv[4])

def until(what):
    end = time.monotonic() + patience_s
    while not what():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)

def listed(items):
    return [
        (i.command, i.frame, i.x, i.y, i.z, i.param1, i.param2, i.param3, i.param4, i.autocontinue)
        for i in items
    ]

client = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
client.add_any_connection(link)
vehicle = client.first_autopilot(patience_s)
missions, action, telemetry = MissionRaw(vehicle), Action(vehicle), Telemetry(vehicle)
telemetry.set_rate_position(4.0)  # ArduCopter streams nothing unasked
sent = [
    MissionItem(seq, frame, command, int(seq == first), more, p1, p2, p3, p4, x=x, y=y, z=z)
    for seq, (command, frame, x, y, z, p1, p2, p3, p4, more) in enumerate(items)
]
missions.upload_mission(sent)
read = missions.download_mission()

action.arm()
missions.start_mission()
flown = []

def progress():
    current = missions.mission_progress().current
    if not flown or flown[-1] != current:
        flown.append(current)
    return current == len(sent) - 1

until(progress)
until(lambda: telemetry.flight_mode() == FlightMode.MISSION)
height_m = telemetry.position().relative_altitude_m
missions.set_current_mission_item(first + 1)
back = missions.mission_progress().current
action.return_to_launch()
until(lambda: telemetry.flight_mode() == FlightMode.RETURN_TO_LAUNCH)
missions.clear_mission()
left = missions.download_mission()
print(json.dumps([listed(read), flown, height_m, back, len(left)]))
client.destroy()
"""


@pytest.mark.parametrize(("name", "kind"), STACKS)
def test_mavsdk_uploads_downloads_flies_and_clears_on_the_mock(name: str, kind: str) -> None:
    stack = stack_named(name, kind)
    hidden = 1 if stack.item_0_is_home else 0
    mission = short_mission()
    sent = (*mission[:hidden], *mission)
    port = free_port()
    with mock_process(port, name, kind, speedup=20.0):
        arguments = [f"udpin://127.0.0.1:{port}", str(hidden), json.dumps([*map(astuple, sent)])]
        arguments.append(str(PATIENCE_S))
        client = subprocess.run(
            [sys.executable, "-c", CLIENT, *arguments],
            capture_output=True,
            text=True,
            timeout=2 * PATIENCE_S,
            check=False,
        )
    assert client.returncode == 0, client.stderr
    line = next(line for line in client.stdout.splitlines() if line.startswith("[["))
    read, flown, height_m, back, left = json.loads(line)
    items = [MissionItem(*values) for values in read]
    assert len(items) == len(sent)
    for ours, theirs in zip(sent[hidden:], items[hidden:], strict=True):
        assert same_as_sent(ours, theirs, stack)
    assert flown[-1] == len(sent) - 1
    assert sorted(flown) == flown  # no item was flown twice
    assert height_m > 15.0
    assert back == hidden + 1
    assert left == hidden  # ArduPilot's item 0 is its home
