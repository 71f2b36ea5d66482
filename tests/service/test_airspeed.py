"""The scenario's airspeed is commanded with each mission; a different airspeed raises an alarm."""

from dataclasses import replace
from pathlib import Path

import pytest

from mission_service.commands import ClearAlarm, RaiseAlarm
from mission_service.config.scenario import load_scenario
from mission_service.events import AirspeedMeasured, ModeChanged
from mission_service.journal.journal_file import SegmentReader
from mission_service.simulation import sim

SHORT = ("start_s=3500", "duration_s=4300", "vehicles.0.airspeed_m_s=15")
STACKS = ("px4", pytest.param("ardupilot", marks=pytest.mark.long))
CRUISE_M_S = 22.0  # the airspeed of an autopilot without an airspeed command


def flown(
    path: Path, monkeypatch: pytest.MonkeyPatch, stack: str, **limits: float
) -> tuple[list[float], list[RaiseAlarm | ClearAlarm], list[str]]:
    """Return the airspeeds after two minutes of flight, the alarms about them, and the modes."""
    ordinary = sim.mock_of

    def mock_of(*given: object) -> object:
        mock = ordinary(*given)  # type: ignore[arg-type]
        mock.flight.change_cruise(CRUISE_M_S)
        mock.flight.limits = replace(mock.flight.limits, **limits)
        return mock

    monkeypatch.setattr(sim, "mock_of", mock_of)
    overrides = (*SHORT, f"vehicles.0.stack={stack}")
    sim.simulate(load_scenario("default", overrides), path, "")
    contents = [entry.content for entry in SegmentReader(path)]
    measured = [each for each in contents if isinstance(each, AirspeedMeasured)]
    alarms = [
        each
        for each in contents
        if isinstance(each, RaiseAlarm | ClearAlarm) and each.alarm == "airspeed"
    ]
    modes = [each.mode for each in contents if isinstance(each, ModeChanged)]
    return [each.airspeed_m_s for each in measured], alarms, modes


@pytest.mark.parametrize("stack", STACKS)
def test_missions_are_flown_at_the_airspeed_of_the_scenario(
    stack: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured, alarms, modes = flown(tmp_path / "j.jsonl", monkeypatch, stack, min_airspeed_m_s=10.0)
    assert "mission" in modes
    assert measured[-1] == pytest.approx(15.0, abs=1.0)
    assert len(measured) < 10  # reported only on a change
    assert not alarms


@pytest.mark.parametrize("stack", STACKS)
def test_an_airspeed_that_the_vehicle_does_not_fly_raises_an_alarm(
    stack: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured, alarms, _ = flown(tmp_path / "j.jsonl", monkeypatch, stack, min_airspeed_m_s=18.0)
    assert measured[-1] == pytest.approx(CRUISE_M_S, abs=1.0)
    (alarm,) = alarms
    assert isinstance(alarm, RaiseAlarm)
    assert "airspeed is 22 m/s, but its missions command 15" in alarm.text


def test_the_airspeed_of_a_long_takeoff_raises_no_alarm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mission commands the airspeed after the takeoff, which takes 150 s here."""
    measured, alarms, _ = flown(tmp_path / "j.jsonl", monkeypatch, "px4", climb_m_s=1.0)
    assert max(measured) == pytest.approx(CRUISE_M_S, abs=1.0)
    assert measured[-1] == pytest.approx(15.0, abs=1.0)
    assert not alarms
