"""Tokens: creation, storage, validation, removal; and rate limits."""

import asyncio
import re
import stat
from copy import deepcopy
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from mission_service.cli.main import main
from mission_service.errors import MissionServiceError
from mission_service.events import FireObserved
from mission_service.interfaces.api.access.auth import ROLES, Tokens, own_token, read_tokens, sum_of
from mission_service.interfaces.api.access.token_file import added
from mission_service.interfaces.limits import MAX_CLIENTS, RateLimiter
from tests.api.worlds import client as http_client
from tests.api.worlds import scenario_of, served, world_in

GOOD = f'[[tokens]]\nname = "anna"\nroles = ["fly"]\nstation = "north"\nsha256 = "{"0" * 64}"\n'


def test_a_run_has_one_token_that_only_its_user_can_read(tmp_path: Path) -> None:
    token = own_token(tmp_path)
    assert len(token) >= 40
    assert stat.S_IMODE((tmp_path / "token").stat().st_mode) == 0o600
    assert own_token(tmp_path) == token  # also valid in a restarted service
    tokens = Tokens.of_run(tmp_path)
    user = tokens.user_of(token)
    assert user is not None
    assert user.roles == set(ROLES)
    assert not tokens.named
    assert tokens.user_of(token[:-1]) is None
    assert tokens.user_of("") is None


@pytest.mark.parametrize(
    ("content", "mode", "why"),
    [("short", 0o600, "contains no token"), ("a" * 43, 0o644, "other users can read it")],
)
def test_a_token_that_is_none_or_open_to_all_is_refused(
    tmp_path: Path, content: str, mode: int, why: str
) -> None:
    path = tmp_path / "token"
    path.write_text(content)
    path.chmod(mode)
    with pytest.raises(MissionServiceError, match=why):
        own_token(tmp_path)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[[tokens", "not valid TOML"),
        (
            GOOD.replace("fly", "all"),
            "tokens.0.roles.0: must be one of approve, correct, fly, look, observe;",
        ),
        (GOOD.replace("0" * 64, "abc"), "tokens.0.sha256: must be all 64 digits of the hash"),
        (
            GOOD + "colour = 1\n",
            "tokens.0.colour: unknown key; the keys are name, roles, sha256, station;",
        ),
        (GOOD + GOOD, "two tokens have the name anna"),
        ("tokens = 7", "tokens"),
        ("other = 7", "other: unknown key; the keys are tokens;"),
    ],
)
def test_an_invalid_tokens_file_is_reported_in_one_line(
    tmp_path: Path, text: str, why: str
) -> None:
    path = tmp_path / "tokens.toml"
    path.write_text(text)
    with pytest.raises(MissionServiceError, match=re.escape(why)) as error:
        read_tokens(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_tokens_file_that_changes_is_read_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "tokens.toml"
    anna = added(path, "anna", ("look", "fly"), "north")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    tokens = Tokens.of_file(path)
    user = tokens.user_of(anna)
    assert user is not None
    assert (user.name, user.station, sorted(user.roles)) == ("anna", "north", ["fly", "look"])
    assert tokens.still(user)
    ben = added(path, "ben", ("approve",), "")
    assert tokens.user_of(ben) is not None
    # A syntax error in the file locks no user out, and is reported once.
    before = path.read_text()
    path.write_text(before + "[[tokens")
    for _ in range(3):
        assert tokens.user_of(anna) == user
    assert caplog.text.count("not valid TOML") == 1
    assert anna not in caplog.text
    # Fewer roles apply at once, and a removed user has no access.
    path.write_text(before.replace('["look", "fly"]', '["look"]'))
    assert not tokens.still(user)
    path.write_text(before[before.index("[[tokens]]", 5) :])
    assert tokens.user_of(anna) is None
    assert tokens.user_of(ben) is not None


def test_what_people_wrote_in_a_tokens_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "tokens.toml"
    path.write_text("# the crew of July\n" + GOOD.rstrip())
    added(path, "neil", ("look",), "")
    assert path.read_text().startswith("# the crew of July\n" + GOOD)
    assert [user.name for user in read_tokens(path)] == ["anna", "neil"]
    assert [each.name for each in tmp_path.iterdir()] == ["tokens.toml"]


def test_the_command_prints_a_token_once_and_keeps_its_sum(tmp_path: Path) -> None:
    path = tmp_path / "tokens.toml"
    line = ["token", "anna", "--roles", "look,approve", "--station", "north", "--file", str(path)]
    made = CliRunner().invoke(main, line)
    assert made.exit_code == 0, made.output
    token = made.output.strip()
    assert token not in path.read_text()
    assert sum_of(token) in path.read_text()
    again = CliRunner().invoke(main, line)
    assert again.exit_code == 1
    assert "already has a token for anna" in again.output
    for wrong in (["token", "x", "--roles", "king"], ["token", "a\nb"], ["token", 'x"y']):
        result = CliRunner().invoke(main, [*wrong, "--file", str(path)])
        assert result.exit_code == 1
        assert result.output.count("\n") == 1
    assert len(read_tokens(path)) == 1


@given(st.lists(st.tuples(st.floats(0, 5), st.sampled_from("ab")), max_size=60))
def test_no_client_sends_more_requests_than_the_bucket_allows(
    steps: list[tuple[float, str]],
) -> None:
    buckets, rate_s, burst = RateLimiter(2.0, 5.0), 2.0, 5.0
    now_s, taken = 0.0, {"a": 0, "b": 0}
    for pause_s, peer in steps:
        now_s += pause_s
        wait_s = buckets.consume(peer, now_s)
        taken[peer] += wait_s == 0.0
        assert taken[peer] <= burst + rate_s * now_s + 1e-6
        if wait_s > 0.0:  # the wait in Retry-After is long enough
            assert deepcopy(buckets).consume(peer, now_s + wait_s + 1e-9) == 0.0
            assert deepcopy(buckets).consume(peer, now_s + 0.9 * wait_s) > 0.0


def test_buckets_drop_the_client_with_the_oldest_request() -> None:
    buckets = RateLimiter(1.0, 1.0)
    for number in range(3 * MAX_CLIENTS):
        buckets.consume(str(number), 0.0)
    assert len(buckets._left) == MAX_CLIENTS
    assert buckets.consume(str(3 * MAX_CLIENTS - 1), 0.0) > 0.0


@pytest.mark.parametrize(("named", "role"), [(True, "approve"), (False, "")])
def test_the_journal_has_the_role_of_who_reports_an_observation(
    tmp_path: Path, named: bool, role: str
) -> None:
    async def post() -> None:
        service = served(world, named=named)
        async with http_client(service.app) as http:
            body = {"state": "burning", "shape": "points", "points": [[36.364232, -84.140907]]}
            response = await http.post(
                "/api/v1/fire/observations", json=body, headers=service.headers()
            )
            assert response.status_code == 200, response.text

    world = world_in(tmp_path, scenario_of())
    asyncio.run(post())
    (event,) = world.submitted
    assert isinstance(event, FireObserved)
    assert (event.role, event.by) == (role, "all")
