"""Fire detections of satellites: files of FIRMS, footprints, and reports to a run."""

import json
import math
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import CliRunner
from pyproj import Geod

from mission_service.cli.main import main
from mission_service.config.scenario import load_scenario
from mission_service.errors import MissionServiceError
from mission_service.sensors.files.satellite_pixels import (
    footprints,
    read_satellite_pixels,
    reports_of,
)
from tests.api.worlds import World, world_in
from tests.service.test_journal_processes import arguments, running

VIIRS = (
    "latitude,longitude,bright_ti4,scan,track,acq_date,acq_time,satellite,instrument,confidence,"
    "version,bright_ti5,frp,daynight\n"
)
MODIS = (
    "latitude,longitude,brightness,scan,track,acq_date,acq_time,satellite,confidence,version,"
    "bright_t31,frp,daynight\n"
)
NOW = datetime(2026, 7, 4, 20, 0, tzinfo=UTC)


def viirs(lat: float, lon: float, seen: datetime, confidence: str = "n") -> str:
    """Return a line as in the files of FIRMS."""
    clock = f"{seen:%Y-%m-%d},{int(f'{seen:%H%M}')}"  # without leading zeros
    return f"{lat},{lon},340.1,0.39,0.36,{clock},N,VIIRS,{confidence},2.0NRT,295.2,5.1,D\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "pixels.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_lines_of_viirs_and_modis_are_read(tmp_path: Path) -> None:
    seen = datetime(2026, 7, 4, 0, 42, tzinfo=UTC)
    text = "".join((VIIRS, *(viirs(36.36, -84.14, seen, each) for each in ("l", "nominal", "h"))))
    found = read_satellite_pixels(written(tmp_path, text)).pixels
    assert [each.false_alarms_pct for each in found] == [50.0, 10.0, 0.0]
    assert {each.seen for each in found} == {seen}
    assert (found[0].scan_km, found[0].track_km, found[0].source) == (0.39, 0.36, "VIIRS N")
    assert found[0].position_sd_m == pytest.approx(375.3 / math.sqrt(12.0), rel=0.001)
    line = "36.36,-84.14,320.0,1.2,1.1,2026-07-04,1830,Terra,72,6.1NRT,290.0,12.0,D\n"
    (modis,) = read_satellite_pixels(written(tmp_path, MODIS + line)).pixels
    assert (modis.false_alarms_pct, modis.source) == (28.0, "Terra")


def test_footprints_have_the_stated_size(tmp_path: Path) -> None:
    text = VIIRS + viirs(36.36, -84.14, NOW) + viirs(61.0, 25.0, NOW)
    pixels = read_satellite_pixels(written(tmp_path, text)).pixels
    shapes = footprints(pixels)["features"]
    assert len(shapes) == 2
    geod = Geod(ellps="WGS84")
    for each in shapes:
        ((south_west, south_east, north_east, _, _),) = each["geometry"]["coordinates"]
        assert geod.inv(*south_west, *south_east)[2] == pytest.approx(390.0, rel=0.005)
        assert geod.inv(*south_east, *north_east)[2] == pytest.approx(360.0, rel=0.005)


# The first lines of NASA's file VNP14IMGTDL_NRT for 22 January 2020.
TEN_POINTS = """\
latitude,longitude,bright_ti4,scan,track,acq_date,acq_time,satellite,confidence,version,bright_ti5,frp,daynight
65.76917,24.18936,338.9,0.43,0.38,2020-01-22,0036,N,nominal,1.0NRT,272,6,N
65.76575,24.18696,312.4,0.43,0.38,2020-01-22,0036,N,nominal,1.0NRT,269.3,6,N
65.76232,24.18457,329.4,0.43,0.38,2020-01-22,0036,N,nominal,1.0NRT,270.5,5.8,N
65.56535,22.21959,307.7,0.47,0.4,2020-01-22,0042,N,nominal,1.0NRT,269.2,2.3,N
65.55402,22.25519,330,0.47,0.39,2020-01-22,0042,N,nominal,1.0NRT,269.9,5.5,N
56.40143,41.33034,295.7,0.37,0.58,2020-01-22,0042,N,nominal,1.0NRT,270.3,0.6,N
59.2752,27.88592,301.7,0.4,0.37,2020-01-22,0042,N,nominal,1.0NRT,271.6,0.8,N
60.80533,1.44585,314.4,0.58,0.7,2020-01-22,0042,N,nominal,1.0NRT,275.7,2.6,N
60.13363,15.42122,303.5,0.39,0.44,2020-01-22,0042,N,nominal,1.0NRT,271.2,0.8,N
58.35916,12.37974,298.2,0.47,0.48,2020-01-22,0042,N,nominal,1.0NRT,274.1,0.6,N
"""


