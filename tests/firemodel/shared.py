"""Access to the project's test data, which are not in the repository."""

from pathlib import Path

import pytest


def shared_file(name: str) -> Path:
    """Return a file below ``shared/data`` beside the repository; skip the test if it is missing."""
    for folder in Path(__file__).parents:
        path = folder / "shared" / "data" / name
        if path.exists():
            return path
    pytest.skip(f"no shared/data/{name}")
