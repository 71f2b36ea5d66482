"""Anderson's 13 fuel models (Anderson 1982, INT-122; Albini 1976, INT-30)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError

SAV_10H, SAV_100H, SAV_LIVE = 109.0, 30.0, 1500.0  # 1/ft, the same in every model
NON_BURNABLE = {91: "urban", 92: "snow or ice", 93: "agriculture", 98: "water", 99: "bare ground"}


@dataclass(frozen=True, slots=True)
class FuelModel:
    """Loads in lb/ft², surface-area-to-volume ratios (SAV) in 1/ft, depth in ft.

    The dead classes are 1 h, 10 h and 100 h; the live ones herbaceous and woody. The 10-h and
    100-h ratios are 109 and 30 1/ft throughout; heat content is 8000 Btu/lb. Extinction moisture
    of the dead fuel is a fraction of the oven-dry weight.
    """

    name: str
    load_1h: float
    load_10h: float
    load_100h: float
    load_herb: float
    load_woody: float
    sav_1h: float
    depth_ft: float
    extinction_moisture: float

    @property
    def loads_lb_ft2(self) -> tuple[float, float, float, float, float]:
        """Oven-dry loads of the five classes in lb/ft²."""
        return self.load_1h, self.load_10h, self.load_100h, self.load_herb, self.load_woody

    @property
    def savs_1_ft(self) -> tuple[float, float, float, float, float]:
        """Surface-area-to-volume ratios of the five classes in 1/ft."""
        return self.sav_1h, SAV_10H, SAV_100H, SAV_LIVE, SAV_LIVE


# Albini 1976, table 7 (loads in lb/ft², three decimals; Anderson 1982 gives them as tons/acre).
# The live fuel of FM 7 has 1500 1/ft as in the Forest Service's `behave`; Anderson prints 1550.
FUEL_MODELS = {
    1: FuelModel("short grass", 0.034, 0, 0, 0, 0, 3500, 1.0, 0.12),
    2: FuelModel("timber grass and understory", 0.092, 0.046, 0.023, 0.023, 0, 3000, 1.0, 0.15),
    3: FuelModel("tall grass", 0.138, 0, 0, 0, 0, 1500, 2.5, 0.25),
    4: FuelModel("chaparral", 0.230, 0.184, 0.092, 0, 0.230, 2000, 6.0, 0.20),
    5: FuelModel("brush", 0.046, 0.023, 0, 0, 0.092, 2000, 2.0, 0.20),
    6: FuelModel("dormant brush", 0.069, 0.115, 0.092, 0, 0, 1750, 2.5, 0.25),
    7: FuelModel("southern rough", 0.052, 0.086, 0.069, 0, 0.017, 1750, 2.5, 0.40),
    8: FuelModel("short needle litter", 0.069, 0.046, 0.115, 0, 0, 2000, 0.2, 0.30),
    9: FuelModel("hardwood litter", 0.134, 0.019, 0.007, 0, 0, 2500, 0.2, 0.25),
    10: FuelModel("timber understory", 0.138, 0.092, 0.230, 0, 0.092, 2000, 1.0, 0.25),
    11: FuelModel("light slash", 0.069, 0.207, 0.253, 0, 0, 1500, 1.0, 0.15),
    12: FuelModel("medium slash", 0.184, 0.644, 0.759, 0, 0, 1500, 2.3, 0.20),
    13: FuelModel("heavy slash", 0.322, 1.058, 1.288, 0, 0, 1500, 3.0, 0.25),
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
