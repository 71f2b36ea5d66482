"""Groups the vehicles of a scenario by link, and checks the links that vehicles share. Pure."""

from collections.abc import Sequence

from autopilot_bridge.links.link_address import SerialAddress, parse_link
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError


def sharing(sections: Sequence[VehicleSection]) -> list[list[VehicleSection]]:
    """Return the vehicles grouped by link, in the order of the scenario's vehicles.

    Raises ScenarioError for vehicles that cannot share their link.
    """
    of_link: dict[str, list[VehicleSection]] = {}
    for section in sections:
        of_link.setdefault(_place_of(section.link), []).append(section)
    for together in of_link.values():
        first, *others = together
        for place, section in enumerate(others, start=1):
            _refuse(first, section)
            for other in together[:place]:
                if other.system_id == section.system_id:
                    raise ScenarioError(
                        f"{other.name} and {section.name} have the system id {section.system_id} "
                        f"on one link, {section.link}: give them different ids (system_id, and "
                        "MAV_SYS_ID or SYSID_THISMAV of the autopilot), or separate links"
                    )
    return list(of_link.values())


def _place_of(link: str) -> str:
    """Return the port or device of a link, which a process can open only once."""
    address = parse_link(link)
    if isinstance(address, SerialAddress):
        return f"serial:{address.device}"
    if address.kind in ("udpin", "tcpin"):  # the port is opened on all addresses of this machine
        return f"{address.kind}:{address.port}"
    return link


def _refuse(first: VehicleSection, section: VehicleSection) -> None:
    """Raise ScenarioError unless two vehicles can share a link."""
    both = f"{first.name} and {section.name} share the link {section.link}"
    if first.link != section.link:
        raise ScenarioError(
            f"{first.name} ({first.link}) and {section.name} ({section.link}) open the same port: "
            "give both the same link, or separate ports"
        )
    if "mavsdk" in (first.backend, section.backend):
        raise ScenarioError(f'{both}: with backend = "mavsdk" each vehicle needs a separate link')
    for key in ("signing_key", "signing_link_id"):
        if getattr(first, key) != getattr(section, key):
            raise ScenarioError(f"{both}, so {key} must be the same for both")
