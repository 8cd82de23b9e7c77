"""Whether the driver's reader keeps up with everything a base can say: all 48 frames, a hundred times a second.

The simulated base has a thread of its own, so that the CPU time of the driver's reader and of the event
loop that assembles packets can be told apart from it.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from drivers.rmp110.codec.assembler import Assembler
from drivers.rmp110.codec.commands import POLL
from drivers.rmp110.codec.feedback import FACTORY_BITMAPS, Layout
from drivers.rmp110.codec.parameters import RMP110_STORED, Stored
from drivers.rmp110.errors import RmpSendDropped
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.serve import serve
from drivers.rmp110.transport.can_bus import CanTransport
from ghal360_robot.errors import GhalError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.rmp110.codec.frames import Frame

PERIOD_S = 0.01
"""The fastest a base answers (fact sheet 3.5)."""
INTERFACES = ("virtual", "socketcand")
LAST_REPLY_S = 0.5
START_S = 5.0
CHANNEL = "bench"
LAYOUT = Layout.of(FACTORY_BITMAPS)
FRAMES = LAYOUT.frame_count
READER = "rmp110-reader"
"""Name of the transport's thread."""


@dataclass(frozen=True, slots=True)
class FeedbackRun:
    """What was asked for and what arrived; CPU shares are of one core."""

    interface: str
    seconds: float
    polls: int
    """Sent; after a stall of this machine they go on at their pace, and the missed ones are not made up for."""
    polls_dropped: int
    """Those the bus did not take."""
    frames: int
    packets: int
    torn: int
    """Packets given up because their frames came late or not at all."""
    damaged: int
    reader_cpu: float
    """The transport's thread: waiting for frames, parsing, stamping."""
    loop_cpu: float
    """The event loop: polls, and frames into packets."""

    @property
    def frames_lost(self) -> int:
        return self.polls * FRAMES - self.frames

    @property
    def lost(self) -> int:
        """Packets that were asked for and did not come whole."""
        return self.polls - self.packets

    @property
    def passed(self) -> bool:
        return self.packets > 0 and not (self.lost or self.torn or self.damaged or self.polls_dropped)

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "lost": self.lost, "frames_lost": self.frames_lost, "passed": self.passed}


def measure(interface: str, seconds: float) -> FeedbackRun:
    """Poll a simulated base over this python-can interface. Raises RmpError, GhalError where the bus is lost."""
    with _base(interface) as port:
        options: dict[str, Any] = {"host": "127.0.0.1", "port": port} if port else {}
        return asyncio.run(_poll(interface, CanTransport(interface, CHANNEL, **options), seconds))


@contextlib.contextmanager
def _base(interface: str) -> Iterator[int]:
    """A base with factory feedback in a thread of its own; its port where it has one."""
    ready, stop = threading.Event(), threading.Event()
    ports: list[int] = []

    async def live() -> None:
        model = RmpModel(
            time.monotonic_ns(),
            Stored.of(
                {**RMP110_STORED, **{f"feedback_bitmap_{n}": word for n, word in enumerate(FACTORY_BITMAPS, start=1)}}
            ),
            boot_s=0.0,
        )
        async with serve(interface, CHANNEL, model=model) as base:
            ports.append(base.port)
            ready.set()
            await asyncio.to_thread(stop.wait)

    thread = threading.Thread(target=lambda: asyncio.run(live()), name="simulated base", daemon=True)
    thread.start()
    try:
        if not ready.wait(START_S):
            raise GhalError(f"no simulated base on python-can's {interface}")
        yield ports[0]
    finally:
        stop.set()
        thread.join(START_S)


async def _poll(interface: str, transport: CanTransport, seconds: float) -> FeedbackRun:
    assembler = Assembler(FRAMES)
    polls = dropped = frames = packets = 0
    news = asyncio.Event()
    lost: list[str] = []

    def receive(stamp_ns: int, frame: Frame) -> None:
        nonlocal frames, packets
        frames += 1
        packets += assembler.feed(stamp_ns, frame) is not None
        news.set()

    await transport.open(receive, lost.append)
    try:
        began, reader_s, loop_s = time.monotonic(), _reader_cpu_s(), time.thread_time()
        due = began
        while due < began + seconds:
            try:
                transport.send(POLL)
                polls += 1
            except RmpSendDropped:
                dropped += 1
            due = max(due + PERIOD_S, time.monotonic())
            await asyncio.sleep(due - time.monotonic())
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LAST_REPLY_S):
                while frames < polls * FRAMES:
                    news.clear()
                    await news.wait()
        spent_s = time.monotonic() - began
        reader_s, loop_s = _reader_cpu_s() - reader_s, time.thread_time() - loop_s
        damaged = transport.damaged + assembler.damaged
    finally:
        await transport.close()
    if lost:
        raise GhalError(f"the bus was lost: {lost[0]}")
    return FeedbackRun(
        interface=interface,
        seconds=round(spent_s, 2),
        polls=polls,
        polls_dropped=dropped,
        frames=frames,
        packets=packets,
        torn=assembler.torn,
        damaged=damaged,
        reader_cpu=round(reader_s / spent_s, 3),
        loop_cpu=round(loop_s / spent_s, 3),
    )


def _reader_cpu_s() -> float:
    """CPU time of the reader's thread so far; of this process' only one that belongs to the driver's end."""
    # On the virtual bus the simulated base has a reader of the same name, started earlier.
    newest = [thread for thread in threading.enumerate() if thread.name == READER and thread.ident is not None][-1]
    assert newest.ident is not None  # noqa: S101 - asked for above
    return time.clock_gettime(time.pthread_getcpuclockid(newest.ident))
