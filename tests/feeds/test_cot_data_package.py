"""Connection data packages of TAK servers: the server and the certificates in a ZIP file."""

import asyncio
import contextlib
import socket
import ssl
import subprocess
import threading
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from pydantic import ValidationError

from mission_service.config.scenario import load_run
from mission_service.config.service_section import CotSection, MqttSection
from mission_service.errors import MissionServiceError, ScenarioError
from mission_service.interfaces.cot.cot_sender import cot_interface
from mission_service.interfaces.cot.tak_endpoint import endpoint_of
from tests.feeds.background import in_background
from tests.mqtt.certificates import make_certificates
from tests.mqtt.stage import context_of
from tests.patience import PATIENCE_S, until

PREF = """<?xml version='1.0' encoding='ASCII' standalone='yes'?>
<preferences>
  <preference version="1" name="cot_streams">
    <entry key="count" class="class java.lang.Integer">1</entry>
    <entry key="description0" class="class java.lang.String">County TAK</entry>
    <entry key="enabled0" class="class java.lang.Boolean">true</entry>
    <entry key="connectString0" class="class java.lang.String">{server}</entry>
  </preference>
  <preference version="1" name="com.atakmap.app_preferences">
    <entry key="caLocation" class="class java.lang.String">/storage/emulated/0/cert/ca.p12</entry>
    <entry key="caPassword" class="class java.lang.String">atakatak</entry>
    <entry key="clientPassword" class="class java.lang.String">client's</entry>
    <entry key="certificateLocation" class="class java.lang.String">cert/Client.p12</entry>
  </preference>
</preferences>
"""
MANIFEST = """<MissionPackageManifest version="2">
  <Configuration><Parameter name="name" value="County_DP"/></Configuration>
  <Contents>
    <Content ignore="false" zipEntry="certs\\server.pref"/>
    <Content ignore="false" zipEntry="certs\\ca.p12"/>
    <Content ignore="false" zipEntry="certs\\Client.p12"/>
  </Contents>
</MissionPackageManifest>
"""


def pkcs12(folder: Path, name: str, password: str, *more: str) -> bytes:
    """Return the certificate NAME.pem and its key, unless ``more`` has -nokeys, as PKCS #12."""
    words = ["pkcs12", "-export", "-in", f"{name}.pem", "-passout", f"pass:{password}", *more]
    words += [] if "-nokeys" in more else ["-inkey", f"{name}.key"]
    done = subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)
    return done.stdout


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of a package by path; the server is broker.pem of ``make_certificates``."""
    folder = tmp_path_factory.mktemp("certificates")
    make_certificates(folder)
    certificates = {
        f"pem/{name}": (folder / name).read_bytes()
        for name in ("ca.pem", "broker.pem", "broker.key", "other-ca.pem")
    }
    return certificates | {
        "MANIFEST/manifest.xml": MANIFEST.encode(),
        "certs/server.pref": PREF.format(server="127.0.0.1:8089:ssl").encode(),
        # As TAK Server's scripts write them: without a key, and with encryption of 2009.
        "certs/ca.p12": pkcs12(folder, "ca", "atakatak", "-nokeys"),
        "certs/Client.p12": pkcs12(folder, "client", "client's", "-legacy"),
        "other/ca.p12": pkcs12(folder, "other-ca", "atakatak", "-nokeys"),
    }


def packed(path: Path, files: dict[str, bytes], **changes: bytes | None) -> Path:
    """Write a package; ``changes`` replace files by name with the ending ``_``, None removes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            if name.startswith(("certs/", "MANIFEST/")):
                new = changes.get(Path(name).stem.lower(), data)
                if new is not None:
                    archive.writestr(name, new)
    return path


def pref(server: str) -> bytes:
    return PREF.format(server=server).encode()


