"""Define Anderson's 13 fuel models (INT-122) and Scott & Burgan's 40 (RMRS-GTR-153).

Anderson's models were published in 1982, Scott & Burgan's models in 2005.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firemodel.errors import FireModelError

SAV_10H, SAV_100H = 109.0, 30.0  # in 1/ft; the same in every model
LB_FT2_PER_TON_ACRE = 2000.0 / 43560.0
NON_BURNABLE = {
    code: {91: "urban", 92: "snow or ice", 93: "agriculture", 98: "water", 99: "bare ground"}.get(
        code, "non-burnable"
    )
    for code in range(91, 100)
}


@dataclass(frozen=True, slots=True)
class FuelModel:
    """A fuel model: loads in lb/ft², surface-area-to-volume ratios (SAV) in 1/ft, depth in ft.

    The dead classes are 1 h, 10 h and 100 h; the live classes are herbaceous and woody. In every
    model the SAV of the 10-h class is 109 1/ft and that of the 100-h class 30 1/ft. The extinction
    moisture of the dead fuel is a fraction of the oven-dry weight. In a dynamic model, herbaceous
    fuel is transferred to a dead class as the herbaceous fuel dries (``rothermel.cured_fraction``).
    ``heat_live_btu_lb`` is the heat content of the live fuel if it differs from that of the dead
    fuel. The spread rate is multiplied by ``rate_factor``, which the user can adjust.
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
    sav_herb: float = 1500.0
    sav_woody: float = 1500.0
    heat_btu_lb: float = 8000.0
    dynamic: bool = False
    heat_live_btu_lb: float | None = None
    rate_factor: float = 1.0

    @property
    def loads_lb_ft2(self) -> tuple[float, float, float, float, float]:
        """The oven-dry loads of the five classes in lb/ft²."""
        return self.load_1h, self.load_10h, self.load_100h, self.load_herb, self.load_woody

    @property
    def savs_1_ft(self) -> tuple[float, float, float, float, float]:
        """The surface-area-to-volume ratios of the five classes in 1/ft."""
        return self.sav_1h, SAV_10H, SAV_100H, self.sav_herb, self.sav_woody


