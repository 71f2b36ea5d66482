"""Metrics for Prometheus: names, values and documentation."""

import asyncio
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from mission_service.config.service_section import JournalSection
from mission_service.events import LinkQuality, LinksReported
from mission_service.interfaces.metrics import FIGURES, PREFIX, metrics_of
from mission_service.journal.snapshot import Known
from mission_service.runtime.journal_retention import JournalRetention
from mission_service.runtime.run_context import RunContext
from tests.ops.contexts import context_after_a_flight, upload_failed

ROOT = Path(__file__).parents[2]
DASHBOARD = ROOT / "docker" / "grafana" / "dashboard.json"
RULES = ROOT / "docker" / "prometheus" / "alerts.yml"
OPERATIONS = ROOT / "docs" / "operations.md"


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunContext]:
    with context_after_a_flight(tmp_path_factory.mktemp("run")) as flown:
        yield flown


def figures(context: RunContext) -> dict[str, dict[tuple[str, ...], float]]:
    """Return the values by name and labels (ordered by their names), as Prometheus reads them."""
    content, media_type = metrics_of(context)
    assert media_type.startswith("text/plain")
    found: dict[str, dict[tuple[str, ...], float]] = {}
    for family in text_string_to_metric_families(content.decode()):
        for sample in family.samples:
            labels = tuple(value for _, value in sorted(sample.labels.items()))
            found.setdefault(sample.name, {})[labels] = sample.value
    return found


def test_a_flight_shows_in_figures(context: RunContext) -> None:
    found = figures(context)
    assert found[f"{PREFIX}vehicles"][()] == 2
    assert found[f"{PREFIX}vehicle_online"] == {("hawk",): 1, ("kite",): 1}
    assert found[f"{PREFIX}telemetry_total"][()] == context.state_view.telemetry_count > 0
    assert found[f"{PREFIX}uploads_total"]["accepted", "hawk"] >= 1
    assert 0 <= found[f"{PREFIX}telemetry_age_seconds"]["hawk",] < 5
    assert found[f"{PREFIX}fire_area_hectares"][()] > 1
    assert found[f"{PREFIX}journal_bytes"][()] > 1000
    assert found["process_resident_memory_bytes"][()] > 10e6


def test_alarms_are_counted_by_kind_until_they_are_cleared(context: RunContext) -> None:
    kinds = f"{PREFIX}alarms_active"
    before = figures(context).get(kinds, {})
    context.state_view.alarm("link/hawk", "gone", "severe", "hawk")
    context.state_view.alarm("link/kite", "gone", "severe", "kite")
    assert figures(context)[kinds]["link",] == before.get(("link",), 0) + 2
    context.state_view.clear_alarm("link/hawk")
    context.state_view.clear_alarm("link/kite")
    assert figures(context).get(kinds, {}) == before


def test_the_quality_of_each_link_is_exported(context: RunContext) -> None:
    now_us = context.clock.now_us
    quality = (LinkQuality("a", "silent", None, now_us - 7_000_000), LinkQuality("b", "up", 0.25))
    report = LinksReported(now_us, "hawk", quality, "b", "silent")
    context.state_view.apply(report, [])
    found = figures(context)
    assert found[f"{PREFIX}link_up"] == {("a", "hawk"): 0, ("b", "hawk"): 1}
    assert found[f"{PREFIX}link_in_use"] == {("a", "hawk"): 0, ("b", "hawk"): 1}
    assert found[f"{PREFIX}link_loss_ratio"] == {("b", "hawk"): 0.25}
    assert found[f"{PREFIX}link_silent_seconds"] == {("a", "hawk"): 7.0}
    assert found[f"{PREFIX}link_switches_total"] == {("silent", "hawk"): 1}


def test_a_failed_upload_counts_as_failed(context: RunContext) -> None:
    name = f"{PREFIX}uploads_total"
    before = figures(context)[name]["failed", "kite"]
    upload_failed(context, "kite")
    assert figures(context)[name]["failed", "kite"] == before + 1


def test_each_announcement_is_counted_once(context: RunContext) -> None:
    name = f"{PREFIX}announcements_total"
    assert figures(context)[name][()] == len(context.state_view.announcements) > 0
    context.state_view.clear_all_but()  # changes other states, and therefore the version
    context.state_view.announce("hawk", "a line")
    assert figures(context)[name][()] == len(context.state_view.announcements)


def test_interfaces_give_their_own_metrics(context: RunContext) -> None:
    assert f"{PREFIX}stream_clients" not in figures(context)
    context.gauges["stream_clients"] = lambda: 3
    assert figures(context)[f"{PREFIX}stream_clients"][()] == 3
    del context.gauges["stream_clients"]


def test_names_carry_units_and_have_a_help_text(context: RunContext) -> None:
    content = metrics_of(context)[0].decode()
    for name in figures(context):
        if name.startswith(PREFIX):
            assert f"# HELP {name.removesuffix('_total')}" in content
    for name, (help_text, _) in FIGURES.items():
        assert re.fullmatch(r"[a-z_]+", name)
        assert help_text.endswith(".")


def test_every_figure_is_in_the_manual() -> None:
    manual = OPERATIONS.read_text(encoding="utf-8")
    missing = [name for name in FIGURES if f"`{PREFIX}{name}`" not in manual]
    assert not missing, f"docs/operations.md does not list {missing}"
    documented = set(re.findall(rf"`{PREFIX}(\w+)`", manual))
    assert documented <= set(FIGURES), (
        f"docs/operations.md lists unknown {documented - set(FIGURES)}"
    )


@pytest.mark.parametrize("path", [DASHBOARD, RULES], ids=lambda path: str(path.name))
def test_dashboard_and_alerts_ask_for_figures_that_there_are(path: Path) -> None:
    named = set(re.findall(rf"\b{PREFIX}(\w+)", path.read_text(encoding="utf-8")))
    assert named
    assert named <= set(FIGURES), f"{path.name} asks for {named - set(FIGURES)}"


def test_the_dashboard_shows_every_figure() -> None:
    text = DASHBOARD.read_text(encoding="utf-8")
    json.loads(text)
    unseen = [name for name in FIGURES if not re.search(rf"\b{PREFIX}{name}\b", text)]
    assert not unseen, f"no panel shows {unseen}"


def test_the_duration_of_a_state_is_reported(context: RunContext) -> None:
    keeping = JournalRetention(
        context.service, Known(context.scenario, context.landscape), JournalSection()
    )
    asyncio.run(keeping.write_state())
    context.gauges["state_seconds"] = lambda: keeping.write_s
    found = figures(context)
    assert 0.0 < found[f"{PREFIX}state_seconds"][()] < 5.0
    assert 0.0 <= found[f"{PREFIX}state_age_seconds"][()] < 60.0
    del context.gauges["state_seconds"]
