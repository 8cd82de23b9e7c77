"""Everything between the pages and the robot but the network: who drives, what of it counts, what is told to whom.

The robot is reached through `tell`, which takes a kind and a value and never waits. Instants come from `clock`
(nanoseconds of the monotonic clock), so that tests bring their own.
"""

from __future__ import annotations

import logging
import secrets
from typing import TYPE_CHECKING, Any

from ghal360_robot.telepresence import gate, lease_desk
from ghal360_robot.telepresence.access import Role
from ghal360_robot.telepresence.connection import MAX_MALFORMED, Connection
from ghal360_robot.telepresence.lease_desk import Desk
from ghal360_robot.telepresence.protocol import (
    VERSION,
    Bookmark,
    Echo,
    Hello,
    LeaseWish,
    MalformedError,
    Operate,
    Ping,
    Pong,
    Probe,
    Quality,
    Refused,
    Right,
    Shown,
    Stop,
    parse,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from ghal360_robot.telepresence.protocol import Message
    from ghal360_robot.telepresence.settings import PageSettings

PICTURE_LOCK = "operator's picture"
"""Held while the driver does not see a live picture; it has to be published, or the safety chain holds."""

BEAT_S = 0.1
"""Lock and lease are published so often."""

QUALITY_BEATS = 2
PROBE_BEATS = 2
NO_PICTURE = "no picture is shown yet"
PRESS_AGAIN = "let go and press again"

logger = logging.getLogger(__name__)


class FloodError(Exception):
    """This connection sends more than any page does, or what no page sends; it has to be closed."""


class Hub:
    """All open pages of one robot."""

    def __init__(self, settings: PageSettings, tell: Callable[[str, Any], object], clock: Callable[[], int]) -> None:
        self.settings = settings
        self.connections: dict[str, Connection] = {}
        self._tell = tell
        self._clock = clock
        self._desk = Desk()
        self._numbers = 0
        self._beats = 0
        self._lock = NO_PICTURE
        self._states: dict[str, str] = {}

    def join(self, role: Role, address: str) -> Connection:
        """A page has connected."""
        self._numbers += 1
        connection = Connection(self._numbers, role, address)
        self.connections[connection.secret] = connection
        s = self.settings
        streams = ("camera", "small", "stills") if s.small_codec else ("camera", "stills")
        hello = Hello(
            kind="hello",
            version=VERSION,
            conn=connection.secret,
            name=connection.name,
            role=role.value,
            robot=s.robot,
            target=s.target,
            v_max=s.v_max,
            w_max=s.w_max,
            camera_yaw=s.camera_yaw,
            picture_hold_s=s.picture_hold_s,
            blind=s.blind,
            arrow=s.arrow,
            streams=streams,  # type: ignore[arg-type]
        )
        connection.outbox.answer(hello.model_dump_json())
        for kind, text in self._states.items():
            connection.outbox.put(kind, text)
        self._say_rights()
        logger.info("%s (%s) has opened the page from %s", connection.name, role.value, connection.address)
        return connection

    def leave(self, connection: Connection) -> None:
        """A page has gone; if it drove, the robot stands still at once."""
        if self.connections.pop(connection.secret, None) is None:
            return
        now_ns = self._clock()
        if self._desk.holder == connection.secret:
            self._let_go(connection, now_ns)
        self._desk = lease_desk.gone(self._desk, connection.secret, now_ns)
        self._publish(now_ns)
        self._say_rights()
        logger.info("%s has closed the page", connection.name)

    def take(self, connection: Connection, text: str) -> None:
        """One message of a page. Raises FloodError where the connection has to be closed."""
        now_ns = self._clock()
        if not connection.allowance.spend(now_ns):
            self._stop_in(connection, text)
            raise FloodError(f"{connection.name} sends more than any page does")
        try:
            message = parse(text)
        except MalformedError as error:
            connection.malformed += 1
            self._refuse(connection, "message", f"malformed: {error}")
            if connection.malformed >= MAX_MALFORMED:
                raise FloodError(f"{connection.name} sends what no page sends") from error
            return
        match message:
            case Operate():
                self._operate(connection, message, now_ns)
            case Stop():
                self._stop(connection, message)
            case LeaseWish():
                self._wish(connection, message, now_ns)
            case Bookmark():
                self._bookmark(connection, message, now_ns)
            case Shown():
                if connection.delays.shown(message.seq, now_ns) and connection.video is not None:
                    connection.video.shown(message.seq)
            case Echo():
                connection.delays.echo(message.nonce, now_ns)
            case Ping():
                received_us, sent_us = now_ns // 1000, self._clock() // 1000
                pong = Pong(kind="pong", t0=message.t0, received_us=received_us, sent_us=sent_us)
                connection.outbox.answer(pong.model_dump_json())

    def broadcast(self, kind: str, text: str) -> None:
        """Something of the robot for every page; a page that opens later gets the newest as well."""
        self._states[kind] = text
        for connection in self.connections.values():
            connection.outbox.put(kind, text)

    def beat(self) -> None:
        """Ten times a second: publish lease and lock, probe the round trips, tell everybody how they are doing."""
        now_ns = self._clock()
        before = self._desk
        self._desk = lease_desk.settle(before, now_ns)
        if before.holder and self._desk.holder != before.holder:
            logger.warning("the driver fell silent: the right to drive is free")
        self._publish(now_ns)
        self._say_rights()
        for connection in self.connections.values():
            if self._beats % PROBE_BEATS == 0:
                nonce = secrets.randbelow(1_000_000_000)
                connection.delays.probe(nonce, now_ns)
                connection.outbox.put("probe", Probe(kind="probe", nonce=nonce).model_dump_json())
            if self._beats % QUALITY_BEATS == 0:
                connection.outbox.put("quality", self._quality(connection, now_ns).model_dump_json())
        self._beats += 1

    @property
    def driver(self) -> Connection | None:
        return self.connections.get(self._desk.holder)

    def picture_lock(self, connection: Connection, now_ns: int) -> str:
        """Why nobody may drive by the picture this page shows, in words; empty if they may."""
        age_ns = connection.delays.picture_age_ns(now_ns)
        if age_ns is None:
            return NO_PICTURE
        if age_ns > self.settings.picture_hold_s * 1e9:
            return f"the picture on the screen is {age_ns / 1e9:.1f} s old"
        return ""

    def _operate(self, connection: Connection, message: Operate, now_ns: int) -> None:
        drives = self._desk.holder == connection.secret and connection.role is Role.DRIVER
        connection.gate, verdict = gate.judge(connection.gate, message, now_ns // 1000, drives=drives)
        self._tell("received", self._received(connection, message, verdict, now_ns))
        if verdict != gate.TAKEN:
            self._refuse(connection, "operate", verdict)
            return
        self._desk = lease_desk.renew(self._desk, connection.secret, now_ns)
        lock = self.picture_lock(connection, now_ns)
        if lock:
            connection.released = False
        elif not message.deadman:
            connection.released = True
        connection.last = message
        self._forward(connection, message, now_ns, deadman=message.deadman and connection.released)
        self._say_lock(lock, now_ns)

    def _forward(self, connection: Connection, message: Operate, now_ns: int, *, deadman: bool) -> None:
        s, stick = self.settings, message.stick
        self._tell(
            "operator",
            {
                "stamp_ns": now_ns,
                "head": {"yaw": message.yaw, "pitch": message.pitch, "fov": message.fov_h},
                "deadman": deadman,
                "stick": None if stick is None else {"v": stick.v * s.v_max, "w": stick.w * s.w_max},
                "arm_presses": message.arm,
                "disarm_presses": message.disarm,
                "found_presses": message.found,
                "holder": connection.holder,
                "latency_s": round(connection.delays.latency_s(now_ns), 4),
            },
        )

    def _let_go(self, connection: Connection, now_ns: int) -> None:
        """The driver's last word, said for them: the dead man is open."""
        if connection.last is not None:
            self._forward(connection, connection.last, now_ns, deadman=False)

    def _stop(self, connection: Connection, message: Stop) -> None:
        if message.press <= connection.stops.get(message.level, 0):
            return
        connection.stops[message.level] = message.press
        self._tell("stop", message.level)
        logger.warning("%s pressed %s", connection.name, "emergency stop" if message.level == "estop" else "stop")

    def _stop_in(self, connection: Connection, text: str) -> None:
        """A stop counts even from a connection that says too much."""
        try:
            message = parse(text)
        except MalformedError:
            return
        if isinstance(message, Stop):
            self._stop(connection, message)

    def _bookmark(self, connection: Connection, message: Bookmark, now_ns: int) -> None:
        if not connection.bookmarks.spend(now_ns):
            self._refuse(connection, "bookmark", "wait a few seconds before the next one")
            return
        # It goes to terminals as well: no escape sequences, one line.
        note = " ".join("".join(c if c.isprintable() else " " for c in message.note).split())
        self._tell("bookmark", {"stamp_ns": now_ns, "holder": connection.holder, "note": note})

    def _wish(self, connection: Connection, message: LeaseWish, now_ns: int) -> None:
        if connection.role is not Role.DRIVER:
            self._refuse(connection, "lease", "this login may look and stop, not drive")
            return
        before = self._desk
        self._desk, why = lease_desk.wish(before, connection.secret, message.wish, now_ns)
        if why:
            self._refuse(connection, "lease", why)
        if self._desk.holder != before.holder:
            old, new = self.connections.get(before.holder), self.driver
            if old is not None:
                self._let_go(old, now_ns)
            if new is not None:
                new.released = False
            logger.warning("%s drives now", "nobody" if new is None else new.name)
        self._publish(now_ns)
        self._say_rights()

    def _publish(self, now_ns: int) -> None:
        driver = self.driver
        lease = None if driver is None else {"holder": driver.holder, "stamp_ns": self._desk.renewed_ns}
        self._tell("lease", lease)
        self._say_lock(NO_PICTURE if driver is None else self.picture_lock(driver, now_ns), now_ns)

    def _say_lock(self, lock: str, now_ns: int) -> None:
        driver = self.driver
        if lock and driver is not None:
            driver.released = False
        if driver is not None and bool(lock) != bool(self._lock):
            if lock:
                logger.warning("driving is locked: %s", lock)
            else:
                logger.info("driving is free again: the driver's picture is live")
        self._lock = lock
        self._tell("lock", {"name": PICTURE_LOCK, "stamp_ns": now_ns, "engaged": bool(lock)})

    def _say_rights(self) -> None:
        """Everybody knows who drives; told only where it has changed for them."""
        now_ns, desk = self._clock(), self._desk
        driver = self.connections.get(desk.holder)
        asking = self.connections.get(desk.asking)
        for connection in self.connections.values():
            yours = driver is connection
            right = Right(
                kind="right",
                driver=None if driver is None else driver.name,
                yours=yours,
                asking=None if asking is None else asking.name,
                may_take=desk.may_take(connection.secret, now_ns),
                words=_words(yours=yours, asks=asking is connection, asking=asking, driver=driver),
            )
            if right != connection.told_right:
                connection.told_right = right
                connection.outbox.put("right", right.model_dump_json())

    def _quality(self, connection: Connection, now_ns: int) -> Quality:
        delays, video = connection.delays, connection.video
        lock = self.picture_lock(connection, now_ns)
        held = connection.last is not None and connection.last.deadman and not connection.released
        if not lock and held and connection is self.driver:
            lock = PRESS_AGAIN
        return Quality(
            kind="quality",
            round_trip_ms=_ms(delays.round_trip_ns(now_ns)),
            loop_ms=_ms(delays.loop_ns),
            picture_ms=_ms(delays.picture_age_ns(now_ns)),
            dropped=0 if video is None else video.dropped,
            bit_rate=0.0 if video is None else round(video.bit_rate(now_ns)),
            lock=lock,
            viewers=len(self.connections),
        )

    def _received(self, connection: Connection, message: Operate, verdict: str, now_ns: int) -> dict[str, Any]:
        return {
            "stamp_ns": now_ns,
            "sent_ns": message.sent_us * 1000,
            "holder": connection.holder,
            "sequence": message.seq,
            "verdict": verdict,
            "deadman": message.deadman,
            "stick": None if message.stick is None else [message.stick.v, message.stick.w],
        }

    def _refuse(self, connection: Connection, what: str, why: str) -> None:
        self.say(connection, Refused(kind="refused", what=what, why=why[:300]))
        if connection.complaints.spend(self._clock()):
            logger.warning("refused of %s: %s (%s)", connection.name, what, why)

    @staticmethod
    def say(connection: Connection, message: Message) -> None:
        connection.outbox.answer(message.model_dump_json())


def _words(*, yours: bool, asks: bool, asking: Connection | None, driver: Connection | None) -> str:
    if yours:
        return "you drive" if asking is None else f"you drive; {asking.name} asks to drive"
    if driver is None:
        return "nobody drives"
    return f"{driver.name} drives" + ("; you have asked to drive" if asks else "")


def _ms(value_ns: int | None) -> float | None:
    return None if value_ns is None else round(min(value_ns / 1e6, 1e6), 1)
