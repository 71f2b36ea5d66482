"""Share of a core for 1,000 other aircraft at 1 Hz, for each format; limit 3 %.

Each aircraft sends a position and a velocity a second (SBS: also a callsign). Received bytes are
decoded four times a second as in a live run. The costs include the events once a second, their
journal lines, and the alerts of the core. ``spread`` has the aircraft within 200 km of one vehicle,
``near`` within 18 km, so that all are tracked.
"""

import math
import random
import time
from collections.abc import Callable
from dataclasses import replace

import click

from autopilot_bridge.clients.native import NativeClient
from autopilot_bridge.links.codec import Codec
from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.local_frame import LocalFrame
from autopilot_bridge.stacks.stacks import stack_named
from mission_service.config.scenario import load_scenario
from mission_service.config.surveillance_section import AircraftSource, Format
from mission_service.core.core import Core
from mission_service.events import Telemetry, VehicleConnected
from mission_service.fire.scenario_fire import landscape_of
from mission_service.ground_distance import M_PER_DEG
from mission_service.journal.journal_file import event_body
from mission_service.runtime.gateway import Gateway, MissionClock
from mission_service.surveillance.aircraft_reports import AircraftReports
from tests.service.aircraft_messages import (
    Aircraft,
    beast_frames,
    cot_event,
    gdl90_report,
    sbs_lines,
)
from tests.service.intruders import ADSB_COMPONENT, Intruder

AIRCRAFT, BATCHES = 1000, 4
LIMIT_PERCENT = 3.0
SPREADS_M = {"spread": 200_000.0, "near": 18_000.0}
Feed = Callable[[list[bytes], int], None]  # one batch of messages, time in us


def aircraft_around(radius_m: float, home: tuple[float, float], seed: int) -> list[Aircraft]:
    """Return aircraft evenly spread in a disc around a position."""
    rng, found = random.Random(seed), []
    for number in range(AIRCRAFT):
        angle, apart_m = rng.uniform(0.0, math.tau), radius_m * math.sqrt(rng.random())
        course, speed_m_s = rng.uniform(0.0, math.tau), rng.uniform(40.0, 120.0)
        lat_deg = home[0] + apart_m * math.cos(angle) / M_PER_DEG
        lon_deg = home[1] + apart_m * math.sin(angle) / M_PER_DEG / math.cos(math.radians(home[0]))
        motion = (speed_m_s * math.cos(course), speed_m_s * math.sin(course), 1.0)
        address = 0xA00000 + 37 * number
        found.append(Aircraft(address, lat_deg, lon_deg, rng.uniform(400.0, 3000.0), *motion))
    return found


def moved(craft: Aircraft, seconds: float) -> Aircraft:
    """Return an aircraft after some seconds."""
    lat_deg = craft.lat_deg + seconds * craft.north_m_s / M_PER_DEG
    scale = M_PER_DEG * math.cos(math.radians(craft.lat_deg))
    return replace(craft, lat_deg=lat_deg, lon_deg=craft.lon_deg + seconds * craft.east_m_s / scale)


def encode(form: str, craft: Aircraft, second: int, codec: Codec) -> bytes:
    """Return the messages of an aircraft in one second."""
    match form:
        case "sbs":
            return sbs_lines(craft)
        case "beast":
            return beast_frames(craft, bool(second % 2))
        case "gdl90":
            return gdl90_report(craft)
        case "cot":
            return cot_event(craft)
        case _:
            seen = Intruder(
                0.0,
                *(craft.lat_deg, craft.lon_deg, craft.altitude_m),
                *(craft.track_deg, craft.speed_m_s, craft.address),
            )
            return seen.report(0.0, codec)


def feed_of(form: str, reports: AircraftReports) -> Feed:
    """Return the function that receives one batch of a format."""
    if form != "adsb_vehicle":
        known: Format = form  # type: ignore[assignment]
        decoder = reports.decoder(AircraftSource(format=known, address="127.0.0.1:30003"))
        return lambda batch, at_us: decoder.decode(b"".join(batch), at_us)
    client = NativeClient()
    mock = MockAutopilot(stack_named("px4", "plane"), LocalFrame(36.37, -84.13, 300.0))
    for now_us in range(0, 3_000_000, 125_000):
        mock.handle_timer(now_us)
        for datagram in mock.data_to_send():
            client.receive_data(datagram, now_us)
    gateway = Gateway("hawk", client, MissionClock(0, wall=False))

    def receive(batch: list[bytes], at_us: int) -> None:
        for datagram in batch:
            client.receive_data(datagram, at_us)
        list(gateway.events(at_us))
        reports.take_seen("hawk", gateway.aircraft, at_us)

    return receive


def measured(form: str, radius_m: float, seconds: int) -> tuple[float, int]:
    """Return the share of a core in percent, and the number of tracked aircraft."""
    scenario = load_scenario("demo", ("surveillance.range_m=20000",))
    scenario = scenario.model_copy(update={"vehicles": scenario.vehicles[:1]})
    core, section = Core(scenario, landscape_of(scenario)), scenario.vehicles[0]
    home = (section.home_lat_deg, section.home_lon_deg)
    reports, codec = AircraftReports(scenario.surveillance), Codec(1, ADSB_COMPONENT)
    feed, crafts = feed_of(form, reports), aircraft_around(radius_m, home, 1)
    name = section.name
    core.handle(VehicleConnected(0, name, "px4 plane", True))
    used_s = 0.0
    for second in range(seconds):
        fix = Telemetry(second * 1_000_000, name, *home, 500.0, 150.0, 12.0, 0.0, 0.0)
        core.handle(fix)
        messages = [encode(form, moved(craft, second), second, codec) for craft in crafts]
        size = AIRCRAFT // BATCHES
        begin_s = time.process_time()
        for number in range(BATCHES):
            at_us = second * 1_000_000 + number * 250_000
            feed(messages[number * size : (number + 1) * size], at_us)
            for event in reports.events_due({name: fix}, at_us):
                event_body(event)
                core.handle(event)
        if second >= 3:
            used_s += time.process_time() - begin_s
    return 100.0 * used_s / (seconds - 3), len(reports.table.tracks)


@click.command(help=__doc__)
@click.option("--seconds", default=20)
def main(seconds: int) -> None:
    """Print the table; exit with code 1 above the limit."""
    worst = 0.0
    for form in ("sbs", "beast", "gdl90", "cot", "adsb_vehicle"):
        for spread, radius_m in SPREADS_M.items():
            share, tracked = measured(form, radius_m, seconds)
            worst = max(worst, share)
            click.echo(f"{form:<13} {spread:<7} {share:5.2f} % of a core, {tracked} tracked")
    click.echo(f"limit {LIMIT_PERCENT:g} %")
    raise SystemExit(worst > LIMIT_PERCENT)


if __name__ == "__main__":
    main()
