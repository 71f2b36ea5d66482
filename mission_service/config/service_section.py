"""Defines the table [service]: interfaces, journal and shutdown of the daemon.

The table is in the scenario file, but is neither part of the scenario nor in the journal, so that a
run can resume with different ports.
"""

import ipaddress
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from mission_service.config.mqtt_names import check_prefix, is_host, read_broker
from mission_service.config.section_base import NotNegative, Positive, Section
from mission_service.config.sections import KEY_SOURCE
from mission_service.errors import MissionServiceError

LOOPBACK = ("127.0.0.1", "::1", "localhost")
DEFAULT_ADDRESS = "127.0.0.1:8765"


class HttpSection(Section):
    """The HTTP interface and the map; addresses other than loopback require tokens and TLS.

    Without ``listen``, the address is the default one, or a free port if that port is in use.
    """

    listen: str | None = None
    hosts: tuple[str, ...] = ()  # further names of this host in URLs
    tokens: Path | None = None
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    basemaps: str | None = None  # folder of PMTiles, MBTiles and GeoTIFF files

    @field_validator("listen")
    @classmethod
    def _is_address(cls, listen: str | None) -> str | None:
        if listen is None:
            return None
        found = re.fullmatch(r"([\w.-]+|\[[0-9a-fA-F:]+\]):(\d{1,5})", listen)
        if found is None or int(found[2]) > 65535:
            raise ValueError('write it as HOST:PORT, as in "127.0.0.1:8765"')
        return listen

    @model_validator(mode="after")
    def _safe_beyond_loopback(self) -> "HttpSection":
        if (self.tls_certificate is None) != (self.tls_key is None):
            raise ValueError("TLS requires both tls_certificate and tls_key")
        if self.host not in LOOPBACK and (self.tokens is None or self.tls_certificate is None):
            raise ValueError(
                f"listen = {self.listen!r} is not a loopback address: set `tokens`, "
                "tls_certificate and tls_key, or listen on 127.0.0.1"
            )
        return self

    @property
    def address(self) -> str:
        """The address as HOST:PORT."""
        return self.listen or DEFAULT_ADDRESS

    @property
    def host(self) -> str:
        """The host to listen on."""
        return self.address.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """The port to listen on; 0 selects a free port."""
        return int(self.address.rpartition(":")[2])


class MqttSection(Section):
    """The MQTT broker to publish to; commands are accepted only with ``commands = true``."""

    broker: str = "127.0.0.1:1883"
    prefix: str = "mission-service"
    user: str | None = None
    password: str | None = None  # "file:PATH" or "env:NAME"
    tls: bool = False
    tls_ca: Path | None = None
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    commands: bool = False
    telemetry_hz: Annotated[float, Field(gt=0, le=10)] = 2.0

    @field_validator("broker")
    @classmethod
    def _is_broker(cls, broker: str) -> str:
        with _as_value_error():
            read_broker(broker, "")
        return broker

    @field_validator("prefix")
    @classmethod
    def _is_prefix(cls, prefix: str) -> str:
        with _as_value_error():
            return check_prefix(prefix, "")

    @field_validator("password")
    @classmethod
    def _password_is_source(cls, source: str | None) -> str | None:
        return _password_source(source)


@contextmanager
def _as_value_error() -> Iterator[None]:
    """Raise ValueError, as validators must, in place of MissionServiceError."""
    try:
        yield
    except MissionServiceError as error:
        raise ValueError(str(error).strip()) from None


def _password_source(source: str | None) -> str | None:
    if source is not None and re.fullmatch(KEY_SOURCE, source) is None:
        raise ValueError('specify the source of the password, as "file:PATH" or "env:NAME"')
    return source


