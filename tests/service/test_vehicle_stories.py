"""Short flights in which a defective service could do harm; the oracle checks each step."""

from collections import Counter
from collections.abc import Callable

import pytest

from tests.service.autopilot_model import Autopilot
from tests.service.vehicle_flights import Flights
from tests.service.vehicle_oracle import Violation


def broken(violation: Violation, story: str) -> None:
    raise AssertionError(f"{violation.kind}: {violation.words}\n{story}")


class Story:
    """One vehicle that has flown for half a minute."""

    def __init__(self, site: str = "plane", seconds: int = 30) -> None:
        self.flights = Flights(site, Counter(), broken)
        self.name = self.flights.names[0]
        self.bridge = self.flights.bridges[self.name]
        self.flights.all_goes_well(seconds)

    @property
    def flown(self) -> Autopilot:
        return self.bridge.autopilot


def after_a_refused_start_and_an_order_home(story: Story) -> None:
    """Issue 20, A1."""
    flights, name = story.flights, story.name
    flights.order(name, "start", True)
    flights.deliver(name, "temporarily rejected", True)
    flights.order(name, "return", True)
    flights.all_goes_well(3)
    flights.lands(name, True)
    flights.all_goes_well(60)
    assert not story.flown.armed


def after_a_start_that_a_hold_took_the_place_of(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.order(name, "start", True)
    flights.order(name, "hold", True)
    flights.all_goes_well(3)
    flights.lands(name, True)
    flights.all_goes_well(60)
    assert not story.flown.armed


def after_a_landing_and_a_reboot(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.lands(name, True)
    flights.reboot(name, False, True)
    flights.all_goes_well(60)
    assert not story.flown.armed


def after_a_pilot_disarmed_it_on_the_ground(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.lands(name, True)
    flights.order(name, "resume", True)
    flights.all_goes_well(1)
    flights.arm(name, False)
    flights.order(name, "hold", True)
    flights.all_goes_well(60)
    assert not story.flown.armed


def when_its_battery_is_low_while_an_upload_is_under_way(story: Story) -> None:
    """An upload fails; the next one succeeds while the autopilot returns by itself."""
    flights, name = story.flights, story.name
    flights.renew(name)
    flights.fly(5.0)
    assert story.bridge.uploads
    flights.upload_ends(name, "failed", False)
    flights.deliver(name, "", True)  # a hold, because its mission may be a mixture
    flights.fly(10.0)
    assert story.bridge.uploads
    flights.failsafe(name, "battery low")
    flights.all_goes_well(3)
    assert story.flown.mode == "return"


def when_a_fence_holds_it(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.failsafe(name, "fence: hold")
    flights.renew(name)
    flights.all_goes_well(60)
    assert (story.flown.mode, story.flown.chosen_by) == ("hold", "failsafe")


def when_a_hold_is_not_answered_before_it_flies_home(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.order(name, "hold", True)
    flights.unanswered(name, 0)
    flights.failsafe(name, "battery low")
    flights.all_goes_well(30)
    assert story.flown.chosen_by == "failsafe"


def when_a_return_was_refused_and_it_lands_by_itself(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.order(name, "return", True)
    flights.deliver(name, "denied", True)
    flights.failsafe(name, "battery emergency")
    flights.all_goes_well(25)
    assert story.flown.mode == "land"


def when_it_is_held_on_its_way_home_and_the_service_restarts(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.order(name, "return", True)
    flights.all_goes_well(3)
    flights.order(name, "hold", True)
    flights.all_goes_well(3)
    flights.restart(10.0, True, "same")
    flights.all_goes_well(30)
    assert story.flown.mode == "hold"


def when_a_pilot_takes_over_from_a_landing_and_the_service_restarts(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.failsafe(name, "battery emergency")
    flights.fly(1.0)
    flights.pilot(name, "manual")
    flights.restart(10.0, True, "same")
    flights.all_goes_well(30)
    assert story.flown.mode == "manual"


def when_a_pilot_flies_it_before_its_first_mission(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.takes_off_manually(name, "manual")
    flights.all_goes_well(30)
    assert story.flown.mode == "manual"


def when_it_is_aborted_on_its_own_way_home(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.failsafe(name, "battery low")
    flights.abort()
    flights.all_goes_well(10)
    assert story.flown.mode == "return"


def when_an_operator_resumes_it_unasked(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.failsafe(name, "battery low")
    flights.order(name, "resume", False)
    flights.all_goes_well(10)
    assert story.flown.mode == "return"
    flights.order(name, "resume", True)
    flights.all_goes_well(20)
    assert story.flown.mode == "mission"


def when_its_time_is_over_in_a_hold_of_its_pilot(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.pilot(name, "hold")
    for _ in range(10):
        flights.fly(120.0)
        flights.all_goes_well(3)
    assert story.flown.chosen_by == "pilot"


def when_it_restarts_in_the_air_on_its_way_home(story: Story) -> None:
    """After a watchdog's reset it is armed and in its mode, which the bridge cannot detect."""
    flights, name = story.flights, story.name
    flights.order(name, "return", True)
    flights.all_goes_well(2)
    flights.reboot(name, True, True)
    flights.all_goes_well(5)
    assert story.flown.mode == "return"


def when_a_return_is_ended_by_its_restart_in_the_air(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.order(name, "hold", True)
    flights.all_goes_well(3)
    flights.order(name, "return", True)
    flights.reboot(name, True, True)  # the order ends as refused
    flights.all_goes_well(20)
    assert story.flown.mode == "hold"


def when_it_restarts_in_the_air_in_a_failsafe(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.failsafe(name, "battery low")
    flights.fly(1.0)
    flights.reboot(name, True, True)
    flights.all_goes_well(5)
    assert story.flown.mode == "return"


def when_it_restarts_in_the_air_while_held(story: Story) -> None:
    flights, name = story.flights, story.name
    flights.order(name, "hold", True)
    flights.all_goes_well(3)
    flights.reboot(name, True, True)
    flights.all_goes_well(20)
    assert story.flown.mode == "hold"


STORIES: dict[Callable[[Story], None], tuple[str, int]] = {
    after_a_refused_start_and_an_order_home: ("plane", 30),
    after_a_start_that_a_hold_took_the_place_of: ("plane", 30),
    after_a_landing_and_a_reboot: ("plane", 30),
    after_a_pilot_disarmed_it_on_the_ground: ("plane", 30),
    when_its_battery_is_low_while_an_upload_is_under_way: ("ardupilot", 30),
    when_a_fence_holds_it: ("plane", 30),
    when_a_hold_is_not_answered_before_it_flies_home: ("plane", 30),
    when_a_return_was_refused_and_it_lands_by_itself: ("plane", 30),
    when_it_is_held_on_its_way_home_and_the_service_restarts: ("plane", 30),
    when_a_pilot_takes_over_from_a_landing_and_the_service_restarts: ("plane", 30),
    when_a_pilot_flies_it_before_its_first_mission: ("plane", 0),
    when_it_is_aborted_on_its_own_way_home: ("plane", 30),
    when_an_operator_resumes_it_unasked: ("plane", 30),
    when_it_restarts_in_the_air_on_its_way_home: ("plane", 30),
    when_a_return_is_ended_by_its_restart_in_the_air: ("plane", 30),
    when_it_restarts_in_the_air_in_a_failsafe: ("plane", 30),
    when_it_restarts_in_the_air_while_held: ("plane", 30),
    when_its_time_is_over_in_a_hold_of_its_pilot: ("short flights", 30),
}


@pytest.mark.parametrize("story", STORIES, ids=lambda story: story.__name__)
def test_a_vehicle_is_left_alone(story: Callable[[Story], None]) -> None:
    story(Story(*STORIES[story]))
