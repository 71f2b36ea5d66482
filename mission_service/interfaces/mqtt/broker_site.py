"""Reads the broker, the credentials and the topics that ``[service.mqtt]`` configures."""

from dataclasses import dataclass

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.signing import held
from mission_service.config.mqtt_names import (
    PORT,
    TLS_PORT,
    Broker,
    read_broker,
    site_of,
    site_topic,
)
from mission_service.config.service_section import MqttSection
from mission_service.errors import MissionServiceError
from mission_service.interfaces.mqtt.broker_connection import OPEN, BrokerAccess, tls_of
from mission_service.runtime.redaction import hide

TABLE = "[service.mqtt]"


@dataclass(frozen=True, slots=True)
class Site:
    """A broker, its credentials, and the prefix of all topics of a site."""

    broker: Broker
    access: BrokerAccess
    topic: str


def site_in(settings: MqttSection, scenario_name: str) -> Site:
    """Return the configured site.

    The password and the certificates are read from files or environment variables. Raises
    MissionServiceError for invalid settings.
    """
    topic = site_topic(settings.prefix, site_of(scenario_name))
    return Site(_broker_in(settings), _access_in(settings), topic)


def access_for(broker: Broker, settings: MqttSection | None) -> BrokerAccess:
    """Return the credentials of ``settings`` if they configure this broker, else ``OPEN``.

    Vehicles in separate processes may use the broker to which the service publishes the run. Raises
    MissionServiceError.
    """
    if settings is None or _broker_in(settings) != broker:
        return OPEN
    return _access_in(settings)


def _broker_in(settings: MqttSection) -> Broker:
    port = TLS_PORT if _uses_tls(settings) else PORT
    return read_broker(settings.broker, f"{TABLE} broker", port)


def _uses_tls(settings: MqttSection) -> bool:
    return settings.tls or settings.tls_ca is not None or settings.tls_certificate is not None


def _access_in(settings: MqttSection) -> BrokerAccess:
    password = None
    if settings.password is not None:
        if settings.user is None:
            raise MissionServiceError(f"{TABLE} password: requires a user; set `user` as well")
        try:
            password = held(settings.password, f"{TABLE} password")
            hide(password)
        except BridgeError as error:
            raise MissionServiceError(str(error)) from None
    tls = None
    if _uses_tls(settings):
        tls = tls_of(settings.tls_ca, settings.tls_certificate, settings.tls_key)
    return BrokerAccess(settings.user, password, tls)
