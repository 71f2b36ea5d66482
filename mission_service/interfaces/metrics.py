"""Exports the metrics of a run to Prometheus, read from the run context at each scrape.

Metrics of an interface, such as the number of live streams, are functions in ``context.gauges``.
The keys of these functions are the names in ``FIGURES``.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST
from prometheus_client.registry import Collector

from mission_service import __version__
from mission_service.journal.segments import closed_segments, newest_state
from mission_service.runtime.clocks import last_written_s, wall_us
from mission_service.runtime.published_states import VehicleState
from mission_service.runtime.run_context import RunContext

PREFIX = "mission_service_"
# For each name without the prefix: its help text and labels. Names that end in _total are counters.
FIGURES: dict[str, tuple[str, tuple[str, ...]]] = {
    "info": ("Version, scenario and rule; always 1.", ("version", "scenario", "rule")),
    "ready": ("1 while /readyz returns 200.", ()),
    "mission_time_seconds": ("Mission time.", ()),
    "vehicles": ("Vehicles that this process flies.", ()),
    "vehicles_online": ("Vehicles whose link is up.", ()),
    "vehicle_online": ("1 while the vehicle's link is up.", ("vehicle",)),
    "link_up": ("1 while frames of the vehicle arrive over the link.", ("vehicle", "link")),
    "link_in_use": ("1 if the service sends over the link.", ("vehicle", "link")),
    "link_loss_ratio": (
        "Share of the vehicle's frames lost in the last seconds; absent while unknown.",
        ("vehicle", "link"),
    ),
    "link_silent_seconds": (
        "Time since the last frame on a silent link; absent while frames arrive.",
        ("vehicle", "link"),
    ),
    "link_switches_total": ("Changes of the link in use, by cause.", ("vehicle", "cause")),
    "vehicle_battery_percent": ("Battery charge that the vehicle reports.", ("vehicle",)),
    "vehicle_time_on_task_seconds": (
        "Time until the vehicle must fly home; negative after this time; absent on the ground.",
        ("vehicle",),
    ),
    "vehicle_time_home_seconds": (
        "Time of the vehicle's flight home; absent on the ground.",
        ("vehicle",),
    ),
    "telemetry_age_seconds": (
        "Mission time since the vehicle's last position; absent before the first.",
        ("vehicle",),
    ),
    "telemetry_total": ("Positions received.", ()),
    "observations_total": ("Camera observations processed.", ()),
    "decisions_total": ("Decisions of the planners.", ("vehicle",)),
    "reversals_total": ("Decisions to turn back.", ("vehicle",)),
    "uploads_total": ("Missions sent, by result.", ("vehicle", "outcome")),
    "drops_total": ("Spheres ordered, by result.", ("vehicle", "outcome")),
    "aircraft_tracked": ("Other aircraft that are tracked near the vehicles.", ()),
    "aircraft_rejected_total": ("Damaged or implausible messages about other aircraft.", ()),
    "clearing_vehicles": (
        "Vehicles by their progress while the airspace is cleared; absent at other times.",
        ("phase",),
    ),
    "alarms_active": ("Active alarms, by kind.", ("kind",)),
    "announcements_total": ("Announcements to operators.", ()),
    "fire_area_hectares": ("Estimated burned area.", ()),
    "fire_changes_total": ("Corrections of the fire and wind by operators.", ()),
    "journal_bytes": ("Size of all journal segments on disk.", ()),
    "state_age_seconds": ("Time since the last write of the state file.", ()),
    "state_seconds": ("Duration of the last write of the state file.", ()),
    "forecast_seconds": ("Duration of the last fire forecast.", ()),
    "event_loop_lag_seconds": ("Largest delay of the event loop in the last seconds.", ()),
    "stream_clients": ("Clients of the live stream.", ()),
    "mqtt_connected": ("1 while the MQTT broker is connected.", ()),
    "mqtt_sent_total": ("Messages that the MQTT broker accepted.", ()),
}


def metrics_of(context: RunContext) -> tuple[bytes, str]:
    """Return the metrics in Prometheus text format, and its media type."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(MetricsCollector(context))
    ProcessCollector(registry=registry)  # process_cpu_seconds_total and others
    return generate_latest(registry), CONTENT_TYPE_LATEST


