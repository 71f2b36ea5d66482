"""Links between the documents of the repository lead to files and headings that exist.

The build of the site checks the same; these tests take a second.
"""

import re
from functools import cache
from pathlib import Path

import pytest
from myst_parser.mdit_to_docutils.base import default_slugify

from tests.documentation.pages import BLOCK, ROOT

DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
LINK = re.compile(r"\]\(([^()\s]*)\)")
HEADING = re.compile(r"^#{1,6} +(.+?) *$", re.MULTILINE)
INDEX = (ROOT / "docs" / "site" / "index.md").read_text(encoding="utf-8")


@cache
def prose_of(document: Path) -> str:
    """Return a document without its blocks of code."""
    return BLOCK.sub("", document.read_text(encoding="utf-8"))


@cache
def anchors_of(document: Path) -> set[str]:
    """Return the anchors of the headings, as the repository's page makes them."""
    plain = (
        re.sub(r"\[(.*?)\]\(.*?\)|`", r"\1", text) for text in HEADING.findall(prose_of(document))
    )
    return {default_slugify(text) for text in plain}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_each_link_leads_to_a_file_and_a_heading(document: Path) -> None:
    broken = []
    for link in LINK.findall(prose_of(document)):
        path, _, anchor = link.partition("#")
        target = (document.parent / path).resolve() if path else document
        if re.match(r"[a-z]+:", link):
            continue
        if not target.exists() or (anchor and anchor not in anchors_of(target)):
            broken.append(link)
    assert broken == []


def test_each_document_is_in_the_table_of_contents_of_the_site() -> None:
    pages = [path.relative_to(ROOT).with_suffix("") for path in DOCUMENTS]
    notebooks = (ROOT / "docs" / "notebooks").glob("*.ipynb")
    pages += [path.relative_to(ROOT).with_suffix("") for path in notebooks]
    assert [str(page) for page in pages if f"<{page}>" not in INDEX] == []
