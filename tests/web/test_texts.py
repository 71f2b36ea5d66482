"""The texts of the page: every text of the sources is translated into every language."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from mission_service.interfaces.web.build import WEB

LANGUAGES = sorted((WEB / "src" / "languages").glob("*.json"))
FORMS = re.compile(r"\b(one|other) \{[^{}]*\}")
ARGUMENT = re.compile(r"\{(\w+)")


@pytest.fixture(scope="module")
def texts() -> Any:
    """Return the keys and the untranslated texts of the sources."""
    node = shutil.which("node")
    if node is None or not (WEB / "node_modules").exists():
        pytest.skip("no node or no node_modules; run make web")
    run = [node, str(WEB / "texts.mjs")]
    return json.loads(subprocess.run(run, check=True, capture_output=True, timeout=120).stdout)


def messages(path: Path) -> dict[str, str]:
    found: dict[str, str] = json.loads(path.read_text(encoding="utf-8"))
    return found


def arguments(message: str) -> set[str]:
    """Return the names of the arguments of an ICU message."""
    return set(ARGUMENT.findall(FORMS.sub("", message)))


def edges(message: str) -> tuple[str, str]:
    """Return the spaces and signs that join a part of a sentence to its neighbours."""
    begin, end = re.match(r"[ ,;:]*", message), re.search(r" *$", message)
    assert begin is not None
    assert end is not None
    return begin[0], end[0]


def test_every_text_of_the_sources_is_translated(texts: Any) -> None:
    assert texts["untranslated"] == []
    assert len(texts["keys"]) > 500


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_a_language_has_every_key_and_no_other(texts: Any, path: Path) -> None:
    assert sorted(set(texts["keys"]) - messages(path).keys()) == []
    assert sorted(messages(path).keys() - set(texts["keys"])) == []


@pytest.mark.parametrize("path", LANGUAGES, ids=lambda path: path.stem)
def test_translations_have_the_arguments_and_edges_of_their_keys(path: Path) -> None:
    for key, message in messages(path).items():
        assert message.strip(), key
        assert arguments(message) == arguments(key), key
        assert edges(message) == edges(key), key


def test_spanish_and_portuguese_are_complete() -> None:
    assert [path.stem for path in LANGUAGES] == ["es", "pt"]
