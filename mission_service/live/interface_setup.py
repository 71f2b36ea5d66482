"""Builds the interfaces of a live run or a replay, and the handler of their requests."""

import contextlib
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from mission_service.config.scenario import Scenario
from mission_service.config.service_section import ServiceSection
from mission_service.core.request_events import RequestScope, accepted_in
from mission_service.events import AnyOperatorEvent
from mission_service.runtime.clocks import clock_us
from mission_service.runtime.engine import Engine
from mission_service.runtime.gateway import MissionClock
from mission_service.runtime.request_handler import Outcome, RequestHandler
from mission_service.runtime.run_context import RunContext
from mission_service.runtime.vehicle_links import Link, connected

# An interface: a coroutine that runs until it is cancelled.
RunInterface = Callable[[RunContext], Coroutine[Any, Any, None]]


def interfaces_of(
    settings: ServiceSection,
    out: Path,
    site: str,
    stack: contextlib.AsyncExitStack,
    address: Callable[[str], None],
    logs: bool,
    announce: Callable[[str, str], None] = lambda vehicle, text: None,
) -> list[RunInterface]:
    """Return the interfaces that the settings configure; other interfaces are not imported.

    ``site`` is the name of the run in MQTT topics and Cursor on Target events. ``announce``
    receives ``"service"`` and a line if the map is not on its default port.
    """
    from mission_service.runtime.systemd_notify import pulse

    run_interfaces: list[RunInterface] = [pulse]
    if logs:
        from mission_service.runtime.service_log import log_announcements

        run_interfaces.append(log_announcements)
    if settings.http is not None:
        from mission_service.interfaces.api.listener import http_interface

        run_interface = stack.enter_context(http_interface(settings.http, out))
        address(run_interface.address)
        if run_interface.other_port_text:
            announce("service", run_interface.other_port_text)
        run_interfaces.append(run_interface)
    if settings.mqtt is not None:
        from mission_service.interfaces.mqtt.publisher import mqtt_interface

        run_interfaces.append(mqtt_interface(settings.mqtt, site))
    if settings.cot is not None:
        from mission_service.interfaces.cot.cot_sender import cot_interface

        run_interfaces.append(cot_interface(settings.cot, site))
    if settings.alarm_receivers:
        from mission_service.interfaces.notifications.notifier import alarm_notifier

        run_interfaces.append(alarm_notifier(settings.alarm_receivers, site))
    return run_interfaces


def request_handler_of(
    scenario: Scenario,
    service: Engine,
    clock: MissionClock,
    links: dict[str, Link],
    outcome: Outcome | None = None,
) -> RequestHandler:
    """Return the handler of operators' requests; the resulting frames are sent without delay.

    ``outcome`` is an argument of ``RequestHandler``.
    """
    burn = scenario.burn_flown
    stations = () if burn is None else tuple(station.name for station in burn.stations)
    items = () if burn is None else burn.go_items

    def submit(event: AnyOperatorEvent) -> list[str]:
        before = service.state_view.announcement_id
        service.submit(event, clock_us())
        flush(links)
        return [line.text for line in service.state_view.announcements_after(before)]

    def status() -> dict[str, Any]:
        return {
            "scenario": scenario.name,
            "at_s": clock.now_us / 1e6,
            "stations": stations,
            "items": items,
            **service.status(),
            "guidance": service.core.guidance.status(),
        }

    def on_map(lat_deg: float, lon_deg: float) -> bool:
        landscape = service.estimate.landscape
        return landscape.contains(*landscape.xy_of_lat_lon(lat_deg, lon_deg))

    def burned_ha() -> float:
        service.estimate.advance(clock.now_us)
        return service.estimate.fire.burned_ha

    names = tuple(section.name for section in scenario.flown)
    view = service.state_view
    scope = RequestScope(
        stations, items, on_map, names, accepted_in(scenario), view.active_or_cleared_alarms
    )
    area = None if burn is not None else burned_ha  # a burn's correction changes the estimated fire
    return RequestHandler(submit, status, lambda: clock.now_us, scope, area, outcome)


def flush(links: dict[str, Link]) -> None:
    """Send the frames that are waiting on all links."""
    for on_it in connected(links):
        on_it[0].connection.flush()
