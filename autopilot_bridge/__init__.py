"""A MAVLink bridge to PX4 and ArduPilot: missions, checks, transfers, clients, a mock, logs.

The package does not use the fire model or the service. A *stack* is one autopilot on one kind of
vehicle. This example reads a mission, checks it against the rules of a stack and writes it in
another format::

    from pathlib import Path
    import autopilot_bridge as bridge
    plan = bridge.read_any(Path("survey.plan"))
    print(*bridge.check(plan.mission, bridge.stack_named("ardupilot", "copter")), sep="\\n")
    bridge.write_any(Path("survey.waypoints"), plan, None)

Each name in ``__all__`` is imported when it is first used; ``import autopilot_bridge`` alone loads
no submodule.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from autopilot_bridge.clients.client_protocol import VehicleClient
    from autopilot_bridge.clients.mavsdk import MavsdkClient
    from autopilot_bridge.clients.native import NativeClient
    from autopilot_bridge.errors import BridgeError
    from autopilot_bridge.items import MissionItem, Plan, loiter_unlimited, takeoff, waypoint
    from autopilot_bridge.links.asyncio_connection import Connection
    from autopilot_bridge.logs.reading import open_log
    from autopilot_bridge.missions.check import adapted, check
    from autopilot_bridge.missions.plan_file import read_any, write_any
    from autopilot_bridge.mock.autopilot import MockAutopilot
    from autopilot_bridge.mock.local_frame import LocalFrame
    from autopilot_bridge.stacks.stacks import Stack, stack_named

__all__ = [
    "BridgeError",
    "Connection",
    "LocalFrame",
    "MavsdkClient",
    "MissionItem",
    "MockAutopilot",
    "NativeClient",
    "Plan",
    "Stack",
    "VehicleClient",
    "adapted",
    "check",
    "loiter_unlimited",
    "open_log",
    "read_any",
    "stack_named",
    "takeoff",
    "waypoint",
    "write_any",
]
_MODULES = {
    "clients.client_protocol": ("VehicleClient",),
    "clients.mavsdk": ("MavsdkClient",),
    "clients.native": ("NativeClient",),
    "errors": ("BridgeError",),
    "items": ("MissionItem", "Plan", "loiter_unlimited", "takeoff", "waypoint"),
    "links.asyncio_connection": ("Connection",),
    "logs.reading": ("open_log",),
    "missions.check": ("adapted", "check"),
    "missions.plan_file": ("read_any", "write_any"),
    "mock.autopilot": ("MockAutopilot",),
    "mock.local_frame": ("LocalFrame",),
    "stacks.stacks": ("Stack", "stack_named"),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
