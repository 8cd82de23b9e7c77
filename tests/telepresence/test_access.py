from __future__ import annotations

import json
import stat
from typing import TYPE_CHECKING

import pytest

from ghal360_robot.errors import UsageError
from ghal360_robot.telepresence.access import (
    MAX_SESSIONS,
    SESSION_NS,
    Role,
    Sessions,
    allowed_hosts,
    host_allowed,
    is_loopback,
    load_tokens,
    origin_allowed,
)

if TYPE_CHECKING:
    from pathlib import Path

TOKENS = {Role.VIEWER: "v" * 32, Role.DRIVER: "d" * 32}


def test_tokens_are_made_once_and_for_their_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "somewhere" / "tokens.json"
    tokens = load_tokens(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert load_tokens(path) == tokens
    assert len(set(tokens.values())) == len(Role)
    assert all(len(token) >= 32 for token in tokens.values())


def test_a_token_file_that_others_may_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    load_tokens(path)
    path.chmod(0o640)
    with pytest.raises(UsageError, match="chmod 600"):
        load_tokens(path)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"viewer": "a"}', '{"viewer": "a", "driver": "b"}', "\udcff"])
def test_a_damaged_token_file_is_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tokens.json"
    path.write_bytes(text.encode(errors="surrogateescape"))
    path.chmod(0o600)
    with pytest.raises(UsageError, match="delete it for new ones"):
        load_tokens(path)


def test_two_equal_tokens_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    path.write_text(json.dumps({"viewer": "x" * 40, "driver": "x" * 40}))
    path.chmod(0o600)
    with pytest.raises(UsageError):
        load_tokens(path)


@pytest.mark.parametrize("role", list(Role))
def test_a_token_opens_a_session_of_its_role(role: Role) -> None:
    sessions = Sessions(TOKENS)
    opened = sessions.log_in(TOKENS[role], 0)
    assert opened is not None
    assert opened[1] is role
    assert sessions.role(opened[0], SESSION_NS) is role
    assert sessions.role(opened[0], SESSION_NS + 1) is None


@pytest.mark.parametrize("token", ["", "d", "d" * 31, "d" * 33, "ü" * 32])
def test_any_other_token_opens_nothing(token: str) -> None:
    assert Sessions(TOKENS).log_in(token, 0) is None


@pytest.mark.parametrize("cookie", [None, "", "x" * 40, TOKENS[Role.DRIVER]])
def test_a_cookie_that_was_never_given_is_nobody(cookie: str | None) -> None:
    assert Sessions(TOKENS).role(cookie, 0) is None


def test_who_logs_out_is_nobody_and_sessions_are_bounded() -> None:
    sessions = Sessions(TOKENS)
    first = sessions.log_in(TOKENS[Role.VIEWER], 0)
    assert first is not None
    sessions.log_out(first[0])
    assert sessions.role(first[0], 0) is None
    for _ in range(3 * MAX_SESSIONS):
        sessions.log_in(TOKENS[Role.VIEWER], 0)
    assert len(sessions._open) == MAX_SESSIONS


def test_which_addresses_only_this_machine_reaches() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.3.2.1", "::1", "localhost")))
    assert not any(map(is_loopback, ("::", "192.168.1.2", "robot.local", "")))


@pytest.mark.parametrize(
    ("host", "allowed"),
    [
        ("127.0.0.1:8360", True), ("LOCALHOST:8360", True), ("[::1]:8360", True), ("robot.local:8360", True),
        ("127.0.0.1", False), ("127.0.0.1:80", False), ("evil.example:8360", False),
        ("127.0.0.1.evil.example:8360", False), ("", False), (None, False),
    ],
)  # fmt: skip
def test_only_the_robots_own_names_are_answered_to(host: str | None, allowed: bool) -> None:
    hosts = allowed_hosts("127.0.0.1", 8360, ("robot.local",))
    assert host_allowed(host, hosts, tls=False) is allowed


def test_the_usual_port_may_be_left_out() -> None:
    hosts = allowed_hosts("192.168.1.2", 443, ())
    assert host_allowed("192.168.1.2", hosts, tls=True)
    assert not host_allowed("192.168.1.2", hosts, tls=False)
    assert not host_allowed("localhost", hosts, tls=True)


def test_listening_everywhere_is_not_being_called_everything() -> None:
    hosts = allowed_hosts("::", 8360, ("robot.local",))
    assert hosts == {"robot.local:8360"}


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        ("https://robot.local:8360", True), ("https://ROBOT.local:8360", True), ("http://robot.local:8360", False),
        ("https://robot.local", False), ("https://robot.local.evil.example:8360", False), ("null", False),
        ("", False), (None, False), ("https://user@robot.local:8360", False),
    ],
)  # fmt: skip
def test_only_this_servers_own_pages_may_ask(origin: str | None, allowed: bool) -> None:
    assert origin_allowed(origin, "robot.local:8360", tls=True) is allowed