# Albini 1976, table 7 (loads in lb/ft², three decimals; Anderson 1982 gives the loads in
# tons/acre). The SAV of the live fuel of FM 7 is 1500 1/ft as in the Forest Service's `behave`;
# Anderson prints 1550.
_ANDERSON = {
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


def _scott_burgan(row: str) -> tuple[int, FuelModel]:
    """Return the code and model of one row; models with herbaceous fuel are dynamic."""
    *numbers, name = row.split(maxsplit=11)
    code, *values = (float(number) for number in numbers)
    one, ten, hundred, herb, woody = (load * LB_FT2_PER_TON_ACRE for load in values[:5])
    sav_1h, sav_herb, sav_woody, depth_ft, extinction_pct = values[5:]
    return int(code), FuelModel(
        name,
        *(one, ten, hundred, herb, woody),
        sav_1h=sav_1h,
        depth_ft=depth_ft,
        extinction_moisture=extinction_pct / 100.0,
        sav_herb=sav_herb,
        sav_woody=sav_woody,
        heat_btu_lb=9000.0 if code == 106 else 8000.0,
        dynamic=herb > 0.0,
    )


# Scott & Burgan 2005: code, loads in tons/acre (1 h, 10 h, 100 h, herbaceous, woody), SAV in 1/ft
# (1 h, herbaceous, woody; 9999 where there is no such fuel), depth in ft, extinction moisture in
# percent, name. The heat content is 9000 Btu/lb for GR6 and 8000 Btu/lb for all other models.
_SCOTT_BURGAN = """
101  0.1    0    0  0.3    0 2200 2000 9999 0.4 15 GR1 short, sparse, dry climate grass
102  0.1    0    0    1    0 2000 1800 9999   1 15 GR2 low load, dry climate grass
103  0.1  0.4    0  1.5    0 1500 1300 9999   2 30 GR3 low load, very coarse, humid climate grass
104 0.25    0    0  1.9    0 2000 1800 9999   2 15 GR4 moderate load, dry climate grass
105  0.4    0    0  2.5    0 1800 1600 9999 1.5 40 GR5 low load, humid climate grass
106  0.1    0    0  3.4    0 2200 2000 9999 1.5 40 GR6 moderate load, humid climate grass
107    1    0    0  5.4    0 2000 1800 9999   3 15 GR7 high load, dry climate grass
108  0.5    1    0  7.3    0 1500 1300 9999   4 30 GR8 high load, very coarse, humid climate grass
109    1    1    0    9    0 1800 1600 9999   5 40 GR9 very high load, humid climate grass
121  0.2    0    0  0.5 0.65 2000 1800 1800 0.9 15 GS1 low load, dry climate grass-shrub
122  0.5  0.5    0  0.6    1 2000 1800 1800 1.5 15 GS2 moderate load, dry climate grass-shrub
123  0.3 0.25    0 1.45 1.25 1800 1600 1600 1.8 40 GS3 moderate load, humid climate grass-shrub
124  1.9  0.3  0.1  3.4  7.1 1800 1600 1600 2.1 40 GS4 high load, humid climate grass-shrub
141 0.25 0.25    0 0.15  1.3 2000 1800 1600   1 15 SH1 low load, dry climate shrub
142 1.35  2.4 0.75    0 3.85 2000 9999 1600   1 15 SH2 moderate load, dry climate shrub
143 0.45    3    0    0  6.2 1600 9999 1400 2.4 40 SH3 moderate load, humid climate shrub
144 0.85 1.15  0.2    0 2.55 2000 9999 1600   3 30 SH4 low load, humid climate timber-shrub
145  3.6  2.1    0    0  2.9  750 9999 1600   6 15 SH5 high load, dry climate shrub
146  2.9 1.45    0    0  1.4  750 9999 1600   2 30 SH6 low load, humid climate shrub
147  3.5  5.3  2.2    0  3.4  750 9999 1600   6 15 SH7 very high load, dry climate shrub
148 2.05  3.4 0.85    0 4.35  750 9999 1600   3 40 SH8 high load, humid climate shrub
149  4.5 2.45    0 1.55    7  750 1800 1500 4.4 40 SH9 very high load, humid climate shrub
161  0.2  0.9  1.5  0.2  0.9 2000 1800 1600 0.6 20 TU1 light load, dry climate timber-grass-shrub
162 0.95  1.8 1.25    0  0.2 2000 9999 1600   1 30 TU2 moderate load, humid climate timber-shrub
163  1.1 0.15 0.25 0.65  1.1 1800 1600 1400 1.3 30 TU3 moderate load, humid timber-grass-shrub
164  4.5    0    0    0    2 2300 9999 2000 0.5 12 TU4 dwarf conifer understory
165    4    4    3    0    3 1500 9999  750   1 25 TU5 very high load, dry climate timber-shrub
181    1  2.2  3.6    0    0 2000 9999 9999 0.2 30 TL1 low load, compact conifer litter
182  1.4  2.3  2.2    0    0 2000 9999 9999 0.2 25 TL2 low load broadleaf litter
183  0.5  2.2  2.8    0    0 2000 9999 9999 0.3 20 TL3 moderate load conifer litter
184  0.5  1.5  4.2    0    0 2000 9999 9999 0.4 25 TL4 small downed logs
185 1.15  2.5  4.4    0    0 2000 9999 9999 0.6 25 TL5 high load conifer litter
186  2.4  1.2  1.2    0    0 2000 9999 9999 0.3 25 TL6 high load broadleaf litter
187  0.3  1.4  8.1    0    0 2000 9999 9999 0.4 25 TL7 large downed logs
188  5.8  1.4  1.1    0    0 1800 9999 9999 0.3 35 TL8 long-needle litter
189 6.65  3.3 4.15    0    0 1800 9999 9999 0.6 35 TL9 very high load broadleaf litter
201  1.5    3   11    0    0 2000 9999 9999   1 25 SB1 low load activity fuel
202  4.5 4.25    4    0    0 2000 9999 9999   1 25 SB2 moderate load activity or low load blowdown
203  5.5 2.75    3    0    0 2000 9999 9999 1.2 25 SB3 high load activity or moderate load blowdown
204 5.25  3.5 5.25    0    0 2000 9999 9999 2.7 25 SB4 high load blowdown
"""
FUEL_MODELS = _ANDERSON | dict(map(_scott_burgan, _SCOTT_BURGAN.strip().splitlines()))


def check_codes(
    fuel_model: NDArray[np.integer], where: str, fuels: Mapping[int, FuelModel] = FUEL_MODELS
) -> None:
    """Raise FireModelError for the first cell (y, x) with an unknown fuel code.

    The known codes are those of ``fuels`` and of ``NON_BURNABLE``.
    """
    unknown = ~np.isin(fuel_model, [*fuels, *NON_BURNABLE])
    if unknown.any():
        row, col = np.argwhere(unknown)[0]
        raise FireModelError(
            f"{where}: unknown fuel code {fuel_model[row, col]} at row {row}, column {col} "
            f"({np.count_nonzero(unknown)} such cells); valid codes are 1-13, 101-109, 121-124, "
            "141-149, 161-165, 181-189, 201-204, 91-99 (non-burnable)"
            + "".join(f", {code}" for code in fuels if code not in FUEL_MODELS)
        )
