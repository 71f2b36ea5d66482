"""Requests at random times of simulated flights; ``benchmarks.request_fuzz`` sends more."""

import pytest

from benchmarks.request_fuzz import CASES, Found, run

SEED = 3
SLOW = ("default", "virtual-agents", "burn", "demo", "sitl")  # only with the long tests


@pytest.mark.parametrize(
    ("name", "requests"),
    [
        *((name, 30) for name in CASES if name not in SLOW),
        *(pytest.param(name, 90, marks=pytest.mark.long) for name in CASES),
    ],
)
def test_no_request_raises_and_a_restart_restores_the_state_of_the_live_run(
    name: str, requests: int
) -> None:
    found = Found()
    run(name, requests, SEED, found, a_fork=15)
    assert found.wrong == []
    assert found.asked.total() == requests
    assert found.done.total() >= requests / 6
