"""What a run came to, as a few figures: once as recorded, once as replayed, side by side."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ghal360_robot.messages import STILL, ArmState, Cue

if TYPE_CHECKING:
    from ghal360_robot.messages import Applied, Decision, Detections

NS = 1e9


@dataclass(slots=True)
class Outcome:
    """Adds up over the ticks of a run, in order."""

    cues_shown: Counter[str] = field(default_factory=Counter)
    intentions: int = 0
    target_seen_s: float = 0.0
    armed_s: float = 0.0
    distance_m: float = 0.0
    """Of the speeds applied; how the robot would have come to stand elsewhere, nobody knows."""
    held_s: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    """Seconds held still against the brain's wish, by reason."""
    objects: Counter[str] = field(default_factory=Counter)
    _before: tuple[int, Decision, Applied] | None = None

    def note(self, stamp_ns: int, decision: Decision, applied: Applied) -> None:
        if self._before is not None:
            self._held(*self._before[1:], (stamp_ns - self._before[0]) / NS)
        cue, intention = (None, None) if self._before is None else (self._before[1].cue, self._before[1].intention)
        self.cues_shown[decision.cue.value] += decision.cue is not Cue.NONE and decision.cue is not cue
        self.intentions += decision.intention is not None and decision.intention != intention
        self._before = (stamp_ns, decision, applied)

    def detected(self, found: Detections) -> None:
        self.objects.update(thing.name for thing in found.objects)

    def figures(self) -> dict[str, Any]:
        return {
            **{f"cues {name}": count for name, count in sorted(self.cues_shown.items()) if count},
            "intentions": self.intentions,
            "target in view, s": round(self.target_seen_s, 2),
            "armed, s": round(self.armed_s, 2),
            "distance by applied speed, m": round(self.distance_m, 2),
            **{f"held, s: {reason}": round(seconds, 2) for reason, seconds in sorted(self.held_s.items())},
            **{f"found {name}": count for name, count in sorted(self.objects.items())},
        }

    def _held(self, decision: Decision, applied: Applied, seconds: float) -> None:
        """What one tick decided held until the next."""
        self.target_seen_s += seconds * (decision.target_yaw is not None)
        self.armed_s += seconds * (applied.arm is ArmState.ARMED)
        self.distance_m += abs(applied.twist.v) * seconds
        if applied.twist == STILL and decision.wanted != STILL:
            for reason in applied.reasons or ("no reason given",):
                self.held_s[reason] += seconds
