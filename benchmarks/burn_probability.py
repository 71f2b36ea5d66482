"""Measure the reliability of burn probabilities: do x % of the cells with probability x burn?

    .venv/bin/python -m benchmarks.burn_probability [FIRST_SEED] [PLACES] [TRUTHS]

For each of PLACES random places (patches of fuels on hills, wind, moisture), an ensemble of 100
members gives the probability of each cell after three hours. The errors of TRUTHS true fires are
drawn independently from the same distributions. The table shows, for each class of the probability
(width 0.1), the number of cells, their mean probability and the share that burned. The baseline is
one run without errors, in which each cell burns or does not burn. Cells that no member and no true
fire reached are excluded. The Brier score is the mean squared error.
"""

import sys
from concurrent.futures import ThreadPoolExecutor

import click
import numpy as np

from firemodel.ensemble.draws import latin_draws, random_draws
from firemodel.ensemble.member_fires import Each, Start, burned_windows
from firemodel.ensemble.products import burn_probability
from firemodel.ensemble.uncertainty import Uncertainty
from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.schemes import new_fire

CELLS, CELL_M, UNTIL_S, MEMBERS = 160, 30.0, 3 * 3600.0, 100
FUELS = np.array([1, 2, 5, 8, 10, 102, 122, 145, 183], dtype=np.int16)
PATCH_CELLS = 10
LIT = (CELLS // 2, CELLS // 2, 0.0)


def place(rng: np.random.Generator) -> tuple[Landscape, WeatherStream]:
    """Return a random landscape and its weather."""
    patches = rng.choice(FUELS, size=2 * (CELLS // PATCH_CELLS,))
    fuel = np.repeat(np.repeat(patches, PATCH_CELLS, 0), PATCH_CELLS, 1)
    row, col = np.indices(fuel.shape)
    phase, waves = rng.uniform(0.0, 6.3, 2), rng.uniform(15.0, 40.0, 2)
    height_m = 60.0 * np.sin(row / waves[0] + phase[0]) * np.sin(col / waves[1] + phase[1])
    land = Landscape("EPSG:32611", 5e5, 4e6, CELL_M, fuel, height_m.astype(np.float32))
    wind = rng.uniform(1.0, 7.0), rng.uniform(0.0, 360.0)
    later = wind[0] * rng.uniform(0.6, 1.6), (wind[1] + rng.normal(0.0, 30.0)) % 360.0
    wet = rng.uniform(4.0, 10.0)
    fuels = (wet, wet + 1.0, wet + 2.0, 70.0, 90.0)
    return land, WeatherStream([Weather(0.0, *wind, *fuels), Weather(5400.0, *later, *fuels)])


def compared(seed: int, truths: int, each: Each) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return three values for each cell and true fire: probability, run without errors, truth."""
    rng = np.random.default_rng((seed, 20))
    land, weather = place(rng)
    start = Start(new_fire("anyangle", land, weather, []), [LIT])
    stated = Uncertainty()
    draws = latin_draws(stated, seed, MEMBERS, start.fuels)
    windows = list(burned_windows(start, draws, range(MEMBERS), UNTIL_S, seed, each))
    chance = burn_probability(windows, land.shape, UNTIL_S)
    expected = new_fire("anyangle", land, weather, [LIT])
    expected.advance(UNTIL_S)
    true = random_draws(stated, rng, truths, start.fuels)
    burned = np.stack(
        [
            burn_probability([window], land.shape, UNTIL_S) > 0.0
            for window in burned_windows(start, true, range(truths), UNTIL_S, seed, each)
        ]
    )
    used = (chance > 0.0) | burned.any(axis=0) | expected.burned()
    return (
        np.tile(chance[used], (truths, 1)).ravel(),
        np.tile(expected.burned()[used].astype(float), (truths, 1)).ravel(),
        burned[:, used].ravel(),
    )


def main() -> None:
    """Print the table of reliability, and the scores."""
    first, places, truths = (
        int(sys.argv[place]) if len(sys.argv) > place else default
        for place, default in ((1, 1000), (2, 40), (3, 60))
    )
    with ThreadPoolExecutor() as pool:
        seeds = range(first, first + places)
        parts = [compared(seed, truths, pool.map) for seed in seeds]
    chance, expected, burned = (np.concatenate(each) for each in zip(*parts, strict=True))
    click.echo(
        f"seeds {first} to {first + places - 1}, {truths} true fires each, {MEMBERS} members"
    )
    click.echo("probability         cells   mean  burned  difference (points)")
    tenth = np.minimum((chance * 10 + 1e-9).astype(int), 9)
    for number in range(10):
        here = tenth == number
        mean, share = 100 * chance[here].mean(), 100 * burned[here].mean()
        label = f"{10 * number:3d} to {10 * number + 10:3d} %"
        click.echo(f"{label}  {here.sum():10d}  {mean:5.1f}  {share:6.1f}  {share - mean:+.1f}")
    click.echo("one expected run:")
    for value, label in ((0.0, "not burned"), (1.0, "burned")):
        here = expected == value
        mean, share = 100 * value, 100 * burned[here].mean()
        click.echo(f"{label:<12}{here.sum():10d}  {mean:5.1f}  {share:6.1f}  {share - mean:+.1f}")
    brier = [float(np.mean((each - burned) ** 2)) for each in (chance, expected)]
    click.echo(f"Brier score: ensemble {brier[0]:.4f}, one expected run {brier[1]:.4f}")


if __name__ == "__main__":
    main()
