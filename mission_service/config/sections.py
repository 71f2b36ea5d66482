"""Defines the tables of planners, burns, missions, links and vehicles in a scenario file."""

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from mission_service.config.rule_lookup import way_named
from mission_service.config.section_base import (
    Finite,
    Latitude,
    Line,
    Longitude,
    NotNegative,
    Positive,
    Section,
)

Share = Annotated[float, Field(ge=0, lt=1)]

ALL = "all"  # stands for all vehicles in operators' requests
KEY_SOURCE = r"file:.+|env:[A-Za-z_]\w*"


class PlannerSection(Section):
    """The planner; ``rule`` selects a way of flying (``rule_lookup.py``).

    Rules that begin with ``team.`` direct all vehicles together, with a shared map.
    """

    rule: str = "predictive"
    importance: Literal["linear", "exponential"] = "linear"  # used by teams only
    # Used only by teams with Bent's rules.
    negotiation: Literal["importance", "centre", "arrival"] = "importance"
    # The targets of a team. The team announces how many vehicles it needs to meet these targets.
    max_revisit_s: Positive | None = None
    max_unseen_advance_m: Positive | None = None
    alpha: NotNegative = 1.0
    first_direction: Literal["clockwise", "anticlockwise"] = "clockwise"
    ignition_known: bool = True
    reported_lat_deg: Latitude | None = None
    reported_lon_deg: Longitude | None = None
    baseline_s: Positive = 600.0
    smoothing_deg: Annotated[int, Field(ge=0, le=90)] = 10
    reversal_margin: NotNegative = 0.5
    min_gain_cells: NotNegative = 0.5
    dwell_s: NotNegative = 200.0

    @field_validator("rule")
    @classmethod
    def _rule_exists(cls, rule: str) -> str:
        way_named(rule)
        return rule

    @model_validator(mode="after")
    def _fire_reported(self) -> "PlannerSection":
        reported = (self.reported_lat_deg is not None, self.reported_lon_deg is not None)
        if not self.ignition_known and not all(reported):
            raise ValueError(
                "ignition_known = false requires reported_lat_deg and reported_lon_deg, a point "
                "inside the fire"
            )
        return self


class FormationSection(Section):
    """The settings of ``rule = "formation"``; the defaults are the values in the paper's table 1.

    Altitude, loiter radius, camera and airspeeds are set in the sections of the vehicles.
    """

    monitoring_m: Positive = 350.0
    agent_speed_m_s: Positive = 25.0
    safety_radius_m: Positive = 30.0
    neighbourhood_m: Positive = 500.0
    range_m: Positive = 2000.0
    # "rvo" is not available: velocity obstacles determine headings, and an autopilot that flies an
    # orbit accepts no headings.
    avoidance: Literal["intent", "none"] = "intent"
    vertical_separation_m: Positive | None = None  # height difference that needs no avoidance
    # Number of altitude layers while most messages are lost; 1: all UAVs keep their altitude.
    lossy_layers: Annotated[int, Field(ge=1, le=64)] = 8
    synchronises: bool = True
    peer_messaging: bool = False  # exchange messages with UAVs of other processes


LatLon = tuple[Latitude, Longitude]

# The burn boss's checklist for aerial ignition (NWCG PMS 515). Any open item is a NO-GO.
GO_ITEMS = (
    "firing plan approved by the burn boss",
    "two remote pilots, or one as the burn plan allows",
    "communication with the burn boss tested",
    "launch site, altitudes and return route agreed",
    "people and equipment are out of the unit",
    "weather is within the prescription",
    "payload checked: spheres, fluid, dropper",
    "battery and lost-link behaviour checked",
)


class Station(Section):
    """A position from which operators approve plans; planned fire keeps a margin from it."""

    name: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[\w-]+$")]
    lat_deg: Latitude
    lon_deg: Longitude


class Circle(Section):
    """People or objects to protect: no drop and no low flight within ``radius_m``."""

    name: Line
    lat_deg: Latitude
    lon_deg: Longitude
    radius_m: Positive


class LitLine(Section):
    """A point or a whole line that the crew lights at mission time ``at_s``."""

    points: Annotated[tuple[LatLon, ...], Field(min_length=1)]
    at_s: NotNegative = 0.0


class Dropper(Section):
    """The output that releases a sphere: set to ``release``, then after ``hold_s`` to ``rest``."""

    by: Literal["servo", "gripper", "actuator"] = "servo"
    number: Annotated[int, Field(ge=1, le=16)] = 9
    release: Finite = 1900.0  # servo: PWM in us; actuator: -1 to 1; unused for a gripper
    rest: Finite = 1100.0
    hold_s: Annotated[float, Field(gt=0, le=5)] = 0.2
    # For a sphere of 32 mm and 5 g with a drag coefficient of 0.47.
    terminal_speed_m_s: Positive = 15.0
    # Delay of link and dropper from the order to the release of the sphere.
    delay_s: NotNegative = 0.2

    @property
    def output(self) -> tuple[Literal["servo", "gripper", "actuator"], int, float, float, float]:
        """The arguments of ``autopilot_bridge.vehicle.orders.Dropper``."""
        return self.by, self.number, self.release, self.rest, self.hold_s


