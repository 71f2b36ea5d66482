"""Signed links for users: sources of keys, shared keys, refusals, and no key in any file."""

import contextlib
import errno
import json
import signal
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from autopilot_bridge.clients.shared_link import SharedLink
from autopilot_bridge.items import Plan
from autopilot_bridge.links.asyncio_connection import Connection
from autopilot_bridge.links.link_address import other_end
from autopilot_bridge.links.signing import Counts, Key, Signing, Timestamps, key_of
from autopilot_bridge.missions.plan_file import write_plan
from autopilot_bridge.missions.transfer import TransferTiming
from autopilot_bridge.stacks.stacks import stack_named
from mission_service.config.scenario import SHIPPED, load_scenario, with_signing_key
from mission_service.errors import ScenarioError
from mission_service.fire.scenario_check import check
from mission_service.runtime.clocks import wall_us
from mission_service.runtime.link_signing import SigningRefusals, refusal, signings, timestamps_file
from mission_service.runtime.vehicle_links import Link
from tests.bridge.helpers import line_of
from tests.bridge.test_tlog import autopilot_on
from tests.bridge.transport_helpers import clock_us
from tests.patience import PATIENCE_S, wait_until
from tests.service.test_cli import call
from tests.service.test_live import free_port, process

PASSPHRASE, OTHER = "correct horse battery", "another horse"
DEFAULT = (SHIPPED / "default.toml").read_text(encoding="utf-8")
VEHICLE = "[[vehicles]]\n"


