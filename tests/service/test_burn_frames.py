"""No sphere without approval: burns with random operators and bad links, checked independently."""

from pathlib import Path

from benchmarks.burn_frames import fly


def test_nothing_reaches_the_dropper_without_approval(tmp_path: Path) -> None:
    found = [fly(seed, tmp_path) for seed in (3, 6, 8)]
    assert sum(each["releases"] for each in found) > 0
