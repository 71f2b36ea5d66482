"""No sphere without approval: burns with a wild crew and bad links, read by an oracle of its own."""

from pathlib import Path

import pytest

from benchmarks.burn_frames import fly


@pytest.mark.parametrize("seed", [2, 5, 6, 8])
def test_nothing_reaches_the_dropper_that_nobody_approved(seed: int, tmp_path: Path) -> None:
    found = fly(seed, tmp_path)
    assert 0 < found["releases"] <= found["ordered"]
