"""One open page as the server knows it: its rights, its delays, and what still has to be told to it."""

from __future__ import annotations

import asyncio
import secrets
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ghal360_robot.telepresence.allowance import Allowance
from ghal360_robot.telepresence.delays import Delays
from ghal360_robot.telepresence.gate import Gate

if TYPE_CHECKING:
    from ghal360_robot.telepresence.access import Role
    from ghal360_robot.telepresence.protocol import Operate, Right
    from ghal360_robot.telepresence.viewer import Viewer

RATE_HZ, BURST = 120.0, 120.0
"""A headset sends 50 wishes, 30 pictures shown and 8 answers a second."""

BOOKMARK_HZ, BOOKMARK_BURST = 0.2, 3.0
"""As many moments as a person finds remarkable, and no way to fill a disk."""

MAX_MALFORMED = 5
"""A page of ours sends none; who sends so many is none of ours."""

MAX_ANSWERS = 16


class Outbox:
    """What waits to be sent to one page: of most kinds only the newest counts, answers keep their order."""

    def __init__(self) -> None:
        self._newest: dict[str, str] = {}
        self._answers: deque[str] = deque(maxlen=MAX_ANSWERS)
        self._ready = asyncio.Event()

    def put(self, kind: str, text: str) -> None:
        """A message of which a newer one makes this superfluous."""
        self._newest[kind] = text
        self._ready.set()

    def answer(self, text: str) -> None:
        """A message that is one of several; the oldest is lost where a page does not fetch them."""
        self._answers.append(text)
        self._ready.set()

    async def take(self) -> list[str]:
        """Everything that waits; waits itself where there is nothing."""
        await self._ready.wait()
        self._ready.clear()
        texts = [*self._answers, *self._newest.values()]
        self._answers.clear()
        self._newest.clear()
        return texts


@dataclass(slots=True, eq=False)
class Connection:
    """One page. `secret` binds its messages to this very connection; `holder` is its name in the recording."""

    number: int
    role: Role
    address: str
    secret: str = field(default_factory=lambda: secrets.token_urlsafe(12))
    outbox: Outbox = field(default_factory=Outbox)
    delays: Delays = field(default_factory=Delays)
    allowance: Allowance = field(default_factory=lambda: Allowance(RATE_HZ, BURST))
    complaints: Allowance = field(default_factory=lambda: Allowance(1.0, 5.0))
    """How often what is refused of it goes into the log."""
    bookmarks: Allowance = field(default_factory=lambda: Allowance(BOOKMARK_HZ, BOOKMARK_BURST))
    gate: Gate = field(init=False)
    holder: str = field(init=False)
    malformed: int = 0
    stops: dict[str, int] = field(default_factory=dict)
    """Stop presses taken, by level."""
    released: bool = False
    """Whether the dead man was seen open since the right to drive began, or since driving was locked."""
    told_right: Right | None = None
    last: Operate | None = None
    """The newest wish that was taken."""
    video: Viewer | None = None
    """The newest stream of pictures to this page."""

    def __post_init__(self) -> None:
        self.gate = Gate(self.secret)
        self.holder = f"page-{self.number}-{secrets.token_hex(2)}"

    @property
    def name(self) -> str:
        return f"operator {self.number}"
