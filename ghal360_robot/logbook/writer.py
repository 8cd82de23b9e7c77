"""The one thread that owns the recording: takes from the mailbox, writes rows, watches the file."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING

from ghal360_robot.logbook import rows
from ghal360_robot.logbook.batches import BAD_ROW, Batches
from ghal360_robot.logbook.errors import RecordingNotWritableError

if TYPE_CHECKING:
    from ghal360_robot.logbook.clock import Anchor
    from ghal360_robot.logbook.mailbox import Mailbox
    from ghal360_robot.logbook.part import PartFile

# Small bites with pauses, so that a control loop in the same interpreter is never kept waiting long.
TAKE_PERIOD_S = 0.05
TAKE_ENTRIES = 50
TAKE_S = 0.025

# A killed process loses what it has not flushed: 0.3 s here and less than 0.1 s on the way there.
# Every flush costs about 1.1 kB for each entity that has rows.
FLUSH_PERIOD_S = 0.3

# Tables that only draw what other tables keep are flushed every so many times.
SLOW_FLUSHES = 4

# Other threads may run between two tables of a flush.
BREATH_S = 0.0005

PROBE_PERIOD_S = 1.0

# Of the time to close, this much is kept for the last flush and the footer.
FOOTER_S = 1.0

SOURCE = "logbook"

logger = logging.getLogger(__name__)


class Writer:
    """Runs from `start` until `stop`; its fields may be read from any thread."""

    def __init__(self, mailbox: Mailbox, part: PartFile, anchor: Anchor) -> None:
        self._mailbox = mailbox
        self._part = part
        self._stop = threading.Event()
        self._reported_drops = (0, 0)
        self._take_until = 0.0
        self._thread = threading.Thread(target=self._run, name="logbook-writer", daemon=True)
        self.batches = Batches(part.stream, anchor)
        self.failed: str | None = None
        self.reopened = 0
        self.cpu_s = 0.0

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout_s: float) -> bool:
        """Write what waits and the footer; False where that takes longer than `timeout_s`."""
        self._take_until = time.monotonic() + max(timeout_s - FOOTER_S, timeout_s / 2)
        self._stop.set()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        flush_at = time.monotonic() + FLUSH_PERIOD_S
        probe_at = time.monotonic() + PROBE_PERIOD_S
        flushes = 0
        while not self._stop.wait(TAKE_PERIOD_S):
            now = time.monotonic()
            if self.failed is None:
                self._take(until=now + TAKE_S)
                if now >= flush_at:
                    flushes += 1
                    self._flush(slow=flushes % SLOW_FLUSHES == 0)
                    flush_at = now + FLUSH_PERIOD_S
            if now >= probe_at:
                self._report()
                self._probe()
                probe_at = now + PROBE_PERIOD_S
            self.cpu_s = time.thread_time()
        self._finish()

    def _run(self) -> None:
        try:
            self._work()
        except Exception as error:
            self.failed = f"The recording has ended because of a mistake in the logbook ({error!r})."
            logger.exception("The logbook's writer has failed")
            self._part.close()

    def _take(self, until: float) -> None:
        while entries := self._mailbox.take(TAKE_ENTRIES):
            for entry in entries:
                try:
                    for row in entry.rows():
                        self.batches.add(row)
                except BAD_ROW as error:
                    self.batches.fail(entry.entity, error)
            if time.monotonic() >= until:
                return

    def _flush(self, *, slow: bool) -> None:
        for _ in self.batches.flush(slow=slow):
            time.sleep(BREATH_S)

    def _finish(self) -> None:
        if self.failed is None:
            self._take(self._take_until)
        self._mailbox.abandon()
        self._report()
        if self.failed is None:
            for _ in self.batches.flush():
                pass
        reason = self._part.close()
        if reason is not None and self.failed is None:
            self.failed = f"The recording {self._part.path} has no proper end ({reason})."

    def _probe(self) -> None:
        """A dead file writer shows in nothing but a failing flush (fact sheet rerun_and_style, A4)."""
        if self.failed is None:
            reason = self._part.death()
            if reason is None:
                return
            self.failed = (
                f"The recording {self._part.path} has stopped ({reason}): the disk is probably full; "
                "make room and it goes on in a new part."
            )
        if not self._part.disk_takes_bytes():
            return
        try:
            self._part.open_next()
        except RecordingNotWritableError as error:
            self.failed = str(error)
            return
        self.reopened += 1
        self.batches.begin_anew()
        self._say("ERROR", f"{self.failed} What came in the second before that is lost.")
        self.failed = None

    def _report(self) -> None:
        """Say in the log itself what is missing from it."""
        drops = (self._mailbox.dropped_video, self._mailbox.dropped_rest)
        video, rest = (now - before for now, before in zip(drops, self._reported_drops, strict=True))
        if video or rest:
            self._reported_drops = drops
            self._say("WARN", f"The disk is too slow: {video} pictures and {rest} other entries were dropped.")
        failures = self.batches.take_failures()
        if failures:
            which = ", ".join(f"{count} of {entity}" for entity, count in sorted(failures.items()))
            self._say("ERROR", f"Rows that could not be logged: {which} ({self.batches.last_failure}).")

    def _say(self, level: str, message: str) -> None:
        for row in rows.text(time.monotonic_ns(), SOURCE, level, message):
            self.batches.add(row)
