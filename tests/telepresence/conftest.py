from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import pytest

from ghal360_robot.telepresence.access import Role
from ghal360_robot.telepresence.connection import Connection
from ghal360_robot.telepresence.hub import Hub
from ghal360_robot.telepresence.settings import PageSettings

MS = 1_000_000


@dataclass
class Desk:
    """A hub with a clock of its own, and everything it told the robot."""

    settings: PageSettings = field(default_factory=PageSettings)
    now_ns: int = 5_000_000_000
    told: list[tuple[str, Any]] = field(default_factory=list)
    hub: Hub = field(init=False)

    def __post_init__(self) -> None:
        self.hub = Hub(self.settings, lambda kind, value: self.told.append((kind, value)), lambda: self.now_ns)

    def open(self, role: Role = Role.DRIVER) -> Page:
        return Page(self, self.hub.join(role, "127.0.0.1"))

    def wait(self, seconds: float, *, beats: bool = True) -> None:
        """Time passes; the hub beats ten times a second, as its server does."""
        until = self.now_ns + round(seconds * 1e9)
        while self.now_ns < until:
            self.now_ns = min(self.now_ns + 100 * MS, until)
            if beats:
                self.hub.beat()

    def said(self, kind: str) -> list[Any]:
        return [value for said, value in self.told if said == kind]

    @property
    def driving(self) -> bool:
        """Whether the newest wish the robot was told keeps it going."""
        wishes = self.said("operator")
        return bool(wishes) and wishes[-1]["deadman"]

    @property
    def locked(self) -> bool:
        return bool(self.said("lock")[-1]["engaged"])


@dataclass
class Page:
    """A page that says what it is told to."""

    desk: Desk
    connection: Connection
    seq: int = 0
    picture: int = 0

    def send(self, **message: Any) -> None:
        self.desk.hub.take(self.connection, json.dumps(message))

    def operate(self, **changes: Any) -> None:
        self.seq += 1
        message = {
            "kind": "operate", "conn": self.connection.secret, "seq": self.seq,
            "sent_us": self.desk.now_ns // 1000, "yaw": 0.1, "pitch": 0.0, "fov_h": 1.8, "fov_v": 1.3,
            "mode": "screen", "deadman": False, "stick": None, "arm": 0, "disarm": 0, "found": 0,
        }  # fmt: skip
        self.send(**{**message, **changes})

    def lease(self, wish: str) -> None:
        self.send(kind="lease", wish=wish)

    def see(self, delay_ms: float = 30.0) -> None:
        """A picture arrives at the robot, is sent, and shown after a while."""
        self.picture += 1
        self.connection.delays.picture(self.picture, self.desk.now_ns)
        self.desk.now_ns += round(delay_ms * MS)
        self.send(kind="shown", seq=self.picture, dropped=0)

    def drive(self) -> None:
        """As a careful operator does: take the controls, see a picture, press."""
        self.lease("ask")
        self.see()
        self.operate()
        self.operate(deadman=True)

    def heard(self, kind: str) -> list[dict[str, Any]]:
        """What waits for this page."""
        box = self.connection.outbox
        texts = [*box._answers, *box._newest.values()]
        return [message for message in map(json.loads, texts) if message["kind"] == kind]


@pytest.fixture
def desk() -> Desk:
    return Desk()
