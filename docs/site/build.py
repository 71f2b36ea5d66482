"""Build the documentation site.

    .venv/bin/python -m docs.site.build [--notebooks off]

The result is the archive that ``mission-service docs`` serves and every later wheel contains.

The documents of the repository and the generated pages are copied to a temporary folder, where
Sphinx reads them. All pages keep their paths, so that their links work here and on the repository's
page. A warning is an error. With ``--notebooks off`` the notebooks have no outputs.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from mission_service.interfaces.manual import SITE

ROOT = Path(__file__).parents[2]
OWN = Path(__file__).parent
DOCUMENTS = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE")
FOLDERS = ("docs", "mission_service/scenarios")
PROCESSES = "2"


def main() -> None:
    """Parse the command line and build the site."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--notebooks", choices=["run", "off"], default="run")
    with tempfile.TemporaryDirectory(prefix="docs-") as made:
        code = build(Path(made, "site"), parser.parse_args().notebooks)
        if code == 0:
            shutil.make_archive(str(SITE.with_suffix("")), "zip", Path(made, "site"))
    sys.exit(code)


def build(site: Path, notebooks: str) -> int:
    """Build the site into a new folder and return the exit code of Sphinx.

    ``notebooks`` is "run" or "off".
    """
    with tempfile.TemporaryDirectory(prefix="docs-") as made:
        source = Path(made, "source")
        stage(source)
        command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "--quiet", "-b", "html"]
        command += ["-j", PROCESSES, "-d", str(Path(made, "doctrees")), "-c", str(OWN)]
        path = os.pathsep.join((str(ROOT), os.environ.get("PYTHONPATH", "")))
        environment = os.environ | {"NOTEBOOKS": notebooks, "PYTHONPATH": path}
        command += [str(source), str(site)]
        return subprocess.run(command, env=environment, check=False).returncode


def stage(folder: Path) -> None:
    """Write all sources of the site into a new folder."""
    from docs.site.reference_pages import pages

    for path in repository_files():
        copied = folder / path
        copied.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, copied)
    shutil.copyfile(OWN / "index.md", folder / "index.md")
    (folder / "reference").mkdir()
    for name, text in pages().items():
        (folder / "reference" / name).write_text(text, encoding="utf-8")


def repository_files() -> list[str]:
    """Return the paths of the documents, pictures and examples in the repository."""
    files = [ROOT / name for name in DOCUMENTS]
    for folder in FOLDERS:
        files += [path for path in (ROOT / folder).rglob("*") if path.is_file()]
    own = {OWN, *OWN.rglob("*")}
    return sorted(
        str(path.relative_to(ROOT))
        for path in files
        if path not in own and "__pycache__" not in path.parts and not path.name.startswith(".")
    )


if __name__ == "__main__":
    main()