def test_a_service_connects_with_a_package_and_both_sides_are_verified(
    tmp_path: Path, files: dict[str, bytes]
) -> None:
    for name, data in files.items():
        if name.startswith("pem/"):
            (tmp_path / Path(name).name).write_bytes(data)
    tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=tmp_path / "ca.pem")
    tls.verify_mode = ssl.CERT_REQUIRED
    tls.load_cert_chain(tmp_path / "broker.pem", tmp_path / "broker.key")
    got = bytearray()

    async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(65_536):
            got.extend(data)
        writer.close()

    async def look() -> None:
        server = await asyncio.start_server(take, "127.0.0.1", 0, ssl=tls)
        text = pref(f"127.0.0.1:{server.sockets[0].getsockname()[1]}:ssl")
        good = packed(tmp_path / "good.zip", files, server=text)
        bad = packed(tmp_path / "bad.zip", files, server=text, ca=files["other/ca.p12"])
        async with server:
            context = context_of(MqttSection(), lambda request: {})
            settings = CotSection(data_package=bad, every_s=0.1)
            async with in_background(cot_interface(settings, "east")(context)):
                await until(lambda: "verify failed" in str(context.state_view.alarms.get("cot")))
            assert not got
            settings = CotSection(data_package=good, every_s=0.1)
            async with in_background(cot_interface(settings, "east")(context)):
                await until(lambda: b"east.fire.1" in got)
            named = settings.model_copy(update={"tls_server_name": "tak.example"})
            async with in_background(cot_interface(named, "east")(context)):
                await until(lambda: "tak.example" in str(context.state_view.alarms.get("cot")))

    asyncio.run(look())


def test_the_server_is_that_of_the_package(tmp_path: Path, files: dict[str, bytes]) -> None:
    def found(server: str) -> tuple[str, bool]:
        path = packed(tmp_path / "package.zip", files, server=pref(server))
        endpoint = endpoint_of(CotSection(data_package=path))
        return endpoint.url, endpoint.tls is not None

    assert found("tak.example:8089:ssl") == ("tls://tak.example:8089", True)
    assert found("2001:db8::1:8088:tcp") == ("tcp://[2001:db8::1]:8088", False)


def test_a_package_of_itak_has_no_manifest(tmp_path: Path, files: dict[str, bytes]) -> None:
    path = packed(tmp_path / "itak.zip", files, manifest=None)
    assert endpoint_of(CotSection(data_package=path)).port == 8089


