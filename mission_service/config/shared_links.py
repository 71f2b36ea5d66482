"""Groups the vehicles of a scenario by link, and checks the links that vehicles share. Pure."""

from collections.abc import Sequence
from itertools import pairwise

from autopilot_bridge.links.link_address import SerialAddress, parse_link
from mission_service.config.sections import VehicleSection
from mission_service.errors import ScenarioError


def sharing(sections: Sequence[VehicleSection]) -> list[list[VehicleSection]]:
    """Return the vehicles grouped by link, in the order of the scenario's vehicles.

    Vehicles that are connected by their backup links are in one group. Raises ScenarioError for
    vehicles that cannot share their link.
    """
    of_link: dict[str, list[VehicleSection]] = {}
    for section in sections:
        for link in dict.fromkeys(map(_place_of, section.links)):
            of_link.setdefault(link, []).append(section)
        if len(section.links) > len(set(map(_place_of, section.links))):
            raise ScenarioError(
                f"{section.name}: link ({section.link}) and backup_link ({section.backup_link}) "
                "open the same port: specify separate ports"
            )
    for place, together in of_link.items():
        for number, section in enumerate(together[1:], start=1):
            _refuse(together[0], section, place)
            for other in together[:number]:
                if other.system_id == section.system_id:
                    raise ScenarioError(
                        f"{other.name} and {section.name} have the system id {section.system_id} "
                        f"on one link, {_link_at(section, place)}: assign them different ids "
                        "(system_id, and MAV_SYS_ID or SYSID_THISMAV of the autopilot), or "
                        "separate links"
                    )
    return _connected(sections, list(of_link.values()))


def _connected(
    sections: Sequence[VehicleSection], of_links: list[list[VehicleSection]]
) -> list[list[VehicleSection]]:
    """Return the vehicles grouped by the links that they share directly or through others."""
    group = {section.name: section.name for section in sections}
    for together in of_links:
        for first, second in pairwise(together):
            old, new = group[second.name], group[first.name]
            group = {name: new if each == old else each for name, each in group.items()}
    groups: dict[str, list[VehicleSection]] = {}
    for section in sections:
        groups.setdefault(group[section.name], []).append(section)
    found = list(groups.values())
    for together in found:
        _refuse_equal_ids(together)
    return found


def _refuse_equal_ids(together: list[VehicleSection]) -> None:
    """Raise ScenarioError for equal system ids in a group of vehicles with shared links."""
    of_id: dict[int, VehicleSection] = {}
    for section in together:
        other = of_id.setdefault(section.system_id, section)
        if other is not section:
            raise ScenarioError(
                f"{other.name} and {section.name} have the system id {section.system_id}, and "
                "share their links with the same vehicles: assign them different ids (system_id)"
            )


def _place_of(link: str) -> str:
    """Return the port or device of a link, which a process can open only once."""
    address = parse_link(link)
    if isinstance(address, SerialAddress):
        return f"serial:{address.device}"
    if address.kind in ("udpin", "tcpin"):  # the port is opened on all addresses of this machine
        return f"{address.kind}:{address.port}"
    return link


def _link_at(section: VehicleSection, place: str) -> str:
    """Return the link of a vehicle that opens a port or device."""
    return next(link for link in section.links if _place_of(link) == place)


def _refuse(first: VehicleSection, section: VehicleSection, place: str) -> None:
    """Raise ScenarioError unless two vehicles can share a link."""
    first_link, link = _link_at(first, place), _link_at(section, place)
    both = f"{first.name} and {section.name} share the link {link}"
    if first_link != link:
        raise ScenarioError(
            f"{first.name} ({first_link}) and {section.name} ({link}) open the same port: specify "
            "the same link for both, or separate ports"
        )
    if "mavsdk" in (first.backend, section.backend):
        raise ScenarioError(f'{both}: with backend = "mavsdk" each vehicle needs a separate link')
    for key in ("signing_key", "signing_link_id"):
        if getattr(first, key) != getattr(section, key):
            raise ScenarioError(f"{both}, so {key} must be the same for both")
