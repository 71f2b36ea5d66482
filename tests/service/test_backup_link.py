"""A vehicle over two links: the daemon and a mock with two ports, over two lossy UDP relays."""

import json
import random
import select
import socket
import threading
import urllib.request
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.framing import message_id_of
from autopilot_bridge.vehicle.client_events import LinksChanged
from autopilot_bridge.vehicle.link_selection import LinkStatus
from mission_service.config.scenario import load_scenario
from mission_service.config.shared_links import sharing
from mission_service.core.core import Core
from mission_service.errors import ScenarioError
from mission_service.events import LinkLost, LinkQuality, LinksReported
from mission_service.fire.scenario_check import check
from mission_service.fire.scenario_fire import landscape_of
from mission_service.replay.verification import verify
from mission_service.runtime.gateway import Gateway, MissionClock
from mission_service.runtime.sortie import LinkUse
from tests.patience import PATIENCE_S
from tests.service.test_forged_frames import Run
from tests.service.test_live import free_port, process

LOSS = 0.2
MISSION_ITEM_INT = 73


class LossyRelay:
    """A relay between a port of the vehicle and one of the daemon, which can be cut."""

    def __init__(self, port: int, seed: int) -> None:
        self.cut = False
        self.cut_after_items: int | None = None
        self.items = 0  # mission items sent to the vehicle
        self._random = random.Random(seed)
        self._to = ("127.0.0.1", port)
        self._service = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for each in (self._service, self._vehicle):
            each.bind(("127.0.0.1", 0))
        self.port: int = self._vehicle.getsockname()[1]
        self._from: Any = None
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ends.is_set():
            for ready in select.select([self._service, self._vehicle], [], [], 0.1)[0]:
                data, address = ready.recvfrom(65536)
                if ready is self._vehicle:
                    self._from = address
                else:
                    self.items += message_id_of(data) == MISSION_ITEM_INT
                    self.cut |= self.items == self.cut_after_items
                if self.cut or self._random.random() < LOSS or self._from is None:
                    continue
                if ready is self._vehicle:
                    self._service.sendto(data, self._to)
                else:
                    self._vehicle.sendto(data, self._from)

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self._service.close()
        self._vehicle.close()


def get(run: Run, path: str) -> bytes:
    token = (run.folder / "token").read_text(encoding="utf-8").strip()
    request = urllib.request.Request(
        f"http://127.0.0.1:{run.http}{path}", headers={"Authorization": f"Bearer {token}"}
    )
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        found: bytes = answer.read()
        return found


def states(run: Run) -> list[tuple[str, bool]]:
    vehicle = json.loads(get(run, "/api/v1/vehicles/hawk"))
    return [(link["state"], link["in_use"]) for link in vehicle["links"]]


@pytest.mark.long
def test_links_are_cut_and_restored_in_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both links lose 20 % of the frames in each direction, and are signed.

    The first link is cut during the first upload, and later the other one too.
    """
    monkeypatch.setenv("THE_KEY", "a passphrase")
    backup = free_port()
    run = Run(tmp_path, "default", f'vehicles.0.backup_link="udpin:127.0.0.1:{backup}"')
    run.arguments += ["--signing-key", "env:THE_KEY"]
    with closing(LossyRelay(run.port, 1)) as first, closing(LossyRelay(backup, 2)) as second:
        first.cut_after_items = 3
        mock = ["mock", "default", "--speedup", "10", "--signing-key", "env:THE_KEY"]
        for relay in (first, second):
            mock += ["--link", f"udpout:127.0.0.1:{relay.port}"]
        with process(run.arguments, run.log) as run.daemon:
            with process(mock, tmp_path / "mock.log"):
                run.wait_for(run.logged("start mission: accepted"))
                assert first.cut
                assert second.items > 3
                run.wait_for(lambda: "one_link/hawk" in run.alarms())
                assert states(run) == [("silent", False), ("up", True)]
                metrics = get(run, "/metrics").decode()
                lte = f'{{link="udpin:127.0.0.1:{backup}",vehicle="hawk"}}'
                assert f"mission_service_link_in_use{lte} 1.0" in metrics
                assert f"mission_service_link_loss_ratio{lte} 0." in metrics
                run.flies_on(100)
                assert not run.events("LinkLost")
                first.cut_after_items, first.cut = None, False
                run.wait_for(lambda: states(run)[0] == ("up", True))
                assert "one_link/hawk" not in run.alarms()
                first.cut = second.cut = True
                run.wait_for(lambda: "link/hawk" in run.alarms())
                run.wait_for(lambda: [state for state, _ in states(run)] == ["silent", "silent"])
                second.cut = False
                run.wait_for(lambda: "link/hawk" not in run.alarms())
                run.wait_for(lambda: states(run)[1] == ("up", True))
                first.cut = False
                run.wait_for(lambda: states(run)[0] == ("up", True))
                run.flies_on(100)
            run.stop()
    assert len(run.events("LinkLost")) == len(run.events("LinkRestored")) == 1
    assert not run.events("VehicleRebooted")
    assert not {"source/hawk", "clock/hawk"} & run_alarms(tmp_path)
    modes = [event["mode"] for event in run.events("ModeChanged")]
    assert len(modes) <= 4, modes
    causes = [event["cause"] for event in run.events("LinksReported") if event["cause"]]
    assert causes[0] == "silent"
    assert causes.count("recovered") >= 2
    (vehicle,) = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["vehicles"]
    assert vehicle["link_switches"]["silent"] >= 1
    by_link = {each["link"]: each for each in vehicle["links"]}
    used, other = (by_link[f"udpin:127.0.0.1:{port}"] for port in (run.port, backup))
    assert 5.0 < used["mean_loss_pct"] < 40.0
    assert used["silent_s"] > other["silent_s"] > 0.0
    assert verify(tmp_path / "journal.jsonl").difference is None


def run_alarms(folder: Path) -> set[str]:
    """Return the kinds of the alarms that were raised in a run."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return {f"{kind}/hawk" for kind in summary["alarms"]}


