"""The documentation site: built without a warning, notebooks run, readable on a phone, off line."""

import json
import re
import shutil
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote, urlsplit
from urllib.request import urlopen

import pytest
from playwright.sync_api import Page, expect

from docs.site.build import build
from mission_service.errors import MissionServiceError
from mission_service.interfaces.manual import SITE, site_server, unpack_site
from tests.documentation.pages import ROOT
from tests.web.browser import chromium, context_of

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
WIDTHS = (390, 1440)
# The elements around the text that would have to be scrolled sideways.
TOO_WIDE = """() => [...document.querySelectorAll("html, .page, .main, .content")]
    .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.tagName + "." + e.className)"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site") / "site"
    assert build(folder, "run") == 0
    return folder


@contextmanager
def served(site: Path) -> Iterator[str]:
    """Serve a site as ``mission-service docs`` does, and yield its address."""
    with site_server(0, site) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def pages_of(site: Path) -> list[str]:
    return [str(path.relative_to(site)) for path in sorted(site.rglob("*.html"))]


@pytest.mark.long
def test_the_pages_contain_all_documents_and_the_results_of_the_notebooks(site: Path) -> None:
    documents = [path.relative_to(ROOT) for path in (ROOT / "docs").glob("*.md")]
    documents += [path.relative_to(ROOT) for path in NOTEBOOKS]
    missing = [path for path in documents if not (site / path.with_suffix(".html")).is_file()]
    assert missing == []
    for path in NOTEBOOKS:
        page = (site / path.relative_to(ROOT).with_suffix(".html")).read_text(encoding="utf-8")
        assert page.count("cell_output") >= 3, path


@pytest.mark.long
@pytest.mark.parametrize("words", ["loiter_radius_m", "sortie plan", "mission_service_ready"])
def test_the_search_finds_keys_commands_and_metrics(site: Path, words: str) -> None:
    with served(site) as address, chromium() as browser, context_of(browser) as context:
        page = context.new_page()
        page.goto(f"{address}/search.html?q={quote(words)}")
        expect(page.locator("#search-results li").first).to_be_visible()
        texts = page.locator("#search-results").inner_text()
    assert any(name in texts for name in ("Configuration", "Command line", "Metrics"))


@pytest.mark.long
@pytest.mark.parametrize("width", WIDTHS)
def test_no_page_is_wider_than_the_window_or_loads_from_other_servers(
    site: Path, width: int
) -> None:
    viewport = {"width": width, "height": 844}
    with (
        served(site) as address,
        chromium() as browser,
        context_of(browser, viewport=viewport) as context,
    ):
        page = context.new_page()
        refused, others = watched(page)
        wide = {}
        for path in pages_of(site):
            page.goto(f"{address}/{path}")
            if found := page.evaluate(TOO_WIDE):
                wide[path] = found[:3]
        assert wide == {}
        assert refused == []
        assert others <= {urlsplit(address).netloc, ""}


def watched(page: Page) -> tuple[list[str], set[str]]:
    """Return lists that receive failed requests, and the hosts of all requests."""
    refused: list[str] = []
    others: set[str] = set()
    page.on("request", lambda request: others.add(urlsplit(request.url).netloc))
    page.on("requestfailed", lambda request: refused.append(request.url))
    page.on("response", lambda reply: refused.append(reply.url) if reply.status >= 400 else None)
    return refused, others


@pytest.mark.long
def test_a_broken_link_fails_the_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from docs.site import build as module

    def stage(folder: Path) -> None:
        folder.mkdir()
        (folder / "index.md").write_text("# Start\n\n[there](missing.md#a)\n", encoding="utf-8")

    monkeypatch.setattr(module, "stage", stage)
    assert module.build(tmp_path / "site", "off") == 1
    assert "missing.md" in capfd.readouterr().err


@pytest.mark.long
def test_a_cell_that_fails_fails_the_build_and_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    from docs.site import build as module

    def stage(folder: Path) -> None:
        folder.mkdir()
        notebook = json.loads(NOTEBOOKS[0].read_text(encoding="utf-8"))
        (cell, *_) = (each for each in notebook["cells"] if each["cell_type"] == "code")
        notebook["cells"] = [cell | {"source": "burnt_ha"}]
        (folder / "index.ipynb").write_text(json.dumps(notebook), encoding="utf-8")

    monkeypatch.setattr(module, "stage", stage)
    assert module.build(tmp_path / "site", "run") == 1
    assert "name 'burnt_ha' is not defined" in capfd.readouterr().err


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: str(path.stem))
def test_notebooks_are_stored_without_outputs(path: Path) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code
    assert [cell for cell in code if cell["outputs"] or cell["execution_count"]] == []


def test_without_a_built_site_the_command_gives_one_line(tmp_path: Path) -> None:
    with pytest.raises(MissionServiceError, match=r"was not built; run make docs") as caught:
        unpack_site(tmp_path, tmp_path / "site.zip")
    assert "\n" not in str(caught.value)


def test_a_damaged_archive_gives_one_line(tmp_path: Path) -> None:
    (tmp_path / "site.zip").write_bytes(b"PK\x03\x04")
    with pytest.raises(MissionServiceError, match=r"cannot be unpacked: .*; build it again"):
        unpack_site(tmp_path, tmp_path / "site.zip")


def test_a_port_in_use_gives_one_line(tmp_path: Path) -> None:
    with (
        site_server(0, tmp_path) as first,
        pytest.raises(MissionServiceError, match="choose another --port"),
    ):
        site_server(first.server_port, tmp_path)


def test_the_command_serves_the_site_until_it_is_interrupted(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("the start page", encoding="utf-8")
    archive = shutil.make_archive(str(tmp_path / "packed" / "site"), "zip", tmp_path, ".")
    code = (
        "import functools, pathlib\n"
        "import mission_service.interfaces.manual as manual\n"
        f"archive = pathlib.Path({archive!r})\n"
        "manual.unpack_site = functools.partial(manual.unpack_site, site=archive)\n"
        "from mission_service.cli.main import main\n"
        "main(['docs', '--no-browser'])\n"
    )
    with subprocess.Popen([sys.executable, "-uc", code], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        found = re.search(r"http://127\.0\.0\.1:\d+/", run.stdout.readline())
        assert found is not None
        with urlopen(found[0], timeout=30) as reply:
            assert reply.read() == b"the start page"
        run.send_signal(signal.SIGINT)
        assert run.wait(30) == 0


def test_wheels_contain_the_built_site_and_the_repository_does_not() -> None:
    path = str(SITE.relative_to(ROOT))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert path in project["tool"]["hatch"]["build"]["artifacts"]
    assert path in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
