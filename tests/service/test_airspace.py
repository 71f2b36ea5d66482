"""Closed airspace: volumes, files, ways around, and vehicles that keep out of it."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import shapely
from click.testing import CliRunner

from firemodel.landscape.landscape import Landscape
from mission_service.airspace.clearance import Airspace, Margins
from mission_service.airspace.occupied_space import (
    LOITER_RADIUS_FACTOR,
    MissionPlace,
    Part,
    corner_parts,
    disc,
    held_turn,
    path_parts,
    turn_area,
    turns_towards,
)
from mission_service.airspace.routes import Detours, exits_from
from mission_service.airspace.volume_files import volumes_in
from mission_service.airspace.volumes import OUTSIDE, Volume, ground_range_m, volumes_of
from mission_service.cli.main import main
from mission_service.commands import (
    AnyCommand,
    Hold,
    RaiseAlarm,
    Return,
    StartMission,
    UploadMission,
)
from mission_service.config.airspace_section import AirspaceSection
from mission_service.config.scenario import load_scenario
from mission_service.core.core import Core
from mission_service.core.flight_space import FlightSpace
from mission_service.errors import ScenarioError
from mission_service.events import (
    AirspaceClosed,
    AirspaceOpened,
    AnyEvent,
    LinkLost,
    MissionAccepted,
    ModeChanged,
    OrderGiven,
    Telemetry,
    VehicleConnected,
)
from mission_service.fire.scenario_fire import landscape_of
from mission_service.missions.mission_hash import mission_hash
from mission_service.vehicles.airspace_state import AirspaceState
from tests.service.people_flights import ANN, Fly, flights_in

FIRE = (36.364232, -84.140907)
HAWK_HOME = (36.370784, -84.132309)


@pytest.fixture(scope="module")
def land() -> Landscape:
    return landscape_of(load_scenario("demo"))


@pytest.fixture
def fly(tmp_path: Path) -> Iterator[Fly]:
    yield from flights_in(tmp_path)


def square(centre: tuple[float, float], half_m: float) -> tuple[tuple[float, float], ...]:
    lat = half_m / 111_200.0
    lon = lat / math.cos(math.radians(centre[0]))
    signs = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    return tuple((centre[0] + a * lat, centre[1] + b * lon) for a, b in signs)


# Volumes ------------------------------------------------------------------------------------------


def test_a_volume_above_the_ground_covers_the_highest_ground(land: Landscape) -> None:
    entry = {"name": "x", "corners": square(FIRE, 900.0), "floor_agl_m": 50, "ceiling_agl_m": 200}
    (volume,) = volumes_of(AirspaceSection.model_validate({"closed": [entry]}), land)
    x_m, y_m = land.xy_of_lat_lon(*FIRE)
    places = [
        (x_m + east, y_m + north)
        for east in np.linspace(-850, 850, 30)
        for north in np.linspace(-850, 850, 30)
    ]
    ground = [float(land.elevation_at(*place)) for place in places]
    assert volume.floor_m <= min(ground) + 50.0
    assert volume.ceiling_m >= max(ground) + 200.0
    assert max(ground) - min(ground) > 50.0  # the ground is not flat


def test_the_ground_in_an_area_is_that_of_the_interpolated_surface(land: Landscape) -> None:
    x_m, y_m = land.xy_of_lat_lon(*FIRE)
    area = shapely.Point(x_m, y_m).buffer(150.0)
    east_m, north_m = np.meshgrid(np.linspace(-150.0, 150.0, 301), np.linspace(-150.0, 150.0, 301))
    inside = np.hypot(east_m, north_m) < 149.0
    ground_m = land.elevation_at(x_m + east_m[inside], y_m + north_m[inside])
    lowest_m, highest_m = ground_range_m(area, land)
    assert lowest_m <= ground_m.min() + 0.1
    assert lowest_m == pytest.approx(ground_m.min(), abs=1.0)
    assert highest_m >= ground_m.max() - 0.1
    assert highest_m == pytest.approx(ground_m.max(), abs=1.0)


@pytest.mark.parametrize(("east", "north"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_volume_off_the_grid_is_measured_from_the_ground_at_the_edge(
    land: Landscape, east: int, north: int
) -> None:
    x_m, y_m = land.xy_of_lat_lon(*FIRE)
    size_m = 2.0 * max(land.shape) * land.cell_size_m
    area = shapely.Point(x_m + east * size_m, y_m + north * size_m).buffer(100.0)
    lowest_m, highest_m = ground_range_m(area, land)
    assert land.elevation_m is not None
    assert land.elevation_m.min() <= lowest_m <= highest_m <= land.elevation_m.max()


def test_a_volume_with_a_spike_in_its_outline_has_limits_above_ground(land: Landscape) -> None:
    lat_deg, lon_deg = FIRE
    corners = [*square(FIRE, 900.0)[:2], (lat_deg + 0.02, lon_deg), *square(FIRE, 900.0)[1:]]
    entry = {"name": "x", "corners": corners, "floor_agl_m": 50}
    (volume,) = volumes_of(AirspaceSection.model_validate({"closed": [entry]}), land)
    assert math.isfinite(volume.floor_m)


def test_a_circle_is_not_smaller_than_its_radius(land: Landscape) -> None:
    entry = {"name": "x", "lat_deg": FIRE[0], "lon_deg": FIRE[1], "radius_m": 400.0}
    (volume,) = volumes_of(AirspaceSection.model_validate({"closed": [entry]}), land)
    centre = land.xy_of_lat_lon(*FIRE)
    for turn in np.linspace(0.0, math.tau, 100):
        place = (centre[0] + 399.9 * math.cos(turn), centre[1] + 399.9 * math.sin(turn))
        assert volume.contains(*place, 500.0)
    assert volume.area_m.area < 1.02 * math.pi * 400.0**2


def test_outside_the_allowed_areas_is_closed(land: Landscape) -> None:
    entry = {"name": "x", "corners": square(FIRE, 500.0)}
    (volume,) = volumes_of(AirspaceSection.model_validate({"allowed": [entry]}), land)
    x_m, y_m = land.xy_of_lat_lon(*FIRE)
    assert volume.name == OUTSIDE
    assert not volume.contains(x_m + 450.0, y_m, 400.0)
    assert volume.contains(x_m + 550.0, y_m, 400.0)
    assert volume.contains(x_m + 20_000.0, y_m, 4000.0)


@pytest.mark.parametrize(
    ("entry", "problem"),
    [
        ({"name": "x"}, "specify either `corners`, or lat_deg, lon_deg and radius_m"),
        ({"name": "x", "lat_deg": 36.0}, "specify either `corners`"),
        (
            {"name": "x", "corners": square(FIRE, 5.0), "floor_amsl_m": 9, "ceiling_amsl_m": 8},
            "ceiling_amsl_m must be above floor_amsl_m",
        ),
        (
            {"name": "x", "corners": square(FIRE, 5.0), "from_s": 9, "until_s": 8},
            "until_s must be later than from_s",
        ),
        (
            {"name": "x", "corners": square(FIRE, 5.0), "floor_amsl_m": 9, "floor_agl_m": 8},
            "specify only one of floor_amsl_m and floor_agl_m",
        ),
    ],
)
def test_impossible_volumes_are_refused_in_one_line(entry: dict[str, object], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        AirspaceSection.model_validate({"closed": [entry]})


def test_a_vehicle_above_the_limit_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"hawk: altitude_agl_m = 150 is above airspace\.max"):
        load_scenario("demo", ("airspace.max_altitude_agl_m=120",))


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ('files=["FOLDER/broken.kml"]', "is not GeoJSON, KML, KMZ or a zipped Shapefile"),
        (
            'closed=[{name="x", lat_deg=36.364, lon_deg=-84.141, radius_m=50, floor_agl_m=200,'
            " ceiling_amsl_m=100}]",
            "its ceiling (100 m above mean sea level) is not above its floor",
        ),
        (
            'allowed=[{name="x", lat_deg=-84.141, lon_deg=36.364, radius_m=5000}]',  # exchanged
            "the home of hawk is outside the allowed areas",
        ),
        ('closed=[{name="x", lat_deg=36.0, lon_deg=-84.1, radius_m=1e12}]', "radius_m"),
        ("margin_m=1e9", "margin_m"),
    ],
)
def test_config_check_reports_volumes_that_cannot_be_used(
    tmp_path: Path, change: str, problem: str
) -> None:
    (tmp_path / "broken.kml").write_bytes(bytes(range(200, 256)))
    override = f"airspace.{change}".replace("FOLDER", str(tmp_path))
    result = CliRunner().invoke(main, ["config", "check", "demo", "--set", override])
    output = f"{result.output}{result.exception}"
    assert result.exit_code != 0
    assert problem in output, output


OPENAIR = """AC R
AN Test range
AL 500 ft AGL
AH FL 65
V X=36:21:51 N 084:08:27 W
DC 1

