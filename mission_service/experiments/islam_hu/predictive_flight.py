"""Simulate flights with the predictive planner.

The planner receives the landscape, the initial moistures and a measured wind. The wind has errors
of 0.8 m/s and 8 degrees, correlated over two minutes (``measured_wind``). The planner receives
neither the true fire nor a forecast.
"""

from mission_service.experiments.fires import Burn
from mission_service.experiments.islam_hu.ideal_flight import Flight, fly
from mission_service.experiments.islam_hu.measured_wind import WIND_20FT_SHARE, MeasuredWind
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.front.predictive_planner import (
    PredictivePlanner,
    PredictiveSettings,
    model_of,
)

SEED = 1


def predictive_planner(burn: Burn, *, modelled: bool = True) -> PredictivePlanner:
    """Return the planner for a known ignition; the vehicle turns on the spot, as in the paper."""
    cell_m = burn.landscape.cell_size_m
    settings = PredictiveSettings(
        clockwise_first=True,
        ignition_known=True,
        speed_cells_s=burn.speed_m_s / cell_m,
        turn_radius_cells=0.0,
        flies_in_wind=False,
        wind_20ft_share=WIND_20FT_SHARE,
        path=PathSettings(horizon_cells=80.0, lookahead_cells=1.0),
    )
    centre = (float(burn.ignition[0]), float(burn.ignition[1]))
    model = model_of(burn.landscape, burn.weather.entries[0]) if modelled else None
    return PredictivePlanner(settings, burn.arrival_s.shape, centre, 0.0, cell_m, model)


def fly_predictive(burn: Burn, seed: int = SEED, model: Burn | None = None) -> Flight:
    """Simulate a flight with the predictive planner and a measured wind.

    The errors are those of the planner's estimated front. ``model`` is the fire whose landscape and
    weather the planner receives; None means ``burn``.
    """
    given = burn if model is None else model
    measured = MeasuredWind(given.weather, seed)
    return fly(burn, predictive_planner(given), hull=False, measured=measured)
