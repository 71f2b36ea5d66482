"""A run without vehicles: a state view that tests change, and a handler that records requests."""

import asyncio
import functools
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import aiomqtt
import numpy as np

from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.service_section import MqttSection, ServiceSection
from mission_service.events import Telemetry
from mission_service.fire.scenario_fire import landscape_of
from mission_service.interfaces.mqtt.broker_site import site_in
from mission_service.interfaces.mqtt.publisher import Publisher
from mission_service.runtime.engine import Engine
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.state_view import StateView
from tests.patience import PATIENCE_S

ROOT = "test/v1/default"


@functools.cache
def scene() -> tuple[Scenario, Landscape]:
    scenario = load_scenario("default")
    return scenario, landscape_of(scenario)


def context_of(
    settings: MqttSection, ask: Callable[[dict[str, Any]], dict[str, Any]]
) -> RunContext:
    """Return a run context for the interfaces, with a round fire that spreads at 1 m/s."""
    scenario, landscape = scene()
    state_view = StateView(scenario, landscape, 0)
    rows, cols = np.indices(landscape.shape)
    arrival_s = 30.0 * np.hypot(rows - 100, cols - 100)
    fire = SimpleNamespace(expected_s=lambda: arrival_s, start_area=None, time_s=300.0)
    processed = SimpleNamespace(begun=False)
    ensemble = SimpleNamespace(processed=processed, inputs_until=lambda at_s: ())
    world = SimpleNamespace(fire=fire, landscape=landscape, ensemble=ensemble)
    service: Any = SimpleNamespace(
        estimate=world,
        state_view=state_view,
        recording=SimpleNamespace(trouble=""),
        core=SimpleNamespace(
            guidance=SimpleNamespace(estimated_fire=None), airspace=SimpleNamespace(volumes=())
        ),
    )
    service.announce = functools.partial(Engine.announce, service)
    return RunContext(
        scenario,
        ServiceSection(mqtt=settings),
        service,
        cast(Any, SimpleNamespace(ask=ask)),
        cast(Any, SimpleNamespace(now_us=300_000_000)),
        {},
        Path(),
    )


def fix(at_us: int, name: str = "hawk", lat_deg: float = 36.36) -> Telemetry:
    """Return a position on the landscape."""
    return Telemetry(at_us, name, lat_deg, -84.14, 900.0, 150.0, 18.0, 0.0, 45.0)


@dataclass
class Stage:
    """A publisher and the requests that it received."""

    context: RunContext
    publisher: Publisher
    task: asyncio.Task[None]
    asked: list[dict[str, Any]]

    @property
    def name(self) -> str:
        return next(iter(self.context.state_view.vehicles))

    def moves(self, at_us: int, lat_deg: float = 36.36) -> None:
        self.context.state_view.apply(fix(at_us, self.name, lat_deg), [])
        self.context.ring()

    def announce(self, text: str) -> None:
        self.context.state_view.announce(self.name, text)
        self.context.ring()


@asynccontextmanager
async def publishing(
    broker: str | int, replay: Any = None, **settings: Any
) -> AsyncIterator[Stage]:
    """Run a publisher (of a replay, if one is given) until the end of the context."""
    broker = f"127.0.0.1:{broker}" if isinstance(broker, int) else broker
    asked: list[dict[str, Any]] = []

    def ask(request: dict[str, Any], may_approve: bool | None = None) -> dict[str, Any]:
        asked.append(request)
        if request.get("vehicle") == "unknown":
            return {"ok": False, "error": "no vehicle 'unknown'"}
        return {"ok": True, "at_s": 300.0, "event": "OrderGiven", "messages": ["done"]}

    section = MqttSection(broker=broker, prefix="test", **settings)
    context = context_of(section, ask)
    context.replay = None if replay is None else lambda: replay
    publisher = Publisher(context, section, site_in(section, context.scenario.name))
    stage = Stage(context, publisher, asyncio.create_task(publisher.run()), asked)
    try:
        yield stage
        assert not stage.task.done(), stage.task
    finally:
        stage.task.cancel()
        _, left = await asyncio.wait([stage.task], timeout=PATIENCE_S)
        assert not left, "it does not end"
        if not stage.task.cancelled():
            # Raises the error that ended the publisher, which may have caused a failure in the
            # block.
            stage.task.result()


@dataclass
class Listener:
    """Another client, which receives all messages of the site."""

    client: aiomqtt.Client
    messages: list[aiomqtt.Message] = field(default_factory=list)

    def of(self, topic: str) -> list[Any]:
        """Return all messages on a topic of the site."""
        found = [each for each in self.messages if each.topic.value == f"{ROOT}/{topic}"]
        return [json.loads(each.payload) for each in found]

    def last(self, topic: str) -> Any:
        """Return the last message on a topic, or None."""
        return (self.of(topic) or [None])[-1]

    async def publish(
        self, topic: str, payload: bytes | dict[str, Any], retain: bool = False
    ) -> None:
        body = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
        await self.client.publish(f"{ROOT}/{topic}", body, qos=1, retain=retain)

    async def run(self) -> None:
        async for message in self.client.messages:
            self.messages.append(message)


@asynccontextmanager
async def listening(port: int, **more: Any) -> AsyncIterator[Listener]:
    """Return a client that receives all messages of the site, including retained ones."""
    async with aiomqtt.Client("127.0.0.1", port, **more) as client:
        await client.subscribe(f"{ROOT}/#", qos=1)
        listener = Listener(client)
        task = asyncio.create_task(listener.run())
        try:
            yield listener
        finally:
            task.cancel()
