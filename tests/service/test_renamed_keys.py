"""Scenarios and journals of version 0.1 get one line with the present name or the remedy."""

from pathlib import Path
from typing import Any

import pytest

from mission_service.config.renamed_keys import RENAMED, RENAMED_RULES
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.config.sections import VehicleSection
from mission_service.config.service import ServiceSection
from mission_service.errors import JournalError, ScenarioError
from mission_service.journal import journal_file
from mission_service.journal.journal_file import Journal, SegmentReader, header_of

KEYS = [(table, old) for table, names in RENAMED.items() for old in names]


@pytest.mark.parametrize(("table", "old"), KEYS)
def test_an_old_key_names_the_new_one(table: str, old: str, tmp_path: Path) -> None:
    file = tmp_path / "old.toml"
    header = f"[[{table}]]" if table == "vehicles" else f"[{table}]"
    file.write_text(f"{header}\n{old} = 1.0\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=rf"{table}\.{old}: .* write {RENAMED[table][old]}$"):
        load_scenario(str(file))


@pytest.mark.parametrize("old", RENAMED_RULES)
def test_an_old_rule_names_the_new_one(old: str) -> None:
    with pytest.raises(ScenarioError, match=f'write "{RENAMED_RULES[old]}"$'):
        load_scenario("default", (f"planner.rule={old}",))


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