class BurnSection(Section):
    """The prescribed burn of ``rule = "burn"``: unit, ignition pattern and safety limits.

    Corners are (lat, lon). Drops and low paths are excluded at places that fire is expected to
    reach within ``time_margin_s``, or to approach to less than ``distance_margin_m``, until
    ``residence_s`` after the fire's arrival. Downwind of the fire, the distance margin is increased
    by the distance that the wind travels in ``wind_margin_s``.
    """

    unit: Annotated[tuple[LatLon, ...], Field(min_length=3)] | None = None
    unit_file: Path | None = None
    no_drop_file: Path | None = None
    fence: Annotated[tuple[LatLon, ...], Field(min_length=3)] | None = None
    people: tuple[Circle, ...] = ()
    stations: Annotated[tuple[Station, ...], Field(min_length=1)]
    go_items: tuple[str, ...] = GO_ITEMS
    lit: tuple[LitLine, ...] = ()
    fuel_model: int = 1  # fuel of the simulated fire; the weather sets its moistures
    corrections: Literal["paper", "gaussian"] = "gaussian"
    camera_corrects: bool = True
    line_spacing_m: Positive = 20.0
    drop_spacing_m: Positive = 15.0
    speed_m_s: Positive = 5.0
    climb_m_s: Positive = 3.0
    sink_m_s: Positive = 2.0
    drop_height_m: Positive = 15.0
    safe_height_m: Positive = 60.0
    time_margin_s: NotNegative = 60.0
    distance_margin_m: NotNegative = 10.0
    wind_margin_s: NotNegative = 2.0
    residence_s: NotNegative = 120.0
    edge_m: NotNegative = 5.0  # distance of drops from the unit's edge and from no-drop areas
    spheres: Annotated[int, Field(ge=0)] = 450
    max_drops_per_min: Positive = 120.0
    ignition_delay_s: NotNegative = 30.0
    battery_s: Positive = 1500.0  # flight time with one load of spheres
    battery_reserve_s: NotNegative = 240.0
    reload_s: NotNegative = 300.0  # time on the ground between two loads
    dropper: Dropper = Dropper()
    max_miss_m: Positive = 4.0  # a sphere with a larger predicted miss is not dropped
    approval_s: Positive = 600.0  # validity of an approval
    approver_timeout_s: Positive = 15.0  # limit between two reports of an approver's presence
    wind_changes_m_s: Positive = 2.0
    wind_changes_deg: Positive = 30.0
    min_battery_pct: Annotated[float, Field(ge=0, le=90)] = 25.0

    @model_validator(mode="after")
    def _consistent(self) -> "BurnSection":
        if (self.unit is None) == (self.unit_file is None):
            raise ValueError("specify either `unit` (its corners) or unit_file")
        if self.safe_height_m <= self.drop_height_m:
            raise ValueError("safe_height_m must be more than drop_height_m")
        min_m = self.speed_m_s * 60.0 / self.max_drops_per_min
        if self.drop_spacing_m < min_m:
            raise ValueError(
                f"drop_spacing_m must be at least {min_m:g} m at {self.speed_m_s:g} m/s and "
                f"{self.max_drops_per_min:g} drops a minute"
            )
        if len({station.name for station in self.stations}) != len(self.stations):
            raise ValueError("stations must have different names")
        return self


class MissionSection(Section):
    """The settings for converting decisions to missions.

    With ``approval = "each"`` a mission is sent to its vehicle only after an operator has accepted
    the mission. The default height of each vehicle is ``layer_m`` above that of the preceding
    vehicle in the scenario. The required vertical separation between vehicles is ``separation_m``.
    ``fire run`` computes the height up to which the fire warms the air by more than
    ``max_warming_k``.
    """

    horizon_m: Positive = 2500.0
    lookahead_m: Positive = 150.0
    path_tolerance_m: Positive = 45.0
    min_upload_interval_s: NotNegative = 4.0
    layer_m: NotNegative = 40.0
    separation_m: Positive = 30.0
    approval: Literal["none", "each"] = "none"  # each: an operator accepts every mission
    max_warming_k: Annotated[float, Field(ge=1, le=500)] | None = None


class PreflightSection(Section):
    """The sign-off of pre-flight checks before a takeoff.

    With ``signoff = "each"`` an operator signs off every takeoff. With "standing" the scenario's
    ``autostart`` is the sign-off of each vehicle's first takeoff. With ``remote_id`` a vehicle
    takes off only while its Remote ID module is ready.
    """

    signoff: Literal["standing", "each"] = "standing"
    remote_id: bool = False


class LinkSection(Section):
    """The simulated link of ``sim``; the values apply to each datagram in both directions."""

    loss: Share = 0.0
    delay_ms: NotNegative = 20.0
    jitter_ms: NotNegative = 0.0
    duplication: Share = 0.0


