"""Holds of planes over rising ground are high enough."""

import pytest

from firemodel.landscape.landscape import Landscape
from mission_service.commands import AnyCommand, Hold, HoldAt
from mission_service.config.scenario import load_scenario
from mission_service.core.hold_height import RAISED_HOLD_AGL_M
from mission_service.events import Aborted, CommandFinished, MissionProgress
from mission_service.fire.scenario_fire import landscape_of
from mission_service.missions.orbits import highest_ground_m
from tests.service.people_flights import ANN
from tests.service.test_other_aircraft import PLACE, Aloft


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("demo"))


def holds(commands: list[AnyCommand]) -> list[AnyCommand]:
    return [command for command in commands if isinstance(command, Hold | HoldAt)]


def test_a_hold_is_above_the_highest_ground_that_its_circle_reaches(land: Landscape) -> None:
    low = Aloft(land, "none", height_m=20.0)
    low.handle(MissionProgress(low.at_us, "hawk", 9))  # its takeoff has ended
    (hold,) = holds(low.handle(Aborted(low.at_us, *ANN)))
    assert isinstance(hold, HoldAt)
    place_m = land.xy_of_lat_lon(*PLACE)
    radius_m = low.scenario.vehicles[0].loiter_radius_m
    ground_m = highest_ground_m(land, place_m, place_m, 2.0 * radius_m)
    assert hold.altitude_amsl_m >= ground_m + RAISED_HOLD_AGL_M - 0.1
    assert (hold.lat_deg, hold.lon_deg) == pytest.approx(PLACE, abs=1e-6)
    low.at_s += 0.25
    low.handle(
        CommandFinished(low.at_us, "hawk", "hold at another height", False, "temporarily rejected")
    )
    again = [command for _ in range(6) for command in holds(low.moved(25.0))]
    assert again == [hold]


def test_a_hold_at_a_sufficient_height_is_not_changed(land: Landscape) -> None:
    high = Aloft(land, "none")
    assert holds(high.handle(Aborted(high.at_us, *ANN))) == [Hold("hawk")]