def _is_multicast(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_multicast
    except ValueError:  # a name
        return False


Names = Annotated[tuple[str, ...], Field(min_length=1)]
Percent = Annotated[float, Field(ge=0, lt=100)]


class CotPeopleSection(Section):
    """Selects the people in TAK; the service uses their positions.

    A person must belong to one of ``groups`` and have one of ``roles`` (not case-sensitive).
    """

    groups: Names  # team colours
    roles: Names

    def accepts_group(self, group: str) -> bool:
        """Return whether people with this team colour are accepted."""
        return group.casefold() in (each.casefold() for each in self.groups)

    def accepts_role(self, role: str) -> bool:
        """Return whether people with this role are accepted."""
        return role.casefold() in (each.casefold() for each in self.roles)


class CotReportsSection(CotPeopleSection):
    """The people whose markers and shapes in TAK are observations of the fire."""

    position_sd_m: Annotated[float, Field(gt=0, le=1000)] = 25.0  # minimum, of a drawn place
    # A TAK user is not identified, and a marker may be wrong. With any fraction above 0, a second
    # report may be required.
    false_alarms_pct: Percent = 5.0
    missed_pct: Percent = 5.0
    max_age_s: Annotated[float, Field(gt=0, le=21_600)] = 3600.0  # older reports are not used


class CotSection(Section):
    """The TAK server or group that receives Cursor on Target events and sends reports.

    Examples of ``url`` are ``udp://239.2.3.1:6969``, ``tcp://HOST:8087`` and ``tls://HOST:8089``.
    A data package of a TAK server replaces ``url`` and the certificates.
    """

    url: str = "udp://239.2.3.1:6969"
    every_s: Annotated[float, Field(ge=0.1, le=600)] = 2.0
    tls_ca: Path | None = None
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    # Name in the server's certificate, if it differs from the host of the connection.
    tls_server_name: Annotated[str, Field(min_length=1)] | None = None
    data_package: Path | None = None
    # Password of the certificates in the data package, as "file:PATH" or "env:NAME"; without this
    # key the passwords in the package apply.
    data_package_password: str | None = None
    # Severe alarms are sent as chat messages to all; "all" adds the other alarms.
    chat: Literal["none", "severe", "all"] = "severe"
    reports: CotReportsSection | None = None
    people: CotPeopleSection | None = None

    @model_validator(mode="after")
    def _events_arrive(self) -> "CotSection":
        receives = self.reports is not None or self.people is not None
        is_udp = self.data_package is None and self.scheme == "udp"
        if receives and is_udp and not _is_multicast(self.host):
            raise ValueError(
                f"no events arrive from {self.url}: use a TAK server (tcp:// or tls://) or a "
                'multicast group, such as "udp://239.2.3.1:6969"'
            )
        return self

    @model_validator(mode="after")
    def _one_server(self) -> "CotSection":
        if self.data_package is None:
            if self.data_package_password is not None:
                raise ValueError("data_package_password requires data_package")
            return self
        replaced = {"url", "tls_ca", "tls_certificate", "tls_key"} & self.model_fields_set
        if replaced:
            raise ValueError(
                f"data_package contains the server and its certificates: remove it, or remove "
                f"{', '.join(sorted(replaced))}"
            )
        return self

    @field_validator("data_package_password")
    @classmethod
    def _is_source(cls, source: str | None) -> str | None:
        return _password_source(source)

    @field_validator("url")
    @classmethod
    def _is_url(cls, url: str) -> str:
        found = re.fullmatch(r"(udp|tcp|tls)://([\w.-]+|\[[0-9a-fA-F:]+\]):(\d{1,5})", url)
        if found is None or not 0 < int(found[3]) < 65536 or not is_host(found[2]):
            raise ValueError(
                'write it as "udp://HOST:PORT", "tcp://HOST:PORT" or "tls://HOST:PORT"'
            )
        return url

    @property
    def scheme(self) -> str:
        """The transport: udp, tcp or tls."""
        return self.url.partition(":")[0]

    @property
    def host(self) -> str:
        """The destination host."""
        return self.url.partition("://")[2].rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """The destination port."""
        return int(self.url.rpartition(":")[2])


class AlarmReceiverSection(Section):
    """A receiver of alarms: e-mail, text message, webhook, and others (URLs of Apprise).

    An alarm is sent when it has been active for ``after_s`` without acknowledgement, and again
    every ``repeat_s`` until an operator acknowledges it.
    """

    name: Annotated[str, Field(min_length=1, max_length=40)]
    # Such as "mailtos://USER:PASSWORD@HOST?to=ADDRESS" or "jsons://HOST/PATH"; or the source of the
    # URL, "file:PATH" or "env:NAME", because a URL may contain a password.
    url: Annotated[str, Field(min_length=1)]
    min_severity: Literal["warning", "severe"] = "severe"
    kinds: tuple[str, ...] = ()  # beginnings of keys of alarms, such as "fire_arrival"; empty: all
    after_s: Annotated[float, Field(ge=0, le=86_400)] = 0.0
    repeat_s: Annotated[float, Field(ge=60, le=86_400)] | None = None


class FireArrivalSection(Section):
    """The forecast arrival of the fire at people and at values at risk, and its alarms.

    An alarm is raised while the fire arrives within ``warn_min`` with a probability of 10 %; it is
    severe within ``severe_min``.
    """

    values: tuple[Path, ...] = ()  # roads, structures, areas: GeoJSON, KML, KMZ, zipped Shapefile
    warn_min: Annotated[float, Field(gt=0, le=360)] = 60.0
    severe_min: Annotated[float, Field(ge=0, le=360)] = 20.0
    distance_m: Annotated[float, Field(ge=0, le=1000)] = 50.0  # fire so near has arrived
    every_s: Annotated[float, Field(ge=5, le=600)] = 30.0

    @model_validator(mode="after")
    def _severe_is_later(self) -> "FireArrivalSection":
        if self.severe_min > self.warn_min:
            raise ValueError(
                f"severe_min = {self.severe_min:g} is longer than warn_min = {self.warn_min:g}: an "
                "alarm is a warning before it is severe"
            )
        return self


class JournalSection(Section):
    """Rotation and retention of the journal on disk."""

    rotate_mb: Positive = 64.0  # size of one segment of the journal
    # Maximum size of all segments together; the oldest are deleted first. Default: no segment is
    # deleted.
    keep_mb: Positive | None = None
    state_every_s: Positive = 30.0


class ServiceSection(Section):
    """The interfaces, the journal and the shutdown of the daemon."""

    http: HttpSection | None = HttpSection()
    mqtt: MqttSection | None = None
    cot: CotSection | None = None
    fire_arrival: FireArrivalSection | None = None
    alarm_receivers: tuple[AlarmReceiverSection, ...] = ()
    journal: JournalSection = JournalSection()
    # The command to vehicles at an orderly shutdown: none (missions end in a loiter), a hold at the
    # current position, or a return home.
    on_shutdown: Literal["leave", "hold", "return"] = "leave"
    shutdown_s: NotNegative = 5.0  # maximum wait for acknowledgements

    @field_validator("http", mode="before")
    @classmethod
    def _false_is_none(cls, http: object) -> object:
        if http is True:
            raise ValueError("use false, or a table [service.http]")
        return None if http is False else http

    @field_validator("alarm_receivers")
    @classmethod
    def _names_differ(
        cls, receivers: tuple[AlarmReceiverSection, ...]
    ) -> tuple[AlarmReceiverSection, ...]:
        names = [each.name for each in receivers]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two receivers have the name {name!r}; use different names")
        return receivers
