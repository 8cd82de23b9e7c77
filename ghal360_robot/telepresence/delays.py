"""How late everything is for one connection, by the robot's clock alone: nothing a page says can make it look better.

Pure: instants come from the caller.
"""

from __future__ import annotations

from collections import deque

WINDOW = 16
"""Round trips looked at: four seconds of probes."""

MAX_PROBES = 32
MAX_PICTURES = 512


class Delays:
    """Fed with what was sent and what came back."""

    def __init__(self) -> None:
        self._probes: dict[int, int] = {}
        self._round_trips: deque[int] = deque(maxlen=WINDOW)
        self._sent: deque[tuple[int, int]] = deque(maxlen=MAX_PICTURES)
        """Sequence and capture of every picture sent."""
        self.loop_ns: int | None = None
        """From a picture's arrival at the robot until the robot heard that it is shown; the newest."""
        self._shown_capture_ns: int | None = None

    def probe(self, nonce: int, now_ns: int) -> None:
        """A probe was sent."""
        self._probes[nonce] = now_ns
        while len(self._probes) > MAX_PROBES:
            del self._probes[next(iter(self._probes))]

    def echo(self, nonce: int, now_ns: int) -> bool:
        """An echo came; False where nobody asked, or had an answer before."""
        sent_ns = self._probes.pop(nonce, None)
        if sent_ns is None:
            return False
        self._round_trips.append(now_ns - sent_ns)
        return True

    def round_trip_ns(self, now_ns: int) -> int | None:
        """The median of the last ones, or for how long the oldest probe has been unanswered where that is longer."""
        waiting = max((now_ns - sent for sent in self._probes.values()), default=0)
        if not self._round_trips:
            return waiting or None
        ordered = sorted(self._round_trips)
        return max(ordered[len(ordered) // 2], waiting if waiting > ordered[-1] else 0)

    def picture(self, sequence: int, capture_ns: int) -> None:
        """A picture was sent."""
        self._sent.append((sequence, capture_ns))

    def shown(self, sequence: int, now_ns: int) -> bool:
        """The page says that this picture is shown; False for one that was never sent, or is older than the last."""
        while self._sent and self._sent[0][0] < sequence:
            self._sent.popleft()
        if not self._sent or self._sent[0][0] != sequence:
            return False
        capture_ns = self._sent.popleft()[1]
        self._shown_capture_ns = capture_ns
        self.loop_ns = now_ns - capture_ns
        return True

    def picture_age_ns(self, now_ns: int) -> int | None:
        """How old the newest picture is that is known to be shown; None before the first."""
        return None if self._shown_capture_ns is None else now_ns - self._shown_capture_ns

    def latency_s(self, now_ns: int) -> float:
        """What the safety chain slows down by: the longer of the two ways round."""
        return max(self.round_trip_ns(now_ns) or 0, self.loop_ns or 0) / 1e9