class VehicleSection(Section):
    """One vehicle: type, performance, camera and link."""

    name: Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[\w-]+$")]
    stack: Literal["px4", "ardupilot"] = "px4"
    kind: Literal["plane", "vtol", "copter"] = "plane"
    link: str = "udpin:127.0.0.1:14550"
    backup_link: str | None = None  # a second link, used while ``link`` is silent or loses frames
    system_id: Annotated[int, Field(ge=1, le=250)] = 1
    backend: Literal["native", "mavsdk"] = "native"
    signing_key: str | None = None  # source of the key; journals must not contain the key itself
    # The default is the vehicle's index in the scenario, from 0; the backup link has another id.
    signing_link_id: Annotated[int, Field(ge=0, le=255)] | None = None
    home_lat_deg: Latitude
    home_lon_deg: Longitude
    airspeed_m_s: Positive = 18.0
    min_airspeed_m_s: Positive = 10.0  # used for planes in a formation, like ``max_airspeed_m_s``
    max_airspeed_m_s: Positive = 25.0
    altitude_agl_m: Positive = 150.0
    turn_radius_m: Positive = 60.0
    min_leg_m: Positive = 90.0
    loiter_radius_m: Positive = 90.0
    # The camera's footprint is a disc with this field of view. With camera_along_deg, the field of
    # view along the track, the footprint is a rectangle that turns with the vehicle.
    camera_fov_deg: Annotated[float, Field(gt=0, lt=170)] = 100.0
    camera_along_deg: Annotated[float, Field(gt=0, lt=170)] | None = None
    camera_rate_hz: Annotated[float, Field(gt=0, le=4)] = 1.0
    # Distance between images along a mission's path, and pitch of the gimbal (-90: down).
    camera_trigger_m: Annotated[float, Field(ge=1, le=1000)] | None = None
    gimbal_pitch_deg: Annotated[float, Field(ge=-90, le=0)] | None = None
    endurance_s: Positive | None = None  # maximum time in the air
    endurance_reserve_s: NotNegative = 120.0  # remaining on arrival at home; at least the landing
    # Remaining charge after the landing, and the voltage below which the vehicle returns.
    battery_reserve_pct: Annotated[float, Field(ge=0, le=90)] = 20.0
    battery_min_voltage_v: Positive | None = None
    # The return, until the autopilot's parameters are read: the height above home to which copters,
    # and planes with PX4, climb first; the speed (over the ground for copters, airspeed for
    # planes); and the climb rate.
    return_height_m: NotNegative | None = None  # default: 60 with PX4, 15 with ArduPilot
    return_speed_m_s: Positive | None = None  # default: airspeed_m_s
    climb_m_s: Positive = 3.0
    max_wind_m_s: Positive | None = None  # wind in which it may take off; default: its airspeed
    autostart: bool = False
    # The reaction to a lost link that the autopilot's parameters must cause; None: any.
    lost_link: Literal["continue", "hold", "return", "land"] | None = None
    landing: bool = True  # whether missions of a PX4 plane end with a landing at home
    landing_course_deg: Annotated[float, Field(ge=0, le=360)] | None = None

    @field_validator("name")
    @classmethod
    def _one_vehicle(cls, name: str) -> str:
        if name == ALL:
            raise ValueError(f'"{ALL}" addresses all vehicles in requests; choose another name')
        return name

    @model_validator(mode="after")
    def _speeds_in_order(self) -> "VehicleSection":
        if self.min_airspeed_m_s >= self.max_airspeed_m_s:
            raise ValueError("min_airspeed_m_s must be less than max_airspeed_m_s")
        return self

    @property
    def links(self) -> tuple[str, ...]:
        """The addresses of the vehicle's links, the preferred link first."""
        return (self.link,) if self.backup_link is None else (self.link, self.backup_link)

    @model_validator(mode="after")
    def _backup_is_native(self) -> "VehicleSection":
        if self.backup_link is not None and self.backend == "mavsdk":
            raise ValueError(
                'backend = "mavsdk" cannot use a backup_link; remove this key, or use backend = '
                '"native"'
            )
        return self

    @property
    def winged(self) -> bool:
        """Whether missions are flown as by a plane: planes, and VTOLs between vertical phases.

        A VTOL takes off and lands vertically.
        """
        return self.kind != "copter"

    @property
    def is_arduplane(self) -> bool:
        """Whether the autopilot is ArduPlane, which also flies VTOLs."""
        return self.stack == "ardupilot" and self.winged

    @model_validator(mode="after")
    def _vtol_is_native(self) -> "VehicleSection":
        if self.kind == "vtol" and self.backend != "native":
            raise ValueError('kind = "vtol" requires backend = "native"')
        return self

    @model_validator(mode="after")
    def _reaction_exists(self) -> "VehicleSection":
        if self.is_arduplane and self.lost_link in ("hold", "land"):
            raise ValueError(
                f'ArduPlane has no reaction lost_link = "{self.lost_link}"; use "continue" or '
                '"return"'
            )
        return self

    @field_validator("signing_key")
    @classmethod
    def _key_is_source(cls, source: str | None) -> str | None:
        if source is not None and re.fullmatch(KEY_SOURCE, source) is None:
            raise ValueError(
                'specify the source of the key, as "file:PATH" or "env:NAME"; '
                "the key itself must not be in a scenario, because journals contain the scenario"
            )
        return source
