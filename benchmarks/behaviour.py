"""Record the outputs of a source tree, and compare two records, to check a refactoring.

    python -m benchmarks.behaviour record FOLDER [PART ...]
    python -m benchmarks.behaviour compare BEFORE AFTER [--names FILE] [--without KEY ...]

``record`` runs the current tree: ``sim`` and ``plan`` of each shipped scenario, each experiment,
the OpenAPI description and the MQTT schemas, or only the given parts (``sim/demo``, ``plan``). All
parts take about twenty minutes on two cores. ``compare`` prints the first differences of each file
and exits with 1 if it finds any. It compares journals line by line without their checksums, and
schemas without their descriptions. ``--names`` is a JSON file of old and new names
(``names_of_0_1.json``), which replaces the old names in BEFORE. ``--without`` excludes fields whose
wording was changed on purpose, such as ``text``.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any

import click

from mission_service.config.scenario import SHIPPED, load_scenario

SCENARIOS = sorted(file.stem for file in SHIPPED.glob("*.toml"))
EXPERIMENTS = ("beachly", "bent", "islam-hu", "virtual-agents")
SCHEMAS = Path(__file__).parents[1] / "docs" / "schemas"
PROSE = ("description", "title", "summary")
# Fields of journal lines and of the header.
UNSTABLE = ("crc", "created", "packages", "mission_service")
SHOWN = 5
PROCESSES = 2
TIMEOUT_S = 3600.0
OVERRIDES = {"sitl": ("--set", "duration_s=7200")}  # because the scenario has no end


def record(folder: Path, selected: list[str]) -> None:
    """Write the outputs of the current tree into a folder, one file for each output."""
    parts = dict(_parts(folder))
    unknown = [each for each in selected if not any(_is_in(name, each) for name in parts)]
    if unknown:
        sys.exit(f"{', '.join(unknown)}: no such part; the parts are {', '.join(parts)}")
    chosen = [name for name in parts if not selected or any(_is_in(name, s) for s in selected)]
    with ThreadPoolExecutor(PROCESSES) as pool:
        for name, _ in zip(chosen, pool.map(lambda each: parts[each](), chosen), strict=True):
            click.echo(f"{name}")


def _is_in(name: str, part: str) -> bool:
    return name == part or name.startswith(f"{part}/")


def _parts(folder: Path) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield the name of each output, and a function that writes it into the folder."""
    for name in SCENARIOS:
        yield f"sim/{name}", partial(_sim, name, folder / "sim" / name)
    for name in SCENARIOS:
        yield f"plan/{name}", partial(_plans, name, folder / "plan" / name)
    for name in EXPERIMENTS:
        yield f"experiment/{name}", partial(_experiment, name, folder / "experiment")
    yield "schemas", partial(_schemas, folder / "schemas")
    yield "openapi", partial(_openapi, folder)


def _service(*arguments: str) -> str:
    """Run a command of the service and return its standard output; exit if it fails."""
    command = (sys.executable, "-m", "mission_service.cli", *arguments)
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(arguments)}: exit code {done.returncode}: {done.stderr[-500:]}")
    return done.stdout