def test_ten_points_of_a_public_file_have_footprints_of_the_documented_size(
    tmp_path: Path,
) -> None:
    """Scan and track are the size of the pixel in km; VIIRS has 0.375 km below the satellite."""
    pixels = read_satellite_pixels(written(tmp_path, TEN_POINTS)).pixels
    lines = [line.split(",") for line in TEN_POINTS.splitlines()[1:]]
    geod = Geod(ellps="WGS84")
    for line, pixel, shape in zip(lines, pixels, footprints(pixels)["features"], strict=True):
        ((south_west, south_east, north_east, north_west, _),) = shape["geometry"]["coordinates"]
        across_m = geod.inv(*south_west, *south_east)[2]
        along_m = geod.inv(*south_east, *north_east)[2]
        assert across_m == pytest.approx(1000.0 * float(line[3]), rel=0.01)
        assert along_m == pytest.approx(1000.0 * float(line[4]), rel=0.01)
        assert 360.0 < across_m < 800.0
        middle = np.mean([south_west, north_east, south_east, north_west], axis=0)
        assert middle == pytest.approx([float(line[1]), float(line[0])], abs=1e-6)
        assert (pixel.seen, pixel.false_alarms_pct) == (
            datetime(2020, 1, 22, 0, int(line[6]), tzinfo=UTC),
            10.0,
        )


GOES = "latitude,longitude,acq_date,acq_time,satellite,confidence,frp\n"


def test_pixels_of_goes_are_cells_of_its_fixed_grid(tmp_path: Path) -> None:
    text = "".join(
        (
            GOES,
            "0.0,-75.2,2026-07-04,1830,GOES-19,10,90\n",
            "36.36,-84.14,2026-07-04,1830,G16,30,90\n",
            "40.0,-120.0,2026-07-04,1830,G18,nominal,90\n",
        )
    )
    below, tennessee, california = read_satellite_pixels(written(tmp_path, text)).pixels
    assert (below.scan_km, below.track_km) == pytest.approx((2.004, 2.004), abs=0.02)
    assert 2.0 < tennessee.scan_km < 2.5 < tennessee.track_km < 3.5
    assert california.track_km > tennessee.track_km
    assert {each.false_alarms_pct for each in (below, tennessee, california)} == {10.0}
    (shape,) = footprints([tennessee])["features"]
    (ring,) = shape["geometry"]["coordinates"]
    assert shapely.Polygon(ring).contains(shapely.Point(-84.14, 36.36))
    for line, words in (
        ("0.0,100.0,2026-07-04,1830,G16,10,9\n", "outside the satellite's field of view"),
        ("36.36,-84.14,2026-07-04,1830,G16,99,9\n", "the confidence is 99"),
        ("36.36,-84.14,2026-07-04,1830,X1,h,9\n", "has no scan"),
    ):
        with pytest.raises(MissionServiceError, match=words):
            read_satellite_pixels(written(tmp_path, GOES + line))


