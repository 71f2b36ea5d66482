"""Simulate the true fire of a simulation.

Only the simulated cameras read this fire (``simulated_cameras``). The estimate, the planners and
the map receive the observations of these cameras, never the fire itself.
"""

from collections.abc import Sequence

from firemodel.landscape.landscape import Landscape
from firemodel.physics.weather import Weather, WeatherStream
from firemodel.spread.fire_scheme import Fire
from mission_service.config.fire_sections import SimulatedFireSection
from mission_service.config.scenario import Scenario
from mission_service.fire.scenario_fire import cells_lit, fire_of, weather_of


class SimulatedFire:
    """The simulated truth, which cameras observe."""

    def __init__(self, fire: Fire, landscape: Landscape) -> None:
        self.fire = fire
        self.landscape = landscape

    def advance(self, at_us: int) -> None:
        """Advance the fire to this mission time; an earlier time has no effect."""
        at_s = at_us / 1e6
        if at_s > self.fire.time_s:
            self.fire.advance(at_s)

    def light(self, points: Sequence[tuple[float, float]], at_s: float) -> None:
        """Ignite the burnable cells of a point or line (lat, lon) at ``at_s``, or now if later."""
        for row, col in cells_lit(points, self.landscape):
            self.fire.light(row, col, max(at_s, self.fire.time_s))


def simulated_fire_of(scenario: Scenario, landscape: Landscape) -> SimulatedFire | None:
    """Return a scenario's simulated fire, or None if it has no table [simulation.fire]."""
    section = scenario.simulation.fire
    if section is None:
        return None
    fire = fire_of(scenario, landscape, simulated_weather(scenario))
    if section.spread_factor != 1.0:
        fire.perturb(1.0, 0.0, section.spread_factor)
    return SimulatedFire(fire, landscape)


def simulated_weather(scenario: Scenario) -> WeatherStream:
    """Return the weather that drives the simulated fire and moves simulated vehicles.

    The result is the scenario's weather, modified by the keys of [simulation.fire].
    """
    reported, section = weather_of(scenario), scenario.simulation.fire or SimulatedFireSection()
    if section == SimulatedFireSection(spread_factor=section.spread_factor):
        return reported
    return WeatherStream([_changed(entry, section) for entry in reported.entries])


def _changed(entry: Weather, section: SimulatedFireSection) -> Weather:
    return entry.with_dead_moisture(section.moisture_factor).in_wind(
        entry.wind_speed_m_s * section.wind_factor, entry.wind_from_deg + section.wind_turn_deg
    )
