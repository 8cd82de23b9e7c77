"""Who takes how much of the processors: a process and all it started, by what each is for."""

from __future__ import annotations

import os
from pathlib import Path

PROC = Path("/proc")
PARTS = (
    ("page_process", "page server"),
    ("--type=renderer", "browser: page"),
    ("--type=gpu-process", "browser: drawing and decoding"),
    ("--type=", "browser: rest"),
    ("chrom", "browser: rest"),
    ("ghal360_robot", "robot"),
)
"""A word of the command line, and what the process is then; the first that fits counts."""

HERE = "bench and simulated devices"
OTHERS = "others on this machine"


def seconds_used(root: int) -> dict[str, float]:
    """Processor seconds until now, by part: `root` is HERE, what it started by PARTS, everything else OTHERS."""
    used: dict[str, float] = {}
    for pid in (root, *below(root)):
        part = HERE if pid == root else _part(pid)
        used[part] = used.get(part, 0.0) + _seconds(pid)
    return {**used, OTHERS: _all_seconds() - sum(used.values())}


def cores_between(before: dict[str, float], after: dict[str, float], seconds: float) -> dict[str, float]:
    """How many cores each part kept busy, the busiest first."""
    cores = {part: round(max(used - before.get(part, 0.0), 0.0) / seconds, 2) for part, used in after.items()}
    return dict(sorted(cores.items(), key=lambda item: -item[1]))


def below(root: int) -> list[int]:
    """Every process that this one, or one of these, has started."""
    children: dict[int, list[int]] = {}
    for entry in PROC.glob("[0-9]*"):
        fields = _stat(int(entry.name))
        if fields:
            children.setdefault(int(fields[1]), []).append(int(entry.name))
    found, waiting = [], [root]
    while waiting:
        born = children.get(waiting.pop(), [])
        found += born
        waiting += born
    return found


def _part(pid: int) -> str:
    try:
        words = (PROC / str(pid) / "cmdline").read_text(errors="replace")
    except OSError:
        return HERE
    return next((part for word, part in PARTS if word in words), HERE)


def _all_seconds() -> float:
    """Of every process since the start, and what the host of a virtual machine took (proc(5), /proc/stat)."""
    user, nice, system, _idle, _wait, hard, soft, stolen = map(int, (PROC / "stat").read_text().split()[1:9])
    return (user + nice + system + hard + soft + stolen) / os.sysconf("SC_CLK_TCK")


def _seconds(pid: int) -> float:
    fields = _stat(pid)
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK") if fields else 0.0


def _stat(pid: int) -> list[str]:
    """The fields after the name, the state first (proc(5), /proc/pid/stat); empty where it has ended."""
    try:
        return (PROC / str(pid) / "stat").read_text(errors="replace").rsplit(")", 1)[1].split()
    except (OSError, IndexError):
        return []