AC D
AN Arc
AL SFC
AH 2500 ft AMSL
DP 36:21:00 N 084:08:00 W
V D=-
V X=36:21:51 N 084:08:27 W
DA 2,90,0
"""


def test_openair_is_read_with_circles_arcs_and_limits(tmp_path: Path, land: Landscape) -> None:
    path = tmp_path / "volumes.txt"
    path.write_text(OPENAIR)
    circle, arc = volumes_in(path)
    assert circle.name == "Test range (R)"
    assert circle.floor_agl_m == pytest.approx(152.4)
    assert circle.ceiling_amsl_m == pytest.approx(1981.2)
    assert (arc.floor_amsl_m, arc.floor_agl_m, arc.ceiling_amsl_m) == (None, None, 762.0)
    section = AirspaceSection(files=(path,))
    volume = volumes_of(section, land)[0]
    assert volume.area_m.area == pytest.approx(math.pi * 1852.0**2, rel=0.02)
    # Anticlockwise from east to north: three corners of the arc, and none in between to the south.
    assert arc.corners is not None
    assert min(lat for lat, _ in arc.corners[1:]) == pytest.approx(36.36417, abs=1e-3)
    assert max(lat for lat, _ in arc.corners) == pytest.approx(
        36.36417 + 2 * 1852 / 111_200, abs=1e-3
    )


def test_geojson_and_kml_are_read(tmp_path: Path) -> None:
    ring = [[lon, lat] for lat, lon in (*square(FIRE, 300.0), square(FIRE, 300.0)[0])]
    geojson = tmp_path / "a.geojson"
    geojson.write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": '
        '{"name": "TFR", "ceiling_amsl_m": 900, "until_s": 5000}, "geometry": '
        f'{{"type": "Polygon", "coordinates": [{ring}]}}}}]}}'
    )
    (volume,) = volumes_in(geojson)
    assert (volume.name, volume.ceiling_amsl_m, volume.until_s) == ("TFR", 900.0, 5000.0)
    kml = tmp_path / "a.kml"
    places = " ".join(f"{lon},{lat},0" for lon, lat in ring)
    kml.write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>town</name><Polygon>'
        f"<outerBoundaryIs><LinearRing><coordinates>{places}</coordinates></LinearRing>"
        "</outerBoundaryIs></Polygon></Placemark></kml>"
    )
    (volume,) = volumes_in(kml)
    assert (volume.name, volume.floor_amsl_m, volume.ceiling_amsl_m) == ("town", None, None)


@pytest.mark.parametrize(
    "content",
    ["AC R\nAN x\nAL nonsense\nAH 500 ft\nDP 1:2:3 N 4:5:6 E\n", "AC R\nDP 1:2\n", "rubbish", ""],
)
def test_files_that_cannot_be_read_are_refused_in_one_line(tmp_path: Path, content: str) -> None:
    path = tmp_path / "volumes.txt"
    path.write_text(content)
    with pytest.raises(ScenarioError) as caught:
        volumes_in(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


# Space and ways -----------------------------------------------------------------------------------

BLOCK = Volume("block", shapely.box(100.0, -100.0, 300.0, 100.0), 200.0, 400.0)


@pytest.mark.parametrize(
    ("parts", "clear"),
    [
        (path_parts([(0.0, 0.0, 300.0), (500.0, 0.0, 300.0)]), False),
        (path_parts([(0.0, 0.0, 420.0), (500.0, 0.0, 430.0)]), True),
        (path_parts([(0.0, 0.0, 410.0), (500.0, 0.0, 430.0)]), False),  # within the vertical margin
        (path_parts([(0.0, 0.0, 500.0), (500.0, 0.0, 100.0)]), False),  # altitudes between the ends
        (path_parts([(0.0, 155.0, 300.0), (500.0, 155.0, 300.0)]), True),
        (path_parts([(0.0, 145.0, 300.0), (500.0, 145.0, 300.0)]), False),  # within the margin
        ([disc(0.0, 0.0, 40.0, 300.0, 300.0)], True),
        ([disc(0.0, 0.0, 60.0, 300.0, 300.0)], False),
    ],
)
def test_a_part_of_a_flight_is_clear_or_not(
    parts: list[Part], clear: bool, land: Landscape
) -> None:
    airspace = Airspace((BLOCK,), Margins(50.0, 15.0))
    assert (airspace.conflict(parts, land) is None) == clear


def test_a_flight_that_begins_in_the_margin_may_leave_it(land: Landscape) -> None:
    airspace = Airspace((BLOCK,), Margins(50.0, 15.0))
    start = (90.0, 0.0, 300.0)
    away = path_parts([start, (-200.0, 0.0, 300.0)])
    towards = path_parts([start, (99.5, 0.0, 300.0)])
    assert airspace.conflict(away, land) is not None
    assert airspace.conflict(away, land, start) is None
    assert airspace.conflict(towards, land, start) is not None


def test_a_turn_may_begin_earlier_or_be_tighter(land: Landscape) -> None:
    airspace = Airspace((BLOCK,), Margins(20.0, 15.0))
    around = [(-50.0, -130.0), (350.0, -130.0), (350.0, 300.0)]
    positions = [(*place, 300.0) for place in around]
    assert airspace.conflict(path_parts(positions), land) is None
    assert airspace.conflict([turn_area(positions)], land) is not None


def test_the_altitude_limit_does_not_apply_beside_the_expected_path(land: Landscape) -> None:
    x_m, y_m = land.xy_of_lat_lon(*FIRE)
    high_m = float(land.elevation_at(x_m, y_m)) + 500.0
    positions = [(x_m + east, y_m + north, high_m) for east, north in ((0, 0), (90, 0), (90, 400))]
    airspace = Airspace((), Margins(0.0, 0.0), max_altitude_agl_m=120.0)
    assert airspace.conflict(path_parts(positions), land) is not None
    assert airspace.conflict([turn_area(positions)], land) is None


def test_the_altitude_limit_counts_from_the_lowest_ground_below(land: Landscape) -> None:
    x_m, y_m = land.xy_of_lat_lon(*FIRE)
    airspace = Airspace((), Margins(0.0, 0.0), max_altitude_agl_m=120.0)
    along = np.linspace(0.0, 600.0, 60)
    lowest_m = min(float(land.elevation_at(x_m + east, y_m)) for east in along)
    for above_m, clear in ((118.0, True), (123.0, False)):
        altitude_m = lowest_m + above_m
        parts = path_parts([(x_m, y_m, altitude_m), (x_m + 600.0, y_m, altitude_m)])
        assert (airspace.conflict(parts, land) is None) == clear


def test_a_way_around_is_short_and_keeps_out() -> None:
    blocked = shapely.box(100.0, -100.0, 300.0, 100.0)
    path = np.array([(0.0, 0.0), (150.0, 0.0), (250.0, 10.0), (400.0, 0.0)])
    around = Detours(blocked).around(path)
    assert around is not None
    line = shapely.LineString(around)
    assert not line.crosses(blocked)
    assert line.length < 2.0 * math.hypot(100.0, 102.0) + 204.0
    assert tuple(around[0]) == (0.0, 0.0)
    assert tuple(around[-1]) == (400.0, 0.0)


def test_a_path_that_ends_inside_ends_before_the_volume() -> None:
    blocked = shapely.box(100.0, -100.0, 300.0, 100.0)
    around = Detours(blocked).around(np.array([(0.0, 0.0), (50.0, 0.0), (200.0, 0.0)]))
    assert around is not None
    assert 98.0 <= around[-1][0] < 100.0


def test_a_path_without_a_way_is_none() -> None:
    ring = shapely.Point(0.0, 0.0).buffer(500.0) - shapely.Point(0.0, 0.0).buffer(300.0)
    path = np.array([(0.0, 0.0), (1000.0, 0.0)])
    assert Detours(ring).around(path) is None


def test_exits_are_outside_and_sorted() -> None:
    blocked = shapely.box(-100.0, -300.0, 500.0, 300.0)
    exits = exits_from((0.0, 0.0), blocked, 50.0)
    assert exits[0][0] == pytest.approx(-151.0, abs=3.0)
    distances = [math.hypot(*place) for place in exits]
    assert distances == pytest.approx(sorted(distances))
    assert all(blocked.distance(shapely.Point(place)) >= 50.0 for place in exits)


@pytest.mark.parametrize("bearing", [0.3, 1.5, 2.8, -0.3, -1.5, -3.0])
def test_a_turn_ends_on_the_course_to_the_target(bearing: float) -> None:
    target = (2000.0 * math.sin(bearing), 2000.0 * math.cos(bearing))
    turns = turns_towards((0.0, 0.0), (0.0, 15.0), target, 80.0)
    assert len(turns) == (2 if abs(bearing) > math.radians(120.0) else 1)
    for points in turns:
        before, last = ((0.0, -10.0), *points)[-2:]
        course = math.atan2(last[0] - before[0], last[1] - before[1])
        wanted = math.atan2(target[0] - last[0], target[1] - last[1])
        off = (course - wanted + math.pi) % math.tau - math.pi
        assert abs(off) < math.radians(25.0)
        assert max(math.hypot(x, y) for x, y in points) <= 161.0


# Flights ------------------------------------------------------------------------------------------


def closed_at(now_us: int, centre: tuple[float, float], half_m: float = 250.0) -> AirspaceClosed:
    return AirspaceClosed(now_us, *ANN, "copter", square(centre, half_m))


def position(entries: list[AnyEvent | AnyCommand]) -> Telemetry:
    return next(entry for entry in reversed(entries) if isinstance(entry, Telemetry))


def inside_s(
    entries: list[AnyEvent | AnyCommand], centre: tuple[float, float], half_m: float
) -> float:
    """Return the seconds that hawk has been over a square after its closing."""
    corners = np.array(square(centre, half_m))
    low, high = corners.min(axis=0), corners.max(axis=0)
    closed_us = next(entry.at_us for entry in entries if isinstance(entry, AirspaceClosed))
    over = [
        entry
        for entry in entries
        if isinstance(entry, Telemetry)
        and entry.at_us > closed_us
        and low[0] < entry.lat_deg < high[0]
        and low[1] < entry.lon_deg < high[1]
    ]
    return len(over) / 4.0


def here(flight: object) -> tuple[float, float]:
    fix = flight.state_view.telemetry["hawk"]  # type: ignore[attr-defined]
    return fix.lat_deg, fix.lon_deg


@pytest.mark.parametrize("turn_deg", [60.0, -60.0, 180.0])
def test_a_plane_needs_space_beside_a_sharp_corner(turn_deg: float) -> None:
    """The path leads north, and at the origin turns by an angle."""
    turn_rad = math.radians(turn_deg)
    after = (900.0 * math.sin(turn_rad), 900.0 * math.cos(turn_rad), 150.0)
    path = [(0.0, -500.0, 100.0), (0.0, 0.0, 120.0), after]
    parts = corner_parts(path, 80.0)
    assert len(parts) == (2 if turn_deg == 180.0 else 1)
    ahead = shapely.box(-200.0, 15.0, 200.0, 400.0) if turn_deg == 180.0 else None
    for part in parts:
        assert (part.lowest_m, part.highest_m) == (120.0, 150.0)
        assert part.shape.distance(shapely.Point(0.0, 0.0)) == 0.0
        assert part.shape.distance(shapely.Point(after[:2])) == 0.0
        assert ahead is None or part.shape.intersects(ahead), "no overshoot"
    assert corner_parts(path, 0.0) == []
    assert corner_parts([path[0], path[1], (10.0, 900.0, 120.0)], 80.0) == []  # almost straight


@pytest.mark.parametrize(("kind", "circles"), [("plane", True), ("copter", False)])
def test_the_return_of_a_plane_ends_in_a_circle_above_home(kind: str, circles: bool) -> None:
    scenario = load_scenario("demo", (f'vehicles.0.kind="{kind}"',))
    core = Core(scenario, landscape_of(scenario))
    vehicle = core.vehicles["hawk"]
    core.handle(VehicleConnected(0, "hawk", kind, True))
    lat_deg, lon_deg = core.landscape.lat_lon_of(vehicle.home_m[0] + 800.0, vehicle.home_m[1])
    core.handle(Telemetry(1, "hawk", float(lat_deg), float(lon_deg), 500.0, 150.0, 0.0, -15.0, 0.0))
    fix = vehicle.availability.fix
    assert fix is not None
    parts = FlightSpace(core.landscape).of_return(vehicle, fix, AirspaceState())
    reach_m = LOITER_RADIUS_FACTOR * vehicle.section.loiter_radius_m
    beyond_home = shapely.Point(vehicle.home_m[0] - 0.9 * reach_m, vehicle.home_m[1])
    assert any(part.shape.intersects(beyond_home) for part in parts) == circles


def test_a_hold_for_an_upload_turns_to_the_right() -> None:
    points, velocity_m_s = held_turn((0.0, 0.0), (0.0, 20.0), 60.0, 3.0)
    assert points[0] == (0.0, 0.0)
    assert points[-1] == pytest.approx((60.0 * (1.0 - math.cos(1.0)), 60.0 * math.sin(1.0)))
    assert velocity_m_s == pytest.approx((20.0 * math.sin(1.0), 20.0 * math.cos(1.0)))
    assert held_turn((5.0, 5.0), (0.5, 0.0), 60.0, 3.0) == ([(5.0, 5.0)], (0.5, 0.0))


@pytest.mark.parametrize(("atomic", "is_free"), [(True, True), (False, False)])
def test_a_mission_is_checked_with_the_hold_for_its_upload(atomic: bool, is_free: bool) -> None:
    """A plane flies north beside a volume in the east; its mission leads to the north-west."""
    core = Core(load_scenario("demo"), landscape_of(load_scenario("demo")))
    vehicle, place = core.vehicles["hawk"], (36.3708, -84.1323)
    core.handle(VehicleConnected(0, "hawk", "plane", atomic))
    core.handle(Telemetry(1, "hawk", *place, 500.0, 0.0, 0.0, 0.0, 0.0))
    core.handle(ModeChanged(2, "hawk", 0, True, "mission"))
    for at_us in (1_000_000, 2_000_000):
        core.handle(Telemetry(at_us, "hawk", *place, 500.0, 150.0, 15.0, 0.0, 0.0))
    x_m, y_m = core.landscape.xy_of_lat_lon(*place)
    target = MissionPlace((x_m - 300.0, y_m + 600.0, 500.0), 0.0, 0)
    parts = FlightSpace(core.landscape).of_mission(vehicle, (target,))
    east = shapely.box(x_m + 10.0, y_m - 500.0, x_m + 500.0, y_m + 500.0)
    enters = any(part.shape.intersects(east) for part in parts)
    assert enters != is_free


def test_a_vehicle_inside_a_volume_that_closes_leaves_it_and_holds_outside(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    centre = here(flight)
    flight.submit(closed_at(flight.now_us, centre))
    flight.run(120)
    assert "airspace/hawk" not in flight.state_view.alarms or "is inside" not in (
        flight.state_view.alarms["airspace/hawk"].text
    )
    entries = flight.over()
    assert 5.0 < inside_s(entries, centre, 250.0) < 60.0
    uploads = [entry for entry in entries if isinstance(entry, UploadMission)]
    assert any(entry.why == "leave closed airspace" for entry in uploads)


@pytest.mark.parametrize("kind", ["plane", "copter"])
def test_a_vehicle_leaves_without_turning_back_or_climbing_on_the_spot(fly: Fly, kind: str) -> None:
    """The first position of the way out is outside, not where the vehicle was."""
    flight = fly(f'vehicles.0.kind="{kind}"')
    flight.run(40)  # a copter is still in its takeoff
    centre = here(flight)
    flight.submit(closed_at(flight.now_us, centre))
    flight.run(2.0)
    leaves = next(
        entry
        for entry in flight.over()
        if isinstance(entry, UploadMission) and entry.why == "leave closed airspace"
    )
    first = next(item for item in leaves.items if item.command in (16, 17))
    away_m = math.hypot(
        (first.x / 1e7 - centre[0]) * 111_200.0,
        (first.y / 1e7 - centre[1]) * 111_200.0 * math.cos(math.radians(centre[0])),
    )
    assert away_m > 250.0


def test_a_vehicle_at_the_ceiling_leaves_without_a_descent() -> None:
    """It flies 200 m higher than its mission would."""
    core = Core(load_scenario("demo"), landscape_of(load_scenario("demo")))
    place, high_m = (36.3708, -84.1323), 700.0
    core.handle(VehicleConnected(0, "hawk", "plane", True))
    core.handle(ModeChanged(1, "hawk", 0, True, "mission"))
    core.handle(Telemetry(250_000, "hawk", *place, high_m, 350.0, 15.0, 0.0, 0.0))
    corners = square(place, 250.0)
    core.handle(AirspaceClosed(300_000, *ANN, "below", corners, ceiling_amsl_m=high_m + 3.0))
    commands = core.handle(Telemetry(500_000, "hawk", *place, high_m, 350.0, 15.0, 0.0, 0.0))
    (leaves,) = [each for each in commands if isinstance(each, UploadMission)]
    assert leaves.why == "leave closed airspace"
    items = leaves.items[: [item.command for item in leaves.items].index(189)]  # before its landing
    assert {item.z for item in items if item.command in (16, 17)} == {high_m}


def test_the_command_to_leave_follows_within_two_seconds(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    flight.submit(closed_at(flight.now_us, here(flight)))
    flight.run(2.0)
    entries = flight.over()
    closed = next(n for n, entry in enumerate(entries) if isinstance(entry, AirspaceClosed))
    after = [entry for entry in entries[closed:] if isinstance(entry, UploadMission)]
    assert after[0].why == "leave closed airspace"


@pytest.mark.long
def test_a_mission_around_the_fire_is_led_around_a_closed_volume(fly: Fly) -> None:
    corner = (FIRE[0] - 0.004, FIRE[1] - 0.004)
    corners = [list(place) for place in square(corner, 250.0)]
    flight = fly(f'airspace.closed=[{{name="smoke jumpers", corners={corners}}}]')
    flight.run(600)
    entries = flight.over()
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    over = [
        entry
        for entry in entries
        if isinstance(entry, Telemetry)
        and low[0] < entry.lat_deg < high[0]
        and low[1] < entry.lon_deg < high[1]
    ]
    assert not over
    assert sum(isinstance(entry, UploadMission) for entry in entries) > 3


def test_no_vehicle_takes_off_from_a_closed_home(fly: Fly) -> None:
    corners = [list(place) for place in square(HAWK_HOME, 300.0)]
    flight = fly(f'airspace.closed=[{{name="airfield", corners={corners}, until_s=3700}}]')
    flight.run(80)
    alarm = flight.state_view.alarms["airspace/hawk"].text
    assert "'airfield'" in alarm
    assert not flight.state_view.vehicles["hawk"].armed
    flight.run(120)  # the volume has opened
    assert flight.state_view.vehicles["hawk"].armed
    flight.run(60)
    assert "airspace/hawk" not in flight.state_view.alarms


def test_a_vehicle_returns_around_a_volume_between_it_and_home(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    place = here(flight)
    middle = ((place[0] + HAWK_HOME[0]) / 2.0, (place[1] + HAWK_HOME[1]) / 2.0)
    flight.submit(closed_at(flight.now_us, middle, 150.0))
    flight.run(1.0)
    flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "return"))
    flight.run(300)
    entries = flight.over()
    assert inside_s(entries, middle, 150.0) == 0.0
    whys = [entry.why for entry in entries if isinstance(entry, UploadMission)]
    assert "fly home clear of closed airspace and terrain" in whys
    assert any(isinstance(entry, Return) for entry in entries)
    last = position(entries)
    assert math.dist((last.lat_deg, last.lon_deg), HAWK_HOME) < 0.004


@pytest.mark.long
def test_a_held_vehicle_leaves_a_volume_that_closes_and_stays_held(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "hold"))
    flight.run(30)
    centre = here(flight)
    flight.submit(closed_at(flight.now_us, centre, 150.0))
    flight.run(120)
    assert flight.state_view.vehicles["hawk"].order == "hold"
    before = flight.now_us
    flight.run(120)
    entries = flight.over()
    assert inside_s(entries, centre, 150.0) < 60.0
    late = [entry for entry in entries if isinstance(entry, Telemetry) and entry.at_us > before]
    assert max(abs(entry.lat_deg - late[0].lat_deg) for entry in late) < 0.004


@pytest.mark.long
def test_after_the_opening_the_planner_leads_again(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    flight.submit(closed_at(flight.now_us, here(flight), 1500.0))
    flight.run(120)
    flight.submit(AirspaceOpened(flight.now_us, *ANN, "copter"))
    flight.run(60)
    assert "airspace/hawk" not in flight.state_view.alarms
    entries = flight.over()
    opened = next(n for n, entry in enumerate(entries) if isinstance(entry, AirspaceOpened))
    assert any(isinstance(entry, UploadMission) for entry in entries[opened:])


def test_a_pilots_vehicle_is_reported_and_left_alone(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    flight.sim.rigs[0].client.command("land", flight.sim.link_us)  # as its pilot would order
    flight.run(5.0)
    flight.submit(closed_at(flight.now_us, here(flight)))
    flight.run(10.0)
    assert "not under the service's control" in flight.state_view.alarms["airspace/hawk"].text
    entries = flight.over()
    closed = next(n for n, entry in enumerate(entries) if isinstance(entry, AirspaceClosed))
    sent = (UploadMission, Hold, Return, StartMission)
    assert not [entry for entry in entries[closed:] if isinstance(entry, sent)]


def test_a_vehicle_without_a_link_is_reported_when_a_volume_closes_over_it(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    place = here(flight)
    flight.sim.core.handle(LinkLost(flight.now_us, "hawk", 5.0))
    commands = flight.sim.core.handle(closed_at(flight.now_us, place))
    (alarm,) = (command for command in commands if isinstance(command, RaiseAlarm))
    assert alarm.severity == "severe"
    assert alarm.text.startswith("its link is lost: it may be inside the closed volume 'copter'")


def test_a_vehicle_that_cannot_return_holds_and_returns_when_the_way_is_free(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    flight.submit(closed_at(flight.now_us, HAWK_HOME, 300.0))
    flight.run(1.0)
    flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "return"))
    flight.run(60)
    assert flight.mode == "hold"
    assert "airspace/hawk" in flight.state_view.alarms
    again = flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "return"))
    assert "no return is sent" in " ".join(again)
    flight.run(5)
    assert flight.mode == "hold"
    flight.submit(AirspaceOpened(flight.now_us, *ANN, "copter"))
    flight.run(30)
    assert flight.mode == "return"
    assert "airspace/hawk" not in flight.state_view.alarms
    flight.over()


def test_a_landing_into_closed_airspace_is_refused(fly: Fly) -> None:
    flight = fly()
    flight.run(150)
    flight.submit(closed_at(flight.now_us, HAWK_HOME, 300.0))
    lines = flight.submit(OrderGiven(flight.now_us, *ANN, "hawk", "land"))
    assert "its mission would enter the closed volume 'copter'" in " ".join(lines)
    flight.over()


def test_an_accepted_mission_is_sent_as_accepted_or_not_at_all(fly: Fly) -> None:
    flight = fly('mission.approval="each"')
    flight.run(5.0)
    proposed = flight.state_view.missions["hawk"].proposed
    assert proposed is not None
    middle = ((HAWK_HOME[0] + FIRE[0]) / 2.0, (HAWK_HOME[1] + FIRE[1]) / 2.0)
    flight.submit(closed_at(flight.now_us, middle, 100.0))
    flight.submit(MissionAccepted(flight.now_us, *ANN, "hawk", proposed.mission_hash))
    assert "a mission is not sent" in flight.state_view.alarms["airspace/hawk"].text
    flight.run(60.0)
    other = flight.state_view.missions["hawk"].proposed
    assert other is not None
    assert other.mission_hash != proposed.mission_hash
    flight.submit(MissionAccepted(flight.now_us, *ANN, "hawk", other.mission_hash))
    flight.run(5.0)
    entries = flight.over()
    sent = [entry for entry in entries if isinstance(entry, UploadMission)]
    assert [mission_hash(entry.items) for entry in sent] == [other.mission_hash]


def test_closing_a_name_twice_and_opening_an_unknown_name_are_refused(fly: Fly) -> None:
    flight = fly()
    flight.run(5.0)
    flight.submit(closed_at(flight.now_us, FIRE))
    twice = flight.submit(closed_at(flight.now_us, FIRE))
    assert "a closed volume 'copter' already exists" in " ".join(twice)
    unknown = flight.submit(AirspaceOpened(flight.now_us, *ANN, "other"))
    assert "no closed volume 'other'; closed volumes: 'copter'" in " ".join(unknown)
    flight.over()


def test_a_name_can_be_closed_again_after_its_time(fly: Fly) -> None:
    flight = fly()
    flight.run(5)
    event = AirspaceClosed(flight.now_us, *ANN, "copter", square(FIRE, 250.0), for_s=10.0)
    flight.submit(event)
    flight.run(20)
    lines = flight.submit(closed_at(flight.now_us, FIRE))
    assert lines == ["airspace 'copter' closed by ann"]
    (volume,) = flight.sim.service.core.airspace.volumes
    assert volume.until_s == math.inf
    flight.over()
