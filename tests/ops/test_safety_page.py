"""docs/safety.md names the tests of each statement, and these tests exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"`((?:\w+/)+\w+\.py)(?:::(\w+))?`")


def test_the_tests_that_the_safety_page_names_exist() -> None:
    page = (ROOT / "docs" / "safety.md").read_text("utf-8")
    named = [match for match in NAMED.findall(page) if not match[0].startswith("autopilot_bridge")]
    assert len(named) > 20
    for path, test in named:
        source = (ROOT / "tests" / path).read_text("utf-8")
        assert not test or f"def {test}(" in source, f"{path}::{test}"


def test_each_thing_that_is_never_done_names_a_test() -> None:
    page = (ROOT / "docs" / "safety.md").read_text("utf-8")
    never = page.split("## What the service never does")[1].split("\n## ")[0]
    sentences = re.split(r"\n- \*\*", never)[1:]
    assert len(sentences) > 8
    for sentence in sentences:
        assert NAMED.search(sentence), sentence[:60]
