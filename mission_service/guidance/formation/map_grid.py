"""The grid of a map, which is that of the landscape."""

from dataclasses import dataclass

from firemodel.landscape.landscape import Landscape


@dataclass(frozen=True, slots=True)
class MapGrid:
    """A grid of square cells, row 0 north; ``west_m``, ``north_m`` are its north-west corner."""

    rows: int
    cols: int
    cell_m: float
    west_m: float
    north_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Return (rows, cols)."""
        return self.rows, self.cols

    def row_col_of(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return the float (row, col) of a place; whole numbers are the centres of cells."""
        return (self.north_m - y_m) / self.cell_m - 0.5, (x_m - self.west_m) / self.cell_m - 0.5

    def xy_of(self, row: float, col: float) -> tuple[float, float]:
        """Return the place (x, y) in metres of a float (row, col)."""
        return self.west_m + (col + 0.5) * self.cell_m, self.north_m - (row + 0.5) * self.cell_m


def map_grid_of(landscape: Landscape) -> MapGrid:
    """Return the grid of a landscape."""
    return MapGrid(*landscape.shape, landscape.cell_size_m, landscape.west_m, landscape.north_m)
