"""The face of the package: names are imported at first use and have documented arguments."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import autopilot_bridge as bridge


def test_importing_the_package_loads_nothing() -> None:
    code = "import sys, autopilot_bridge; print(len([m for m in sys.modules if 'mavlink' in m]))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "0"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        _ = bridge.fly


@pytest.mark.parametrize("name", bridge.__all__)
def test_what_is_exported_is_documented(name: str) -> None:
    exported = getattr(bridge, name)
    text = inspect.getdoc(exported) or ""
    assert text
    if inspect.isfunction(exported):
        expected = {"Args:"}
        if inspect.signature(exported).return_annotation is not None:
            expected.add("Returns:")
        assert all(section in text for section in expected), text
    elif name not in ("BridgeError", "Stack", "VehicleClient"):
        arguments = [each for each in inspect.signature(exported).parameters if each != "self"]
        assert "Args:" in text
        assert all(f"{each}:" in text or f"``{each}``" in text for each in arguments[:4]), text


def test_the_example_of_the_docstring_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert bridge.__doc__ is not None
    monkeypatch.chdir(tmp_path)
    mission = (
        bridge.takeoff(36.3, -84.2, 350.0),
        bridge.waypoint(36.31, -84.2, 400.0),
        bridge.loiter_unlimited(36.31, -84.2, 400.0, 80.0),
    )
    stack = bridge.stack_named("px4", "plane")
    bridge.write_any(Path("survey.plan"), bridge.Plan(mission), stack)
    example = bridge.__doc__.split("::\n\n")[1].split("\n\n")[0]
    exec(inspect.cleandoc(example), {})
    assert Path("survey.waypoints").read_text(encoding="utf-8").startswith("QGC WPL 110")
