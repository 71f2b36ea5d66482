"""Spot fires in flights: when they are seen and modelled. ``benchmarks.spot_fires FIRST LAST``.

One plane flies over a crown fire that lights spot fires, in virtual time, on the terrain of the
default scenario with a forest and streams. Wind, moisture and spread rate of the simulated fire
differ from those that the estimate receives (as in ``benchmarks.flown_estimate``), and its
firebrands land at other places than those of the estimate. A spot fire is a burned area that is
not connected with the main fire and reaches at least ``MIN_CELLS`` cells. It is seen when a camera
image shows one of its cells burned, and modelled when the estimate contains at least half of its
cells. Printed are:

- the spot fires, those that were seen before they merged with another fire, those of the seen ones
  that were modelled before they merged, and those that were neither modelled nor merged within ten
  minutes of the first view (late);
- the median time from the ignition to the first view, and the median and the longest time from the
  first view until the spot fire is modelled;
- the area around the seen spot fires (within ``AROUND_CELLS``) that is wrong ten minutes after the
  first view, divided by the spot fires' true area: of the estimate, of the cells that images have
  shown as burned (``last seen``), and of the model without observations.
"""

import argparse
import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label

from benchmarks.flown_estimate import simulation_of, wrong_inputs
from firemodel.arrays import Floats, Mask
from firemodel.assimilation.observation import BURNED
from firemodel.landscape.landscape import Landscape
from firemodel.physics.fuels import NON_BURNABLE
from mission_service.config.fire_sections import Ignition
from mission_service.config.scenario import Scenario, load_scenario
from mission_service.events import AnyEvent, Observed
from mission_service.fire.observed_window import states_in
from mission_service.fire.scenario_fire import fire_of, landscape_of

DEPLOY_S, END_S, STEP_S = 1800.0, 9000.0, 30.0
LIMIT_S = 600.0
MIN_CELLS, AROUND_CELLS = 3, 4
TIMBER_UNDERSTORY, PATCH_CELLS, FOREST_SHARE = 10, 10, 0.75
WATER, STREAM_EVERY_CELLS = 98, 30
CANOPY = {
    "canopy_cover": 0.5,
    "canopy_height_m": 18.0,
    "canopy_base_m": 1.0,
    "canopy_bulk_density_kg_m3": 0.15,
}
WIND_M_S, AIRSPEED_M_S = (5.0, 9.0), 22.0
EIGHT = np.ones((3, 3), dtype=bool)


class Sample(NamedTuple):
    """The burned cells (y, x) at a time."""

    at_s: float
    estimate: Mask
    model: Mask


class Spot(NamedTuple):
    """A spot fire: times of mission, infinity for never, and wrong areas in cells."""

    lit_s: float
    seen_s: float
    modelled_s: float
    merged_s: float
    wrong: NDArray[np.float64]  # estimate, last seen, model; NaN if merged within ``LIMIT_S``
    cells: float  # its true area when the wrong areas were measured
    most_cells: int

    @property
    def is_seen(self) -> bool:
        """Whether an image showed it before it merged."""
        return self.seen_s < self.merged_s

    @property
    def is_modelled(self) -> bool:
        """Whether it was modelled before it merged."""
        return self.modelled_s <= self.merged_s

    @property
    def is_late(self) -> bool:
        """Whether it was neither modelled nor merged within ``LIMIT_S`` of the first view."""
        return min(self.modelled_s, self.merged_s) > self.seen_s + LIMIT_S


