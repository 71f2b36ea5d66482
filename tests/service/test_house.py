"""Rules of the repository for readers: names, sizes of folders, faces, docstrings."""

import ast
import importlib
import inspect
import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("firemodel", "autopilot_bridge", "mission_service")
MAX_MODULES = 25  # maximum number of modules in a folder
# Roles that repeat by design: each way of flying has the same files, each package its own base.
ROLES = {
    "__init__.py",
    "__main__.py",
    "errors.py",
    "settings.py",
    "planners.py",
    "controller.py",
    "requests.py",
    "warm_up.py",
    "way.py",  # modules of a way of flying that the registry uses
    # modules of an experiment
    "run.py",
    "scenarios.py",
    "tables.py",
    "figures.py",
}
MODULES = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
FACES = [
    ".".join(file.relative_to(ROOT).parent.parts) for file in MODULES if file.name == "__init__.py"
]


def test_no_folder_has_more_than_25_modules() -> None:
    counts = Counter(file.parent for file in MODULES if file.name != "__init__.py")
    assert {str(folder): n for folder, n in counts.items() if n > MAX_MODULES} == {}


def test_no_two_modules_have_the_same_basename_but_roles() -> None:
    names = Counter(file.name for file in MODULES if file.name not in ROLES)
    assert [name for name, n in names.items() if n > 1] == []


def test_only_guidance_names_a_rule_or_a_guidance_class() -> None:
    asks = re.compile(r"rule ==|isinstance\(.*(Planner|Flight)\)")
    service = ROOT / "mission_service"
    outside = [file for file in service.rglob("*.py") if "guidance" not in file.parts]
    assert [
        f"{file.relative_to(ROOT)}:{number}"
        for file in outside
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        if asks.search(line)
    ] == []


@pytest.mark.parametrize("name", FACES)
def test_each_package_states_its_purpose(name: str) -> None:
    assert importlib.import_module(name).__doc__


@pytest.mark.parametrize("name", FACES)
def test_what_a_face_exports_is_documented(name: str) -> None:
    """Check the docstrings of exports, with arguments, results and errors of functions."""
    face = importlib.import_module(name)
    missing = []
    for export in getattr(face, "__all__", ()):
        thing = getattr(face, export)
        if not (inspect.isfunction(thing) or inspect.isclass(thing)):
            continue
        text = inspect.getdoc(thing) or ""
        if inspect.isfunction(thing):
            signature = inspect.signature(thing)
            required = ["Args:"] if signature.parameters else []
            required += ["Returns:"] if signature.return_annotation not in (None, "None") else []
            required += ["Raises:"] if _raises(thing) else []
            missing += [f"{export}: {each}" for each in required if each not in text]
            missing += [f"{export}: {each}" for each in signature.parameters if each not in text]
        elif not text:
            missing.append(export)
    assert missing == []


def _raises(function: object) -> bool:
    """Return whether the function itself contains a ``raise`` statement."""
    source = inspect.getsource(function)  # type: ignore[arg-type]
    tree = ast.parse(inspect.cleandoc(source) if source.startswith(" ") else source)
    return any(isinstance(node, ast.Raise) for node in ast.walk(tree))
