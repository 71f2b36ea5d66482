"""Compare rates of crown fires with 57 observed wildfires (Alexander & Cruz 2006).

    python -m benchmarks.crown_fires [--data FOLDER]

The table contains the mean absolute error and the bias, both relative to the observed rate, the
root of the mean square error, and the fraction of the fires that are predicted within a factor of
2. The last line is the simplest baseline: for each fire the mean rate of the other fires. Cruz et
al. use the estimated moisture of fine dead fuel, Rothermel's method also the moistures of the other
classes, which are not known: 10-h and 100-h fuel are 1 and 2 percentage points moister, live fuel
has 100 %.
"""

import csv
from pathlib import Path

import click
import numpy as np

from benchmarks.shared import check_folder, data_parser
from firemodel.arrays import Floats
from firemodel.physics import crown_fire
from firemodel.physics.weather import Weather, wind_20ft_from_10m
from firemodel.spread.crown_spread import WIND_B, WIND_C, crown_factor

FILE = "alexander_and_cruz_2006.csv"
LIVE_PCT = 100.0
KM_H_PER_M_S = 3.6


def rates_of(path: Path) -> dict[str, Floats]:
    """Return the observed and the predicted rates (n) in m/min of the fires in a file."""
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))[1:]  # the first row contains the units
    observed, found = [], []
    for row in rows:
        wind_10m_m_s, moisture = float(row["U_10"]) / KM_H_PER_M_S, float(row["M"])
        density = float(row["CBD"])
        wind_m_s = float(wind_20ft_from_10m(wind_10m_m_s))
        dead = (moisture, moisture + 1.0, moisture + 2.0)
        entry = Weather(0.0, wind_m_s, 0.0, *dead, LIVE_PCT, LIVE_PCT)
        cruz = crown_fire.cruz_active_rate_m_s(crown_factor("cruz", entry), wind_10m_m_s, density)
        critical = crown_fire.critical_rate_m_s(density)
        passive = crown_fire.cruz_passive_rate_m_s(cruz, critical)
        still = crown_factor("rothermel", entry)
        rothermel = crown_fire.rothermel_rate_m_s(still, WIND_B, WIND_C, wind_m_s)
        observed.append(float(row["ROS"]))
        found.append((cruz, cruz if cruz >= critical else passive, rothermel))
    rates = np.array(observed)
    predicted = np.array(found).T * 60.0
    others = (rates.sum() - rates) / (rates.size - 1)
    return {
        "observed": rates,
        "Cruz et al. 2005, all fires active": predicted[0],
        "Cruz et al. 2005, passive below the critical rate": predicted[1],
        "Rothermel 1991": predicted[2],
        "mean rate of the other fires": others,
    }


def main() -> None:
    """Print the table."""
    options = data_parser(__doc__).parse_args()
    rates = rates_of(check_folder(options.data / "crown_fires") / FILE)
    observed = rates.pop("observed")
    click.echo(f"{observed.size} fires, {observed.min():.1f} to {observed.max():.1f} m/min")
    click.echo(f"{'':50} {'error':>7} {'bias':>7} {'RMSE m/min':>11} {'factor 2':>9}")
    for name, predicted in rates.items():
        relative = (predicted - observed) / observed
        rmse = np.sqrt(np.mean((predicted - observed) ** 2))
        near = np.mean((predicted <= 2.0 * observed) & (predicted >= observed / 2.0))
        error, bias = np.abs(relative).mean(), relative.mean()
        click.echo(f"{name:50} {error:7.0%} {bias:+7.0%} {rmse:11.1f} {near:9.0%}")


if __name__ == "__main__":
    main()
