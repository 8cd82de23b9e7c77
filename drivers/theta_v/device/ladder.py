"""What to do when the pictures stop: from the mildest means to the strongest (fact sheet 3.3)."""

from __future__ import annotations

from enum import Enum

STEADY_S = 5.0  # pictures for so long, and the last step helped; after a shorter spell the next stall climbs on
LONGEST_DROUGHT_S = 60.0  # a bus that spoils every key picture must not have its stream restarted all the time


class Step(Enum):
    RESTART = "restarting the stream"
    RENEGOTIATE = "negotiating the stream anew"
    RESET = "resetting its USB port"
    TOGGLE = "sending it to still mode and back"
    REOPEN = "opening the camera anew"


ORDER = (Step.RESTART, Step.RESTART, Step.RENEGOTIATE, Step.RESET, Step.TOGGLE, Step.REOPEN)


class Ladder:
    """Pure: told when the stream was started and when pictures came, says what is due at `now_ns`."""

    def __init__(self, now_ns: int, *, stall_s: float, first_picture_s: float) -> None:
        self._stall_ns, self._first_ns = round(stall_s * 1e9), round(first_picture_s * 1e9)
        self._rung = 0
        self._started_ns = now_ns

    def due(self, now_ns: int, last_picture_ns: int | None) -> Step | None:
        """The step to take now, or None. After a step call `started()`."""
        if last_picture_ns is not None and last_picture_ns >= self._started_ns:
            if last_picture_ns - self._started_ns >= STEADY_S * 1e9:
                self._rung = 0
            silent, patience = now_ns - last_picture_ns, self._stall_ns
        else:
            # A camera that streamed a moment ago need not be waited for as long as one just switched on.
            silent = now_ns - self._started_ns
            patience = self._first_ns if self._rung == 0 else self._stall_ns
        if silent < patience:
            return None
        step = ORDER[min(self._rung, len(ORDER) - 1)]
        self._rung += 1
        return step

    def started(self, now_ns: int) -> None:
        """The stream was started again."""
        self._started_ns = now_ns


class Drought:
    """Pure: pictures come, but somebody waits for a key picture, which only a new start is sure to bring.

    Nobody knows how often a THETA V sends one (fact sheet 2.3), and there is no request for it.
    """

    def __init__(self, patience_s: float) -> None:
        self._patience_ns = self._wait_ns = round(patience_s * 1e9)
        self._asked_ns = 0

    def due(self, now_ns: int, since_ns: int | None) -> bool:
        """Whether to restart the stream now; `since_ns` is when the waiting began, None when nobody waits."""
        if since_ns is None:
            self._wait_ns = self._patience_ns
            return False
        if now_ns - max(since_ns, self._asked_ns) < self._wait_ns:
            return False
        self._asked_ns = now_ns
        self._wait_ns = min(2 * self._wait_ns, max(self._patience_ns, round(LONGEST_DROUGHT_S * 1e9)))
        return True