@pytest.mark.parametrize(
    ("sets", "words"),
    [
        (('vehicles.0.backup_link="udpin:0.0.0.0:14550"',), "hawk: link .* open the same port"),
        (('vehicles.0.backup_link="lte:1"',), "lte:1"),
        (
            ('vehicles.0.backend="mavsdk"', 'vehicles.0.backup_link="udpin:0.0.0.0:14560"'),
            "cannot use a backup_link",
        ),
        (
            ('vehicles.0.backup_link="udpin:127.0.0.1:1"', 'vehicles.1.link="udpin:127.0.0.1:1"'),
            "hawk and kite have the system id 1 on one link",
        ),
        (('vehicles.0.backup_link="udpin:0.0.0.0:14560"',), "hawk .* and kite .* open the same"),
        (
            (
                'vehicles.0.backup_link="udpin:0.0.0.0:14570"',
                'vehicles.1.backup_link="udpin:0.0.0.0:14570"',
                'vehicles.1.link="udpin:0.0.0.0:14571"',
                "vehicles.1.signing_link_id=7",
            ),
            "signing_link_id must be the same",
        ),
        (('vehicles.0.backup_link="udpin:0.0.0.0:14570"',), ""),
    ],
)
def test_links_that_cannot_be_used_are_reported_in_one_line(
    sets: tuple[str, ...], words: str
) -> None:
    ids = "vehicles.1.system_id=" + ("1" if "system id" in words else "2")
    sets = ('vehicles.0.link="udpin:127.0.0.1:14550"', *sets, ids)
    if not words:
        check(load_scenario("demo", sets))
        return
    with pytest.raises((ScenarioError, BridgeError), match=words) as raised:
        check(load_scenario("demo", sets))
    assert "\n" not in str(raised.value)


def test_vehicles_that_share_one_of_their_links_are_in_one_group() -> None:
    sets = (
        'vehicles.0.backup_link="udpin:0.0.0.0:14570"',
        'vehicles.1.backup_link="udpin:0.0.0.0:14570"',
        "vehicles.1.system_id=2",
    )
    for number, groups in ((2, [["hawk", "kite"]]), (1, [["hawk"], ["kite"]])):
        scenario = load_scenario("demo", sets[-number:] if number == 1 else sets)
        found = sharing(scenario.vehicles)
        assert [[section.name for section in group] for group in found] == groups


RADIO, LTE = "serial:/dev/ttyUSB0:57600", "udpin:0.0.0.0:14560"


def links_of(
    *states: Any, in_use: str = RADIO, cause: Any = "", at_s: float = 1.0
) -> LinksReported:
    named = zip((RADIO, LTE), states, strict=False)
    quality = (LinkQuality(link, state, 0.1) for link, state in named)
    return LinksReported(round(at_s * 1e6), "hawk", tuple(quality), in_use, cause)


def test_the_core_warns_while_one_of_two_links_is_left_and_sends_nothing() -> None:
    scenario = load_scenario("demo")
    core = Core(scenario, landscape_of(scenario))
    found = [
        [type(command).__name__ for command in core.handle(event)]
        for event in (
            links_of("up", "up"),
            links_of("silent", "up", in_use=LTE, cause="silent"),
            links_of("silent", "degraded", in_use=LTE),
            links_of("silent", "silent", in_use=LTE),
            links_of("up", "silent", cause="silent"),
            links_of("up", "up"),
            links_of("up"),
        )
    ]
    assert found == [
        [],
        ["Announce", "Announce", "RaiseAlarm"],
        [],
        ["ClearAlarm"],
        ["Announce", "Announce", "RaiseAlarm"],
        ["ClearAlarm"],
        [],
    ]


def test_times_and_shares_of_each_link_are_summed() -> None:
    use = LinkUse()
    use.on_event(links_of("up", "up", at_s=0.0))
    use.on_event(links_of("silent", "up", in_use=LTE, cause="silent", at_s=10.0))
    use.on_event(links_of("up", "up", cause="recovered", at_s=40.0))
    use.on_event(LinkLost(50_000_000, "hawk", 3.0))
    first, second = use.of_links()
    assert first == {
        "link": RADIO,
        "observed_s": 50.0,
        "in_use_s": 20.0,
        "degraded_s": 0.0,
        "silent_s": 30.0,
        "mean_loss_pct": 10.0,
    }
    assert second["in_use_s"] == 30.0
    assert use.switches == {"silent": 1, "recovered": 1}


def test_the_time_of_the_last_frame_is_in_mission_time() -> None:
    client, clock = NativeClient(), MissionClock(100_000_000, wall=True)
    gateway = Gateway("hawk", client, clock)
    silent = LinkStatus(RADIO, "silent", 0.25, 5_000_000)
    client.report(LinksChanged(9_000_000, (silent,), RADIO, ""))
    (event,) = gateway.events(9_000_000)
    assert event == LinksReported(
        100_000_000, "hawk", (LinkQuality(RADIO, "silent", 0.25, 96_000_000),), RADIO
    )
