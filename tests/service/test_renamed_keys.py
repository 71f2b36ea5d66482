"""Scenarios and journals of version 0.1 are refused with one line that states the new name."""

from pathlib import Path
from typing import Any

import pytest

from mission_service.config.renamed_keys import RENAMED, RENAMED_VALUES
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.sections import VehicleSection
from mission_service.config.service_section import ServiceSection
from mission_service.errors import JournalError, ScenarioError
from mission_service.journal import journal_file
from mission_service.journal.journal_file import Journal, SegmentReader, header_of

KEYS = [(table, old) for table, names in RENAMED.items() for old in names]


@pytest.mark.parametrize(("table", "old"), KEYS)
def test_an_old_key_names_the_new_one(table: str, old: str, tmp_path: Path) -> None:
    file = tmp_path / "old.toml"
    header = f"[[{table}]]" if table == "vehicles" else f"[{table}]"
    file.write_text(f"{header}\n{old} = 1.0\n", encoding="utf-8")
    key = rf"vehicles\.0\.{old}" if table == "vehicles" else rf"{table}\.{old}"
    with pytest.raises(ScenarioError, match=rf": {key}: .* write {RENAMED[table][old]}$"):
        load_scenario(str(file))


@pytest.mark.parametrize(
    ("key", "old", "new"),
    [
        (f"{table}.{key}", old, new)
        for (table, key), values in RENAMED_VALUES.items()
        for old, new in values.items()
    ],
)
def test_an_old_value_names_the_new_one(key: str, old: str, new: str) -> None:
    with pytest.raises(ScenarioError, match=f'{key} = "{old}": .* write "{new}"$'):
        load_scenario("default", (f"{key}={old}",))


def test_all_old_keys_of_a_file_are_named_at_once() -> None:
    old = ("planner.worst_age_s=1", "mission.lead_m=1", "vehicles.0.least_leg_m=1")
    with pytest.raises(ScenarioError) as caught:
        load_scenario("default", old)
    for words in ("planner.worst_age_s", "write lookahead_m", "vehicles.0.least_leg_m"):
        assert words in str(caught.value)


@pytest.mark.parametrize(("table", "old"), KEYS)
def test_each_new_key_exists_and_no_old_one_does(table: str, old: str) -> None:
    if table == "vehicles":
        model: Any = VehicleSection
    elif table == "service":
        model = ServiceSection
    else:
        annotation = Scenario.model_fields[table].annotation
        model = getattr(annotation, "__args__", (annotation,))[0]
    assert RENAMED[table][old] in model.model_fields
    assert old not in model.model_fields


def test_a_journal_of_version_0_1_states_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "journal.jsonl"
    with monkeypatch.context() as patch:
        patch.setattr(journal_file, "FORMAT", 1)
        Journal(file, header_of(load_scenario("default"), "", ""), durable=False).close()
    with pytest.raises(JournalError, match=r"format 1, not 2: use version 0\.1"):
        SegmentReader(file)
