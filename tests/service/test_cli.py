"""The command line, used as a user does."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from autopilot_bridge.items import MissionItem, Plan
from autopilot_bridge.missions.plan_file import read_any, write_plan
from autopilot_bridge.missions.read_back import same_as_sent
from autopilot_bridge.stacks.stacks import stack_named
from mission_service import __version__
from mission_service.cli.main import main
from mission_service.cli.options import report_address
from mission_service.config.scenario import SHIPPED
from tests.patience import PATIENCE_S
from tests.service.test_live import CLI, free_port

QUICK = ("--set", "start_s=3500", "--set", "duration_s=3800")


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, list(arguments))


def test_the_version_is_printed() -> None:
    assert __version__ in call("--version").output


@pytest.mark.parametrize(
    "command", ["demo", "sim", "run", "mock", "plan", "mission", "replay", "config", "signing"]
)
def test_every_command_explains_itself(command: str) -> None:
    result = call(command, "--help")
    assert result.exit_code == 0
    assert "Usage:" in result.output


def test_a_simulation_leaves_its_files_and_prints_json(tmp_path: Path) -> None:
    result = call("sim", "default", "--out", str(tmp_path), "--json", *QUICK)
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    assert summary == json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        "journal.jsonl",
        "map.png",
        *(f"perimeters.{suffix}" for suffix in ("geojson", "kml", "qml")),
        "summary.json",
        "tracks.geojson",
    }


def test_replay_reports_what_was_reproduced_and_fails_on_a_changed_line(tmp_path: Path) -> None:
    call("sim", "default", "--out", str(tmp_path), *QUICK)
    journal = tmp_path / "journal.jsonl"
    good = call("replay", str(journal), "--verify", "--json")
    assert good.exit_code == 0
    assert json.loads(good.stdout)["difference"] is None
    lines = journal.read_text(encoding="utf-8").splitlines(keepends=True)
    lines[400] = lines[400].replace('"lat_deg":36', '"lat_deg":35')
    journal.write_text("".join(lines), encoding="utf-8")
    bad = call("replay", str(journal), "--verify")
    assert bad.exit_code == 1
    assert "first difference in line 401" in bad.stderr


def test_a_plan_can_be_written_and_read(tmp_path: Path) -> None:
    path = tmp_path / "first.plan"
    assert call("plan", "default", "-o", str(path)).exit_code == 0
    assert len(read_any(path).mission) >= 3


@pytest.mark.parametrize("name", sorted(path.stem for path in SHIPPED.glob("*.toml")))
def test_shipped_scenarios_check(name: str) -> None:
    result = call("config", "check", name, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["result"] == "ok"


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("planner.beta=1", "--set: planner.beta: unknown key"),
        ("planner.alpha=-1", "--set: planner.alpha: must be a number, at least 0 (got -1)"),
        ("weather.9.at_s=3", "--set weather.9.at_s=3: the scenario has no such key"),
        ("planner", "--set planner: write it as key=value"),
        ('estimate.sensors=["a","b","a"]', "estimate.sensors: contains a sensor twice"),
    ],
)
def test_a_wrong_option_gets_one_line_and_exit_code_2(option: str, words: str) -> None:
    result = call("config", "check", "default", "--set", option)
    assert result.exit_code == 2
    assert words in result.output
    assert result.output.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sim", "nowhere", "--out", "OUT"), "nowhere: no such file"),
        (("sim", "default", "--out", "/proc/nothing"), "/proc/nothing"),
        (
            ("sim", "default", "--out", "OUT", "--set", 'estimate.sensors=["observation_files"]'),
            "estimate.sensors: observation_files uses wall-clock time",
        ),
        (("replay", "OUT/none.jsonl", "--verify"), "none.jsonl: cannot be read"),
        (("plan", "default", "--vehicle", "owl", "-o", "OUT/x.plan"), "no vehicle 'owl'"),
        (("plan", "default", "-o", "/proc/nothing/x.plan"), "/proc/nothing/x.plan"),
        (("mission", "upload", "OUT/none.plan"), "none.plan: cannot be read"),
        (("mission", "clear", "--link", "bus:1"), "udpin:HOST:PORT"),
        (("mock", "--home", "here"), "LAT,LON,ALTITUDE_AMSL_M"),
        (("mock", "--system-id", "249", "--count", "3"), "the highest valid id is 250"),
        (("config", "check", "nowhere"), "nowhere: no such file"),
        (
            ("config", "check", "default", "--set", "estimate.observation_files.burned_values=[0]"),
            "burned_values and unburned_values both contain 0",
        ),
    ],
)
def test_bad_input_gets_one_line_and_exit_code_1(
    tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    result = call(*(argument.replace("OUT", str(tmp_path)) for argument in arguments))
    assert result.exit_code == 1
    assert words in result.stderr
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    "arguments",
    [
        ("burn", "watch", "--every"),
        ("demo", "--speedup"),
        ("experiment", "bent", "--speed"),
        ("fire", "run", "default", "-o", "OUT", "--front-every"),
        ("fire", "wind", "default", "-o", "OUT", "--from", "90", "--speed"),
        ("incident", "new", "OUT/new.toml", "--hours"),
        ("mission", "clear", "--timeout"),
        ("mock", "--battery"),
        ("mock", "--speedup"),
        ("mock", "--terrain"),
        ("observe", "OUT/a.tif", "--scenario", "default", "-o", "OUT", "--every"),
        ("plan", "default", "--what-if", "1", "--minutes"),
        ("products", "OUT", "-o", "OUT/made", "--forecast"),
    ],
)
def test_an_option_that_is_no_finite_number_is_refused(
    tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    given = [argument.replace("OUT", str(tmp_path)) for argument in arguments]
    for number in ("nan", "inf"):
        result = call(*given, number)
        assert result.exit_code == 2, result.output
        assert f"Invalid value for '{given[-1]}'" in result.stderr
        assert number in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "default", "--prefix", "uav"), "--prefix has no effect without --broker"),
        (("run", "default", "--log-level", "debug"), "--log-level has no effect without --log"),
        (("plan", "default", "--minutes", "30"), "--minutes has no effect without --what-if"),
        (
            ("fire", "sweep", "default", "--vary", "seed=1,2", "--set", "seed=3"),
            "--set seed has no effect with --vary seed",
        ),
    ],
)
def test_an_option_without_effect_is_refused(
    tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    out = "-o" if arguments[0] in ("plan", "fire") else "--out"
    result = call(*arguments, out, str(tmp_path / "out"))
    assert result.exit_code == 2, result.output
    assert words in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_place_of_a_result_gets_one_line(tmp_path: Path) -> None:
    (tmp_path / "map.png").mkdir()
    result = call("sim", "default", "--out", str(tmp_path), *QUICK)
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1] == f"Error: {tmp_path}/map.png: Is a directory"
    assert isinstance(result.exception, SystemExit)


def test_a_full_device_gets_one_line() -> None:
    with Path("/dev/full").open("wb") as full:
        result = subprocess.run(
            [*CLI, "config", "check", "default", "--json"],
            stdout=full, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S, check=False,
        )  # fmt: skip
    assert result.returncode == 1
    assert result.stderr.endswith("standard output: No space left on device\n")
    assert result.stderr.count("\n") == 1


def test_a_vehicle_that_never_answers_is_reported() -> None:
    link = f"udpin:127.0.0.1:{free_port()}"
    result = call("mission", "clear", "--link", link, "--timeout", "0.5")
    assert result.exit_code == 1
    assert "no autopilot was found within 0.5 s" in result.stderr


FENCE = (MissionItem(5003, 0, 363_700_000, -841_300_000, 0.0, 5000.0, autocontinue=0),)
RALLY = (MissionItem(5100, 3, 363_710_000, -841_310_000, 100.0),)


@pytest.mark.parametrize(("name", "stack"), [("hawk", "px4"), ("kite", "ardupilot")])
def test_plans_go_up_and_come_down_over_udp(tmp_path: Path, name: str, stack: str) -> None:
    port = free_port()
    sent, read = tmp_path / "sent.plan", tmp_path / "read.plan"
    assert call("plan", "demo", "--vehicle", name, "-o", str(sent)).exit_code == 0
    mission = read_any(sent).mission
    write_plan(sent, Plan(mission, FENCE, RALLY), stack_named(stack, "plane"))
    command = [*CLI, "mock", "demo", "--vehicle", name, "--link", f"udpout:127.0.0.1:{port}"]
    link = ("--link", f"udpin:127.0.0.1:{port}", "--timeout", "20")
    mock = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    counts = {"items": len(mission), "fence": 1, "rally": 1}
    try:
        up = call("mission", "upload", str(sent), *link, "--json")
        assert up.exit_code == 0, up.stderr
        assert json.loads(up.stdout) == {"result": "accepted", **counts, "holds": "the new one"}
        down = call("mission", "download", "-o", str(read), *link, "--json")
        assert json.loads(down.stdout) == {"result": "accepted", **counts, "file": str(read)}
        held = read_any(read)
        alike = stack_named(stack, "plane")
        users = zip(mission, held.mission, strict=True)
        assert all(same_as_sent(ours, theirs, alike) for ours, theirs in users)
        assert (held.fence[0].param1, held.rally[0].z) == (5000.0, 100.0)
        assert call("mission", "clear", *link).exit_code == 0
        call("mission", "download", "-o", str(read), *link)
        assert (read_any(read).mission, len(read_any(read).fence)) == ((), 1)
        assert call("mission", "clear", "--all", *link).exit_code == 0
        call("mission", "download", "-o", str(read), *link)
        assert (read_any(read).fence, read_any(read).rally) == ((), ())
    finally:
        mock.kill()
        mock.wait(timeout=PATIENCE_S)


def test_a_fence_that_would_be_refused_stops_the_upload_before_it_begins(tmp_path: Path) -> None:
    port = free_port()
    path = tmp_path / "fenced.plan"
    bad = MissionItem(5003, 0, 363_700_000, -841_300_000, 0.0, -1.0, autocontinue=0)
    write_plan(path, Plan((), (bad,)), stack_named("px4", "plane"))
    command = [*CLI, "mock", "default", "--link", f"udpout:127.0.0.1:{port}"]
    mock = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        link = f"udpin:127.0.0.1:{port}"
        result = call("mission", "upload", str(path), "--link", link, "--timeout", "20")
        assert result.exit_code == 1
        assert "fence: item 0" in result.stderr
    finally:
        mock.kill()
        mock.wait(timeout=PATIENCE_S)


def test_start_up_is_quick() -> None:
    """No large package is imported before a command needs it."""
    code = (
        "import sys, mission_service.cli; heavy = ('numba', 'matplotlib', 'rasterio', 'scipy'); "
        "print([name for name in heavy if name in sys.modules])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("http://127.0.0.1:1/#token=secret", "(its token is in out/token)"),
        ("http://127.0.0.1:1/", "(use a token from the tokens file)"),
    ],
)
def test_the_path_of_the_token_is_printed_unchanged(
    capsys: pytest.CaptureFixture[str], address: str, words: str
) -> None:
    report_address(Path("out"), address)
    printed = capsys.readouterr().err
    assert printed == f"map: http://127.0.0.1:1/ {words}\n"
    report_address(Path("out"), address, "tour")
    assert capsys.readouterr().err == f"map: http://127.0.0.1:1/#tour {words}\n"


@pytest.mark.parametrize(("address", "sign"), [("http://a/#token=secret", "&"), ("http://a/", "#")])
def test_a_terminal_receives_the_token_and_the_tour(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, address: str, sign: str
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    report_address(Path("out"), address, "tour")
    assert capsys.readouterr().err == f"map: {address}{sign}tour\n"
