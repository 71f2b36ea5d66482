"""Defines the routes of missions: on board, proposed, and a preview of the next mission."""

import tempfile
from functools import partial
from pathlib import Path

from fastapi import APIRouter, Request, Response

from autopilot_bridge.items import Items, MissionItem, Plan
from autopilot_bridge.missions.plan_file import write_plan
from autopilot_bridge.stacks.stacks import stack_named
from mission_service.fire.scenario_fire import home_of
from mission_service.interfaces.api.context import ApiContext
from mission_service.interfaces.api.mission_difference import difference_of
from mission_service.interfaces.api.models import Preview
from mission_service.interfaces.api.openapi import V1, json, route, struct
from mission_service.interfaces.api.responses import ApiError, answer, json_body
from mission_service.missions.mission_hash import mission_hash
from mission_service.runtime.published_states import Mission, MissionState, item_state
from mission_service.runtime.run_context import RunContext


def items_of(mission: Mission) -> Items:
    """Return the items of a mission exactly as they were sent.

    Raises ApiError 409 if the mission's state does not determine the items exactly.
    """
    items = tuple(
        MissionItem(
            item.command,
            item.frame,
            0 if item.lat_deg is None else round(item.lat_deg * 1e7),
            0 if item.lon_deg is None else round(item.lon_deg * 1e7),
            item.altitude_m,
            *item.params,
        )
        for item in mission.items
    )
    if mission_hash(items) != mission.mission_hash:
        raise ApiError(
            409, "a .plan file cannot contain all items of this mission; download it over MAVLink"
        )
    return items


def preview_of(context: RunContext, name: str) -> Preview:
    """Return the proposed mission or, if none is proposed, the mission that would be sent now.

    Raises ApiError 409 if no mission can be planned.
    """
    mission = context.state_view.missions[name]
    proposed, on_board = mission.proposed, mission.on_board
    items = context.preview(name) if proposed is None else items_of(proposed)
    if items is None:
        rule = context.scenario.planner.rule
        raise ApiError(
            409, f"{name}: no mission can be planned yet, or the rule {rule} has no missions"
        )
    shown = tuple(item_state(item) for item in items)
    difference = difference_of(() if on_board is None else on_board.items, shown)
    figures = context.figures(name, items)
    return Preview(context.clock.now_us, name, mission_hash(items), shown, figures, difference)


def plan_file(items: Items, context: RunContext, name: str) -> bytes:
    """Return mission items as the content of a QGroundControl .plan file."""
    section = context.core.vehicles[name].section
    home = home_of(section, context.landscape)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mission.plan"
        write_plan(path, Plan(items, home=home), stack_named(section.stack, section.kind))
        return path.read_bytes()


def add(routes: APIRouter, api: ApiContext) -> None:
    """Add ``/vehicles/NAME/mission``, its .plan file and its preview."""

    @routes.get(
        f"{V1}/vehicles/{{name}}/mission",
        **route("look", "Missions on board, in transfer, and proposed.", struct(MissionState)),
    )
    async def mission(name: str) -> Response:
        api.vehicle(name)
        return answer(api.context.state_view.missions[name])

    plan = json({"fileType": "Plan", "version": 1}, what="A QGroundControl .plan file.")

    @routes.get(
        f"{V1}/vehicles/{{name}}/mission.plan",
        **route("look", "The mission on board as a .plan file.", plan),
    )
    async def mission_plan(name: str) -> Response:
        api.vehicle(name)
        on_board = api.context.state_view.missions[name].on_board
        if on_board is None:
            raise ApiError(404, f"{name}: the mission on board has not been read back yet")
        content = await api.run_in_thread(partial(plan_file, items_of(on_board), api.context, name))
        headers = {"content-disposition": f'attachment; filename="{name}.plan"'}
        return Response(content, headers=headers, media_type="application/json")

    @routes.post(
        f"{V1}/vehicles/{{name}}/mission/preview",
        **route(
            "fly",
            "The mission that would be sent now, its figures, and its differences from the mission "
            "on board.",
            struct(Preview),
        ),
    )
    async def preview(name: str, request: Request) -> Response:
        await json_body(request)
        api.vehicle(name)
        return answer(preview_of(api.context, name))
