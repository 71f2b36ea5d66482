"""Error of a fire's shape by the number of weather entries: ``-m benchmarks.weather_steps``.

Constant weather is divided into an increasing number of equal entries, which should not change the
fire. The head advances by 120 cells; the table shows the overlap with the exact ellipse.
"""

from dataclasses import replace

import click
import numpy as np
from shapely import Polygon, affinity

from benchmarks.farsite_flatland import Stretch, ellipse
from benchmarks.shared import overlap
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.anyangle import AnyAngleFire
from tests.firemodel.spread_fields import spread_fields

CELLS, CELL_M, HEAD_CELLS = 281, 30.0, 120
COUNTS = (1, 4, 16, 32, 64, 128, 256)
WINDS_M_S = (0.0, 3.0, 6.0)


def main() -> None:
    """Print the table of overlaps by wind and number of entries."""
    level = np.zeros((CELLS, CELLS), dtype=np.float32)
    landscape = Landscape("EPSG:32616", 0.0, 0.0, CELL_M, level.astype(np.int16) + 1, level)
    middle = CELLS // 2
    counts = " ".join(f"{HEAD_CELLS / count:7.2f}" for count in COUNTS)
    click.echo(f"cells that the head covers in one entry {counts}")
    for wind_m_s in WINDS_M_S:
        weather = Weather(0.0, wind_m_s, 200.0, 5.0, 6.0, 7.0, 90.0, 90.0)
        rate, toward, e = (float(field[0, 0]) for field in spread_fields(landscape, weather))
        end_s = HEAD_CELLS * CELL_M / rate
        shape = Polygon(ellipse(Stretch(end_s, rate * end_s, toward, e)))
        exact = affinity.translate(shape, *landscape.xy_of(middle, middle))
        found = []
        for count in COUNTS:
            entries = [replace(weather, at_s=end_s / count * number) for number in range(count)]
            fire = AnyAngleFire(landscape, WeatherStream(entries), [(middle, middle, 0.0)])
            fire.advance(end_s)
            found.append(overlap(fire.front(end_s), exact))
        row = " ".join(f"{value:7.4f}" for value in found)
        click.echo(f"length/width {1.0 / np.sqrt(1.0 - e * e):.2f}:{'':15} {row}")


if __name__ == "__main__":
    main()
