"""Names of the squares of the US National Grid."""

import pytest

from firemodel.landscape.flat import flat_landscape
from mission_service.products.grid_reference import draw_utm_grid, grid_square, zone_of


# Published squares: the Washington Monument is in 18S UJ, the Eiffel Tower in 31U DQ, the Sydney
# Opera House in 56H LH.
@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "square"),
    [
        (38.889, -77.035, "18S UJ"),
        (48.8583, 2.2945, "31U DQ"),
        (-33.8568, 151.2153, "56H LH"),
        (36.36, -84.14, "16S GF"),
        (85.0, 0.0, ""),
    ],
)
def test_a_square(lat_deg: float, lon_deg: float, square: str) -> None:
    assert grid_square(lat_deg, lon_deg) == square


def test_the_zone_at_the_date_line() -> None:
    assert zone_of(10.0, 180.0).number == 1
    assert zone_of(-10.0, -180.0).crs == "EPSG:32701"


@pytest.mark.parametrize(("lon_deg", "number"), [(179.99, 60), (-179.99, 1)])
def test_the_grid_of_a_map_across_the_date_line(lon_deg: float, number: int) -> None:
    from matplotlib.figure import Figure

    land = flat_landscape(200, 200, 30.0, -16.8, lon_deg)
    axes = Figure().add_subplot()
    zone, step_km = draw_utm_grid(axes, land, (0.0, 6.0, 0.0, 6.0))
    assert (zone.number, step_km) == (number, 1)
    assert len(axes.lines) >= 10
