"""How much one connection may send: a bucket of tokens that fills by itself. Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Allowance:
    """`rate_hz` messages a second in the long run, `burst` at once."""

    rate_hz: float
    burst: float
    _tokens: float = -1.0
    _at_ns: int = 0

    def spend(self, now_ns: int) -> bool:
        """One message; False where there is no token left for it."""
        if self._tokens < 0.0:
            self._tokens, self._at_ns = self.burst, now_ns
        self._tokens = min(self.burst, self._tokens + (now_ns - self._at_ns) / 1e9 * self.rate_hz)
        self._at_ns = now_ns
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
