"""Rules of the repository for readers: names, sizes of folders, faces, docstrings."""

import ast
import importlib
import inspect
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
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
MAX_UNRELATED = 3  # classes that share the name of a public method
# Names that have one meaning in all their classes: each of these classes can stand for another.
PROTOCOLS = {
    # sans-IO exchanges and state machines of the bridge
    "start": "returns the first messages of an exchange",
    "receive": "processes a received message, and returns what to send or what has happened",
    "next_timer": "returns the time at which handle_timer must be called",
    "handle_timer": "does what is due at a time, and returns what to send or what has happened",
    "cancel": "ends an exchange before its result",
    # states of a run
    "apply": "changes a state by the next event of a run or log (a fold)",
    "on_event": "lets a part of the fire or a sensor process the next event of a run",
    "on_command": "lets a part of the fire or the core process a command that is sent",
    "status": "returns a state as plain data for interfaces",
    "validate_state": "raises AssertionError if an invariant is broken; for tests",
    # fires
    "advance": "computes a fire, or several, up to a time; never back",
    # objects in general
    "copy": "returns an independent copy; data that never changes is shared",
    "close": "releases a file, a socket, a thread or a process",
    "connection_lost": "is called by asyncio when a connection has ended",
    "convert": "is called by click to read the value of an option or an argument",
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


def test_no_more_than_three_unrelated_classes_share_a_method_name_but_protocols() -> None:
    classes = Classes()
    shared = {
        method: [sorted(group) for group in groups]
        for method, groups in classes.groups_by_method().items()
        if len(groups) > MAX_UNRELATED
    }
    assert {method: groups for method, groups in shared.items() if method not in PROTOCOLS} == {}
    assert sorted(PROTOCOLS.keys() - shared.keys()) == []  # the list contains no unnecessary name


class Classes:
    """The classes of the packages, with their bases and their public methods."""

    def __init__(self) -> None:
        self.bases: dict[str, set[str]] = {}
        self.own: dict[str, set[str]] = {}
        self.properties: set[tuple[str, str]] = set()
        names: dict[str, list[str]] = defaultdict(list)
        found = [(file, node) for file in MODULES for node in _classes_in(file)]
        for file, node in found:
            names[node.name].append(f"{file.relative_to(ROOT)}:{node.name}")
        for file, node in found:
            key = f"{file.relative_to(ROOT)}:{node.name}"
            bases = [ast.unparse(base).partition("[")[0] for base in node.bases]
            self.bases[key] = {full for base in bases for full in names.get(base, [base])}
            methods = [
                each
                for each in node.body
                if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)
                and not each.name.startswith("_")
            ]
            self.own[key] = {method.name for method in methods}
            self.properties |= {
                (key, method.name)
                for method in methods
                if any(ast.unparse(each) == "property" for each in method.decorator_list)
            }

    def family(self, key: str) -> set[str]:
        """Return a class and all its bases in the packages."""
        found, new = set[str](), {key}
        while new:
            found |= new
            new = {base for each in new for base in self.bases[each] & self.own.keys()} - found
        return found

    def methods(self, key: str) -> set[str]:
        """Return the methods of a class and of its bases."""
        return {method for each in self.family(key) for method in self.own[each]}

    def protocols(self) -> dict[str, set[str]]:
        """Return the methods that each declared ``Protocol`` requires."""
        return {
            key: {
                method
                for each in self.family(key)
                for method in self.own[each]
                if (each, method) not in self.properties
            }
            for key in self.own
            if any("Protocol" in self.bases[each] for each in self.family(key))
        }

    def groups_by_method(self) -> dict[str, list[set[str]]]:
        """Return the groups of related classes that define each method.

        Two classes are related if they have a base in common, or implement the same protocol.
        """
        protocols = self.protocols()
        implemented = {
            key: {name for name, required in protocols.items() if required <= self.methods(key)}
            for key in self.own
        }
        groups: dict[str, list[set[str]]] = {}
        for method in {method for own in self.own.values() for method in own}:
            parts: list[tuple[set[str], set[str]]] = []  # classes, and what relates them
            for key in (key for key, own in self.own.items() if method in own):
                links = self.family(key) | {
                    name for name in implemented[key] if method in protocols[name]
                }
                related = [part for part in parts if part[1] & links]
                parts = [part for part in parts if not part[1] & links]
                members, ties = {key}, links
                for part in related:
                    members, ties = members | part[0], ties | part[1]
                parts.append((members, ties))
            groups[method] = [members for members, _ in parts]
        return groups


def _classes_in(file: Path) -> Iterator[ast.ClassDef]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef))


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
