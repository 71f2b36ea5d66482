"""Reads the connection data packages that TAK servers issue to clients (ATAK, WinTAK, iTAK).

A package is a ZIP file: ``MANIFEST/manifest.xml`` lists its files (iTAK: no manifest); a ``.pref``
file contains the address of the server, the names of two PKCS #12 files and their passwords; the
PKCS #12 files contain the authority of the server's certificate, and the client's certificate and
key. Paths in the ``.pref`` file are those on a phone, so files are found by name.
"""

import lzma
import re
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree

from mission_service.errors import MissionServiceError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes
    from cryptography.x509 import Certificate

MAX_PACKAGE_BYTES, MAX_FILES = 10_000_000, 100
SCHEMES = {"ssl": "tls", "tls": "tls", "tcp": "tcp"}


class DataPackage(NamedTuple):
    """The server in a package, with PEM texts that are empty for a server without TLS.

    ``client_pem`` contains the key of the client, encrypted with the given password, and then
    its certificates.
    """

    scheme: str  # tcp or tls
    host: str
    port: int
    authorities: str
    client_pem: bytes


def read_data_package(path: Path, password: str | None, key_password: bytes) -> DataPackage:
    """Return the first server of a package; raises MissionServiceError.

    Args:
        path: The ZIP file.
        password: Password of both PKCS #12 files; None: the passwords in the package.
        key_password: The password with which the returned key is encrypted.
    """
    files = _unpacked(path)
    preferences = _preferences(files, path)
    scheme, host, port = _server(preferences.get("connectString0", ""), path)
    if scheme == "tcp":
        return DataPackage(scheme, host, port, "", b"")
    if preferences.get("useAuth0") == "true" or "certificateLocation" not in preferences:
        raise MissionServiceError(
            f"{path}: the package contains no client certificate, and requesting one by user name "
            "and password is not supported: ask the server's administrator for a package with one"
        )
    trusted = _certificate_file(files, preferences, "ca", password, path)
    own = _certificate_file(files, preferences, "client", password, path)
    return DataPackage(
        scheme,
        host,
        port,
        _authorities(*trusted, path),
        _client_certificate(*own, key_password, path),
    )


def _unpacked(path: Path) -> dict[str, bytes]:
    """Return the files of a package by lower-case name, without folders."""
    found: dict[str, bytes] = {}
    left = MAX_PACKAGE_BYTES
    try:
        with zipfile.ZipFile(path) as archive:
            if len(archive.infolist()) > MAX_FILES:
                raise MissionServiceError(f"{path}: contains more than {MAX_FILES} files")
            for member in archive.infolist():
                with archive.open(member) as file:
                    data = file.read(left + 1)
                left -= len(data)
                if left < 0:
                    raise MissionServiceError(
                        f"{path}: contains more than {MAX_PACKAGE_BYTES} bytes"
                    )
                found.setdefault(_name(member.filename), data)
    except OSError as error:
        raise MissionServiceError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (
        *(zipfile.BadZipFile, NotImplementedError, RuntimeError, zlib.error, lzma.LZMAError),
        *(EOFError, ValueError),
    ) as error:
        raise _damaged(path, "it is not a complete ZIP file", error) from None
    return found


def _preferences(files: dict[str, bytes], path: Path) -> dict[str, str]:
    """Return the entries of the ``.pref`` files; ``caLocation0`` becomes ``caLocation``."""
    if "manifest.xml" in files:
        for content in _xml(files, "manifest.xml", path).iter("Content"):
            name = _name(content.get("zipEntry", ""))
            if content.get("ignore") != "true" and name not in files:
                raise _damaged(path, f"{name}, which its manifest lists, is missing")
    names = sorted(name for name in files if name.endswith(".pref"))
    if not names:
        raise MissionServiceError(
            f"{path}: contains no .pref file: it is not a data package for a connection"
        )
    found: dict[str, str] = {}
    for name in names:
        for entry in _xml(files, name, path).iter("entry"):
            key = re.sub(
                r"^(ca|certificate|client)(Location|Password)0$", r"\1\2", entry.get("key", "")
            )
            found.setdefault(key, (entry.text or "").strip())
    return found


