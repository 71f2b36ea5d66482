"""A run in the air, for all tests that only look at it or do not mind what others have done."""

from pathlib import Path

import pytest

from tests.api.worlds import World, scenario_of, world_in


@pytest.fixture(scope="session")
def flying(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Two vehicles, one of them in the air on its way to the fire."""
    world = world_in(tmp_path_factory.mktemp("run"), scenario_of())
    world.fly(3700.0)
    return world


@pytest.fixture
def standing(tmp_path: Path) -> World:
    """A run that has not begun."""
    return world_in(tmp_path, scenario_of())
