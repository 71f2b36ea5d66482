"""kill -9 of the live service in separate processes; ``benchmarks.kills`` runs longer."""

from pathlib import Path

import pytest

from benchmarks.kills import Found, run


@pytest.mark.long
def test_a_service_that_is_killed_goes_on_and_has_lost_nothing(tmp_path: Path) -> None:
    found = Found()
    keep = {"state_every_s": 1.0, "rotate_mb": 0.05, "keep_mb": 100.0}
    run("islam_hu_damped", 3, 7, tmp_path, found, keep)
    assert found.wrong == []
    assert found.kills >= 3
    assert found.asked > 0
    assert found.recognised > 0
