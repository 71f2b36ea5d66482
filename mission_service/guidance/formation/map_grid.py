"""The grid of a formation's maps, which is the landscape's grid."""

from dataclasses import dataclass

from firemodel.landscape.landscape import Landscape


@dataclass(frozen=True, slots=True)
class MapGrid:
    """A grid of square cells, with row 0 in the north.

    ``west_m`` and ``north_m`` are the coordinates of the grid's north-west corner.
    """

    rows: int
    cols: int
    cell_m: float
    west_m: float
    north_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Return the numbers of rows and columns."""
        return self.rows, self.cols

    def row_col_of(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Return the row and column of a position, as floats; cell centres have integer values."""
        return (self.north_m - y_m) / self.cell_m - 0.5, (x_m - self.west_m) / self.cell_m - 0.5

    def xy_of(self, row: float, col: float) -> tuple[float, float]:
        """Return the position (x and y in metres) at a row and column, given as floats."""
        return self.west_m + (col + 0.5) * self.cell_m, self.north_m - (row + 0.5) * self.cell_m


def map_grid_of(landscape: Landscape) -> MapGrid:
    """Return the grid of a landscape as a ``MapGrid``."""
    return MapGrid(*landscape.shape, landscape.cell_size_m, landscape.west_m, landscape.north_m)