def _server(text: str, path: Path) -> tuple[str, str, int]:
    """Return scheme, host and port of a text such as ``tak.example:8089:ssl``."""
    host, port, protocol = [*text.rsplit(":", 2), "", ""][:3]
    host = host.strip("[]")
    if protocol not in SCHEMES or not re.fullmatch(r"[\w.:-]+", host):
        raise MissionServiceError(
            f"{path}: connectString0 is {text!r}; only HOST:PORT:ssl and HOST:PORT:tcp are "
            "supported"
        )
    if re.fullmatch(r"\d{1,5}", port) is None or not 0 < int(port) < 65536:
        raise MissionServiceError(f"{path}: connectString0 is {text!r}; {port!r} is not a port")
    return SCHEMES[protocol], host, int(port)


def _certificate_file(
    files: dict[str, bytes],
    preferences: dict[str, str],
    kind: str,
    password: str | None,
    path: Path,
) -> tuple[str, bytes, bytes]:
    """Return name, content and password of the PKCS #12 file of the authority or the client."""
    location = "caLocation" if kind == "ca" else "certificateLocation"
    name = _name(preferences.get(location, ""))
    if not name:
        raise _damaged(path, f"{location} is missing from its .pref file")
    if name not in files:
        raise _damaged(path, f"{name}, the file named by {location}, is missing")
    secret = preferences.get(f"{kind}Password", "") if password is None else password
    return name, files[name], secret.encode()


def _authorities(name: str, data: bytes, password: bytes, path: Path) -> str:
    from cryptography.hazmat.primitives.serialization import Encoding

    _, certificate, others = _pkcs12(name, data, password, path)
    found = [each for each in (certificate, *others) if each is not None]
    if not found:
        raise _damaged(path, f"{name} contains no certificate")
    return "".join(each.public_bytes(Encoding.PEM).decode() for each in found)


def _client_certificate(
    name: str, data: bytes, password: bytes, key_password: bytes, path: Path
) -> bytes:
    """Return the encrypted key and the certificates of the client as one PEM text."""
    from cryptography.hazmat.primitives.serialization import (
        BestAvailableEncryption,
        Encoding,
        PrivateFormat,
    )

    key, certificate, others = _pkcs12(name, data, password, path)
    if key is None or certificate is None:
        raise _damaged(path, f"{name} contains no certificate with a key")
    encryption = BestAvailableEncryption(key_password)
    parts = [key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, encryption)]
    parts += [each.public_bytes(Encoding.PEM) for each in (certificate, *others)]
    return b"".join(parts)


def _pkcs12(
    name: str, data: bytes, password: bytes, path: Path
) -> "tuple[PrivateKeyTypes | None, Certificate | None, list[Certificate]]":
    """Return key, certificate and further certificates of a PKCS #12 file."""
    from cryptography.hazmat.primitives.serialization import pkcs12

    try:
        return pkcs12.load_key_and_certificates(data, password)
    except ValueError as error:
        if "password" in str(error).lower():
            raise MissionServiceError(
                f"{path}: the password of {name} is wrong; set data_package_password"
            ) from None
        raise _damaged(path, f"{name} is not a PKCS #12 file", error) from None


def _xml(files: dict[str, bytes], name: str, path: Path) -> ElementTree.Element:
    data = files[name]
    if b"<!DOCTYPE" in data:
        raise MissionServiceError(f"{path}: {name} contains a DOCTYPE, which is not allowed")
    try:
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise _damaged(path, f"{name} is not valid XML", error) from None


def _name(path: str) -> str:
    return path.replace("\\", "/").rsplit("/", 1)[-1].lower()


def _damaged(path: Path, fault: str, error: Exception | None = None) -> MissionServiceError:
    cause = f" ({' '.join(str(error).split())})" if error is not None else ""
    return MissionServiceError(
        f"{path}: the data package is corrupt: {fault}{cause}; download it again"
    )
