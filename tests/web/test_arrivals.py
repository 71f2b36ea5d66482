"""People that the fire may reach: on the map, in the list, and their alarms acknowledged.

If the environment variable MAP_PICTURES is set, the test writes the picture of docs/tak.md to that
folder.
"""

import os
from collections.abc import Iterator

import pytest

from mission_service.fire_arrival.arrival_times import FireArrival
from tests.api.worlds import scenario_of, world_in
from tests.web import browser as screen
from tests.web.browser import page_of
from tests.web.service import wait_for
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES = os.environ.get("MAP_PICTURES", "")
SCENARIO = scenario_of("demo", ("landscape.rows=150", "landscape.cols=150"))
MIN_US = 60_000_000


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Show three people: the fire comes soon, later, and not within the forecast."""
    world = world_in(tmp_path_factory.mktemp("run"), SCENARIO)
    world.fly(SCENARIO.deploy_at_s + 60.0)
    context, now_us = world.context, world.simulation.clock.now_us
    lat_deg, lon_deg = SCENARIO.ignition[0].lat_deg, SCENARIO.ignition[0].lon_deg
    assert lat_deg is not None
    assert lon_deg is not None

    def place_of(north_deg: float) -> tuple[float, float]:
        return lat_deg + north_deg, lon_deg

    def arrival(name: str, north_deg: float, *minutes: float | None) -> FireArrival:
        times = [None if each is None else now_us + round(each * MIN_US) for each in minutes]
        return FireArrival(
            *(now_us, None, f"person/{name}", name, "person", *place_of(north_deg), None),
            *(times[0], times[1], times[2], now_us + 360 * MIN_US),
        )

    context.arrivals = [
        arrival("Engine 3", 0.003, 12.0, 25.0, None),
        arrival("Crew 7", -0.003, 95.0, None, None),
        arrival("Lookout", 0.005, None, None, None),
    ]
    text = "Engine 3: fire possible from 14:35 PDT, expected at 14:48 PDT"
    context.state_view.alarm("fire_arrival/person/Engine 3", text, "severe")
    context.state_view.arrivals_changed()
    with site_of(world) as found:
        yield found


def test_people_are_shown_with_the_time_left_and_an_alarm_is_acknowledged_for_all(
    site: Site,
) -> None:
    labels = """() => missionMap.queryRenderedFeatures({ layers: ["arrivals"] })
        .map((one) => one.properties.label)"""
    context, token = site.world.context, site.service.tokens["all"]
    with (
        screen.chromium() as browser,
        page_of(browser, site.address, token, (1440, 900)) as (page, _),
        page_of(browser, site.address, token, (390, 844)) as (phone, _),
    ):
        expected = {"Engine 3 · 12 min", "Crew 7 · 1 h 35 min", "Lookout"}
        wait_for(lambda: set(page.evaluate(labels)) == expected, 30, "the people are drawn")
        page.click("#tab-fire")
        text = page.inner_text('ul[aria-label="When the fire arrives"]')
        assert "Engine 3 possible in 12 min, expected in 25 min" in text
        assert "1 more later, or not within the forecast" in text
        if IMAGES:
            page.screenshot(path=f"{IMAGES}/arrivals.png")
        wait_for(lambda: "Engine 3" in phone.inner_text("#alarms"), 30, "the phone alarms")
        page.click("#alarms button:has-text('Acknowledge')")
        alarms = context.state_view.alarms
        wait_for(
            lambda: alarms["fire_arrival/person/Engine 3"].acknowledged_by == "all",
            30,
            "the service has the acknowledgement",
        )
        context.ring()
        quiet = "#alarms .alarm"
        wait_for(lambda: not phone.query_selector_all(quiet), 30, "the other station is quiet")
