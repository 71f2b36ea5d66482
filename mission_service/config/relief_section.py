"""Defines the table ``[relief]``: vehicles that fly one task in turn, and simulated batteries."""

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, field_validator

from mission_service.config.section_base import NotNegative, Positive, Section
from mission_service.errors import did_you_mean

if TYPE_CHECKING:
    from mission_service.config.scenario import Scenario


class ReliefSection(Section):
    """A task that lasts longer than a flight: one of ``vehicles`` flies it, the others stand by.

    The next vehicle arrives ``overlap_s`` before the present one must leave. Each takeoff needs an
    operator's order. With ``standing_signoff`` two kinds of takeoffs need no order: the first
    takeoff, and the takeoff of a vehicle that has landed after its time on task, when its autopilot
    has reported a full battery for ``ready_after_s`` on the ground.
    """

    vehicles: Annotated[tuple[str, ...], Field(min_length=2)]
    standing_signoff: bool = False
    overlap_s: NotNegative = 120.0
    ready_after_s: Positive = 300.0

    @field_validator("vehicles")
    @classmethod
    def _different(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(names)) < len(names):
            raise ValueError("contains a vehicle twice; list each vehicle once")
        return names


class SimulatedBatteriesSection(Section):
    """The batteries of simulated vehicles; each battery lasts the vehicle's ``endurance_s``.

    Each vehicle begins with a full battery, and ``packs`` further full batteries fit all vehicles.
    A used battery is exchanged ``swap_s`` after the vehicle has been disarmed, and is full again
    ``charge_s`` later.
    """

    packs: Annotated[int, Field(ge=0, le=1000)]
    charge_s: Positive = 3600.0
    swap_s: NotNegative = 180.0


def refuse_relief(scenario: "Scenario", relief: ReliefSection) -> None:
    """Raise ValueError for vehicles that cannot relieve each other."""
    if not scenario.way.relieves:
        raise ValueError(
            "[relief] requires a rule with a separate planner for each vehicle, not "
            f"{scenario.planner.rule}; set planner.rule, for example to predictive"
        )
    if scenario.only is not None:
        raise ValueError("[relief] requires all its vehicles in one process; remove the key `only`")
    if scenario.mission.approval == "each":
        raise ValueError(
            '[relief] requires mission.approval = "none", because reliefs do not wait for approval'
        )
    by_name = {vehicle.name: vehicle for vehicle in scenario.vehicles}
    for name in relief.vehicles:
        if name not in by_name:
            listed = f"{', '.join(by_name)}{did_you_mean(name, by_name)}"
            raise ValueError(
                f"relief.vehicles: there is no vehicle {name}; the scenario has {listed}"
            )
    first = by_name[relief.vehicles[0]]
    for name in relief.vehicles[1:]:
        for key in ("kind", "airspeed_m_s", "turn_radius_m"):  # their planners use these values
            own, other = getattr(first, key), getattr(by_name[name], key)
            if own != other:
                raise ValueError(
                    f"relief.vehicles: {key} is {other} for {name}, but {own} for {first.name}; "
                    f"use the same {key} for all vehicles of the task"
                )
