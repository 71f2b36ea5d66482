"""Settings of all tests."""

import logging
import threading
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

# The result of a test must not depend on the speed of the machine.
settings.register_profile("any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any speed")

SENSORS = ("ImageFolder", "ObservationFolder", "ThermalVideo")  # with threads of these names

# The files that take longest begin first, so that no worker runs one alone at the end.
LONGEST_FILES = (
    "test_request_fuzz.py",
    "test_journal_processes.py",
    "test_forged_frames.py",
    "test_source_agreement.py",
    "test_planner_package.py",
    "test_live.py",
    "test_kills.py",
    "test_journal_log.py",
    "test_replay_stages.py",
    "test_people.py",
    "test_team_live.py",
    "test_forged_property.py",
    "test_truth_apart.py",
    "test_burn_watched.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests by their files: the longest files first, the others in their order."""
    places = {name: place for place, name in enumerate(LONGEST_FILES)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


@pytest.fixture(autouse=True)
def no_sensor_thread_left() -> Iterator[None]:
    """Fail a test that leaves the thread of a sensor running: it would disturb later tests."""
    before = set(threading.enumerate())
    yield
    for thread in set(threading.enumerate()) - before:
        if thread.name in SENSORS:
            thread.join(60.0)
            assert not thread.is_alive(), f"the test must call close() of {thread.name}"


@pytest.fixture(autouse=True)
def no_hidden_defect(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail a test in which the estimate could not use a report because of a defect.

    A run goes on without the report. Tests that cause such a defect have the marker ``defect``.
    """
    found: list[logging.LogRecord] = []
    handler = logging.Handler(logging.ERROR)
    handler.emit = found.append  # type: ignore[assignment]
    log = logging.getLogger("mission_service.fire.run_estimate")
    log.addHandler(handler)
    yield
    log.removeHandler(handler)
    if request.node.get_closest_marker("defect") is None and found:
        raise AssertionError(found[0].getMessage()) from (found[0].exc_info or (None, None))[1]
