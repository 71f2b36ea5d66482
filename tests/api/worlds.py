"""A run in virtual time with the run context that the interfaces of the daemon use."""

import asyncio
import contextlib
import ssl
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.service_section import HttpSection, ServiceSection
from mission_service.core.request_events import RequestScope, accepted_in
from mission_service.events import AnyOperatorEvent
from mission_service.fire.scenario_fire import landscape_of
from mission_service.interfaces.api.access.auth import ROLES, Tokens, User, new_token, sum_of
from mission_service.interfaces.api.app import Application, app_of, role_of, routes_of
from mission_service.interfaces.api.server import bound, serving
from mission_service.journal.journal_file import Journal, header_of
from mission_service.live.estimate_worker import EstimateWorker
from mission_service.requests import Role
from mission_service.runtime.request_handler import RequestHandler
from mission_service.runtime.run_context import RunContext
from mission_service.simulation.sim import Simulation

SMALL = (
    *("landscape.rows=150", "landscape.cols=150", "vehicles.1.autostart=false"),
    # A planner with importance values and settings that may change in flight.
    'planner.rule="islam_hu_damped"',
)
HOST = "127.0.0.1:8765"
ANY = HttpSection(listen="127.0.0.1:0")


@dataclass
class World:
    """A simulation and its run context; ``submitted`` contains the events made from requests."""

    simulation: Simulation
    context: RunContext
    worker: EstimateWorker  # not running: reads fold the estimate's inputs
    submitted: list[AnyOperatorEvent] = field(default_factory=list)

    def fly(self, until_s: float) -> None:
        """Continue until a mission time, and publish the announcements."""
        self.simulation.run_until(until_s)
        self.simulation.estimate.advance(self.simulation.clock.now_us)
        self.context.ring()

    @property
    def now_s(self) -> float:
        return self.simulation.clock.now_us / 1e6


def scenario_of(name: str = "demo", changes: tuple[str, ...] = SMALL) -> Scenario:
    return load_scenario(name, changes)


def world_in(out: Path, scenario: Scenario) -> World:
    """Return a run that has not begun, with its files in ``out``."""
    landscape = landscape_of(scenario)
    header = header_of(scenario, landscape.digest(), "2026-11-21T00:00:00+00:00")
    journal = Journal(out / "journal.jsonl", header, durable=True)
    simulation = Simulation(scenario, journal, landscape, lambda at, core: [])
    service, clock = simulation.service, simulation.clock
    submitted: list[AnyOperatorEvent] = []

    def submit(event: AnyOperatorEvent) -> list[str]:
        submitted.append(event)
        before = service.state_view.announcement_id
        service.submit(event, simulation.link_us)
        return [line.text for line in service.state_view.announcements_after(before)]

    def on_map(lat_deg: float, lon_deg: float) -> bool:
        return landscape.contains(*landscape.xy_of_lat_lon(lat_deg, lon_deg))

    def burned_ha() -> float:
        simulation.estimate.advance(clock.now_us)
        return simulation.estimate.fire.burned_ha

    burn = scenario.burn_flown
    scope = RequestScope(
        () if burn is None else tuple(station.name for station in burn.stations),
        () if burn is None else burn.go_items,
        on_map,
        tuple(section.name for section in scenario.vehicles),
        accepted_in(scenario),
    )
    area = None if burn is not None else burned_ha
    worker = EstimateWorker(service, lambda: simulation.link_us, lambda: None)
    request_handler = RequestHandler(
        submit, service.status, lambda: clock.now_us, scope, area, worker.outcome
    )
    settings = ServiceSection(http=HttpSection())
    context = RunContext(
        scenario,
        settings,
        service,
        request_handler,
        clock,
        {},
        out / "journal.jsonl",
    )
    return World(simulation, context, worker, submitted)


@dataclass
class Served:
    """An application with a token for each set of roles."""

    world: World
    app: Application
    tokens: dict[str, str]

    def headers(self, name: str = "all") -> dict[str, str]:
        return {"authorization": f"Bearer {self.tokens[name]}"}


def served(world: World, named: bool = False, page: Path = Path("no page")) -> Served:
    """Return the application; with ``named``, each token belongs to a user."""
    secret = {name: new_token() for name in (*ROLES, "all")}
    roles: dict[str, frozenset[Role]] = {role: frozenset([role]) for role in ROLES}
    roles["all"] = frozenset(ROLES)
    users = tuple(User(name, roles[name], sum_of(secret[name])) for name in secret)
    tokens = Tokens(users)
    tokens.named = named
    world.context.ring()  # a separate signal for each event loop
    app = app_of(world.context, tokens, page)
    return Served(world, app, secret)


def client(app: Application, **keywords: Any) -> httpx.AsyncClient:
    """Return a client that calls the application directly."""
    transport = httpx.ASGITransport(app=app.asgi, raise_app_exceptions=False)
    return httpx.AsyncClient(transport=transport, base_url=f"http://{HOST}", **keywords)


@dataclass(frozen=True)
class Call:
    """A request that is valid except for its user."""

    method: str
    path: str
    role: str
    body: dict[str, Any] | None

    def __str__(self) -> str:
        return f"{self.method} {self.path}"


def calls(app: Application) -> list[Call]:
    """Return one request for each route and method, with the example of its description."""
    found = []
    for route in routes_of(app.routes):
        path = route.path
        for name, value in (("name", "hawk"), ("z", "1"), ("x", "0"), ("y", "0")):
            path = path.replace(f"{{{name}}}", value)
        for method in sorted(route.methods or ()):
            content = (route.openapi_extra or {}).get("requestBody", {}).get("content", {})
            body = content.get("application/json", {}).get("example")
            found.append(Call(method, path, role_of(route), body))
    return found


@contextlib.asynccontextmanager
async def listened_to(
    service: Served, tls: ssl.SSLContext | None = None
) -> AsyncIterator[tuple[str, int]]:
    """Serve the application on a separate port."""
    with bound(ANY) as listening:
        async with serving(service.app.asgi, listening, service.app.api.streams.stopping, tls):
            yield listening.getsockname()


async def stream_of(
    service: Served, address: tuple[str, int], limit: int = 2**16
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Return a connection that has requested the live stream."""
    reader, writer = await asyncio.open_connection(*address, limit=limit)
    lines = ["GET /api/v1/live HTTP/1.1", f"Host: 127.0.0.1:{address[1]}"]
    lines += [f"Authorization: Bearer {service.tokens['look']}", "", ""]
    writer.write("\r\n".join(lines).encode())
    await reader.readuntil(b"\r\n\r\n")
    return reader, writer
