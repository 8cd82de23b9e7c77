"""Things that move: what stands where an earlier scan saw free ground, followed and remembered for a while.

Nothing here knows what a person is. But in a house it is people who move, and who stopped walking a moment ago
may walk on at any time: what has moved is treated as a person until it has stood still for long.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.safety.sight import seen_free

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ghal360_robot.safety.sight import Look

    Floats = NDArray[np.float64]

AGES_S = (0.2, 0.45, 0.9)
"""Scans of these ages are compared with: the first shows who walks fast soon, the last who strolls at all."""

SOON_NS = 300_000_000
"""Up to this age the narrow neighbourhood of a direction will do (`sight.ASTRAY_SOON`)."""

BESIDE = 4
"""Beams apart that still belong to one thing."""

LEAST_POINTS = 2
"""Returns (of every second beam) that make a thing that moved; one is the edge of something that stands."""

ONE_THING_M = 0.15
"""Two neighbouring returns further apart than this in range belong to two things."""

SAME_M = 0.5
"""A leg moves up to 0.3 m from one of these scans to the next step: what moves within this is the same."""

REACH_M = 0.45
"""Around a leg that moved, this much belongs to the person: the other leg, one step away."""

CONFIRMED = 2
"""Scans in which a thing has to be seen moving: once may be chance."""

REST_NS = 1_000_000_000
"""Who was not seen moving for so long has stopped for the moment: a step takes half of it."""

GONE_NS = 1_500_000_000
"""Nothing where it was for so long, and the place is seen to be free: it walked off. Who is merely out of sight, behind
the robot or a corner, may stand there still, and is no furniture when they come into sight again."""

SUSPECT_NS = 100_000_000
"""Who was seen moving only once is braked for until the next scan tells: a start of 0.03 m/s less, if it was chance."""

CHANCE_NS = 500_000_000
"""What was seen moving only once is forgotten after this."""

MOST = 12
"""People remembered; a crowd that is bigger is in each other's reach anyway."""

ADRIFT = 0.5
"""When more than this share of everything nearby seems to move, it is the odometry that does."""

FEW = 40
"""Of so few returns a person may well be the most."""

EDGE = np.ones(1, bool)


@dataclass(frozen=True, slots=True)
class Person:
    """Something that moved: where it last did, odometry frame."""

    x: float
    y: float
    moved_ns: int
    """When it was last seen moving."""
    there_ns: int
    """When something was last seen there."""
    times: int = 1
    """Scans in which it was seen moving, as far as they matter."""

    @property
    def confirmed(self) -> bool:
        return self.times >= CONFIRMED

    def counts(self, now_ns: int) -> bool:
        """Whether the robot keeps clear of them: of who is known to have moved, and of who seems to at the moment."""
        return self.confirmed or now_ns - self.moved_ns <= SUSPECT_NS


def compared(looks: Sequence[Look], stamp_ns: int) -> tuple[Look, ...]:
    """Of the kept scans, oldest first, for each age the newest that is at least as old."""
    found: list[Look] = []
    for age_s in AGES_S:
        newest_ns = stamp_ns - round(age_s * 1e9)
        old = next((past for past in reversed(looks) if past.stamp_ns <= newest_ns), None)
        if old is None or (found and found[-1].stamp_ns == old.stamp_ns):
            continue
        found.append(old.soon() if stamp_ns - old.stamp_ns <= SOON_NS else old)
    return tuple(found)


def moving(looks: Sequence[Look], points: Floats, beam: NDArray[np.intp], turning: float) -> NDArray[np.bool_]:
    """Which of `points` (n, 2), odometry frame, by `beam` (n,), stand where one of `looks` saw free ground.

    Single ones do not count: there have to be a few beside each other.
    """
    came = np.asarray(seen_free(looks, points, turning).any(axis=0))
    suspects = np.flatnonzero(came)
    if len(suspects) < LEAST_POINTS or (len(suspects) > ADRIFT * len(points) and len(points) > FEW):
        return np.zeros(len(points), bool)
    _, count = things(points.take(suspects, axis=0), beam[suspects])
    came[suspects[np.repeat(count < LEAST_POINTS, count)]] = False
    return came


