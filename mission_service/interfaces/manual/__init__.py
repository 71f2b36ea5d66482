"""The documentation site: ``make docs`` builds it, and ``mission-service docs`` serves it."""

from mission_service.interfaces.loopback_server import LOOPBACK
from mission_service.interfaces.manual.site_server import SITE, site_server, unpack_site

__all__ = ["LOOPBACK", "SITE", "site_server", "unpack_site"]
