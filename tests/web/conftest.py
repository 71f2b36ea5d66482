"""Fixtures of the tests of the map."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.web import browser as screen


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Return a browser for the tests of a module."""
    with screen.chromium() as found:
        yield found
