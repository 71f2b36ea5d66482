"""Other aircraft on the map, of a flight in virtual time.

If the environment variable MAP_PICTURES is set, the test writes the picture of docs/surveillance.md
to that folder.
"""

import math
import os
from collections.abc import Iterator
from dataclasses import replace

import pytest
from playwright.sync_api import Page

from mission_service.config.surveillance_section import AircraftSource
from mission_service.ground_distance import M_PER_DEG
from tests.api.worlds import scenario_of, world_in
from tests.service.aircraft_messages import Aircraft, sbs_lines
from tests.web import browser as screen
from tests.web.browser import page_of
from tests.web.service import wait_for
from tests.web.virtual_flight import Site, site_of

pytestmark = pytest.mark.long  # a browser that draws without a graphics card

IMAGES = os.environ.get("MAP_PICTURES", "")
SIZES = ((390, 844), (768, 1024), (1440, 900))
SCENARIO = scenario_of(
    "demo",
    ("landscape.rows=150", "landscape.cols=150", "planner.rule=circling"),
)
SCENARIO = SCENARIO.model_copy(
    update={
        "surveillance": scenario_of("demo", ("surveillance.resolution=none",)).surveillance,
    }
)
SECONDS = 8


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """Fly with four aircraft: a warning, a corrective alert, and two that are far enough."""
    world = world_in(tmp_path_factory.mktemp("run"), SCENARIO)
    world.fly(SCENARIO.deploy_at_s + 300.0)
    service, clock = world.simulation.service, world.simulation.clock
    decoder = service.aircraft.decoder(AircraftSource(format="sbs", address="127.0.0.1:30003"))
    fix = service.state_view.telemetry["hawk"]

    def at(north_m: float, east_m: float, up_m: float) -> tuple[float, float, float]:
        scale = M_PER_DEG * math.cos(math.radians(fix.lat_deg))
        place = (fix.lat_deg + north_m / M_PER_DEG, fix.lon_deg + east_m / scale)
        return (*place, fix.altitude_amsl_m + up_m)

    crafts = [
        Aircraft(0xA4C2F1, *at(1200.0, 0.0, 20.0), -50.0, 0.0, 0.0, "N417EA"),
        Aircraft(0xA00002, *at(-900.0, 2100.0, -40.0), 20.0, -50.0, 2.0, "LIFE3"),
        Aircraft(0xA00003, *at(900.0, -1900.0, 310.0), 30.0, 60.0, -3.0, "TNK07"),
        Aircraft(0xA00004, *at(-1700.0, -1500.0, 800.0), 60.0, 90.0, 0.0, ""),
    ]
    for _ in range(SECONDS):
        decoder.decode(b"".join(map(sbs_lines, crafts)), clock.now_us)
        world.fly(clock.now_us / 1e6 + 1.0)
        crafts = [
            replace(
                each,
                lat_deg=each.lat_deg + each.north_m_s / M_PER_DEG,
                lon_deg=each.lon_deg + each.east_m_s / M_PER_DEG / math.cos(math.radians(36.36)),
            )
            for each in crafts
        ]
    with site_of(world) as found:
        yield found


def shown(page: Page) -> dict[str, str]:
    """Return the alerts about the aircraft that the map draws, by the first line of labels."""
    script = """() => missionMap.queryRenderedFeatures({ layers: ["aircraft"] })
        .map((one) => [one.properties.label.split("\\n")[0], one.properties.alert])"""
    return {str(name): str(alert) for name, alert in page.evaluate(script)}


@pytest.mark.parametrize("size", SIZES, ids=lambda size: str(size[0]))
def test_the_map_draws_aircraft_with_their_alerts(site: Site, size: tuple[int, int]) -> None:
    with (
        screen.chromium() as browser,
        page_of(browser, site.address, site.service.tokens["all"], size) as (page, _),
    ):
        nearest = min(site.world.context.state_view.aircraft(), key=lambda each: each.distance_m)
        assert nearest.callsign == "N417EA"
        script = "([lon, lat]) => missionMap.jumpTo({ center: [lon, lat], zoom: 12.4 })"
        page.evaluate(script, [nearest.lon_deg, nearest.lat_deg])
        wait_for(lambda: shown(page).get("N417EA") == "warning", 30, "the aircraft is drawn")
        if size == SIZES[-1]:  # on a phone the map is too small for all
            found = shown(page)
            assert set(found) == {"N417EA", "LIFE3", "TNK07", "a00004"}
            assert found["a00004"] == "none"
        if IMAGES:
            page.screenshot(path=f"{IMAGES}/aircraft-{size[0]}.png")
        if size == SIZES[-1]:
            page.click("#tab-fire")
            page.uncheck("#show-aircraft")
            wait_for(lambda: not shown(page), 30, "the layer is hidden")
