"""Compare FARSITE with itself: ``python -m benchmarks.farsite_resolution PROGRAM FOLDER``.

FOLDER is that of ``benchmarks.real_fires sandiego``. PROGRAM is FARSITE's ``TestFARSITE``, built
from its public sources (dschwilk/farsite: ``make``; not part of this project). The published
perimeters have a distance and a perimeter resolution of 150 m: vertices about 100 m apart, on cells
of 90 m. The benchmark runs FARSITE again with other resolutions and otherwise the published inputs,
and prints the intersection over union with the published perimeters after 30, 60 and 90 minutes.
Beside it are the overlaps of this model's fire, with crown fire by ``scott_reinhardt`` and
acceleration as a lag, with each of these FARSITE runs: first with the wind from true north, then
from grid north, as FARSITE reads it.
"""

import argparse
import re
import subprocess
import tempfile
from functools import partial
from pathlib import Path

import click
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.real_fires import run_fire, san_diego
from benchmarks.shared import check_folder, overlap
from firemodel.landscape.readers.repairs import repaired
from firemodel.landscape.readers.shapes import features_of

CASE = "0912a968d53d4a8a81ec57e3e2d79308"
# (distance resolution, perimeter resolution) in m; the second must not be smaller than the first.
PUBLISHED = (150, 150)
RESOLUTIONS = (PUBLISHED, (140, 150), (100, 150), (60, 100), (30, 60), (15, 30), (10, 10))
CROWN = "fire.crown=scott_reinhardt"


def farsite(program: Path, folder: Path, resolution: tuple[int, int]) -> list[BaseGeometry]:
    """Return FARSITE's perimeters of the San Diego fire after 30, 60 and 90 minutes.

    Args:
        program: TestFARSITE.
        folder: The folder with the fire's files, as for ``benchmarks.real_fires``.
        resolution: Distance and perimeter resolution in m.
    """
    case = folder / "tmp" / CASE
    inputs = Path(f"{case}_config.cfg").read_text(encoding="utf-8") + "\n"
    for key, value in zip(("DISTANCE", "PERIMETER"), resolution, strict=True):
        inputs = re.sub(rf"(FARSITE_{key}_RES:) .*", rf"\1 {value}", inputs)
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        (out / "inputs.cfg").write_text(inputs, encoding="utf-8")
        barriers = folder / "NoBarrier" / "NoBarrier.shp"
        lines = (folder / "landscape.lcp", out / "inputs.cfg", f"{case}_ignite.shp", barriers, out)
        (out / "command").write_text(" ".join(map(str, lines)) + "/out 1\n", encoding="utf-8")
        subprocess.run([program, out / "command"], check=True, capture_output=True, timeout=600)
        return perimeters(out / "out_Perimeters.shp")


def perimeters(path: Path) -> list[BaseGeometry]:
    """Return the areas in a file of FARSITE's perimeters."""
    return [repaired(line) for line in features_of(path)[0]]


def row(found: list[BaseGeometry], reference: list[BaseGeometry]) -> str:
    """Return the overlaps after 30, 60 and 90 minutes as text."""
    return "".join(f"{overlap(*pair):7.3f}" for pair in zip(found, reference, strict=True))


def main() -> None:
    """Print one line for each resolution."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    folder = check_folder(given.folder).resolve()
    published = perimeters(folder / "tmp" / f"{CASE}_out_Perimeters.shp")
    slopes = (("degrees", "unburnable"),)
    models = []
    for north in ("true", "grid"):
        run = partial(run_fire, (CROWN, f'weather_file.north="{north}"'))
        models.append([each.found for each in san_diego(folder, run, slopes)][len(published) :])
    times = "".join(f"{minutes:7}" for minutes in (30, 60, 90))
    click.echo(
        f"{'resolution, m':16}{'ha after 90 min':>16} | {'FARSITE, published':21} | "
        f"{'this model, FARSITE':21} | {'same, grid north':21}\n{'':32} | {' | '.join([times] * 3)}"
    )
    for resolution in RESOLUTIONS:
        theirs = farsite(given.program.resolve(), folder, resolution)
        label = "{} / {}".format(*resolution)
        parts = [row(theirs, published), *(row(model, theirs) for model in models)]
        click.echo(f"{label:16}{theirs[-1].area / 1e4:16.1f} | {' | '.join(parts)}")
        if resolution == PUBLISHED:
            apart = max(map(shapely.hausdorff_distance, theirs, published))
            click.echo(f"{'':32} | largest distance to the published perimeters {apart:.1f} m")


if __name__ == "__main__":
    main()