def test_a_password_outside_the_package_applies(
    tmp_path: Path, files: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = files["certs/server.pref"].replace(b"client's", b"").replace(b"atakatak", b"")
    path = packed(tmp_path / "package.zip", files, server=text)
    settings = CotSection(data_package=path, data_package_password="env:TAK_PASSWORD")
    with pytest.raises(MissionServiceError, match="variable TAK_PASSWORD is not set"):
        endpoint_of(settings)
    monkeypatch.setenv("TAK_PASSWORD", "wrong")
    with pytest.raises(MissionServiceError, match=r"the password of ca\.p12 is wrong"):
        endpoint_of(settings)
    with pytest.raises(MissionServiceError, match=r"the password of ca\.p12 is wrong"):
        endpoint_of(CotSection(data_package=path))


Changed = Callable[[dict[str, bytes]], dict[str, bytes | None]]
DAMAGED: dict[str, tuple[Changed, str]] = {
    "missing": (lambda files: {"ca": None}, "ca.p12, which its manifest lists, is missing"),
    "pref": (lambda files: {"server": None, "manifest": None}, "contains no .pref file"),
    "xml": (lambda files: {"server": b"<preferences"}, "server.pref is not valid XML"),
    "doctype": (lambda files: {"manifest": b"<!DOCTYPE a><a/>"}, "contains a DOCTYPE"),
    "p12": (
        lambda files: {"client": files["certs/Client.p12"][:500]},
        "client.p12 is not a PKCS #12 file",
    ),
    "no key": (lambda files: {"client": None, "manifest": None}, "client.p12, the file named by"),
    "enrolment": (
        lambda files: {"server": files["certs/server.pref"].replace(b"certificateLoc", b"x")},
        "contains no client certificate",
    ),
    "no server": (lambda files: {"server": b"<preferences/>"}, "connectString0 is ''"),
    "protocol": (lambda files: {"server": pref("a:8089:quic")}, "only HOST:PORT:ssl and"),
    "port": (lambda files: {"server": pref("a:0:ssl")}, "'0' is not a port"),
}


@pytest.mark.parametrize("fault", DAMAGED)
def test_a_damaged_package_is_refused_with_one_line(
    fault: str, tmp_path: Path, files: dict[str, bytes]
) -> None:
    change, text = DAMAGED[fault]
    path = packed(tmp_path / "package.zip", files, **change(files))
    with pytest.raises(MissionServiceError) as refused:
        cot_interface(CotSection(data_package=path), "east")
    assert text in str(refused.value)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


def test_truncated_packages_are_refused(tmp_path: Path, files: dict[str, bytes]) -> None:
    data = packed(tmp_path / "package.zip", files).read_bytes()
    short = tmp_path / "short.zip"
    for size in range(0, len(data), 97):
        short.write_bytes(data[:size])
        with pytest.raises(MissionServiceError, match=r"corrupt: it is not a complete ZIP file"):
            endpoint_of(CotSection(data_package=short))
    with zipfile.ZipFile(short, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("server.pref", bytes(11_000_000))
    with pytest.raises(MissionServiceError, match="more than 10000000 bytes"):
        endpoint_of(CotSection(data_package=short))


def test_a_package_replaces_the_other_keys(tmp_path: Path) -> None:
    package = tmp_path / "package.zip"
    with pytest.raises(ValidationError, match="remove it, or remove tls_ca, url"):
        CotSection(data_package=package, url="tls://a:1", tls_ca=package)
    with pytest.raises(ValidationError, match="data_package_password requires data_package"):
        CotSection(data_package_password="env:A")
    with pytest.raises(ValidationError, match="specify the source of the password"):
        CotSection(data_package=package, data_package_password="secret")
    with pytest.raises(ScenarioError, match=r"data_package: no such file"):
        load_run("demo", ("service.cot.data_package=none.zip",))


def issued(folder: Path, name: str, days: int) -> None:
    """Write NAME.pem, a certificate of ca.pem for 127.0.0.1 that ends in ``days``, and NAME.key."""
    authority = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
    authority_key = serialization.load_pem_private_key((folder / "ca.key").read_bytes(), None)
    assert isinstance(authority_key, ec.EllipticCurvePrivateKey)
    key, end = ec.generate_private_key(ec.SECP256R1()), datetime.now(UTC) + timedelta(days=days)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
        .issuer_name(authority.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(end - timedelta(days=9))
        .not_valid_after(end)
        .add_extension(
            x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), critical=False
        )
        .sign(authority_key, hashes.SHA256())
    )
    form = (
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    (folder / f"{name}.key").write_bytes(key.private_bytes(*form))
    (folder / f"{name}.pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def test_an_expired_certificate_of_the_server_is_reported(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    issued(tmp_path, "old", -1)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(tmp_path / "old.pem", tmp_path / "old.key")
    assert "certificate has expired" in reported(tls, tmp_path, "client")


def test_an_expired_certificate_of_the_service_is_reported(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    issued(tmp_path, "old", -1)
    tls = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=tmp_path / "ca.pem")
    tls.verify_mode = ssl.CERT_REQUIRED
    tls.load_cert_chain(tmp_path / "broker.pem", tmp_path / "broker.key")
    assert "certificate expired" in reported(tls, tmp_path, "old")


def reported(server_tls: ssl.SSLContext, folder: Path, name: str) -> str:
    """Return the alarm of a service with a certificate of this name."""
    listener = socket.create_server(("127.0.0.1", 0))
    context = context_of(MqttSection(), lambda request: {})

    def serve() -> None:
        """Serve until the listener is closed; asyncio's server would not send TLS alerts."""
        with contextlib.suppress(OSError):
            while True:
                client, _ = listener.accept()
                with (
                    contextlib.suppress(OSError),
                    server_tls.wrap_socket(client, server_side=True) as connection,
                ):
                    while connection.recv(65_536):
                        pass

    async def look() -> None:
        settings = CotSection(
            url=f"tls://127.0.0.1:{listener.getsockname()[1]}",
            every_s=0.1,
            tls_ca=folder / "ca.pem",
            tls_certificate=folder / f"{name}.pem",
            tls_key=folder / f"{name}.key",
        )
        async with in_background(cot_interface(settings, "east")(context)):
            await until(lambda: "expired" in str(context.state_view.alarms.get("cot")))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        asyncio.run(look())
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(PATIENCE_S)
    return context.state_view.alarms["cot"].text
