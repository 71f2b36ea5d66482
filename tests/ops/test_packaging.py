"""The packages of the container and of ``make demo``, and the description of this package."""

import os
import re
import subprocess
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PINNED = re.compile(
    r"^(?P<name>[\w.-]+)==(?P<version>[^\s;]+)(?P<rest>(?:[^\n]*\\\n)*[^\n]*)", re.M
)
HOW_TO_UPDATE = "run make lock"


def pinned(name: str) -> dict[str, set[str]]:
    """Return the versions of each package in a lock file, each of which must have hashes."""
    text = (ROOT / "docker" / name).read_text(encoding="utf-8")
    found: dict[str, set[str]] = {}
    for each in PINNED.finditer(text):
        assert "--hash=sha256:" in each["rest"], each["name"]
        found.setdefault(canonicalize_name(each["name"]), set()).add(each["version"])
    assert len(found) > 5
    return found


def test_the_container_has_versions_that_the_package_permits() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    needed = (*PROJECT["project"]["dependencies"], *extras["serial"], *extras["notify"])
    wanted = [Requirement(each) for each in needed]
    found = pinned("requirements.txt")
    for each in wanted:
        versions = found.get(canonicalize_name(each.name), set())
        assert versions, f"{each.name} has no version: {HOW_TO_UPDATE}"
        for version in versions:
            assert each.specifier.contains(version), f"{each} {version}: {HOW_TO_UPDATE}"


def test_the_tools_that_build_the_package_are_pinned() -> None:
    found = pinned("build-requirements.txt")
    for each in PROJECT["build-system"]["requires"]:
        assert canonicalize_name(Requirement(each).name) in found, HOW_TO_UPDATE


def test_the_image_installs_nothing_without_a_hash() -> None:
    text = (ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")
    commands = re.findall(r"pip (?:install|wheel)[^&\n]*", text)
    assert len(commands) == 4
    for command in commands:
        assert "--require-hashes" in command or "--no-deps" in command, command
        assert "wheel" not in command.split()[1] or "--no-build-isolation" in command, command


def commands_of(target: str) -> str:
    """Return the commands that make would run for a target in a fresh clone."""
    done = subprocess.run(
        ["make", "--dry-run", "--always-make", target],
        cwd=ROOT,
        env={key: value for key, value in os.environ.items() if not key.startswith("MAKE")},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return done.stdout


def test_make_demo_installs_only_what_the_product_needs() -> None:
    assert "[dev]" not in commands_of("demo")
    assert re.search(r"pip install (?!.*--quiet).*--editable \.$", commands_of("demo"), re.M)
    assert "'.[dev]'" in commands_of("lint")
