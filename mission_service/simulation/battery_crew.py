"""Simulates a crew that replaces the batteries of mock autopilots and charges used ones."""

from bisect import insort
from collections.abc import Mapping

from autopilot_bridge.mock.autopilot import MockAutopilot
from autopilot_bridge.mock.failsafe_causes import Battery
from mission_service.config.relief_section import SimulatedBatteriesSection
from mission_service.config.scenario import Scenario
from mission_service.errors import ScenarioError

CHECK_EVERY_S = 1.0
USED_PCT = 99.0  # a battery with less charge is replaced


class BatteryCrew:
    """The batteries at one field; all used batteries are charged at the same time."""

    def __init__(
        self,
        section: SimulatedBatteriesSection,
        scenario: Scenario,
        mocks: Mapping[str, MockAutopilot],
    ) -> None:
        """Give each mock a full battery.

        Args:
            mocks: Mocks by vehicle name; other processes may have further mocks.

        Raises:
            ScenarioError: A vehicle of the scenario has no ``endurance_s``.
        """
        self._section = section
        self._mocks = mocks
        self._full_at_s = [0.0] * section.packs  # times at which the spare batteries are full
        self._disarmed_since_s: dict[str, float] = {}
        self._checked_at_s = 0.0
        for vehicle in scenario.flown:
            if vehicle.endurance_s is None:
                raise ScenarioError(
                    f"{scenario.name}: [simulation.batteries] requires endurance_s of "
                    f"{vehicle.name}, the flight time on a full battery"
                )
            if vehicle.name in mocks:
                mocks[vehicle.name].flight.battery = Battery(100.0, vehicle.endurance_s)

    def work(self, at_s: float) -> None:
        """Replace the batteries that are due at mission time ``at_s``."""
        if at_s - self._checked_at_s < CHECK_EVERY_S:
            return
        self._checked_at_s = at_s
        for name, mock in self._mocks.items():
            flight = mock.flight
            if flight.armed or flight.airborne or (flight.battery.percent or 0.0) >= USED_PCT:
                self._disarmed_since_s.pop(name, None)
                continue
            since_s = self._disarmed_since_s.setdefault(name, at_s)
            full = self._full_at_s and self._full_at_s[0] <= at_s
            if full and at_s - since_s >= self._section.swap_s:
                self._full_at_s.pop(0)
                insort(self._full_at_s, at_s + self._section.charge_s)
                mock.replace_battery()


def battery_crew_of(scenario: Scenario, mocks: Mapping[str, MockAutopilot]) -> BatteryCrew | None:
    """Return the crew of ``[simulation.batteries]``, or None without this table.

    Raises ScenarioError for a vehicle without ``endurance_s``.
    """
    section = scenario.simulation.batteries
    return None if section is None else BatteryCrew(section, scenario, mocks)
