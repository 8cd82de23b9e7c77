"""Training curves of the guidance learners over many seeds, with the plain learner's time beside them."""

from __future__ import annotations

import random
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot import __version__
from ghal360_robot.experiments.paper import FGS_VALUE, OPTIMUM
from ghal360_robot.experiments.plain_learner import PlainLearner, train_plain
from ghal360_robot.experiments.work import config_hash, do_all
from ghal360_robot.guidance.factored import learn_factored
from ghal360_robot.guidance.learner import EPISODES, SNAPSHOT_EVERY, VARIANTS
from ghal360_robot.guidance.training import learn

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

BATCH = 25
"""Seeds trained at once by one process: their values stay in its cache."""
SHOWN_SEEDS = 20
"""Up to so many seeds, results hold every curve; above, the bands only."""
PERCENTILES = (5, 25, 50, 75, 95)
FACTORED = "factored"
FACTORED_EPISODES = (0, 1, 2, 3, 5, 10, 20, 30)
LEARNERS = (*VARIANTS, FACTORED)


@dataclass(frozen=True, slots=True)
class Batch:
    """One learner and some seeds: what a process does at a time."""

    learner: str
    seeds: tuple[int, ...]
    episodes: int

    def key(self) -> dict[str, Any]:
        settings = asdict(VARIANTS[self.learner]) if self.learner in VARIANTS else {}
        settings = {name: getattr(value, "value", value) for name, value in settings.items()}
        return {
            "learner": self.learner,
            "settings": settings,
            "seeds": list(self.seeds),
            "episodes": self.episodes,
            "every": SNAPSHOT_EVERY,
            "version": __version__,
        }


def train_all(
    learners: Sequence[str],
    seeds: Sequence[int],
    episodes: int = EPISODES,
    *,
    jobs: int = 1,
    keep_in: Path | None = None,
    on_done: Callable[[int], None] = lambda _: None,
) -> dict[str, Any]:
    """The results of every learner, as JSON."""
    batches = batches_of(learners, seeds, episodes)
    began = time.perf_counter()
    results = do_all(batches, train_batch, Batch.key, jobs=jobs, keep_in=keep_in, on_done=on_done)
    seconds = time.perf_counter() - began
    settings = [batch.key() for batch in batches]
    return {
        "kind": "train",
        "config_hash": config_hash(settings),
        "episodes": episodes,
        "snapshot_every": SNAPSHOT_EVERY,
        "seeds": list(seeds),
        "references": {"optimum": OPTIMUM, "fgs": FGS_VALUE},
        "learners": {
            name: _report(name, [r for b, r in zip(batches, results, strict=True) if b.learner == name])
            for name in learners
        },
        "seconds": round(seconds, 3),
    }


def batches_of(learners: Sequence[str], seeds: Sequence[int], episodes: int) -> list[Batch]:
    """What there is to do."""
    return [
        Batch(name, tuple(seeds[i : i + BATCH]), episodes) for name in learners for i in range(0, len(seeds), BATCH)
    ]


def train_batch(batch: Batch) -> dict[str, Any]:
    """The curves of one batch, as JSON."""
    began = time.perf_counter()
    if batch.learner == FACTORED:
        value = learn_factored(batch.seeds, FACTORED_EPISODES)
        return {
            "episodes": list(FACTORED_EPISODES),
            "value": value.round(4).tolist(),
            "seconds": time.perf_counter() - began,
        }
    learned = learn(VARIANTS[batch.learner], batch.seeds, batch.episodes)
    whole = batch.episodes // SNAPSHOT_EVERY * SNAPSHOT_EVERY
    returns = learned.returns[:, :whole].reshape(len(batch.seeds), -1, SNAPSHOT_EVERY).mean(axis=2)
    return {
        "episodes": learned.curve.episodes.tolist(),
        "value": learned.curve.value.round(4).tolist(),
        "training_return": returns.mean(axis=0).round(3).tolist(),
        "steps": learned.steps,
        "seconds": time.perf_counter() - began,
    }


def compare_with_plain(episodes: int, seconds_per_seed: float) -> dict[str, Any]:
    """How long one seed of the plain learner takes here and now, with and without the same tests of its policy."""
    began = time.perf_counter()
    train_plain(random.Random(1), episodes)  # noqa: S311 - a learner's draws, not a secret
    tested = time.perf_counter() - began
    learner, rng = PlainLearner(), random.Random(2)  # noqa: S311
    began = time.perf_counter()
    for _ in range(episodes):
        learner.episode(rng.randrange(len(learner.q)), rng.random)
    untested = time.perf_counter() - began
    return {
        "plain_seconds_per_seed": round(tested, 4),
        "plain_seconds_per_seed_untested": round(untested, 4),
        "vectorised_seconds_per_seed": round(seconds_per_seed, 5),
        "speedup": round(tested / seconds_per_seed, 1),
        "speedup_over_untested": round(untested / seconds_per_seed, 1),
    }


def _report(name: str, results: list[dict[str, Any]]) -> dict[str, Any]:
    value = np.array([curve for result in results for curve in result["value"]])
    episodes = np.array(results[0]["episodes"])
    mean = value.mean(axis=0)
    report: dict[str, Any] = {
        "episodes": episodes.tolist(),
        "mean": mean.round(4).tolist(),
        "sd": (value.std(axis=0, ddof=1) if len(value) > 1 else np.zeros_like(mean)).round(4).tolist(),
        "percentiles": {str(p): np.percentile(value, p, axis=0).round(4).tolist() for p in PERCENTILES},
        "final": value[:, -1].round(4).tolist(),
        "first_above_fgs": _first(episodes, mean > FGS_VALUE),
        "first_above_99_percent": _first(episodes, mean > 0.99 * OPTIMUM),
        "seeds_above_fgs": int((value > FGS_VALUE).any(axis=1).sum()),
        "never_below_fgs": bool((value >= FGS_VALUE).all()),
        "cpu_seconds": round(sum(result["seconds"] for result in results), 3),
    }
    if len(value) <= SHOWN_SEEDS:
        report["curves"] = value.tolist()
    if name != FACTORED:
        report["training_return"] = np.mean([r["training_return"] for r in results], axis=0).round(3).tolist()
        report["steps"] = sum(result["steps"] for result in results)
    return report


def _first(episodes: np.ndarray, above: np.ndarray) -> int | None:
    places = np.flatnonzero(above)
    return int(episodes[places[0]]) if places.size else None
