"""Real fires with each process: ``python -m benchmarks.fire_processes FIRE=FOLDER…``.

FIRE is one of the following; the FOLDERs are those of ``benchmarks.real_fires``:

- sandiego: FARSITE's perimeters after 30, 60 and 90 minutes, slopes in degrees. The fire begins
  with a perimeter, so that acceleration is that of a line source: the fire 200 s earlier.
- tubbs: hulls of VIIRS detections, 5.5 and 11.5 h after the ignition (rows of 6 and 12 h). The
  second hull contains the detections until 16.8 h. ``wind_grids`` are ELMFIRE's hourly grids of
  300 m.
- maria: means of all and of the first four of the 19 intervals between mapped perimeters.
- maasmechelen: the mapped area of the largest of the Belgian fires, after the first and the last
  hour of the weather.

For the processes alone, all together, and all but one, the benchmark prints the area at the last
comparison; the agreement (Cohen's kappa over the landscape for tubbs, else intersection over
union) beside that of persistence; the processor time of the spread (the better of two runs,
without reading, weather and output); its ratio to that of surface only; the ratio of the speeds,
in burned cells per second; and the processor time of computing the wind in each cell, which a
landscape needs once. The dead fuel model ``nelson`` is not among the processes, because no
weather of these fires has records of temperature and humidity before the fire.

``--members N`` compares the median arrival of an ensemble of N with the default errors instead.
``--only "PROCESS + PROCESS"`` (repeatable) computes these combinations instead. ``--pictures DIR``
draws the outlines at the comparison at which the reference has grown most.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from benchmarks.real_fires import Row, Run, belgian, kappa, maria, san_diego, tubbs
from benchmarks.shared import check_folder, overlap
from firemodel.ensemble.member_fires import burned_windows
from firemodel.ensemble.products import arrival_quantiles_s
from firemodel.landscape.landscape import Landscape
from firemodel.outputs.arrival_map import frame_around, save_map, set_title, start_map
from firemodel.spread.front import front_polygons
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.fire.scenario_fire import fire_of, landscape_of, weather_of
from mission_service.simulation.fire_members import job_of

CHANGES: dict[str, tuple[str, ...]] = {
    "scott_reinhardt": ("fire.crown=scott_reinhardt",),
    "cruz": ("fire.crown=cruz",),
    "spotting": ("fire.spotting=true",),
    "acceleration": ("fire.acceleration=true",),
    "terrain_wind": ("terrain_wind={}",),
}
CROWNS = ("scott_reinhardt", "cruz")
SURFACE = "surface only"
REPEATS = 2


class Case(NamedTuple):
    """A real fire: its comparisons, the processes that its data allow, and the rows to print."""

    rows: Callable[[Path, Run], Iterator[Row]]
    processes: tuple[str, ...]
    picks: Mapping[str, slice]
    lag: bool = False  # half of the rows are those of an acceleration, which is only a time lag


@dataclass
class Timed:
    """Runs scenarios with changed keys, and adds up the processor times."""

    changes: Sequence[str]
    members: int | None
    landscape: Landscape | None = None
    spread_s: float = 0.0
    weather_s: float = 0.0
    cells: int = 0

    @property
    def cells_per_s(self) -> float:
        """Burned cells per second of processor time."""
        return self.cells / self.spread_s

    def __call__(self, scenario: str, every_s: float, crs: str) -> list[tuple[float, Any]]:
        """Return the fronts of a scenario in the CRS of its landscape, which must be ``crs``."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "fire.toml"
            path.write_text(scenario, encoding="utf-8")
            loaded = load_scenario(str(path), tuple(self.changes))
            self.landscape = landscape_of(loaded)
            began_s = time.process_time()
            weather_of(loaded)
            self.weather_s += time.process_time() - began_s
            return self._median(loaded, every_s) if self.members else self._single(loaded, every_s)

    def _single(self, scenario: Scenario, every_s: float) -> list[tuple[float, Any]]:
        assert self.landscape is not None
        weather, took_s = weather_of(scenario), []
        for _ in range(REPEATS):
            began_s = time.process_time()
            fire = fire_of(scenario, self.landscape, weather)
            start_s, first = fire.time_s, np.count_nonzero(fire.burned())
            fire.advance(scenario.duration_s)
            took_s.append(time.process_time() - began_s)
        self.spread_s += min(took_s)
        self.cells += int(np.count_nonzero(fire.burned()) - first)
        times_s = front_times_s(start_s, scenario.duration_s, every_s)
        return [(at_s, fire.front(at_s).buffer(0.0)) for at_s in times_s]

    def _median(self, scenario: Scenario, every_s: float) -> list[tuple[float, Any]]:
        assert self.members is not None
        job, began_s = job_of(scenario, self.members), time.process_time()
        numbers = list(range(self.members))
        windows = list(burned_windows(job.start_state, job.draws, numbers, job.until_s, job.seed))
        self.spread_s += time.process_time() - began_s
        self.cells += sum(int(np.isfinite(window.after_s).sum()) for window in windows)
        start_s = job.burning.at_s if job.burning else 0.0
        (after_s,) = arrival_quantiles_s(windows, job.landscape.shape, (0.5,))
        arrival_s = start_s + after_s.astype(np.float64)
        return [
            (at_s, front_polygons(arrival_s, at_s, job.landscape).buffer(0.0))
            for at_s in front_times_s(start_s, scenario.duration_s, every_s)
        ]


