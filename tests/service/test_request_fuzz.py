"""Requests at random times of simulated flights; ``benchmarks.request_fuzz`` sends more."""

import pytest

from benchmarks.request_fuzz import CASES, Found, run

SEED = 3


@pytest.mark.parametrize("name", CASES)
def test_no_request_raises_and_a_restart_restores_the_state_of_the_live_run(name: str) -> None:
    found = Found()
    run(name, 60, SEED, found, a_fork=20)
    assert found.wrong == []
    assert found.asked.total() == 60
    assert found.done.total() > 10