def _sim(name: str, folder: Path) -> None:
    with tempfile.TemporaryDirectory() as out:
        summary = _service("sim", name, "--out", out, "--json", *OVERRIDES.get(name, ()))
        lines = (Path(out) / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    _write(folder / "summary.json", json.loads(summary))
    with (folder / "journal.jsonl").open("w", encoding="utf-8") as file:
        for line in lines:
            file.write(json.dumps(_without(json.loads(line), UNSTABLE)) + "\n")


def _plans(name: str, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for vehicle in load_scenario(name).vehicles:
        file = folder / f"{vehicle.name}.plan"
        _service("plan", name, "--vehicle", vehicle.name, "--output", str(file))


def _experiment(name: str, folder: Path) -> None:
    _write(folder / f"{name}.json", json.loads(_service("experiment", name, "--json")))


def _schemas(folder: Path) -> None:
    for file in sorted(SCHEMAS.glob("*.json")):
        _write(folder / file.name, _without(json.loads(file.read_text(encoding="utf-8")), PROSE))


def _openapi(folder: Path) -> None:
    from tests.api.worlds import scenario_of, served, world_in

    with tempfile.TemporaryDirectory() as out:
        world = world_in(Path(out), scenario_of())
        described = served(world).app.routes.openapi()
    _write(folder / "openapi.json", _without(json.loads(json.dumps(described)), PROSE))


def _write(file: Path, content: Any) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _without(content: Any, keys: tuple[str, ...]) -> Any:
    """Return JSON without these keys.

    If the value of a key of ``PROSE`` is an object, the key is the name of a field and is kept.
    """
    if isinstance(content, dict):
        return {
            key: _without(value, keys)
            for key, value in content.items()
            if key not in keys or (keys is PROSE and isinstance(value, dict))
        }
    if isinstance(content, list):
        return [_without(each, keys) for each in content]
    return content


def compare(before: Path, after: Path, names: dict[str, str], without: tuple[str, ...]) -> int:
    """Print the differences of two records; return the number of files that differ."""
    old = {_renamed(file.relative_to(before), names): file for file in _files(before)}
    files = sorted({*old, *(file.relative_to(after) for file in _files(after))})
    if not files:
        sys.exit(f"{before}, {after}: contain no record")
    different = 0
    for file in files:
        pair = (old.get(file, before / file), after / file)
        found = list(islice(_differences(*pair, names, without), SHOWN))
        different += bool(found)
        for line in found:
            click.echo(f"{file}: {line}")
    click.echo(f"{len(files)} files, {different} differ")
    return different


def _renamed(file: Path, names: dict[str, str]) -> Path:
    return Path(*(names.get(part, part) for part in file.parts))


def _files(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.is_file()]


def _differences(
    before: Path, after: Path, names: dict[str, str], without: tuple[str, ...]
) -> Iterator[str]:
    for file in (before, after):
        if not file.is_file():
            yield f"missing in {file.parent}"
            return
    lines = (_lines(before, names, without), _lines(after, {}, without))
    for number, (old, new) in enumerate(zip_longest(*lines, fillvalue=""), 1):
        if old != new:
            yield f"line {number}:\n  - {_about(old, new)}\n  + {_about(new, old)}"


def _lines(file: Path, names: dict[str, str], without: tuple[str, ...]) -> Iterator[str]:
    """Yield the lines of a journal or of another JSON file, with the old names replaced."""
    words = re.compile(r"(?<!\w)(" + "|".join(map(re.escape, names)) + r")(?!\w)")
    with file.open(encoding="utf-8") as content:
        for text in content if file.suffix == ".jsonl" else (content.read(),):
            renamed = words.sub(lambda found: names[found[0]], text) if names else text
            found = _without(json.loads(renamed), without)
            indent = None if file.suffix == ".jsonl" else 1
            yield from json.dumps(found, sort_keys=True, indent=indent).splitlines()


def _about(line: str, other: str) -> str:
    """Return an excerpt of a line, from shortly before its first difference to another line."""
    same = next((at for at, (a, b) in enumerate(zip(line, other, strict=False)) if a != b), 0)
    start = max(0, same - 80)
    return f"{'…' if start else ''}{line[start : start + 240]}"


def main() -> int:
    """Record or compare outputs, as requested on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("folder", type=Path)
    recording.add_argument("part", nargs="*")
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--names", type=Path)
    comparing.add_argument("--without", nargs="*", default=())
    given = parser.parse_args()
    if given.command == "record":
        record(given.folder, given.part)
        return 0
    names = {} if given.names is None else json.loads(given.names.read_text(encoding="utf-8"))
    return 1 if compare(given.before, given.after, names, tuple(given.without)) else 0


if __name__ == "__main__":
    sys.exit(main())
