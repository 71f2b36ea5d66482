"""Parses the address of an MQTT broker and checks the topic prefix."""

import re
from dataclasses import dataclass

from mission_service.errors import MissionServiceError

PREFIX = "mission-service"
VERSION = "v1"
PORT, TLS_PORT = 1883, 8883


@dataclass(frozen=True, slots=True)
class Broker:
    """The address of an MQTT broker."""

    host: str
    port: int = PORT

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def read_broker(text: str, option: str = "--broker", port: int = PORT) -> Broker:
    """Parse HOST or HOST:PORT. Raises MissionServiceError with the name of the option."""
    found = re.fullmatch(r"([\w.-]+|\[[0-9a-fA-F:]+\])(?::(\d{1,5}))?", text)
    number = int(found[2] or port) if found else 0
    if found is None or not 0 < number < 65536 or not is_host(found[1]):
        raise MissionServiceError(f"{option} {text}: write it as HOST or HOST:PORT")
    return Broker(found[1].strip("[]"), number)


def is_host(text: str) -> bool:
    """Return whether a host name is valid (IDNA).

    Python's encoder raises UnicodeError for some invalid names.
    """
    try:
        text.encode("idna")
    except UnicodeError:
        return False
    return True


def check_prefix(prefix: str, option: str = "--prefix") -> str:
    """Return the topic prefix unchanged; raise MissionServiceError for an invalid prefix."""
    if re.fullmatch(r"[^/+#$\s\0][^+#\s\0]*(?<!/)", prefix) is None:
        raise MissionServiceError(
            f"{option} {prefix}: not a valid topic prefix; use a form such as uav/east"
        )
    return prefix


def site_of(scenario_name: str) -> str:
    """Return the name of a scenario as one topic level."""
    return re.sub(r"[^\w-]+", "-", scenario_name).strip("-") or "site"


def site_topic(prefix: str, site: str) -> str:
    """Return the prefix of all topics of a site."""
    return f"{prefix}/{VERSION}/{site}"
