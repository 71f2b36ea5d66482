"""Damaged files for the sensors of files: ``python -m benchmarks.sensor_fuzz [COUNT] [SEED]``.

Valid files of each kind (thermal images, GeoJSON, KML, KMZ, Shapefile, GeoPackage, GeoTIFF, CSV of
FIRMS) are damaged at random: flipped bits, changed numbers and names, removed, repeated and
exchanged parts, and truncation. Each file must give either observations that the journal and the
estimate accept, or one line with the reason; within limits of time and memory. The files are read
in processes with the limits of the service, ``BATCH`` files each; a process that crashes counts as
the reason for its file, as in the service. Thermal images are read as in the service's thread,
where a crash would end the service: one crash fails the run. At the end, files that are made to
exhaust memory or time are read in processes of their own.
"""

import gzip
import multiprocessing
import os
import random
import resource
import sys
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np

from benchmarks.observation_samples import VIIRS, viirs_line, write_samples
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.config.scenario import load_scenario
from mission_service.errors import MissionServiceError
from mission_service.events import FireObserved
from mission_service.fire.reported_observations import checked_report
from mission_service.fire.scenario_fire import landscape_of
from mission_service.sensors.files.file_contents import FileCells, FileReport, grid_of
from mission_service.sensors.files.observation_file import (
    FileJob,
    Unusable,
    Usable,
    answer_to,
    read_observation_file,
)
from mission_service.sensors.files.observation_folder import settings_of
from mission_service.sensors.thermal.camera_geometry import CameraPose
from mission_service.sensors.thermal.frame_cells import frame_cells
from mission_service.sensors.thermal.thermal_image import read_thermal_image
from mission_service.sensors.worker_process import MAX_MEMORY_BYTES
from mission_service.simulation.thermal_images import LENS, write_frame

AT = datetime(2026, 7, 4, 19, 37, 11, tzinfo=UTC)
BATCH = 500
MAX_FILE_S = 20.0  # processor time of one file
NUMBERS = (b"-1", b"0", b"1e999", b"NaN", b"99999999999999999999", b"", b'"', b"\xff", b"null")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return a file after one to four random changes."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        if len(found) < 4:
            break
        start = rng.randrange(len(found))
        stop = min(start + rng.choice((1, 2, 4, 16, 256)), len(found))
        match rng.randrange(7):
            case 0:
                found[start] ^= 1 << rng.randrange(8)
            case 1:
                found[start:stop] = rng.randbytes(stop - start)
            case 2:
                del found[start:stop]
            case 3:
                found[start:start] = found[start:stop] * rng.choice((1, 2, 50))
            case 4:
                del found[start:]
            case 5:
                found[start:stop] = rng.choice(NUMBERS)
            case _:
                found[start:stop] = rng.choice((b"\x00", b"\xff")) * (stop - start)
    return bytes(found)


def thermal_samples(folder: Path, land: Landscape) -> list[Path]:
    """Write thermal images of each kind of values."""
    pose = CameraPose(*land.xy_of(100.0, 100.0), 900.0, 0.0, -90.0)
    lens = LENS._replace(width=64, height=48, focal_px=40.0)
    levels = np.full((48, 64), 20, dtype=np.uint8)
    for name, values in (
        ("celsius.tif", np.full((48, 64), 25.0)),
        ("counts.tif", np.full((48, 64), 29_000, dtype=np.uint16)),
        ("levels.jpg", levels),
        ("levels.png", levels),
    ):
        write_frame(folder / name, land, pose, values, AT, lens)
    return sorted(folder.iterdir())


class Reader:
    """Reads damaged files, and checks what they contribute."""

    def __init__(self) -> None:
        """Prepare the landscape of the default scenario."""
        changes = ("estimate.thermal_frames.hot_level=200",)
        self.scenario = load_scenario("default", changes)
        self.land = landscape_of(self.scenario)
        self._grid, self._settings = grid_of(self.land), settings_of(self.scenario)

    def thermal(self, path: Path) -> str:
        """Read a thermal image; return "used" or "refused"."""
        try:
            frame_cells(read_thermal_image(path), self.land, self.scenario.estimate.thermal_frames)
        except (MissionServiceError, FireModelError) as error:
            return "refused" if path.name in str(error) else f"wrong: {error}"
        return "used"

    def observations(self, path: Path) -> str:
        """Read another file; return "used" or "refused"."""
        answer = answer_to(FileJob(str(path), self._grid, self._settings))
        answer = msgspec.json.decode(msgspec.json.encode(answer), type=Usable | Unusable)
        if isinstance(answer, Unusable):
            assert answer.reason.isprintable(), repr(answer.reason)
            assert path.name in answer.reason, answer.reason
            return "refused"
        assert answer.contents.observations
        for each in answer.contents.observations:
            self._check(each)
        return "used"

    def _check(self, each: FileReport | FileCells) -> None:
        if isinstance(each, FileCells):
            rows, cols = self.land.shape
            assert {len(row) for row in each.cells} == {len(each.cells[0])}
            assert 0 <= each.row <= rows - len(each.cells)
            assert 0 <= each.col <= cols - len(each.cells[0])
            return
        sent = FireObserved(
            0,
            *("", "", each.state, each.shape, each.points, 0),
            *(each.position_sd_m, each.false_alarms, each.source),
            islands=each.islands,
        )
        checked_report(msgspec.convert(msgspec.to_builtins(sent), FireObserved), self.land)