@pytest.fixture(autouse=True)
def state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Create a folder for the timestamps, and set the keys in the environment."""
    folder = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    monkeypatch.setenv("THE_KEY", PASSPHRASE)
    monkeypatch.setenv("OTHER_KEY", OTHER)
    return folder


@contextlib.contextmanager
def mock_on(port: int, folder: Path, *more: str) -> Iterator[None]:
    words = ["mock", "--stack", "ardupilot", "--link", f"udpout:127.0.0.1:{port}", *more]
    words += ["--speedup", "8"]  # so heartbeats have a rate of eight a second
    log = folder / "mock.log"
    with process(words, log):
        wait_until(lambda: "ardupilot" in log.read_text(encoding="utf-8"))
        yield


def a_plan(folder: Path) -> str:
    path = folder / "sent.plan"
    write_plan(path, Plan(line_of(5)), stack_named("ardupilot", "plane"))
    return str(path)


def holds_no_key(path: Path) -> bool:
    held = path.read_bytes()
    secrets = [key_of(text).secret for text in (PASSPHRASE, OTHER)]
    texts = [secret.hex().encode() for secret in secrets] + [PASSPHRASE.encode(), OTHER.encode()]
    return len(held) > 0 and not any(found in held for found in (*secrets, *texts))


# Scenarios ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "line",
    [
        f'signing_key = "{PASSPHRASE}"',
        f'signing_key = "hex:{PASSPHRASE}"',
        f'signing_keys = "{PASSPHRASE}"',
        f'signing = "{PASSPHRASE}"',
        f'signing_key = ["{PASSPHRASE}"]',
        'signing_key = "file:"',
        'signing_key = "env:two words"',
    ],
)
def test_a_key_in_a_scenario_is_refused_in_one_line_that_does_not_show_it(
    tmp_path: Path, line: str
) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(DEFAULT.replace(VEHICLE, f"{VEHICLE}{line}\n"), encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(str(path))
    text = str(caught.value)
    assert text.startswith(f"{path}: vehicles.0.signing")
    assert "horse" not in text
    assert "\n" not in text
    if line.startswith("signing_key =") and "[" not in line:
        assert 'as "file:PATH" or "env:NAME"' in text


def test_a_key_file_counts_from_the_scenario_and_is_looked_at_by_the_check(tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    text = f'{VEHICLE}signing_key = "file:the.key"\nsigning_link_id = 7\n'
    path.write_text(DEFAULT.replace(VEHICLE, text), encoding="utf-8")
    scenario = load_scenario(str(path))
    assert scenario.vehicles[0].signing_key == f"file:{tmp_path / 'the.key'}"
    assert scenario.vehicles[0].signing_link_id == 7
    missing = call("config", "check", str(path))
    assert (missing.exit_code, missing.stderr.count("\n")) == (1, 1)
    assert f"{tmp_path / 'the.key'}: No such file" in missing.stderr
    (tmp_path / "the.key").write_text(PASSPHRASE, encoding="utf-8")
    assert check(scenario)["vehicles"]


def test_a_bare_key_on_the_command_line_is_refused(tmp_path: Path) -> None:
    for command in (("mission", "clear"), ("mock",), ("run", "default", "--out", str(tmp_path))):
        result = call(*command, "--signing-key", PASSPHRASE)
        assert result.exit_code == 1
        assert "as file:PATH or env:NAME" in result.stderr
        assert "horse" not in result.output
    with pytest.raises(ScenarioError, match="file:PATH"):
        with_signing_key(load_scenario("default"), PASSPHRASE)


# Sharing and reports --------------------------------------------------------------------------


def test_the_same_key_from_two_places_is_one_signing_with_lasting_timestamps(
    tmp_path: Path, state: Path
) -> None:
    file = tmp_path / "the.key"
    file.write_text(PASSPHRASE + "\n", encoding="utf-8")
    file.chmod(0o644)
    lines: list[str] = []
    sources = (f"file:{file}", "env:THE_KEY", None, "env:OTHER_KEY")
    with signings(sources, lambda: 1_800_000_000_000_000, lines.append) as of:
        assert of[f"file:{file}"] is of["env:THE_KEY"] is not of["env:OTHER_KEY"]
        assert of.get(None) is None
        frame = bytes.fromhex("fd0100000001010000000000ff")
        stamps = [of[source].sign(frame, 0)[-12:-6] for source in ("env:THE_KEY", "env:OTHER_KEY")]
    first, second = (int.from_bytes(stamp, "little") for stamp in stamps)
    assert second == first + 1
    assert timestamps_file() == state / "mission-service" / "signing-timestamp"
    assert int(timestamps_file().read_text(encoding="ascii")) == second
    assert lines == [
        f"signing key: {file} is readable by other users of this machine; run chmod 600 {file}"
    ]
    assert stat.S_IMODE(file.stat().st_mode) == 0o644  # reported, not changed
    with signings((None,), wall_us, lines.append) as of:
        assert of == {}


def test_the_most_frequent_refusal_is_reported_once() -> None:
    assert refusal(Counts(good=9, wrong=265, unsigned=2), "udpin:h:1") == (
        "refused 265 frames with a wrong signature on udpin:h:1; "
        "check that the vehicle has this key"
    )
    assert refusal(Counts(good=9), "udpin:h:1") is None
    refusals = SigningRefusals("udpin:h:1", 1, Signing(Key(bytes(range(32))), Timestamps(wall_us)))
    assert refusals.new_reports(Counts(unsigned=3), False) == []
    (line,) = refusals.new_reports(Counts(unsigned=12), False)
    assert line.startswith("refused 12 frames without a signature on udpin:h:1; set the vehicle")
    assert refusals.new_reports(Counts(unsigned=40), False) == []
    silent = SigningRefusals("udpin:h:1", 1, None)
    assert "no signing key is configured" in silent.new_reports(Counts(), True)[0]


def test_a_vehicle_whose_clock_is_ahead_is_reported() -> None:
    key = Key(bytes(range(32)))
    ours = Signing(key, Timestamps(lambda: 1_800_000_000_000_000))
    theirs = Signing(key, Timestamps(lambda: 1_800_000_090_000_000))
    frame = bytes.fromhex("fd09000000030100000000000000000000000000000000")
    assert ours.accepts(theirs.sign(frame, 0))
    assert SigningRefusals("udpin:h:1", 1, ours).new_reports(ours.counts, False) == []
    (line,) = SigningRefusals("udpin:h:1", 3, ours).new_reports(ours.counts, False)
    assert "90 s ahead" in line


def test_lost_datagrams_are_reported_once_for_each_vehicle() -> None:
    connection = Connection("udpin:127.0.0.1:14999", SharedLink("a link"), clock_us)
    unused: Any = None
    hawk, kite = (
        Link(unused, unused, connection, connection.ports, (refusals,), {}, frozenset())
        for refusals in (SigningRefusals("udpin:h:1", number, None) for number in (1, 2))
    )
    assert hawk.new_reports() == []
    reports = []
    for _ in range(3):
        connection.ports[0].datagram_lost(PermissionError(errno.EPERM, "unused"))
        reports += hawk.new_reports()
    (report,) = reports
    assert report.startswith(
        "a datagram was lost on udpin:127.0.0.1:14999: Operation not permitted"
    )
    assert kite.new_reports() == reports


# Two processes --------------------------------------------------------------------------------


def test_missions_over_a_signed_link(tmp_path: Path) -> None:
    port, plan, tlog = free_port(), a_plan(tmp_path), tmp_path / "up.tlog"
    link = ("--link", f"udpin:127.0.0.1:{port}")
    with mock_on(port, tmp_path, "--signing-key", "env:THE_KEY"):
        key = ("--signing-key", "env:THE_KEY", "--timeout", "10", "--tlog", str(tlog))
        up = call("mission", "upload", plan, *link, *key, "--json")
        assert up.exit_code == 0, up.output
        assert json.loads(up.stdout)["items"] == 5
        back = call("mission", "download", "-o", str(tmp_path / "back.plan"), *link, *key, "--json")
        assert json.loads(back.stdout)["items"] == 5

        other = call(
            "mission", "clear", *link, "--signing-key", "env:OTHER_KEY", "--timeout", "0.8"
        )
        assert other.exit_code == 1
        assert "no autopilot was accepted within 0.8 s: refused" in other.stderr
        assert "with a wrong signature" in other.stderr

        none = call("mission", "clear", *link, "--timeout", "0.8")
        assert none.exit_code == 1
        assert "are signed, but no signing key is configured" in none.stderr
    assert holds_no_key(tlog)


def test_silence_is_not_called_a_refusal() -> None:
    link = ("--link", f"udpin:127.0.0.1:{free_port()}")
    result = call("mission", "clear", *link, "--signing-key", "env:THE_KEY", "--timeout", "0.3")
    assert "no autopilot was found within 0.3 s" in result.stderr


def test_a_vehicle_is_given_a_key_another_one_and_none(tmp_path: Path) -> None:
    port, plan, tlog = free_port(), a_plan(tmp_path), tmp_path / "set.tlog"
    link = ("--link", f"udpin:127.0.0.1:{port}", "--timeout", "12")
    one, other = ("--signing-key", "env:THE_KEY"), ("--signing-key", "env:OTHER_KEY")
    with mock_on(port, tmp_path):
        unsigned = call("mission", "clear", *link, *one, "--timeout", "0.8")
        assert "without a signature" in unsigned.stderr
        on = call("signing", "set-up", *link, *one, "--tlog", str(tlog), "--json")
        assert on.exit_code == 0, on.output
        assert json.loads(on.stdout) == {"result": "accepted", "system_id": 1, "signing": "on"}
        assert call("mission", "upload", plan, *link, *one).exit_code == 0
        changed = call("signing", "set-up", *link, *other, "--old-key", "env:THE_KEY")
        assert changed.exit_code == 0, changed.output
        assert call("mission", "clear", *link, *other).exit_code == 0
        off = call("signing", "off", *link, *other, "--tlog", str(tlog))
        assert off.exit_code == 0, off.output
        assert call("mission", "clear", *link).exit_code == 0
    assert holds_no_key(tlog)


def test_a_vehicle_that_ignores_its_commands_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mission_service.cli.signing_setup.TIMING", TransferTiming(200_000, 2))
    ours = f"udpin:127.0.0.1:{free_port()}"
    with autopilot_on(other_end(ours)):  # it receives no key
        result = call("signing", "set-up", "--link", ours, "--signing-key", "env:THE_KEY")
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert "vehicle 1 received the key but does not sign" in result.stderr
    port = free_port()
    link = ("--link", f"udpin:127.0.0.1:{port}")
    with mock_on(port, tmp_path, "--signing-key", "env:THE_KEY"):
        again = call("signing", "set-up", *link, "--signing-key", "env:OTHER_KEY")
        assert "signs with another key; specify that key with --old-key" in again.stderr
        off = call("signing", "off", *link, "--signing-key", "env:OTHER_KEY", "--timeout", "0.8")
        assert "no autopilot was accepted" in off.stderr


def test_the_service_signs_natively_and_through_mavsdk_and_reports_a_wrong_key(
    tmp_path: Path,
) -> None:
    """One vehicle uses its key through MAVSDK, one natively, and one has another key."""
    ports = [free_port() for _ in range(3)]
    table = DEFAULT[DEFAULT.index(VEHICLE) :].partition("\n\n")[0]
    name = next(line for line in table.splitlines() if line.startswith("name"))
    backends = ("mavsdk", "native", "native")
    tables = [
        table.replace(name, f'name = "v{number}"\nsystem_id = {number}\nbackend = "{backend}"\n')
        + f'\nlink = "udpin:127.0.0.1:{port}"\nsigning_key = "env:THE_KEY"\n'
        for number, (port, backend) in enumerate(zip(ports, backends, strict=True), start=1)
    ]
    path, log, tlog = tmp_path / "three.toml", tmp_path / "daemon.log", tmp_path / "a.tlog"
    path.write_text(DEFAULT.replace(table, "\n".join(tables)), encoding="utf-8")
    words = ["run", str(path), "--out", str(tmp_path), "--tlog", str(tlog)]
    words += ["--set", "start_s=3600", "--set", "duration_s=100000"]

    def logged(*texts: str) -> bool:
        held = log.read_text(encoding="utf-8")
        return all(text in held for text in texts)

    with contextlib.ExitStack() as stack:
        daemon = stack.enter_context(process(words, log))
        for number, port in enumerate(ports, start=1):
            link = ["--link", f"udpout:127.0.0.1:{port}", "--system-id", str(number)]
            key = ["--signing-key", "env:OTHER_KEY" if number == 3 else "env:THE_KEY"]
            mock = ["mock", "--stack", "px4", "--speedup", "5", *link, *key]
            stack.enter_context(process(mock, tmp_path / f"mock{number}.log"))
        wait_until(lambda: logged("v1: connected", "v2: connected", "v3: refused"))
        wait_until(lambda: accepted(tmp_path / "journal.jsonl") == {"v1", "v2"})
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(timeout=PATIENCE_S) == 0
    assert logged("with a wrong signature on udpin", "check that the vehicle has this key")
    assert not logged("v3: connected")
    journal = tmp_path / "journal.jsonl"
    assert '"env:THE_KEY"' in journal.read_text(encoding="utf-8")
    assert all(holds_no_key(file) for file in (journal, tlog, log, tmp_path / "summary.json"))


def accepted(journal: Path) -> set[str]:
    """Return the vehicles that have accepted a mission."""
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.exists() else []
    uploads = [json.loads(line)["event"] for line in lines if "UploadFinished" in line]
    return {upload["vehicle"] for upload in uploads if upload["outcome"] == "accepted"}
