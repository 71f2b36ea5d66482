"""Determines which vehicle may fly a task next, and reports the task's roles and lapses. Pure."""

from collections.abc import Mapping

from mission_service.commands import (
    AnyCommand,
    ClearAlarm,
    RaiseAlarm,
    ReliefRole,
    Severity,
    ShowRelief,
)
from mission_service.relief.task_relief import ReliefTask, TaskRole, TaskVehicle
from mission_service.vehicles.endurance import time_up_words
from mission_service.vehicles.vehicle_state import Vehicle, announce

ALARM = "relief"
GAP_S = 120.0  # time without a vehicle on task after which an alarm is raised

Vehicles = Mapping[str, Vehicle]
Alarm = tuple[str, Severity, str]  # vehicle, severity and text


def takeoff_obstacle(vehicle: Vehicle, at_s: float) -> str:
    """Return why a vehicle cannot take off to fly the task now; "" if it can."""
    availability = vehicle.availability
    if not availability.online or vehicle.unconfirmed is not None:
        return "has no link"
    if availability.airborne or availability.armed:
        return "is not on the ground"
    if vehicle.waits_for_operator:
        return "waits for sign-off"
    if vehicle.ordered or availability.recalled:
        return "was ordered to stay"
    if availability.fix is None or not availability.position_good:
        return "has no position fix"
    return "does not have enough energy" if time_up_words(vehicle, at_s) else ""


def next_vehicle(task: ReliefTask, vehicles: Vehicles, at_s: float) -> str | None:
    """Return the vehicle that flies the task next, or None if none may take off."""
    return task.next_of(
        [name for name, each in vehicles.items() if not takeoff_obstacle(each, at_s)]
    )


def lapse_alarm(
    task: ReliefTask, vehicles: Vehicles, needs_next: bool, at_s: float
) -> Alarm | None:
    """Return the alarm about a task that lapses now or will lapse soon, or None.

    ``needs_next`` states whether the next vehicle should take off soon.
    """
    if task.place is None:
        return None
    present = task.one_with(TaskRole.ON_TASK)
    relief = task.one_with(TaskRole.RELIEVES, TaskRole.RESUMES)
    if present is None:
        if relief is None:
            return task.holder, "severe", f"the task lapses: {_why_none(task, vehicles, at_s)}"
        if task.alarm is None and at_s - task.left_at_s <= GAP_S:
            return None
        return task.holder, "severe", f"the task lapses until {relief.name} resumes it"
    if relief is not None or not needs_next or next_vehicle(task, vehicles, at_s) is not None:
        return None
    why = _why_none(task, vehicles, at_s)
    return present.name, "warning", f"the task lapses when {present.name} must leave: {why}"


def _why_none(task: ReliefTask, vehicles: Vehicles, at_s: float) -> str:
    """Return why each vehicle cannot take off."""
    present = task.one_with(TaskRole.ON_TASK)
    others = [each for name, each in vehicles.items() if present is None or name != present.name]
    obstacles = [(each.name, takeoff_obstacle(each, at_s)) for each in others]
    return ", ".join(f"{name} {why}" for name, why in obstacles if why)


def changed_alarm(task: ReliefTask, alarm: Alarm | None, vehicles: Vehicles) -> list[AnyCommand]:
    """Record an alarm; return the commands that raise it or clear the previous one."""
    if alarm == task.alarm:
        return []
    before, task.alarm = task.alarm, alarm
    commands: list[AnyCommand] = []
    if before is not None and (alarm is None or alarm[0] != before[0]):
        commands.append(ClearAlarm(before[0], ALARM))
    if alarm is not None:
        name, severity, words = alarm
        commands.append(announce(vehicles[name], words, warning=True))
        commands.append(RaiseAlarm(name, ALARM, words, severity))
    return commands


def changed_roles(
    task: ReliefTask, vehicles: Vehicles, standing_signoff: bool, at_s: float
) -> list[AnyCommand]:
    """Record the roles that have changed, and return the commands that show them."""
    commands: list[AnyCommand] = []
    planned = next_vehicle(task, vehicles, at_s)
    for name, member in task.members.items():
        role: ReliefRole = member.role.value
        text = _text(task, member, vehicles, planned)
        if text == "waits for sign-off" and standing_signoff and member.released:
            text = "waits for a full battery"
        if (role, text) != member.shown:
            member.shown = (role, text)
            commands.append(ShowRelief(name, role, text))
    return commands


def _text(task: ReliefTask, member: TaskVehicle, vehicles: Vehicles, planned: str | None) -> str:
    """Return a vehicle's role in a few words."""
    vehicle, present = vehicles[member.name], task.one_with(TaskRole.ON_TASK)
    if member.role is TaskRole.LEAVES:
        return "flies home" if vehicle.availability.online else "no link"
    if member.role is TaskRole.STANDS_BY and vehicle.waits_for_operator:
        return "waits for sign-off"
    taken = task.one_with(TaskRole.RELIEVES, TaskRole.RESUMES) is not None
    if member.role is TaskRole.STANDS_BY and (member.name != planned or present is None or taken):
        return "stands by"
    if member.role is TaskRole.ON_TASK:
        return "on task"
    if present is None:
        return "resumes the task" if task.place is not None else "takes off"
    found = vehicles[present.name].energy.estimate
    if found is None:
        return f"relieves {present.name}"
    return f"relieves {present.name} in {max(found.time_on_task_s, 0.0) / 60.0:.0f} min"
