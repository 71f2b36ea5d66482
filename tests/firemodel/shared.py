"""The project's data for tests only, which is not in the repository."""

from pathlib import Path

import pytest


def shared_file(name: str) -> Path:
    """A file below ``shared/data`` next to the repository; without it the test is skipped."""
    for folder in Path(__file__).parents:
        path = folder / "shared" / "data" / name
        if path.exists():
            return path
    pytest.skip(f"no shared/data/{name}")
