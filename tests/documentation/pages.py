"""Reads the blocks of code of a page, and runs the commands of a tutorial."""

import os
import re
import signal
import subprocess
import sys
import sysconfig
import venv
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
COMMAND_S = 540.0  # maximum time of a block


@dataclass(frozen=True)
class Block:
    """A block of code: its language, its words (``title=NAME``, ``background``) and its text."""

    language: str
    words: tuple[str, ...]
    text: str

    def named(self, key: str) -> str | None:
        """Return the value of a word ``key=value``, or None."""
        values = [word.partition("=")[2] for word in self.words if word.startswith(f"{key}=")]
        return values[0] if values else None


def blocks_of(page: Path) -> list[Block]:
    """Return the blocks of code of a page in their order."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [Block(language, tuple(words.split()), text) for language, words, text in found]


def environment_in(folder: Path) -> dict[str, str]:
    """Make an environment like that of a reader: the packages of this one, and the command.

    What a page installs is installed in ``folder`` only.
    """
    venv.create(folder, with_pip=False, symlinks=True)
    bin_folder = folder / "bin"
    packages = {sysconfig.get_paths()["purelib"], *(p for p in sys.path if "site-packages" in p)}
    (packed,) = folder.glob("lib/python*/site-packages")
    lines = [f"import site; site.addsitedir({path!r})" for path in sorted(packages)]
    (packed / "parent.pth").write_text("\n".join([str(ROOT), *lines]) + "\n", encoding="utf-8")
    command = bin_folder / "mission-service"
    command.write_text(f'#!/bin/sh\nexec "{bin_folder}/python" -m mission_service.cli "$@"\n')
    command.chmod(0o755)
    inherited = {key: value for key, value in os.environ.items() if key != "VIRTUAL_ENV"}
    path = os.pathsep.join((str(bin_folder), os.environ["PATH"]))
    return inherited | {"PATH": path, "PYTHONPATH": str(ROOT), "BROWSER": "true"}


def run_page(page: Path, folder: Path, ports: dict[str, str]) -> list[str]:
    """Write the files of a tutorial and run its commands in order; return their outputs.

    A block with ``title=FILE`` is a file, with ``append=FILE`` a further part of it. A block
    ``sh background`` runs until the page ends, other blocks ``sh`` until they succeed. ``ports``
    replaces ports of the page, which other processes may use.
    """
    environment = environment_in(folder.parent / f"{folder.name}-environment")
    outputs = []
    with ExitStack() as stack:
        for block in blocks_of(page):
            text = block.text
            for old, new in ports.items():
                text = text.replace(old, new)
            if (name := block.named("title")) is not None:
                (folder / name).write_text(text, encoding="utf-8")
            elif (name := block.named("append")) is not None:
                with (folder / name).open("a", encoding="utf-8") as file:
                    file.write(text)
            elif block.language == "sh" and "background" in block.words:
                stack.enter_context(_Background(text, folder, environment))
            elif block.language == "sh":
                outputs.append(_output(text, folder, environment))
    return outputs


def _output(text: str, folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", text],
        cwd=folder, env=environment, timeout=COMMAND_S, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    assert done.returncode == 0, f"{text}\n{done.stdout[-3000:]}"
    return done.stdout


class _Background:
    """A block that runs while the rest of the page runs."""

    def __init__(self, text: str, folder: Path, environment: dict[str, str]) -> None:
        self._process = subprocess.Popen(
            ["bash", "-euc", text], cwd=folder, env=environment, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        ended = self._process.poll()
        if ended is None:
            os.killpg(self._process.pid, signal.SIGTERM)
        self._process.wait(30)
        assert ended is None, f"the command in the background ended with exit code {ended}"
