"""The products of a burn: its own estimate, and the drops."""

import csv
import json
from datetime import datetime
from pathlib import Path

import pyogrio
import pytest

from mission_service.config.scenario import load_scenario
from mission_service.products.incident import Incident
from mission_service.products.journal_incident import incident_in
from mission_service.products.write import write_products
from mission_service.runtime.run_outputs import write_outputs
from mission_service.simulation.sim import simulate

ZERO = datetime.fromisoformat("2026-08-01T14:00-04:00")


@pytest.fixture(scope="module")
def burn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Incident]:
    journal = tmp_path_factory.mktemp("burn") / "journal.jsonl"
    simulate(load_scenario("burn", ("duration_s=700",)), journal, "today")
    incident = incident_in(journal, None, 1800.0, ZERO)
    out = tmp_path_factory.mktemp("products")
    write_products(out, incident)
    return out, incident


def test_a_burn_is_no_wildfire(burn: tuple[Path, Incident]) -> None:
    out, incident = burn
    assert incident.prescribed
    meta, _, _, values = pyogrio.raw.read(out / "incident.gpkg", layer="perimeter")
    fields = dict(zip(meta["fields"], (column[0] for column in values), strict=True))
    assert fields["poly_FeatureCategory"] == "Prescribed Fire"
    assert 0.5 < fields["poly_GISAcres"] < 40.0
    assert not (out / "flame_length_m.tif").exists()


def test_the_drops_are_in_the_table_and_in_the_layer(burn: tuple[Path, Incident]) -> None:
    out, incident = burn
    with (out / "drops.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    _, _, shapes, _ = pyogrio.raw.read(out / "incident.gpkg", layer="drops")
    drops = [drop for each in incident.record.vehicles.values() for drop in each.drops]
    assert len(rows) == len(shapes) == len(drops) > 5
    assert {row["outcome"] for row in rows} == {"done"}
    assert f"Drops:{' ' * 20}{len(drops)}" in (out / "interpreter-log.txt").read_text()


def test_the_perimeters_of_a_burn_have_the_category_prescribed_fire(tmp_path: Path) -> None:
    scenario = load_scenario("burn", ("duration_s=20",))
    write_outputs(tmp_path, scenario, *simulate(scenario, tmp_path / "journal.jsonl", "today"))
    fronts = json.loads((tmp_path / "perimeters.geojson").read_text(encoding="utf-8"))["features"]
    assert {front["properties"]["FeatureCategory"] for front in fronts} == {"Prescribed Fire"}
