"""A temporary certificate authority, a broker's certificate for 127.0.0.1, and a client's."""

import subprocess
from pathlib import Path


def _openssl(*words: str, folder: Path) -> None:
    subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)


def make_certificates(folder: Path) -> None:
    """Create ca.pem, other-ca.pem; broker.pem and client.pem, with their keys (.key)."""
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    for name in ("ca", "other-ca"):
        paths = ("-keyout", f"{name}.key", "-out", f"{name}.pem")
        _openssl("req", "-x509", *key, *paths, "-subj", f"/CN={name}", "-days", "2", folder=folder)
    for name in ("broker", "client"):
        paths = ("-keyout", f"{name}.key", "-out", f"{name}.csr")
        _openssl("req", *key, *paths, "-subj", f"/CN={name}", folder=folder)
        (folder / f"{name}.ext").write_text("subjectAltName = IP:127.0.0.1\n", encoding="utf-8")
        by = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2")
        out = ("-in", f"{name}.csr", "-out", f"{name}.pem", "-extfile", f"{name}.ext")
        _openssl("x509", "-req", *by, *out, folder=folder)
