"""Measure ``mission-service products``: time, sizes, equal bytes, and files without warnings.

    python -m benchmarks.products [JOURNAL]

Without a journal, the scenario ``default`` is simulated first (six hours, one aircraft).
"""

import sys
import tempfile
import time
import warnings
from datetime import UTC, datetime
from pathlib import Path

import click

from mission_service.config.scenario import load_scenario
from mission_service.products.journal_incident import incident_in
from mission_service.products.write import write_products
from mission_service.simulation.sim import simulate

LIMIT_S = 60.0
FORECAST_S = 3 * 3600.0
ZERO = datetime(2026, 8, 1, 18, tzinfo=UTC)


def made(journal: Path, out: Path) -> float:
    """Write the products to a folder; return the time in s."""
    begun_s, of_processor_s = time.perf_counter(), time.process_time()
    out.mkdir()
    incident = incident_in(journal, None, FORECAST_S, ZERO)
    read_s = time.perf_counter() - begun_s
    write_products(out, incident)
    took_s = time.perf_counter() - begun_s
    of_processor_s = time.process_time() - of_processor_s
    click.echo(
        f"journal and forecast {read_s:.1f} s, files {took_s - read_s:.1f} s; "
        f"{of_processor_s:.1f} s of processor time"
    )
    return took_s


def opened(path: Path) -> str:
    """Open a file with GDAL or OGR and return a description; a warning raises an exception."""
    import pyogrio
    import rasterio
    from pypdf import PdfReader

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        match path.suffix:
            case ".gpkg" | ".kmz" | ".zip":
                layers = [name for name, _ in pyogrio.list_layers(path)]
                found = [pyogrio.read_info(path, layer=name)["features"] for name in layers]
                return ", ".join(map("{} {}".format, found, layers))
            case ".tif" | ".png":
                with rasterio.open(path) as file:
                    file.read(1)
                    return f"{file.width} x {file.height}, {file.crs}"
            case ".pdf":
                page = PdfReader(path).pages[0]
                return f"georeferenced: {'/VP' in page}"
            case _:
                return ""


def main(arguments: list[str]) -> None:
    """Print the figures."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        journal = Path(arguments[0]) if arguments else here / "journal.jsonl"
        if not arguments:
            simulate(load_scenario("default"), journal, "today")
        times_s = [made(journal, here / name) for name in ("first", "second")]
        for path in sorted((here / "first").iterdir()):
            equal = path.read_bytes() == (here / "second" / path.name).read_bytes()
            same = "" if equal else "  DIFFERS in a second run"
            click.echo(f"{path.name:22} {path.stat().st_size / 1e3:8.0f} kB  {opened(path)}{same}")
        click.echo(f"{max(times_s):.1f} s (limit {LIMIT_S:g} s)")


if __name__ == "__main__":
    main(sys.argv[1:])