def front_times_s(start_s: float, end_s: float, every_s: float) -> list[float]:
    """Return the times of the fronts of ``fire run --front-every``."""
    return [*np.arange(start_s + every_s, end_s - 1e-6, every_s).tolist(), end_s]


def combinations(processes: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the processes alone, together with each crown model, and all but each of them.

    Spotting is always with crown fire. Of two winds only the last one is among all processes.
    """
    crowns = [each for each in CROWNS if each in processes]
    winds = [each for each in processes if each in ("terrain_wind", "wind_grids")]
    singles = [(each,) for each in processes if each != "spotting"]
    others = [each for each in processes if each not in (*CROWNS, *winds[:-1])]
    found: list[tuple[str, ...]] = [(), *singles]
    if "spotting" in processes:
        found += [(crown, "spotting") for crown in crowns]
    found += [(crown, *others) for crown in crowns] or [tuple(others)]
    if crowns:
        found.append(tuple(each for each in others if each != "spotting"))
        found += [(crowns[0], *(each for each in others if each != out)) for out in others]
    return list(dict.fromkeys(found))


def grids_of(data: Path, into: Path) -> str:
    """Write ELMFIRE's hourly winds as pairs of files, and return the change that names them."""
    import rasterio

    pairs = []
    for name, kind in (("ws", "speed"), ("wd", "direction")):
        with rasterio.open(data / "weather" / f"{name}.tif") as file:
            bands, profile = file.read(), file.profile | {"count": 1}
        for hour, band in enumerate(bands[:13]):
            with rasterio.open(into / f"{kind}_{hour}.tif", "w", **profile) as file:
                file.write(band, 1)
    for hour in range(13):
        files = ", ".join(f'{kind} = "{into}/{kind}_{hour}.tif"' for kind in ("speed", "direction"))
        pairs.append(f"{{{files}, at_s = {3600.0 * hour}}}")
    return f'wind_grids={{unit = "mph", height = "20ft", pairs = [{", ".join(pairs)}]}}'


CASES = {
    "sandiego": Case(
        lambda folder, run: san_diego(folder, run, (("degrees", "unburnable"),)),
        ("scott_reinhardt", "cruz", "spotting", "acceleration", "terrain_wind"),
        {f"{30 * (number + 1)} min": slice(number, number + 1) for number in range(3)},
        lag=True,
    ),
    "tubbs": Case(
        tubbs,
        ("scott_reinhardt", "cruz", "spotting", "acceleration", "terrain_wind", "wind_grids"),
        {"6 h": slice(0, 1), "12 h": slice(1, 2)},
    ),
    "maria": Case(
        maria,
        ("scott_reinhardt", "cruz", "spotting", "terrain_wind"),
        {"mean of 19": slice(None), "first 4": slice(0, 4)},
    ),
    "maasmechelen": Case(
        lambda folder, run: belgian(folder / "Case4_Maasmechelen", run),
        ("acceleration", "terrain_wind"),
        {"first hour": slice(0, 1), "last hour": slice(-1, None)},
    ),
}


def agreement(found: BaseGeometry, row: Row) -> float:
    """Return kappa if the row has a landscape, else the intersection over union."""
    assert row.reference is not None
    if row.landscape is None:
        return overlap(found, row.reference)
    return kappa(found, row.reference, row.landscape)


def compared(name: str, folder: Path, chosen: Sequence[str], run: Timed) -> list[Row]:
    """Return the rows of a fire that have a reference."""
    case = CASES[name]
    rows = [row for row in case.rows(folder, run) if row.reference is not None]
    if case.lag:
        half = len(rows) // 2
        rows = rows[half:] if "acceleration" in chosen else rows[:half]
    return rows


def draw(path: Path, title: str, land: Landscape, shapes: Mapping[str, BaseGeometry]) -> None:
    """Draw outlines, with their names in a legend, on the map of a landscape."""
    from PIL import Image

    points = np.concatenate([shapely.get_coordinates(each) for each in shapes.values()])
    nothing = np.full(land.shape, np.inf)
    figure, axes = start_map(land, nothing, frame_around(land, nothing, points))
    figure.set_dpi(62)
    corner = np.array([land.west_m, land.south_m])
    styles = (("black", "-"), ("#1f5fd0", "-"), ("#c4162a", "-"), ("#8a2be2", "--"))
    for (name, area), (colour, style) in zip(shapes.items(), styles, strict=False):
        for number, line in enumerate(shapely.get_exterior_ring(shapely.get_parts(area))):
            km = (shapely.get_coordinates(line) - corner) / 1e3
            label = None if number else name
            axes.plot(*km.T, color=colour, linestyle=style, linewidth=2.0, label=label)
    axes.legend(loc="lower right", fontsize=11)
    set_title(axes, title, "outer outlines of the burned area")
    with BytesIO() as file:
        save_map(figure, file)
        Image.open(file).convert("RGB").quantize(192, Image.Quantize.FASTOCTREE).save(
            path, optimize=True
        )


def run_case(name: str, folder: Path, given: argparse.Namespace, grids: Path) -> None:
    """Print the table of one fire, and draw its picture."""
    case, pictures = CASES[name], {}
    changes = dict(CHANGES)
    if "wind_grids" in case.processes:
        changes["wind_grids"] = (grids_of(folder / "data", grids),)
    if case.lag:
        changes["acceleration"] = ()
    heads = "".join(f"{label:>12}" for label in case.picks)
    click.echo(f"\n{name:64}{'ha':>9}{heads}{'time, s':>9}{'ratio':>7}{'speed':>7}{'wind, s':>9}")
    surface: Timed | None = None
    only = [() if text == SURFACE else tuple(text.split(" + ")) for text in given.only]
    if unknown := {each for chosen in only for each in chosen} - set(case.processes):
        sys.exit(f"--only: {name} has no {', '.join(sorted(unknown))}")
    for chosen in only or combinations(case.processes):
        label = " + ".join(chosen) or SURFACE
        timed = Timed([text for each in chosen for text in changes[each]], given.members)
        rows = compared(name, folder, chosen, timed)
        if surface is None:
            surface = timed
            click.echo(f"{'persistence':73}{_means(rows, case, persistence=True)}")
        line = f"{label:64}{rows[-1].found.area / 1e4:9.1f}{_means(rows, case)}"
        ratio = timed.spread_s / surface.spread_s
        speed = timed.cells_per_s / surface.cells_per_s
        click.echo(f"{line}{timed.spread_s:9.2f}{ratio:7.2f}{speed:7.2f}{timed.weather_s:9.2f}")
        pictures[label] = rows
    if given.pictures and surface is not None and surface.landscape is not None:
        given.pictures.mkdir(parents=True, exist_ok=True)
        title, shapes = outlines(case, pictures)
        draw(given.pictures / f"{name}.png", f"{name}: {title}", surface.landscape, shapes)


def outlines(case: Case, rows: Mapping[str, Sequence[Row]]) -> tuple[str, dict[str, BaseGeometry]]:
    """Return the name and the areas of the comparison with the largest growth of the reference.

    ``rows`` are the comparisons of each combination of processes, by its label.
    """
    plain = rows[SURFACE]
    growth = [row.reference.area - row.start.area for row in plain if row.reference is not None]
    at = growth.index(max(growth))
    reference = plain[at].reference
    assert reference is not None
    found = {"reference": reference, SURFACE: plain[at].found}
    full = max(rows, key=lambda label: (label.count("+"), label != SURFACE))
    crowns = [each for each in CROWNS if each in case.processes]
    for crown in crowns or [""]:
        label = full.replace(crowns[0], crown) if crowns else full
        if label in rows:
            found[f"all processes, {crown}" if crown else "all processes"] = rows[label][at].found
    return plain[at].name, found


def _means(rows: Sequence[Row], case: Case, *, persistence: bool = False) -> str:
    scores = [agreement(row.start if persistence else row.found, row) for row in rows]
    return "".join(f"{np.mean(scores[pick]):12.3f}" for pick in case.picks.values())


def main() -> None:
    """Print a table for each fire."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("fires", nargs="+", metavar="FIRE=FOLDER")
    parser.add_argument("--members", type=int, help="median of an ensemble of this size")
    parser.add_argument("--only", action="append", default=[], metavar="LABEL")
    parser.add_argument("--pictures", type=Path, metavar="DIR")
    given = parser.parse_args()
    if given.pictures and given.only and SURFACE not in given.only:
        sys.exit(f"--pictures: add --only '{SURFACE}'")
    for text in given.fires:
        name, _, folder = text.partition("=")
        if name not in CASES or not folder:
            sys.exit(f"{text}: write FIRE=FOLDER, where FIRE is one of {', '.join(CASES)}")
        with tempfile.TemporaryDirectory() as grids:
            run_case(name, check_folder(Path(folder)).resolve(), given, Path(grids))


if __name__ == "__main__":
    main()
