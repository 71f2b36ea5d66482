"""Bent's team rule: each vehicle has a region and a planner; negotiations move the borders."""

from mission_service.guidance.team.bent_region import (
    Course,
    CourseRule,
    Region,
    course_back,
    lifted,
)
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, Integers
from mission_service.guidance.team.negotiation import Negotiation, Party, reserved_cells
from mission_service.guidance.team.regions import (
    Regions,
    equal_regions,
    on_new_ring,
    retained,
    served,
    with_border_moved,
    with_member,
    without_member,
)

NEGOTIATE_EVERY_S = 20.0


class RegionTeam:
    """Bent's ``TeamRule``.

    ``steer`` directs each vehicle in its region, and ``negotiate`` moves the borders.
    """

    def __init__(
        self,
        steer: CourseRule,
        negotiate: Negotiation,
        *,
        exponential: bool,
        every_s: float = NEGOTIATE_EVERY_S,
    ) -> None:
        self._steer = steer
        self._negotiate = negotiate
        self._exponential = exponential
        self._every_s = every_s
        self._next_s = 0.0
        self._regions: Regions | None = None
        self._growths: list[Integers] = []
        self._courses: dict[int, Course] = {}
        self._fleet_members: list[int] = []
        self._index: dict[int, int] = {}

    @property
    def regions(self) -> Regions | None:
        """The regions at the last decision; None before the first decision."""
        return self._regions

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        """Return whether the vehicle flies clockwise, as planned or back into its region."""
        regions = self._now(ring, fleet, at_s)
        member = int(fleet.member[which])
        begin, end = served(regions, self._index[member])
        own_cell = lifted(int(fleet.cell[which]), begin, regions.cells)
        speed_m_s = float(fleet.speed_m_s[which])
        region = Region(ring, begin, end, own_cell, at_s, speed_m_s, self._exponential)
        if own_cell >= end:
            course = course_back(region)
        else:
            before = self._courses.get(member, Course())
            if before.target is not None:
                target = lifted(before.target, begin, regions.cells)
                before = Course(before.clockwise, target)
            course = self._steer(region, before)
        self._courses[member] = course
        return course.clockwise

    def on_ring_changed(self, place_of: Integers) -> None:
        """Record the new ring, to which the next decision moves borders and targets."""
        # The size of the new ring is known only at the next decision or the next change.
        self._growths.append(place_of)

    def _now(self, ring: FrontRing, fleet: ActiveFleet, at_s: float) -> Regions:
        """Return the regions after all changes since the last decision."""
        cells = ring.step_m.size
        members = fleet.member.tolist()
        regions = self._regions
        if regions is None:
            regions = equal_regions(members, fleet.cell.tolist(), cells)
            self._growths.clear()
            self._next_s = at_s + self._every_s
        for number, place_of in enumerate(self._growths, 1):
            last = number == len(self._growths)
            regions = self._grown(regions, place_of, cells if last else self._growths[number].size)
        self._growths.clear()
        if members != self._fleet_members:
            regions = _with_team(regions, members, fleet.cell.tolist())
            self._fleet_members = members
            self._index = {member: index for index, member in enumerate(regions.members)}
        if at_s >= self._next_s:
            self._next_s = at_s + self._every_s
            regions = self._negotiated(regions, ring, fleet, at_s)
        self._regions = regions
        return regions

    def _grown(self, regions: Regions, place_of: Integers, cells: int) -> Regions:
        for member, course in self._courses.items():
            if course.target is not None:
                target = int(place_of[course.target % place_of.size])
                self._courses[member] = Course(course.clockwise, target)
        return on_new_ring(regions, place_of, cells)

    def _negotiated(
        self, regions: Regions, ring: FrontRing, fleet: ActiveFleet, at_s: float
    ) -> Regions:
        """Return the regions after each vehicle has given cells to its neighbours (4.2.1).

        The vehicles negotiate one after the other, in the order of their regions.
        """
        count = len(regions.members)
        if count == 1:
            return regions
        which_of = {member: which for which, member in enumerate(fleet.member.tolist())}
        for index in range(count):
            parts = {
                other: self._part(regions, other, fleet, which_of[regions.members[other]])
                for other in {(index - 1) % count, index, (index + 1) % count}
            }
            own = parts[index]
            left, right = parts[(index - 1) % count], parts[(index + 1) % count]
            first, last = self._negotiate(ring, left, own, right, at_s, self._exponential)
            if first:
                regions = with_border_moved(regions, index, own.begin + first, left=False)
            if last:
                after = (index + 1) % count
                place = own.end - last - (0 if after else regions.cells)
                regions = with_border_moved(regions, after, place, left=True)
        return regions

    def _part(self, regions: Regions, index: int, fleet: ActiveFleet, which: int) -> Party:
        begin, end = retained(regions, index)
        cell, cells = int(fleet.cell[which]), regions.cells
        own_cell = lifted(cell, begin, cells)
        following = lifted(cell + (1 if fleet.clockwise[which] else -1), begin, cells)
        target = self._courses.get(regions.members[index], Course()).target
        going_to = own_cell if target is None else lifted(target, begin, cells)
        return Party(
            begin, end, own_cell, reserved_cells(begin, end, (own_cell, following, going_to))
        )


def _with_team(regions: Regions, members: list[int], cells_of: list[int]) -> Regions:
    """Return the regions after adding new vehicles and removing those that have left."""
    for member, cell in zip(members, cells_of, strict=True):
        if member not in regions.members:
            at = dict(zip(members, cells_of, strict=True))
            # The cell of a vehicle that has left is unknown, so the start of its region is used
            # instead.
            begins = dict(zip(regions.members, regions.borders, strict=True))
            others = [at.get(other, begins[other].right.place) for other in regions.members]
            regions = with_member(regions, member, others, cell)
    for member in regions.members:
        if member not in members:
            regions = without_member(regions, member)
    return regions
