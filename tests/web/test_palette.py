"""The colours of the map differ also for people with deuteranopia.

The simulation is that of Machado, Oliveira & Fernandes (2009), doi:10.1109/TVCG.2009.113, table 1,
severity 1.0, in linear RGB; the difference is that of CIELAB (1976).
"""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

PALETTE = Path(__file__).parents[2] / "mission_service/interfaces/web/src/palette.ts"
MIN_DIFFERENCE = 15.0  # 2.3 is just noticeable side by side
DEUTERANOPIA = np.array(
    [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]
)
XYZ_OF_RGB = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])


def groups() -> dict[str, dict[str, str]]:
    text = PALETTE.read_text(encoding="utf-8")
    found = re.findall(r"^  (\w+): \{([^}]*)\}", text, re.MULTILINE)
    return {name: dict(re.findall(r'(\w+): "(#\w{6})"', inner)) for name, inner in found}


def seen_lab(colour: str) -> NDArray[np.float64]:
    """Return the CIELAB coordinates of a colour as people with deuteranopia see it."""
    rgb = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ_OF_RGB @ np.clip(DEUTERANOPIA @ linear, 0.0, 1.0) / WHITE
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("group", ["pens", "missions", "vehicles", "aircraft", "arrival", "fire"])
def test_colours_differ_for_people_with_deuteranopia(group: str) -> None:
    colours = groups()[group]
    assert len(colours) >= 3
    for (one, first), (other, second) in itertools.combinations(colours.items(), 2):
        difference = float(np.linalg.norm(seen_lab(first) - seen_lab(second)))
        assert difference >= MIN_DIFFERENCE, f"{group}: {one} and {other}: {difference:.1f}"