class MetricsCollector(Collector):
    """The collector of a run context's metrics."""

    def __init__(self, context: RunContext) -> None:
        self._context = context

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics that have values."""
        found = dict(_of_run(self._context))
        found |= _of_vehicles(self._context)
        found |= {name: [((), float(value()))] for name, value in self._context.gauges.items()}
        for name, samples in found.items():
            help_text, labels = FIGURES[name]
            family = CounterMetricFamily if name.endswith("_total") else GaugeMetricFamily
            metric = family(PREFIX + name, help_text, labels=labels)
            for values, value in samples:
                metric.add_metric(values, value)
            yield metric


Samples = list[tuple[tuple[str, ...], float]]
Add = Callable[[str, tuple[str, ...], float], None]


def _of_run(context: RunContext) -> Iterable[tuple[str, Samples]]:
    state_view, scenario = context.state_view, context.scenario
    yield "info", [((__version__, scenario.name, scenario.planner.rule), 1.0)]
    yield "ready", [((), float(not context.ready() and not context.stopping))]
    yield "mission_time_seconds", [((), context.clock.now_us / 1e6)]
    yield "telemetry_total", [((), state_view.telemetry_count)]
    yield "observations_total", [((), state_view.statistics.observations)]
    clearing = state_view.clearing
    if clearing is not None and clearing.outcome == "in force":
        phases = Counter(each.phase for each in clearing.vehicles)
        yield "clearing_vehicles", [((phase,), count) for phase, count in sorted(phases.items())]
    kinds = Counter(key.partition("/")[0] for key in state_view.alarms)
    yield "alarms_active", [((kind,), count) for kind, count in sorted(kinds.items())]
    yield "announcements_total", [((), state_view.announcement_count)]
    yield "fire_area_hectares", [((), context.fire()["area_ha"])]
    yield "fire_changes_total", [((), state_view.fire_version - 1)]
    yield "journal_bytes", [((), _bytes_of(context.journal_path))]
    state = newest_state(context.journal_path)
    if state.exists():
        yield "state_age_seconds", [((), wall_us() / 1e6 - last_written_s(state))]


def _bytes_of(journal: Path) -> int:
    """Return the total size in bytes of the journal's current and earlier segments."""
    segments = [journal, *closed_segments(journal).values()]
    return sum(segment.stat().st_size for segment in segments if segment.exists())


def _add_links(context: RunContext, state: VehicleState, add: Add) -> None:
    """Add the metrics of a vehicle's links."""
    for each in state.links:
        labels = (state.vehicle, each.link)
        add("link_up", labels, each.state in ("up", "degraded"))
        add("link_in_use", labels, each.in_use)
        if each.loss_pct is not None:
            add("link_loss_ratio", labels, each.loss_pct / 100.0)
        if each.silent_since_us is not None:
            silent_us = context.clock.now_us - each.silent_since_us
            add("link_silent_seconds", labels, silent_us / 1e6)
    switches = context.state_view.statistics.vehicles[state.vehicle].sortie.links.switches
    for cause, count in sorted(switches.items()):
        add("link_switches_total", (state.vehicle, cause), count)


def _of_vehicles(context: RunContext) -> dict[str, Samples]:
    found: dict[str, Samples] = {}

    def add(name: str, labels: tuple[str, ...], value: float) -> None:
        found.setdefault(name, []).append((labels, value))

    state_view = context.state_view
    online = [state.link == "online" for state in state_view.vehicles.values()]
    add("vehicles", (), len(online))
    add("vehicles_online", (), sum(online))
    for name, state in state_view.vehicles.items():
        add("vehicle_online", (name,), state.link == "online")
        _add_links(context, state, add)
        if state.battery_pct is not None:
            add("vehicle_battery_percent", (name,), state.battery_pct)
        if state.time_on_task_s is not None:
            add("vehicle_time_on_task_seconds", (name,), state.time_on_task_s)
        if state.time_home_s is not None:
            add("vehicle_time_home_seconds", (name,), state.time_home_s)
        fix = state_view.telemetry.get(name)
        if fix is not None:
            add("telemetry_age_seconds", (name,), (context.clock.now_us - fix.at_us) / 1e6)
        add("decisions_total", (name,), state.decisions)
        add("reversals_total", (name,), state.reversals)
        add("uploads_total", (name, "accepted"), state.uploads_accepted)
        add("uploads_total", (name, "failed"), state.uploads_failed)
        if context.scenario.burn_flown is not None:
            add("drops_total", (name, "done"), state.drops_done)
            add("drops_total", (name, "refused"), state.drops_refused)
            add("drops_total", (name, "unknown"), state.drops_unknown)
    return found
