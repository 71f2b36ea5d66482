"""Determines the server or group of ``[service.cot]``: from ``url`` or from a data package."""

import secrets
import ssl
import tempfile
from typing import NamedTuple

from autopilot_bridge.errors import BridgeError
from autopilot_bridge.links.signing import held
from mission_service.config.service_section import CotSection
from mission_service.errors import MissionServiceError
from mission_service.interfaces.cot.data_package import DataPackage, read_data_package
from mission_service.interfaces.mqtt.broker_connection import tls_of
from mission_service.runtime.redaction import hide


class TakEndpoint(NamedTuple):
    """A server or group; ``tls`` verifies the server and authenticates this client."""

    scheme: str  # udp, tcp or tls
    host: str
    port: int
    tls: ssl.SSLContext | None

    @property
    def url(self) -> str:
        """The address as one text."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def endpoint_of(settings: CotSection) -> TakEndpoint:
    """Return the configured endpoint, from its files. Raises MissionServiceError."""
    if settings.data_package is None:
        tls = None
        if settings.scheme == "tls":
            tls = tls_of(settings.tls_ca, settings.tls_certificate, settings.tls_key)
        return TakEndpoint(settings.scheme, settings.host, settings.port, tls)
    password = None
    if settings.data_package_password is not None:
        try:
            password = held(settings.data_package_password, "service.cot data_package_password")
        except BridgeError as error:
            raise MissionServiceError(str(error)) from None
        hide(password)
    key_password = secrets.token_hex(32).encode()
    package = read_data_package(settings.data_package, password, key_password)
    tls = _tls_of(package, key_password) if package.scheme == "tls" else None
    return TakEndpoint(package.scheme, package.host, package.port, tls)


def _tls_of(package: DataPackage, key_password: bytes) -> ssl.SSLContext:
    """Return a context that trusts only the authorities in the package."""
    context = ssl.create_default_context(cadata=package.authorities)
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN  # a package may omit the root authority
    # OpenSSL reads certificates only from files; the key in this one is encrypted.
    with tempfile.NamedTemporaryFile(suffix=".pem") as file:
        file.write(package.client_pem)
        file.flush()
        try:
            context.load_cert_chain(file.name, password=key_password)
        except ssl.SSLError as error:
            text = f"service.cot data_package: the certificate and key cannot be used: {error}"
            raise MissionServiceError(text) from None
    return context
