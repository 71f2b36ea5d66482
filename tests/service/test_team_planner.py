"""A team's shared map, its first lap, and its members."""

from pkgutil import resolve_name

import numpy as np
import pytest

from mission_service.config.scenario import load_scenario
from mission_service.events import Observed
from mission_service.guidance.fire_map import BEARINGS
from mission_service.guidance.front.front_path import PathSettings
from mission_service.guidance.team import way
from mission_service.guidance.team.front_ring import ActiveFleet, FrontRing, Integers
from mission_service.guidance.team.team import MemberPerformance, Team, TeamMember, TeamSettings

CENTRE = 100.0
RADIUS = 40.0
CELL_M = 30.0


class ScriptedRule:
    """A rule that decides as scripted, and records its inputs."""

    def __init__(self) -> None:
        self.clockwise: dict[int, bool] = {}
        self.fleets: list[ActiveFleet] = []
        self.rings: list[FrontRing] = []

    def decide(self, ring: FrontRing, fleet: ActiveFleet, which: int, at_s: float) -> bool:
        self.fleets.append(fleet)
        self.rings.append(ring)
        return self.clockwise.get(int(fleet.member[which]), bool(fleet.clockwise[which]))

    def on_ring_changed(self, place_of: Integers) -> None:
        raise AssertionError("the bearings stay")


def team_of(
    rule: ScriptedRule, *names: str, ignition_known: bool = True, centre: float = CENTRE
) -> Team:
    settings = TeamSettings(CELL_M, True, ignition_known, 300.0, 10, PathSettings(80.0, 5.0))
    return Team(
        rule,
        settings,
        dict.fromkeys(names, MemberPerformance(15.0, 20.0)),
        (200, 200),
        (centre, centre),
        0.0,
    )


def place(bearing_deg: float) -> tuple[float, float]:
    """Return a place on the front of a round fire."""
    angle = np.deg2rad(bearing_deg)
    return CENTRE - RADIUS * float(np.cos(angle)), CENTRE + RADIUS * float(np.sin(angle))


def look(member: TeamMember, name: str, bearing_deg: float, at_s: float, reach: int = 6) -> None:
    """Observe a square of the round fire around a place."""
    row, col = (round(value) for value in place(bearing_deg))
    rows, cols = np.mgrid[row - reach : row + reach + 1, col - reach : col + reach + 1]
    burned = np.hypot(rows - CENTRE, cols - CENTRE) <= RADIUS
    cells = tuple("".join("b" if cell else "u" for cell in line) for line in burned)
    member.observe(Observed(round(at_s * 1e6), name, row - reach, col - reach, cells))


def fly(team: Team, name: str, from_deg: float, to_deg: float, at_s: float) -> float:
    """Fly along the front, a degree every two seconds; return the time at the end."""
    step = 1 if to_deg >= from_deg else -1
    for bearing in range(round(from_deg), round(to_deg) + step, step):
        look(team.member(name), name, bearing, at_s)
        team.member(name).at(*place(bearing), at_s)
        at_s += 2.0
    return at_s


def lap(team: Team) -> float:
    """Fly the first lap, shared by two vehicles."""
    fly(team, "a", 0, 185, 1000.0)
    return fly(team, "b", 360, 175, 1000.0)


def test_an_observation_of_one_reaches_all() -> None:
    team = team_of(ScriptedRule(), "a", "b")
    fly(team, "a", 0, 90, 1000.0)
    assert np.isfinite(team.map.outer[:90]).all()
    look(team.member("b"), "b", 0, 1200.0)
    assert team.member("b").shape(*place(0))[60] == pytest.approx(RADIUS, abs=1.5)


def test_two_share_the_first_lap_and_it_ends_for_both() -> None:
    team = team_of(ScriptedRule(), "a", "b")
    assert team.member("a").clockwise
    assert not team.member("b").clockwise
    assert {team.member(name).phase for name in "ab"} == {"approach"}
    fly(team, "a", 0, 170, 1000.0)
    assert team.member("a").phase == "initial circle"
    fly(team, "b", 360, 340, 1000.0)
    assert not team.surveyed
    fly(team, "b", 340, 165, 1040.0)
    assert {team.member(name).phase for name in "ab"} == {"monitor"}


def test_a_lap_of_its_own_ends_the_survey_though_bearings_are_unseen() -> None:
    team = team_of(ScriptedRule(), "a")
    at_s = 1000.0
    for bearing in range(365):
        if not 90 < bearing < 120:  # smoke
            look(team.member("a"), "a", bearing, at_s)
        team.member("a").at(*place(bearing), at_s)
        at_s += 2.0
    assert not team.map.complete
    assert team.surveyed


def test_a_correction_before_the_first_view_does_not_end_the_lap() -> None:
    team = team_of(ScriptedRule(), "a", "b", centre=CENTRE - RADIUS - 10.0)
    window = ("u" * 9,) * 9
    corner = round(CENTRE - RADIUS - 10.0) - 4
    team.member("a").correct(Observed(round(990e6), "a", corner, corner, window, corrects=True))
    fly(team, "a", 0, 20, 1000.0)
    assert team.member("a").phase == "initial circle"
    assert not team.map.complete


