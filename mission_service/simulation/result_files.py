"""Stores the results of many runs in a folder, so that a stopped command can be resumed.

Each result is one file, which is written completely or not at all. The file ``recipe.json``
contains the inputs of the computation (the recipe); a folder is reused only for the same recipe.
"""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile

import firemodel
from firemodel.compiled import cache_folder
from firemodel.outputs.whole_file import whole_file, write_whole
from mission_service.config.input_files import input_files
from mission_service.config.scenario import Scenario
from mission_service.errors import MissionServiceError, ScenarioError

RECIPE = "recipe.json"
PART = ".part-"  # prefix of the names of temporary folders
# One result of each command, which identifies its results folder.
COMMANDS = {
    "fire run": "arrival_time_s.tif",
    "fire run --members": "members",
    "fire sweep": "runs",
    "fire assimilate": "assimilation.json",
    "fire wind": "wind_speed.tif",
}
Recipe = dict[str, Any]
# The exceptions that json and NumPy raise for a damaged file.
DAMAGE: tuple[type[Exception], ...] = (
    *(ValueError, LookupError, TypeError, EOFError, BadZipFile, NotImplementedError),
    *(MemoryError, OverflowError, SyntaxError, TokenError),
)


# The tables of a scenario on which its fire depends.
USED = {"name", "seed", "time_zero", "duration_s", "landscape", "fire", "ensemble", "ignition"}
USED |= {"weather", "weather_file", "wind_grids", "terrain_wind", "burn", "suppression"}


def recipe_of(scenarios: Sequence[Scenario]) -> Recipe:
    """Return the fires' inputs: settings (of the first scenario), input files, the fire model.

    Raises OSError or FireModelError for a file that cannot be read.
    """
    files = {path for each in scenarios for path in input_files(each, USED)}
    digests = {}
    for path in sorted(files):
        with path.open("rb") as file:
            digests[str(path)] = hashlib.file_digest(file, "sha256").hexdigest()
    return {
        "scenario": scenarios[0].model_dump(mode="json", include=USED),
        "files": digests,
        "model": cache_folder(Path(firemodel.__file__).parent).name,
    }


@contextmanager
def whole_files(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder, whose files are moved to ``folder`` if no exception is raised.

    Temporary folders left in ``folder`` by killed processes are removed.
    """
    for left in folder.glob(f"{PART}*"):
        shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=PART) as part:
        yield Path(part)
        for path in sorted(Path(part).iterdir()):
            path.replace(folder / path.name)


def check_command(folder: Path, command: str) -> None:
    """Raise ScenarioError for a folder with the results of another command (``COMMANDS``)."""
    for other, result in COMMANDS.items():
        if other != command and (folder / result).exists():
            raise ScenarioError(
                f"{folder}: contains results of {other} ({result}); choose another folder with -o"
            )


def results_folder(folder: Path, recipe: Recipe) -> Path:
    """Create a folder for the results of a recipe, or check the recipe of an existing folder.

    Raises MissionServiceError for a folder with the results of another recipe.
    """
    folder.mkdir(exist_ok=True)
    path, recipe = folder / RECIPE, json.loads(json.dumps(recipe))
    # Without results, the recipe is written.
    if not any(each.name[0].isdigit() for each in folder.iterdir()):
        write_whole(path, json.dumps(recipe, indent=1) + "\n")
        return folder
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        found = None
    if not isinstance(found, dict):
        raise MissionServiceError(
            f"{path}: is missing or corrupt, so the settings of the results in this folder are "
            "unknown; choose another folder with -o, or delete this folder"
        )
    if found != recipe:
        raise MissionServiceError(
            f"{folder}: contains results with other settings ({difference(found, recipe)}); choose "
            "another folder with -o, or delete this folder"
        )
    return folder


def difference(before: Any, now: Any, key: str = "") -> str:
    """Return the first difference between two recipes, as ``key: before, now``."""
    if isinstance(before, dict) and isinstance(now, dict):
        names = sorted({*before, *now})
        pairs = [(name, before.get(name, "missing"), now.get(name, "missing")) for name in names]
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = [(str(place), *pair) for place, pair in enumerate(zip(before, now, strict=True))]
    else:
        return f"{key}: before {json.dumps(before)[:60]}, now {json.dumps(now)[:60]}"
    name, old, new = next(pair for pair in pairs if pair[1] != pair[2])
    return difference(old, new, f"{key}.{name}" if key else name)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Report a damaged result within the context as a MissionServiceError with the remedy."""
    try:
        yield
    except OSError as error:
        raise MissionServiceError(f"{path}: cannot be read: {error.strerror or error}") from None
    except DAMAGE as error:
        raise MissionServiceError(
            f"{path}: is corrupt ({' '.join(str(error).split())}); delete it and repeat the command"
        ) from None


def numbered(folder: Path, number: int, suffix: str) -> Path:
    """Return the path of the result file with this number."""
    return folder / f"{number:06d}{suffix}"


def missing(folder: Path, count: int, suffix: str) -> list[int]:
    """Return the numbers below ``count`` that have no result in the folder."""
    present = {path.name for path in folder.glob(f"*{suffix}")}
    return [n for n in range(count) if numbered(folder, n, suffix).name not in present]


def complete(
    folder: Path,
    count: int,
    suffix: str,
    compute: Callable[[Sequence[int]], Iterable[Any]],
    save: Callable[[Any, Path], object],
    progress: Callable[[float], None],
) -> int:
    """Compute and store the results below ``count`` that are missing in a folder.

    Args:
        folder: The results folder.
        count: The number of all results.
        suffix: The suffix of the result files.
        compute: A function that returns the results with the given numbers, in the same order.
        save: A function that writes a result to a file.
        progress: A function that is called after each new result with the number of results in the
            folder.

    Returns:
        The number of results that were missing.
    """
    absent = missing(folder, count, suffix)
    present = count - len(absent)
    for number, result in zip(absent, compute(absent), strict=True):
        with whole_file(numbered(folder, number, suffix)) as path:
            save(result, path)
        present += 1
        progress(present)
    return len(absent)
