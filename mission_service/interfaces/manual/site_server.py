"""Serves the built documentation site on loopback."""

import shutil
from functools import partial
from http.server import SimpleHTTPRequestHandler
from pathlib import Path
from typing import Any

from mission_service.errors import MissionServiceError
from mission_service.interfaces.loopback_server import LoopbackServer

SITE = Path(__file__).parent / "site.zip"


def unpack_site(folder: Path, site: Path = SITE) -> None:
    """Unpack the built site into a folder.

    Args:
        folder: An existing folder.
        site: The ZIP archive that ``make docs`` writes.

    Raises:
        MissionServiceError: The site was not built, or the archive is damaged.
    """
    if not site.is_file():
        raise MissionServiceError(
            f"{site}: the documentation was not built; run make docs in a checkout, or read the "
            "files in the repository's folder docs"
        )
    try:
        shutil.unpack_archive(site, folder)
    except (shutil.ReadError, OSError) as error:
        raise MissionServiceError(
            f"{site}: cannot be unpacked: {error}; build it again with make docs"
        ) from None


def site_server(port: int, folder: Path) -> LoopbackServer:
    """Return a server for the files in a folder; the server listens on loopback.

    Args:
        port: The port to listen on; 0 selects a free port.
        folder: The folder of the unpacked site.

    Returns:
        The server. ``serve_forever`` serves the site; ``server_port`` is the port.

    Raises:
        MissionServiceError: The port cannot be used.
    """
    return LoopbackServer(port, partial(_Files, directory=str(folder)))


class _Files(SimpleHTTPRequestHandler):
    """Serves files; prints nothing for each request."""

    def log_message(self, *_: Any) -> None:
        """Print nothing."""