def things(points: Floats, beam: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which of `points` (n, 2) in the order of their beams belong together: first index and number of each thing."""
    if len(points) == 0:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    step, beams = points[1:] - points[:-1], beam[1:] - beam[:-1]
    apart = step[:, 0] ** 2 + step[:, 1] ** 2 > (ONE_THING_M + 0.02 * beams) ** 2
    edges = np.flatnonzero(np.concatenate((EDGE, apart | (beams > BESIDE), EDGE)))
    return edges[:-1], edges[1:] - edges[:-1]


def follow(
    people: Sequence[Person],
    points: Floats,
    moved: NDArray[np.bool_],
    beam: NDArray[np.intp],
    stamp_ns: int,
    memory_s: float,
    scan: Sequence[Look] = (),
) -> tuple[Person, ...]:
    """People after one more scan: those seen moving now, and those remembered. `scan` is itself, one or none."""
    if not people and not moved.any():
        return ()
    there = np.asarray(near(points, people).any(axis=0)).tolist()
    followed = [
        Person(person.x, person.y, person.moved_ns, stamp_ns, person.times) if seen else person
        for person, seen in zip(people, there, strict=True)
    ]
    for x, y in _middles(points[moved], beam[moved]):
        which = _nearest(followed, x, y)
        if which is None:
            followed.append(Person(x, y, stamp_ns, stamp_ns))
            continue
        before = followed[which]
        if before.moved_ns == stamp_ns and before.confirmed:
            continue  # the other leg
        times = min(before.times + (before.moved_ns != stamp_ns), CONFIRMED)
        followed[which] = Person(x, y, stamp_ns, stamp_ns, times)
    kept = _without_gone([p for p in followed if not _forgotten(p, stamp_ns, memory_s)], stamp_ns, scan)
    return tuple(sorted(kept, key=lambda person: -person.moved_ns)[:MOST])


def near(points: Floats, people: Sequence[Person]) -> NDArray[np.bool_]:
    """Which of `points` (n, 2) are so close to each of `people` that they belong to them: (n, people)."""
    at = np.array([(person.x, person.y) for person in people]).reshape(-1, 2)
    return np.asarray((points[:, :1] - at[:, 0]) ** 2 + (points[:, 1:] - at[:, 1]) ** 2 < REACH_M**2)


def _middles(points: Floats, beam: NDArray[np.intp]) -> list[list[float]]:
    """The middle of each thing among `points`."""
    if len(points) == 0:
        return []
    first, count = things(points, beam)
    middles: list[list[float]] = (np.add.reduceat(points, first) / count[:, None]).tolist()
    return middles


def _nearest(people: Sequence[Person], x: float, y: float) -> int | None:
    """Index of whoever is nearest, if near enough to be the same."""
    found, least = None, SAME_M**2
    for which, person in enumerate(people):
        squared = (person.x - x) ** 2 + (person.y - y) ** 2
        if squared < least:
            found, least = which, squared
    return found


def _forgotten(person: Person, now_ns: int, memory_s: float) -> bool:
    if not person.confirmed:
        return now_ns - person.moved_ns > CHANCE_NS
    return now_ns - person.moved_ns > memory_s * 1e9


def about(people: Sequence[Person], now_ns: int) -> bool:
    """Whether anybody is known to be there, and was a moment ago."""
    return any(person.confirmed and now_ns - person.there_ns <= GONE_NS for person in people)


def _without_gone(people: list[Person], now_ns: int, scan: Sequence[Look]) -> list[Person]:
    missed = [person for person in people if now_ns - person.there_ns > GONE_NS]
    if not missed:
        return people
    free = np.asarray(seen_free(scan, np.array([(person.x, person.y) for person in missed])).any(axis=0)).tolist()
    gone = [person for person, empty in zip(missed, free, strict=True) if empty]
    return [person for person in people if person not in gone]
