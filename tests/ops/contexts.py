"""A run context after a short flight in virtual time, for metrics and logs."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import msgspec

from mission_service.config.scenario import load_scenario
from mission_service.config.service_section import ServiceSection
from mission_service.events import UploadFinished
from mission_service.fire.scenario_fire import landscape_of
from mission_service.journal.journal_file import Journal, header_of
from mission_service.runtime.request_handler import RequestHandler
from mission_service.runtime.run_context import RunContext
from mission_service.simulation.sim import Simulation

FLIGHT_S = 60.0


@contextlib.contextmanager
def context_after_a_flight(out: Path) -> Iterator[RunContext]:
    """Return the context of a demo flight on a small landscape, with its files in ``out``."""
    scenario = load_scenario("demo", ("landscape.rows=150", "landscape.cols=150"))
    landscape = landscape_of(scenario)
    header = header_of(scenario, landscape.digest(), "2026-11-21T00:00:00+00:00")
    journal = Journal(out / "journal.jsonl", header, durable=True)
    simulation = Simulation(scenario, journal, landscape, lambda at, core: [])
    simulation.run_until(scenario.start_s + FLIGHT_S)
    simulation.estimate.advance(simulation.clock.now_us)
    service, clock = simulation.service, simulation.clock
    request_handler = RequestHandler(lambda event: [], service.status, lambda: clock.now_us)
    settings, journal_path = ServiceSection(), out / "journal.jsonl"
    yield RunContext(scenario, settings, service, request_handler, clock, {}, journal_path)
    journal.close()


def upload_failed(context: RunContext, vehicle: str) -> None:
    """Return a mission upload without a reply."""
    mission = context.state_view.missions[vehicle]
    sent = mission.sending or mission.on_board
    assert sent is not None
    mission.sending = msgspec.structs.replace(sent, mission_id=9999)
    at_us = context.state_view.at_us
    context.state_view.apply(UploadFinished(at_us, vehicle, 9999, "failed", "no answer"), [])
