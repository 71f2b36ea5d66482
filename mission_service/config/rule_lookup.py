"""Finds the way of flying for a ``planner.rule`` when a scenario is checked.

A way of flying is the guidance for one or more planner rules, and is a plug-in.
``guidance/registry.py`` lists the ways of flying of this package. Other packages register their
ways of flying as entry points of ``GROUP``, each with the name of its rule. A way of flying is
loaded by its address ``module:object``, so this module imports no planner.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Protocol

from pydantic import BaseModel

from mission_service.errors import MissionServiceError, PlannerError, did_you_mean, in_words

GROUP = "mission_service.planners"
OWN = EntryPoint("own", "mission_service.guidance.registry:WAYS", GROUP)
NAME = r"[a-z][a-z0-9_]*"  # rules of other packages, and their tables


class Way(Protocol):
    """The attributes of a ``WayOfFlying`` that are used when a scenario is read."""

    @property
    def rules(self) -> tuple[str, ...]:
        """The values of ``planner.rule`` for this way of flying."""

    @property
    def section(self) -> type[BaseModel] | None:
        """The model of the table with the rule's name; None for a rule without a table."""

    @property
    def prescribed(self) -> bool:
        """Whether the vehicles ignite the burn unit in the table ``[burn]``."""

    @property
    def messages_peers(self) -> bool:
        """Whether the vehicles exchange messages with vehicles of other processes."""

    @property
    def reads_fronts(self) -> bool:
        """Whether the planners use the fronts of the estimated fire (``FrontsEstimated``)."""

    @property
    def relieves(self) -> bool:
        """Whether vehicles may relieve each other (the table ``[relief]``)."""

    def check(self, scenario: Any) -> None:
        """Raise ValueError for vehicles or tables that this way of flying cannot use."""


@cache
def own_ways() -> Mapping[str, Way]:
    """Return this package's ways of flying by the names of their rules."""
    ways: tuple[Way, ...] = OWN.load()
    return {rule: way for way in ways for rule in way.rules}


def rules() -> list[str]:
    """Return all rules: those of this package, then those of other packages."""
    others = {each.name for each in entry_points(group=GROUP)} - own_ways().keys()
    return [*own_ways(), *sorted(others)]


def versions_of_others() -> dict[str, str]:
    """Return the versions of other packages with rules, by the address of each entry point."""
    points = entry_points(group=GROUP)
    return {each.value: "" if each.dist is None else each.dist.version for each in points}


@cache
def way_named(rule: str) -> Way:
    """Return the way of flying for a rule. Raises ValueError if no such rule can be loaded."""
    own = own_ways().get(rule)
    found = list(entry_points(group=GROUP, name=rule))
    if own is not None and found:
        raise ValueError(
            f"{_described(found[0])} has the name of a rule of this service; rename the rule of "
            "the package, or uninstall the package"
        )
    if own is not None:
        return own
    if not found:
        meant = did_you_mean(rule, rules())
        raise ValueError(f"no such rule; available are {', '.join(rules())}{meant}")
    if len(found) > 1:
        where = ", ".join(each.value for each in found)
        raise ValueError(f"{len(found)} packages have a rule of that name: {where}")
    return _of_another_package(found[0])


def _of_another_package(point: EntryPoint) -> Way:
    """Return the way of flying at an entry point. Raises ValueError."""
    where = _described(point)
    if re.fullmatch(NAME, point.name) is None:
        raise ValueError(
            f"{where}: the name of a rule may contain only lower-case letters, digits and _"
        )
    try:
        way: Way = point.load()
    except (Exception, SystemExit) as error:  # imports of other packages may raise any exception
        raise ValueError(f"{where}: {type(error).__name__}: {error}") from error
    own = next(iter(own_ways().values()))
    if not isinstance(way, type(own)) or way.rules != (point.name,):
        raise ValueError(f"{where}: it must be a WayOfFlying whose only rule is {point.name}")
    section: Any = way.section
    if section is not None and not (isinstance(section, type) and issubclass(section, BaseModel)):
        raise ValueError(f"{where}: its section must be a pydantic model (got {section!r})")
    return way


def _described(point: EntryPoint) -> str:
    package = "" if point.dist is None else f" of package {point.dist.name} {point.dist.version}"
    return f"entry point {point.name} = {point.value}{package}"


def blamed(rule: str) -> str | None:
    """Return text that names a rule from another package as the probable cause of an error."""
    if rule in own_ways():
        return None
    where = ", ".join(_described(point) for point in entry_points(group=GROUP, name=rule))
    return (
        f"the cause is probably rule {rule} ({where}): correct that package, or choose another rule"
    )


@contextmanager
def faults_of(rule: str) -> Iterator[None]:
    """Convert any exception raised by another package's rule to PlannerError."""
    try:
        yield
    except (Exception, SystemExit) as error:
        blame = blamed(rule)
        if blame is None or isinstance(error, MissionServiceError):
            raise
        raise PlannerError(f"{in_words(error)}; {blame}") from error
