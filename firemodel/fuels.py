"""Anderson's 13 fuel models (Anderson 1982, INT-122; Albini 1976, INT-30)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError

LB_FT2_PER_TON_ACRE = 2000.0 / 43560.0
NON_BURNABLE = {91: "urban", 92: "snow or ice", 93: "agriculture", 98: "water", 99: "bare ground"}


@dataclass(frozen=True, slots=True)
class FuelModel:
    """Loads in tons per acre, surface-area-to-volume ratios in 1/ft, depth in feet.

    The dead classes are 1 h, 10 h and 100 h; the live ones herbaceous and woody. The 10-h and
    100-h ratios are 109 and 30 1/ft throughout; heat content is 8000 Btu/lb.
    """

    name: str
    load_1h: float
    load_10h: float
    load_100h: float
    load_herb: float
    load_woody: float
    sav_1h: float
    sav_herb: float
    sav_woody: float
    depth_ft: float
    extinction_moisture: float

    @property
    def loads_lb_ft2(self) -> tuple[float, float, float, float, float]:
        """Oven-dry loads of the five classes in lb/ft²."""
        tons = (self.load_1h, self.load_10h, self.load_100h, self.load_herb, self.load_woody)
        return tuple(load * LB_FT2_PER_TON_ACRE for load in tons)  # type: ignore[return-value]

    @property
    def savs_1_ft(self) -> tuple[float, float, float, float, float]:
        """Surface-area-to-volume ratios of the five classes."""
        return (self.sav_1h, 109.0, 30.0, self.sav_herb, self.sav_woody)


FUEL_MODELS = {
    1: FuelModel("short grass", 0.74, 0, 0, 0, 0, 3500, 1500, 1500, 1.0, 0.12),
    2: FuelModel("timber grass and understory", 2.0, 1.0, 0.5, 0.5, 0, 3000, 1500, 1500, 1.0, 0.15),
    3: FuelModel("tall grass", 3.01, 0, 0, 0, 0, 1500, 1500, 1500, 2.5, 0.25),
    4: FuelModel("chaparral", 5.01, 4.01, 2.0, 0, 5.01, 2000, 1500, 1500, 6.0, 0.20),
    5: FuelModel("brush", 1.0, 0.5, 0, 0, 2.0, 2000, 1500, 1500, 2.0, 0.20),
    6: FuelModel("dormant brush", 1.5, 2.5, 2.0, 0, 0, 1750, 1500, 1500, 2.5, 0.25),
    7: FuelModel("southern rough", 1.13, 1.87, 1.5, 0, 0.37, 1750, 1500, 1500, 2.5, 0.40),
    8: FuelModel("short needle litter", 1.5, 1.0, 2.5, 0, 0, 2000, 1500, 1500, 0.2, 0.30),
    9: FuelModel("hardwood litter", 2.92, 0.41, 0.15, 0, 0, 2500, 1500, 1500, 0.2, 0.25),
    10: FuelModel("timber understory", 3.01, 2.0, 5.01, 0, 2.0, 2000, 1500, 1500, 1.0, 0.25),
    11: FuelModel("light slash", 1.5, 4.51, 5.51, 0, 0, 1500, 1500, 1500, 1.0, 0.15),
    12: FuelModel("medium slash", 4.01, 14.03, 16.53, 0, 0, 1500, 1500, 1500, 2.3, 0.20),
    13: FuelModel("heavy slash", 7.01, 23.04, 28.05, 0, 0, 1500, 1500, 1500, 3.0, 0.25),
}


def check_codes(fuel_model: NDArray[np.integer], where: str) -> None:
    """Raise FireModelError for the first cell whose code is neither a fuel nor non-burnable."""
    unknown = ~np.isin(fuel_model, [*FUEL_MODELS, *NON_BURNABLE])
    if unknown.any():
        row, col = np.argwhere(unknown)[0]
        raise FireModelError(
            f"{where}: unknown fuel code {fuel_model[row, col]} at row {row}, column {col} "
            f"({np.count_nonzero(unknown)} such cells); known are 1-13 and "
            f"{', '.join(map(str, NON_BURNABLE))} (non-burnable)"
        )
