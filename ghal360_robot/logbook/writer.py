"""The one thread that owns the recording: takes from the mailbox, encodes rows, hands them to store and live view."""

from __future__ import annotations

import logging
import math
import threading
import time
from typing import TYPE_CHECKING

from ghal360_robot.logbook import rows
from ghal360_robot.logbook.batches import BAD_ROW, Batches
from ghal360_robot.logbook.handler import LEVELS, RECORDED

if TYPE_CHECKING:
    from collections.abc import Callable

    from ghal360_robot.logbook.clock import Anchor
    from ghal360_robot.logbook.live_feed import LiveFeed
    from ghal360_robot.logbook.mailbox import Entry, Mailbox
    from ghal360_robot.logbook.store import Store

# Small bites with pauses, so that a control loop in the same interpreter is never kept waiting long.
TAKE_PERIOD_S = 0.05
TAKE_ENTRIES = 50
TAKE_S = 0.025

# A third of a second's entries: beyond that the pauses are short, or a busy machine would never let it catch up.
BACKLOG = 300
HURRY_S = 0.005

# A killed process loses what is not settled: this long, and the way there.
SETTLE_PERIOD_S = 0.05
"""Pictures settle every second time: each time makes a chunk of them, and a chunk has its price."""

# A chunk costs about 1.1 kB beside its rows, and there are twenty of them; until then rows are in the log ahead.
MERGE_PERIOD_S = 5.0

# Other threads may run between two tables. Where other processes want the machine, coming back from each of these
# breaths takes long: so much in all, and the rest goes without, or a killed process would lose what waits here.
BREATH_S = 0.0005
BREATHS_S = 0.02

LOOK_PERIOD_S = 1.0

# Of the time to close, this much is kept for the last chunks and the footer.
FOOTER_S = 1.0

SOURCE = "logbook"

logger = logging.getLogger(__name__)


class Writer:
    """Runs from `start` until `stop`; its fields may be read from any thread."""

    def __init__(
        self, mailbox: Mailbox[Entry], anchor: Anchor, open_store: Callable[[Writer], Store], live: LiveFeed | None
    ) -> None:
        self._mailbox = mailbox
        self._live = live
        self._stop = threading.Event()
        self._reported_drops = (0, 0)
        self._take_until = 0.0
        self._thread = threading.Thread(target=self._run, name="logbook-writer", daemon=True)
        self.batches = Batches(anchor)
        self.failed: str | None = None
        self.cpu_s = 0.0
        self.store = open_store(self)

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout_s: float) -> bool:
        """Write what waits and the footer; False where that takes longer than `timeout_s`."""
        self._take_until = time.monotonic() + max(timeout_s - FOOTER_S, timeout_s / 2)
        self._stop.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def say(self, level: int, message: str) -> None:
        """Into the recording, and to whoever reads Python's logging beside it."""
        logger.log(level, "%s", message, extra=RECORDED)
        name = next((name for bound, name in LEVELS if level >= bound), "TRACE")
        for row in rows.text(time.monotonic_ns(), SOURCE, name, message):
            self.batches.add(row)

    def _work(self) -> None:
        now = time.monotonic()
        settle_at, merge_at, look_at = now + SETTLE_PERIOD_S, now + MERGE_PERIOD_S, now + LOOK_PERIOD_S
        pictures = False
        while not self._stop.wait(HURRY_S if len(self._mailbox) > BACKLOG else TAKE_PERIOD_S):
            now = time.monotonic()
            self._take(TAKE_S)
            if now >= settle_at:
                pictures = not pictures
                self._encode(pictures=pictures)
                settle_at = now + SETTLE_PERIOD_S
                if now >= merge_at:
                    self.store.merge()
                    merge_at = now + MERGE_PERIOD_S
                else:
                    self.store.settle()
            if now >= look_at:
                self._report()
                self.store.look()
                look_at = now + LOOK_PERIOD_S
            self.cpu_s = time.thread_time()
        self._finish()

    def _run(self) -> None:
        try:
            self._work()
        except Exception as error:
            self.failed = f"The recording has ended because of a mistake in the logbook ({error!r})."
            logger.exception("The logbook's writer has failed")
            self.store.close()

    def _take(self, cpu_s: float, until: float = math.inf) -> None:
        """For so much of the processor's time: of the wall's, a machine with much else to do grants little."""
        enough_s = time.thread_time() + cpu_s
        while entries := self._mailbox.take(TAKE_ENTRIES):
            for entry in entries:
                try:
                    for row in entry.rows():
                        self.batches.add(row)
                except BAD_ROW as error:
                    self.batches.fail(entry.entity, error)
            if time.thread_time() >= enough_s or time.monotonic() >= until:
                return

    def _encode(self, *, pictures: bool = True) -> None:
        live = self._live
        if live is not None and live.wants_everything_anew():
            self.batches.begin_anew()
        breathe_until = time.monotonic() + BREATHS_S
        for table, batch in self.batches.take(pictures=pictures):
            try:
                self.store.put(table, batch)
                if live is not None:
                    live.offer(table, batch)
            except BAD_ROW as error:
                self.batches.fail(table.entity, error, batch.num_rows)
            if not self._stop.is_set() and time.monotonic() < breathe_until:
                time.sleep(BREATH_S)

    def _finish(self) -> None:
        self._take(math.inf, self._take_until)
        self._mailbox.abandon()
        self._report()
        self._encode()
        reason = self.store.close()
        if reason is not None:
            self.failed = f"The recording has no proper end: {reason}."

    def _report(self) -> None:
        """Say in the log itself what is missing from it."""
        store = self.store
        drops = (self._mailbox.dropped_video + store.dropped_video, self._mailbox.dropped_rest + store.dropped_rest)
        video, rest = (now - before for now, before in zip(drops, self._reported_drops, strict=True))
        if video or rest:
            self._reported_drops = drops
            why = "; ".join(store.not_recorded) or "the disk is too slow"
            self.say(logging.WARNING, f"{video} pictures and {rest} other entries are not in the recording: {why}.")
        failures = self.batches.take_failures()
        if failures:
            which = ", ".join(f"{count} of {entity}" for entity, count in sorted(failures.items()))
            self.say(logging.ERROR, f"Rows that could not be logged: {which} ({self.batches.last_failure}).")