def forest(landscape: Landscape, rng: np.random.Generator) -> Landscape:
    """Return the landscape with trees in most patches, and crossed by streams.

    Fire crosses the streams only by firebrands, so that spot fires beyond them last.
    """
    rows, cols = landscape.shape
    coarse = rng.random((rows // PATCH_CELLS + 1, cols // PATCH_CELLS + 1)) < FOREST_SHARE
    trees = np.kron(coarse, np.ones((PATCH_CELLS, PATCH_CELLS), bool))[:rows, :cols]
    fuel = np.where(trees, TIMBER_UNDERSTORY, landscape.fuel_model).astype(np.int16)
    first_row, first_col = rng.integers(STREAM_EVERY_CELLS, size=2)
    for begin in range(0, max(rows, cols), STREAM_EVERY_CELLS):
        fuel[begin + first_row : begin + first_row + 2] = WATER
        fuel[:, begin + first_col : begin + first_col + 2] = WATER
    layers: dict[str, Any] = {
        name: np.where(trees, value, 0.0).astype(np.float32) for name, value in CANOPY.items()
    }
    return dataclasses.replace(landscape, fuel_model=fuel, **layers)


def drawn_flight(seed: int, rule: str) -> tuple[Scenario, Landscape]:
    """Return the scenario and the landscape of a flight."""
    rng = np.random.default_rng((2727, seed))
    changes = (
        f"planner.rule={rule}",
        f"deploy_at_s={DEPLOY_S:g}",
        f"duration_s={END_S + 1000.0:g}",
        "fire.crown=scott_reinhardt",
        "fire.spotting=true",
    )
    found = load_scenario("default", changes)
    landscape = forest(landscape_of(found), rng)
    speed_m_s, from_deg = float(rng.uniform(*WIND_M_S)), float(rng.uniform(0.0, 360.0))
    upwind = np.array([-math.cos(math.radians(from_deg)), math.sin(math.radians(from_deg))])
    place = np.array(landscape.shape) * (0.5 + 0.25 * upwind)
    burnable = np.argwhere(~np.isin(landscape.fuel_model, list(NON_BURNABLE)))
    row, col = burnable[np.hypot(*(burnable - place).T).argmin()]
    lat_deg, lon_deg = landscape.lat_lon_of(*landscape.xy_of(row, col))
    windy = {"wind_speed_m_s": speed_m_s, "wind_from_deg": from_deg}
    update = {
        "seed": seed,
        "weather": (found.weather[0].model_copy(update=windy),),
        "ignition": (Ignition(lat_deg=float(lat_deg), lon_deg=float(lon_deg)),),
        "simulation": wrong_inputs(seed),
        "vehicles": tuple(
            each.model_copy(update={"airspeed_m_s": AIRSPEED_M_S}) for each in found.vehicles
        ),
    }
    return found.model_copy(update=update), landscape


def flown(scenario: Scenario, landscape: Landscape) -> tuple[list[Sample], Floats, Floats]:
    """Fly; return samples, and the times (y, x) of arrival and of the first burned view."""
    seen_s = np.full(landscape.shape, np.inf)
    with simulation_of(scenario, landscape) as flight:
        on_event = flight.estimate.on_event

        def note(event: AnyEvent) -> None:
            if isinstance(event, Observed) and not event.corrects and not event.estimated:
                burned = states_in(event.cells) == BURNED
                rows, cols = burned.shape
                window = seen_s[event.row : event.row + rows, event.col : event.col + cols]
                window[burned] = np.minimum(window[burned], event.at_us / 1e6)
            on_event(event)

        flight.estimate.on_event = note  # type: ignore[method-assign]
        model, samples = fire_of(scenario, landscape), []
        for at_s in np.arange(DEPLOY_S, END_S + STEP_S, STEP_S):
            flight.run_until(float(at_s))
            flight.service.advance_fire(flight.clock.now_us)
            model.advance(float(at_s))
            estimate = flight.estimate.fire
            samples.append(Sample(float(at_s), estimate.burned(), model.burned()))
        assert flight.cameras is not None
        true = flight.cameras.fire.fire
        true.advance(END_S)
        return samples, true.arrival_time_s.copy(), seen_s


def spots_of(samples: Sequence[Sample], arrival_s: Floats, seen_s: Floats) -> list[Spot]:
    """Return the spot fires of a flight.

    A spot fire is identified by the cell that burned first. It merges when this cell is no longer
    the first of its burned area.
    """
    states: dict[int, Spot] = {}
    for sample in samples:
        areas, count = label(arrival_s <= sample.at_s, EIGHT)
        present = set()
        for number in range(1, count + 1):
            here = areas == number
            cell = int(np.where(here, arrival_s, np.inf).argmin())
            present.add(cell)
            if cell == int(arrival_s.argmin()):
                continue
            found = states.get(cell) or _new_spot(float(arrival_s.flat[cell]))
            states[cell] = _updated(found, sample, here, arrival_s, seen_s)
        for cell, found in states.items():
            if cell not in present and found.merged_s == np.inf:
                states[cell] = found._replace(merged_s=sample.at_s)
    return [found for found in states.values() if found.most_cells >= MIN_CELLS]


def _new_spot(lit_s: float) -> Spot:
    return Spot(lit_s, np.inf, np.inf, np.inf, np.full(3, np.nan), 0.0, 0)


def _updated(found: Spot, sample: Sample, here: Mask, arrival_s: Floats, seen_s: Floats) -> Spot:
    found = found._replace(most_cells=max(found.most_cells, int(np.count_nonzero(here))))
    first_s = float(seen_s[here].min())
    if first_s <= sample.at_s:
        found = found._replace(seen_s=min(found.seen_s, first_s))
    if found.seen_s < np.inf and found.modelled_s == np.inf and sample.estimate[here].mean() >= 0.5:
        found = found._replace(modelled_s=max(sample.at_s, found.seen_s))
    if np.isnan(found.wrong[0]) and sample.at_s >= found.seen_s + LIMIT_S:
        true = arrival_s <= sample.at_s
        near = binary_dilation(here, EIGHT, AROUND_CELLS)
        areas = (sample.estimate, seen_s <= sample.at_s, sample.model)
        wrong = np.array([np.count_nonzero((area ^ true)[near]) for area in areas], dtype=float)
        found = found._replace(wrong=wrong, cells=float(np.count_nonzero(here)))
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the spot fires of each flight, and of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--rule", default="informative")
    given = parser.parse_args(arguments)
    click.echo(
        "seed  spots  seen  modelled  late  lit to seen  seen to modelled: median, longest"
        "  wrong area: estimate, last seen, model"
    )
    every: list[Spot] = []
    for seed in range(given.first, given.last + 1):
        spots = spots_of(*flown(*drawn_flight(seed, given.rule)))
        every += spots
        click.echo(_line(f"{seed:4}", spots))
    click.echo(_line(" all", every))


def _line(name: str, spots: Sequence[Spot]) -> str:
    seen = [spot for spot in spots if spot.is_seen]
    modelled = [spot for spot in seen if spot.is_modelled]
    late = sum(spot.is_late for spot in seen)
    parts = [f"{name}  {len(spots):5}  {len(seen):4}  {len(modelled):8}  {late:4}"]
    if seen:
        parts.append(f"{np.median([spot.seen_s - spot.lit_s for spot in seen]) / 60:7.1f} min")
    if modelled:
        late_s = [spot.modelled_s - spot.seen_s for spot in modelled]
        parts.append(f"{np.median(late_s) / 60:7.1f} min, {max(late_s) / 60:.1f} min")
    measured = [spot for spot in seen if spot.cells]
    if measured:
        cells = sum(spot.cells for spot in measured)
        wrong = np.sum([spot.wrong for spot in measured], axis=0) / cells
        parts.append("  " + ", ".join(f"{value:.2f}" for value in wrong))
    return "  ".join(parts)


if __name__ == "__main__":
    main()
