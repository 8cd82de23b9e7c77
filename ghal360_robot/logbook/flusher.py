"""Whether rows get to the operating system, asked from a thread that may be lost over it."""

from __future__ import annotations

import queue
import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rerun as rr

# A healthy writer answers a flush in about a millisecond; a slow disk may take longer, a dead one raises.
ANSWER_S = 0.5

# Rerun's flush has a time limit, and does not keep it where its file's writer dies at the wrong moment (0.41): it
# never comes back then. No disk that is any good takes so long.
STUCK_S = 5.0
STUCK = "its writer does not answer any more"


class Flusher:
    """Of one stream. `flush` is for one thread; it returns in ANSWER_S whatever the stream does."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._questions: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._asked_s = 0.0
        self.pending = False
        """Whether rows that were sent before the last `flush` are still on their way."""
        self.stuck = False
        """Whether the stream has to be left behind as it is: whatever touches it may never come back."""
        threading.Thread(target=self._run, name="logbook-flush", daemon=True).start()

    def flush(self) -> str | None:
        """Why rows do not arrive any more; None where they have arrived, or are `pending`."""
        late = self.pending
        if not late:
            self.pending, self._asked_s = True, time.monotonic()
            self._questions.put(True)
        try:
            reason = self._answers.get(timeout=ANSWER_S)
        except queue.Empty:
            self.stuck = time.monotonic() - self._asked_s > STUCK_S
            return STUCK if self.stuck else None
        self.pending = False
        if late and reason is None:
            return self.flush()  # for what was sent since that question
        return reason

    def close(self) -> None:
        """End the thread, if it can be ended."""
        self._questions.put(False)

    def _run(self) -> None:
        while self._questions.get():
            self._answers.put(self._flushed())

    def _flushed(self) -> str | None:
        while True:
            try:
                self._stream.flush(timeout_sec=ANSWER_S)
            except (RuntimeError, ValueError) as error:
                reason = str(error)
                if "timed out" not in reason.lower() and "timeout" not in reason.lower():
                    return reason
            else:
                return None