def read_batch(
    reader: Reader, samples: list[tuple[str, bytes]], thermal: bool, seed: int, sender: Any
) -> None:
    """Read ``BATCH`` damaged files in this process; send the name before and the result after."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries print warnings
    rng = random.Random(seed)
    read = reader.thermal if thermal else reader.observations
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = {file: data for file, data in samples if "." + file.partition(".")[2] in PARTS}
        mains = [(file, data) for file, data in samples if file not in parts]
        for _ in range(BATCH):
            file, data = rng.choice(mains)
            changed = {file: damaged(data, rng)}
            if file.endswith(".shp"):
                victim = rng.choice([file, *parts])
                changed = {file: data} | parts
                changed[victim] = damaged(changed[victim], rng)
            for inside, content in changed.items():
                (folder / inside).write_bytes(content)
            sender.send(("begins", file, 0.0))
            begun_s = time.process_time()
            try:
                outcome = read(folder / file)
            except Exception as error:  # the reader, or what it contributes, is wrong
                outcome = f"wrong: {type(error).__name__}: {error}"
            sender.send((outcome, file, time.process_time() - begun_s))
            for path in folder.iterdir():
                path.unlink()
    sender.send(("memory", "", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))


PARTS = (".shx", ".dbf", ".prj", ".cpg")


def outcomes(
    reader: Reader, samples: list[Path], thermal: bool, count: int, seed: int
) -> Iterator[Any]:
    """Yield (outcome, file, seconds) of ``count`` damaged files."""
    method, done = multiprocessing.get_context("fork"), 0
    data = [(path.name, path.read_bytes()) for path in samples]
    while done < count:
        receiver, sender = method.Pipe(duplex=False)
        child = method.Process(target=read_batch, args=(reader, data, thermal, seed, sender))
        child.start()
        sender.close()
        file, seed = "", seed + 1
        try:
            while True:
                if not receiver.poll(60.0):
                    child.kill()
                    yield "too slow", file, 60.0
                outcome, file, seconds = receiver.recv()
                if outcome == "begins":
                    done += 1
                else:
                    yield outcome, file, seconds
        except EOFError:
            child.join()
        if child.exitcode:
            yield f"ended with {child.exitcode}", file, 0.0


def bombs(folder: Path, land: Landscape) -> Iterator[tuple[str, Path]]:
    """Yield files that are made to exhaust memory or time, with their names."""
    with zipfile.ZipFile(folder / "bomb.kmz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", b"<kml>" + b" " * 600_000_000)
    yield "KMZ that unpacks to 600 MB", folder / "bomb.kmz"
    entities = "".join(f'<!ENTITY e{k + 1} "{f"&e{k};" * 10}">' for k in range(9))
    (folder / "entities.kml").write_text(
        f'<?xml version="1.0"?><!DOCTYPE kml [<!ENTITY e0 "lol">{entities}]><kml>&e9;</kml>'
    )
    yield "KML with nested entities", folder / "entities.kml"
    line = viirs_line(10.0, 10.0, AT)
    (folder / "large.csv").write_text(VIIRS + line * (60_000_000 // len(line)))
    yield "CSV of 60 MB", folder / "large.csv"
    (folder / "deep.geojson").write_text('{"type":"FeatureCollection","features":' + "[" * 10**6)
    yield "GeoJSON with a million brackets", folder / "deep.geojson"
    (folder / "gzip.geojson").write_bytes(gzip.compress(b"{" + b" " * 10**8))
    yield "compressed GeoJSON", folder / "gzip.geojson"
    with (folder / "huge.tif").open("wb") as file:
        file.truncate(4 * 1024**3)
    yield "file of 4 GB", folder / "huge.tif"


def run_bombs(reader: Reader) -> None:
    """Read the bombs as the service does, and print the time and the reason."""
    with tempfile.TemporaryDirectory() as name:
        for title, path in bombs(Path(name), reader.land):
            begun_s = time.monotonic()
            try:
                read_observation_file(path, reader.land, settings_of(reader.scenario))
                reason = "used"
            except MissionServiceError as error:
                reason = str(error).replace(name, "")
            click.echo(f"{title}: {time.monotonic() - begun_s:.1f} s: {reason[:140]}")
            path.unlink()


def main(count: int = 100_000, seed: int = 0) -> None:
    """Read ``count`` damaged files, a fifth of them thermal images."""
    reader = Reader()
    fails = 0
    kinds: tuple[tuple[bool, int, Callable[[Path], list[Path]]], ...] = (
        (True, count // 5, lambda folder: thermal_samples(folder, reader.land)),
        (False, count - count // 5, lambda folder: _all_files(folder, reader.land)),
    )
    for thermal, number, write in kinds:
        results: Counter[tuple[str, str]] = Counter()
        slowest, most_mib = (0.0, ""), 0.0
        with tempfile.TemporaryDirectory() as name:
            for outcome, file, value in outcomes(reader, write(Path(name)), thermal, number, seed):
                if outcome == "memory":
                    most_mib = max(most_mib, value)
                    continue
                results[file, outcome] += 1
                slowest = max(slowest, (value, file))
        for (file, outcome), times in sorted(results.items()):
            click.echo(f"{file}: {outcome}: {times}")
        click.echo(f"slowest: {slowest[0]:.2f} s ({slowest[1]}); memory {most_mib:.0f} MiB")
        ended = sum(times for (_, outcome), times in results.items() if "ended" in outcome)
        bad = ("too slow", "wrong")
        wrong = sum(times for (_, outcome), times in results.items() if outcome.startswith(bad))
        fails += wrong + (ended if thermal else 0) + (slowest[0] > MAX_FILE_S)
    run_bombs(reader)
    click.echo("failed" if fails else "passed")
    sys.exit(1 if fails else 0)


def _all_files(folder: Path, land: Landscape) -> list[Path]:
    write_samples(folder, land, AT)
    return sorted(folder.iterdir())


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
