"""Pieces of work done by several processes, each kept when done, so that an interrupted experiment goes on."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TYPE_CHECKING, Any, TypeVar

from ghal360_robot.atomic import write_atomically
from ghal360_robot.errors import GhalError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

Piece = TypeVar("Piece")


def config_hash(settings: Any) -> str:
    """Twelve hexadecimal digits that name these settings (anything JSON can hold)."""
    text = json.dumps(settings, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def default_jobs() -> int:
    """As many processes as this machine has cores for us."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def do_all(
    pieces: Sequence[Piece],
    do: Callable[[Piece], Any],
    key: Callable[[Piece], Any],
    *,
    jobs: int,
    keep_in: Path | None,
    on_done: Callable[[int], None] = lambda _: None,
) -> list[Any]:
    """The results of `do` (JSON values) in the order of the pieces.

    `key` is all that a result depends on; results are kept under its hash in `keep_in` and not made again.
    `do` has to be a function of a module. `on_done` hears how many pieces are done.
    """
    results: dict[int, Any] = {}
    for i, piece in enumerate(pieces):
        kept = _kept(keep_in, key(piece))
        if kept is not None:
            results[i] = kept
    on_done(len(results))
    missing = [i for i in range(len(pieces)) if i not in results]
    for i, result in _done(pieces, missing, do, jobs):
        results[i] = result
        _keep(keep_in, key(pieces[i]), result)
        on_done(len(results))
    return [results[i] for i in range(len(pieces))]


def _done(pieces: Sequence[Piece], missing: list[int], do: Callable[[Piece], Any], jobs: int) -> Any:
    if jobs <= 1 or len(missing) <= 1:
        for i in missing:
            yield i, do(pieces[i])
        return
    # Forked, not spawned: a fresh interpreter would take longer to import this than to do a piece.
    context = multiprocessing.get_context("fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn")
    with ProcessPoolExecutor(min(jobs, len(missing)), mp_context=context) as pool:
        futures = {pool.submit(do, pieces[i]): i for i in missing}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _path(keep_in: Path, key: Any) -> Path:
    return keep_in / f"{config_hash(key)}.json"


def _kept(keep_in: Path | None, key: Any) -> Any:
    if keep_in is None:
        return None
    try:
        body = json.loads(_path(keep_in, key).read_text())
    except (OSError, ValueError):
        return None  # not there, or torn: it is made again
    return body["result"] if isinstance(body, dict) and body.get("key") == json.loads(json.dumps(key)) else None


def _keep(keep_in: Path | None, key: Any, result: Any) -> None:
    if keep_in is None:
        return
    try:
        write_atomically(_path(keep_in, key), json.dumps({"key": key, "result": result}).encode())
    except OSError as error:
        raise GhalError(f"cannot keep results in {keep_in}: {error.strerror}") from error