def test_the_ring_is_the_front_in_metres() -> None:
    rule = ScriptedRule()
    team = team_of(rule, "a", "b")
    at_s = lap(team)
    fly(team, "a", 0, 3, at_s)
    ring = rule.rings[-1]
    assert ring.step_m.shape == (BEARINGS,)
    assert ring.step_m.sum() == pytest.approx(2 * np.pi * RADIUS * CELL_M, rel=0.08)
    assert ring.visited_at_s[0] == pytest.approx(at_s + 6.0)
    assert ring.visited_at_s[100] < 1300.0
    assert np.median(ring.spread_rate_m_s) == pytest.approx(RADIUS * CELL_M / 1200.0, rel=0.2)


def test_the_rule_is_asked_at_every_cell_and_after_a_turn_from_that_cell_on() -> None:
    rule = ScriptedRule()
    team = team_of(rule, "a", "b")
    at_s = lap(team)
    a = team.member("a")
    fly(team, "a", 10, 12, at_s)
    asked = len(rule.fleets)
    assert a.at(*place(12), at_s) is None
    decision = a.at(*place(15.3), at_s)
    assert decision is not None
    assert not decision.reversed
    assert [int(fleet.cell[0]) for fleet in rule.fleets[asked:]] == [13, 14, 15]
    rule.clockwise = {0: False}
    decision = a.at(*place(18), at_s)
    assert decision is not None
    assert decision.reversed
    assert not a.clockwise
    assert a.reversals == 1
    assert rule.fleets[-1].cell[0] == 16  # cells behind it are not requested
    for turning in (20, 21, 19, 17, 16):
        assert a.at(*place(turning), at_s + 5.0) is None
    assert a.at(*place(15), at_s + 19.0) is None
    assert a.at(*place(14), at_s + 20.0) is not None
    assert [int(fleet.cell[0]) for fleet in rule.fleets[-2:]] == [15, 14]


def test_a_departed_vehicle_is_out_of_the_fleet_at_the_next_decision_until_it_sees_the_front() -> (
    None
):
    rule = ScriptedRule()
    team = team_of(rule, "a", "b")
    at_s = lap(team)
    fly(team, "a", 0, 4, at_s)
    assert rule.fleets[-1].member.tolist() == [0, 1]
    assert rule.fleets[-1].cell[0] in (3, 4)
    team.member("b").left(at_s)
    look(team.member("a"), "a", 8, at_s + 9.0)
    assert team.member("a").at(*place(8), at_s + 9.0) is not None
    assert rule.fleets[-1].member.tolist() == [0]
    assert team.member("b").at(*place(90), at_s + 9.0) is None
    fly(team, "b", 92, 88, at_s + 10.0)
    fly(team, "a", 9, 10, at_s + 20.0)
    assert rule.fleets[-1].member.tolist() == [0, 1]


@pytest.mark.parametrize("name", way.RULES)
def test_every_rule_directs_a_team_that_loses_one_and_gets_it_back(name: str) -> None:
    rule = resolve_name(f"{way.__package__}.{way.RULES[name]}")
    team = team_of(rule(load_scenario("team", (f"planner.rule={name}",))), "a", "b", "c")
    at_s = lap(team)
    places = {"a": 5, "b": 175, "c": 270}
    decisions = 0
    for second in range(240):
        at_s += 1.0
        if second == 60:
            team.member("c").left(at_s)
        for each in "ab" if 60 <= second < 120 else "abc":
            places[each] += 1 if team.member(each).clockwise else -1
            look(team.member(each), each, places[each], at_s)
            decision = team.member(each).at(*place(places[each]), at_s)
            decisions += decision is not None
    assert decisions > 100


def test_an_unknown_ignition_is_replaced_by_the_centre_of_what_was_seen() -> None:
    team = team_of(ScriptedRule(), "a", "b", ignition_known=False, centre=90.0)
    lap(team)
    assert team.surveyed
    assert team.map.centre_row == pytest.approx(CENTRE, abs=1.0)
    assert team.map.centre_col == pytest.approx(CENTRE, abs=1.0)
    assert team.map.complete


def test_a_path_leads_along_the_front_in_the_flying_direction() -> None:
    team = team_of(ScriptedRule(), "a", "b")
    lap(team)
    for name, side in (("a", 1.0), ("b", -1.0)):
        path = team.member(name).path(*place(90))
        radii = np.hypot(path[:, 0] - CENTRE, path[:, 1] - CENTRE)
        assert np.allclose(radii, RADIUS, atol=2.0)
        assert side * (path[5, 0] - CENTRE) > 0.0


def test_a_silent_one_is_reckoned_to_fly_on_and_then_as_lost() -> None:
    rule = ScriptedRule()
    team = team_of(rule, "a", "b")
    at_s = lap(team)
    fly(team, "b", 180, 178, at_s)  # last received 4 s later, flying anticlockwise
    fly(team, "a", 0, 12, at_s)
    ring = rule.rings[-1]
    flown_m = float(ring.step_m[158:178].sum())  # the distance in 20 s at 15 m/s
    assert flown_m > 300.0
    b = int(rule.fleets[-1].cell[1])
    assert float(ring.step_m[b:178].sum()) == pytest.approx(300.0, abs=2 * ring.step_m.max())
    fly(team, "a", 13, 20, at_s + 26.0)
    assert rule.fleets[-1].member.tolist() == [0]