def test_of_lines_elsewhere_only_the_place_is_read(tmp_path: Path) -> None:
    odd = viirs(10.0, 10.0, NOW).replace("VIIRS,n", "VIIRS,?")
    path = written(tmp_path, VIIRS + odd + viirs(36.36, -84.14, NOW))
    found = read_satellite_pixels(path, (36.0, -85.0, 37.0, -84.0))
    assert (len(found.pixels), found.lines) == (1, 2)
    with pytest.raises(MissionServiceError, match="line 2"):
        read_satellite_pixels(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "has no column latitude"),
        (VIIRS + "36,x,340,0.4,0.4,2026-07-04,1200,N,VIIRS,n,2,295,5,D\n", "line 2: could not"),
        (VIIRS + "36,-84,340,0.4,0.4,2026-07-04,2561,N,VIIRS,n,2,295,5,D\n", "line 2: unconverted"),
        (VIIRS + "36,-84,340,400,0.4,2026-07-04,1200,N,VIIRS,n,2,295,5,D\n", "400 x 0.4 km"),
        (
            VIIRS + "96,-84,340,0.4,0.4,2026-07-04,1200,N,VIIRS,n,2,295,5,D\n",
            "the position is 96.0",
        ),
        (VIIRS + "36,-84,340,0.4,0.4,2026-07-04,1200,N,VIIRS,z,2,295,5,D\n", "line 2: could not"),
        (VIIRS + "36,-84\n", "line 2"),
        ("\x00\x00", "has no column"),
        (VIIRS.replace(",", ";"), "use a CSV file of FIRMS"),
        (VIIRS + '36,"' + "x\n" * 9999, "line 10000: could not convert"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_its_line(
    text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(MissionServiceError, match=re.escape(words)) as raised:
        read_satellite_pixels(written(tmp_path, text))
    assert "pixels.csv" in str(raised.value)
    with pytest.raises(MissionServiceError, match="No such file"):
        read_satellite_pixels(tmp_path / "missing.csv")


def test_blank_lines_are_skipped_and_sources_are_one_printed_line(tmp_path: Path) -> None:
    line = viirs(36.36, -84.14, NOW).replace("VIIRS", '"VI\n\x1b[2JIRS' + "S" * 99 + '"')
    (found,) = read_satellite_pixels(
        written(tmp_path, VIIRS + "\n  \n" + "," * 13 + "\n" + line)
    ).pixels
    assert found.source.isprintable()
    assert len(found.source) == 80


def test_many_pixels_of_one_overpass_are_several_requests(tmp_path: Path) -> None:
    path = written(tmp_path, VIIRS + viirs(36.36, -84.14, NOW) * 2500)
    reports = reports_of(read_satellite_pixels(path).pixels, NOW)
    assert [len(each["points"]) for each in reports] == [1000, 1000, 500]


def test_an_overpass_in_the_future_is_refused(tmp_path: Path) -> None:
    pixels = read_satellite_pixels(written(tmp_path, VIIRS + viirs(36.36, -84.14, NOW))).pixels
    assert reports_of(pixels, NOW - timedelta(minutes=4))[0]["age_s"] == 0.0
    with pytest.raises(MissionServiceError, match=r"in the future .*must be UTC"):
        reports_of(pixels, NOW - timedelta(hours=5))


def test_a_device_is_no_file() -> None:
    with pytest.raises(MissionServiceError, match="/dev/zero: is not a file"):
        read_satellite_pixels(Path("/dev/zero"))


@pytest.fixture
def world(tmp_path: Path) -> World:
    """Return a run without cameras, 25 minutes after ignition."""
    changes = ("start_s=1490", "deploy_at_s=1490", "planner.rule=circling")
    scenario = load_scenario("default", changes)
    scenario = scenario.model_copy(update={"simulation": type(scenario.simulation)()})
    found = world_in(tmp_path, scenario)
    found.fly(1500.0)
    return found


def reported(world: World, row: float, col: float, confidence: str, tmp_path: Path) -> None:
    land = world.context.landscape
    lat, lon = (float(each) for each in land.lat_lon_of(*land.xy_of(row, col)))
    path = written(tmp_path, VIIRS + viirs(lat, lon, NOW - timedelta(minutes=10), confidence))
    for each in reports_of(read_satellite_pixels(path).pixels, NOW):
        reply = world.context.request_handler.ask({"by": "ann", "station": "desk", **each})
        assert reply["ok"], reply


def burned(world: World) -> np.ndarray:
    world.simulation.estimate.advance(world.simulation.clock.now_us)
    return world.simulation.estimate.fire.burned().copy()


def test_pixels_move_the_front_by_no_more_than_their_error_allows(
    world: World, tmp_path: Path
) -> None:
    before = burned(world)
    rows, cols = np.nonzero(before)
    for row, col in ((rows.mean(), cols.mean()), (rows.min() - 4.0, cols.mean())):
        reported(world, float(row), float(col), "h", tmp_path)  # 120 m from the front
        assert np.array_equal(burned(world), before)
    reported(world, rows.min() - 40.0, cols.mean(), "n", tmp_path)
    assert np.array_equal(burned(world), before), "a nominal pixel far away needs a second report"
    reported(world, rows.min() - 40.0, cols.mean(), "h", tmp_path)
    spot = burned(world) & ~before
    assert spot.any()
    assert np.nonzero(spot)[0].max() < rows.min() - 30


def test_the_command_reports_the_pixels_of_a_file_to_a_run(tmp_path: Path) -> None:
    out = tmp_path / "out"
    now = datetime.now(UTC)
    fresh, old = now - timedelta(minutes=30), now - timedelta(hours=9)
    lines = (
        viirs(36.375, -84.14, fresh, "h"),
        viirs(36.375, -84.14, old),
        viirs(10.0, 20.0, fresh),
    )
    path = written(tmp_path, "".join((VIIRS, *lines)))
    shapes = tmp_path / "footprints.geojson"
    with running(arguments(out), out):
        command = ["request", "satellite-pixels", str(path), "--out", str(out), "--json"]
        done = CliRunner().invoke(main, [*command, "--footprints", str(shapes)])
    assert done.exit_code == 1, done.output
    found = json.loads(done.stdout)
    assert (found["pixels"], found["on_landscape"]) == (3, 2)
    first, second = found["reports"]
    assert "age_s: must be a number from 0 to 21600" in first["error"]
    assert second == {"source": "VIIRS N", "pixels": 1}
    assert len(json.loads(shapes.read_text())["features"]) == 2
    missing = CliRunner().invoke(main, ["request", "satellite-pixels", str(path), "--out", "none"])
    assert missing.exit_code == 1
    assert "no run uses this folder" in missing.output
