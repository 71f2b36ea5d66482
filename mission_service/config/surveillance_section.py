"""Defines the table [surveillance]: sources of other aircraft, alerts and resolution."""

import re
from typing import Annotated, Literal

from pydantic import Field, field_validator

from mission_service.config.section_base import Positive, Section

Format = Literal["sbs", "beast", "gdl90", "cot"]
Resolution = Literal["none", "hold", "descend", "return"]


class AircraftSource(Section):
    """A source of other aircraft.

    ``sbs`` and ``beast`` connect to a TCP server at ``address``. ``gdl90`` and ``cot`` receive UDP
    datagrams at ``address``, which may be a multicast group.
    """

    format: Format
    address: str

    @field_validator("address")
    @classmethod
    def _is_address(cls, address: str) -> str:
        found = re.fullmatch(r"(?:[\w.-]+|\[[0-9a-fA-F:]+\]):(\d{1,5})", address)
        if found is None or not 0 < int(found[1]) < 65536:
            raise ValueError('write it as HOST:PORT, as in "127.0.0.1:30003"')
        return address

    @property
    def host(self) -> str:
        """The host or multicast group."""
        return self.address.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """The port."""
        return int(self.address.rpartition(":")[2])

    @property
    def label(self) -> str:
        """The name of the source in alarms and reports."""
        return f"{self.format} {self.address}"


class SurveillanceSection(Section):
    """The surveillance of other aircraft. Reports over the links of vehicles are always used."""

    sources: tuple[AircraftSource, ...] = ()
    range_m: Annotated[float, Field(ge=2_000, le=100_000)] = 20_000.0
    qnh_hpa: Annotated[float, Field(ge=850, le=1100)] = 1013.25  # pressure reduced to sea level
    # ICAO addresses of aircraft without alerts, such as those of the run's own transponders.
    ignored: tuple[Annotated[str, Field(pattern=r"^[0-9a-fA-F]{6}$")], ...] = ()
    silent_s: Positive = 30.0  # a source without data for this time raises an alarm
    alerts: Literal[
        "small_uas",
        "do_365_en_route",
        "do_365_terminal",
        "do_365_non_cooperative",
        "buffered_en_route",
    ] = "small_uas"
    # The order of the service at a corrective alert, in force until an operator's order.
    resolution: Resolution = "descend"
    descend_to_agl_m: Annotated[float, Field(ge=20, le=300)] = 40.0  # for "descend"
