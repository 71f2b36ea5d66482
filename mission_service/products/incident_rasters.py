"""Write the rasters of an incident as cloud-optimised GeoTIFFs."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firemodel.outputs.geotiff import write_raster
from firemodel.outputs.layer_legends import (
    FLAME_LENGTH_LAYER,
    PROBABILITY_LAYER,
    Layer,
    arrival_layer,
)
from firemodel.spread.behaviour import behaviour_of
from mission_service.products.incident import Incident

ARRIVAL, PROBABILITY, FLAME_LENGTH = "arrival_time_s", "burn_probability", "flame_length_m"


def write_rasters(out: Path, incident: Incident) -> list[Path]:
    """Write arrival times, burn probability and flame length; return the paths.

    The arrival times are those of the estimate and of the forecast. There is no burn probability
    without a forecast, and no flame length in a burn.
    """
    layers: dict[str, tuple[NDArray[Any], Layer]] = {}
    arrival_s, end_s = incident.arrival.arrival_s, incident.at_s + incident.forecast_s
    shown_s = np.where(arrival_s <= end_s, arrival_s, np.inf)
    first_s = min(float(shown_s.min()), end_s)
    layers[ARRIVAL] = (np.maximum(shown_s, 0.0), arrival_layer(first_s, end_s, incident.time_zero))
    if incident.probability is not None:
        layers[PROBABILITY] = (incident.probability, PROBABILITY_LAYER)
    if incident.fire is not None:
        layers[FLAME_LENGTH] = (behaviour_of(incident.fire).flame_length_m, FLAME_LENGTH_LAYER)
    paths = []
    for name, (values, layer) in layers.items():
        paths.append(out / f"{name}.tif")
        write_raster(paths[-1], values, incident.landscape, layer)
    return paths
