"""Ticks put together again: their rows lie in ten entities, most of which are written on change only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ghal360_robot.logbook.errors import MADE_OF_FLIPPED_BITS
from ghal360_robot.logbook.records import Tick
from ghal360_robot.logbook.rows import NO_INTENTION, NO_STAMP
from ghal360_robot.messages import (
    Applied,
    ArmState,
    Command,
    Cue,
    Decision,
    Freshness,
    Lease,
    Lock,
    Stops,
    Twist,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ghal360_robot.logbook.clock import Anchor
    from ghal360_robot.logbook.rrd import StoredRow

CARRIED = (
    "scene/wedges",
    "guidance/cue",
    "guidance/q",
    "intent/belief",
    "intent/intention",
    "cmd/wanted",
    "cmd/asked",
    "cmd/rights",
    "cmd/applied",
    "loop/timing",
)


LATER = ("guidance/target",)
"""Entities that recordings of the first versions lack."""


class Carry:
    """One entity's values as of a tick: the newest row that is not later."""

    def __init__(self, rows: Iterator[StoredRow]) -> None:
        self._rows = rows
        self._next = next(rows, None)
        self.values: dict[str, Any] = {}

    def at(self, tick: int) -> dict[str, Any]:
        while self._next is not None and self._next.tick is not None and self._next.tick <= tick:
            self.values = {**self.values, **self._next.values}
            self._next = next(self._rows, None)
        return self.values


def read_ticks(
    rows: Callable[[str], Iterator[StoredRow]], anchor: Anchor, complain: Callable[[str], None]
) -> Iterator[Tick]:
    """Join by tick number; `loop/inputs` has one row for every tick and was written last.

    Ticks before the first whole one (their part's beginning was lost) are left out, and so are those whose rows
    contradict each other, which `complain` is told of once.
    """
    senseless = False
    carries = {entity: Carry(rows(entity)) for entity in (*CARRIED, *LATER)}
    devices: list[str] = []
    for row in rows("loop/inputs"):
        if row.tick is None:
            continue
        devices = row.values.get("Inputs:devices", devices)
        now = {entity: carry.at(row.tick) for entity, carry in carries.items()}
        if not all(now[entity] for entity in CARRIED):
            continue
        try:
            tick = _tick(row, anchor.to_monotonic(row.t_ns), devices, now)
        except MADE_OF_FLIPPED_BITS as error:
            if not senseless:
                complain(f"Tick {row.tick} makes no sense and is left out, and perhaps others ({error}).")
            senseless = True
            continue
        yield tick


def _tick(row: StoredRow, stamp_ns: int, devices: list[str], now: dict[str, dict[str, Any]]) -> Tick:
    base, scan, detections, operator = (
        None if stamp == NO_STAMP else stamp for stamp in row.values["Inputs:stamps"].tolist()
    )
    health = zip(devices, row.values["Inputs:health"].tolist(), row.values["Inputs:age_s"].tolist(), strict=True)
    lateness_ms, work_ms = now["loop/timing"]["Scalars:scalars"].tolist()
    return Tick(
        stamp_ns,
        row.tick if row.tick is not None else 0,
        base,
        scan,
        detections,
        operator,
        {name: Freshness(bool(bits & 1), bool(bits & 2), bool(bits & 4), age) for name, bits, age in health},
        _decision(now),
        _applied(now["cmd/applied"]),
        lateness_ms,
        work_ms,
        _commands(now["cmd/asked"]),
        *_rights(now["cmd/rights"]),
    )


def _commands(values: dict[str, Any]) -> tuple[Command, ...]:
    twists = values["Asked:twists"].reshape(-1, 2).tolist()
    asked = zip(values["Asked:sources"], values["Asked:stamps"].tolist(), twists, strict=True)
    return tuple(Command(source, stamp, Twist(*twist)) for source, stamp, twist in asked)


def _rights(values: dict[str, Any]) -> tuple[tuple[Lock, ...], Lease | None, Stops]:
    locks = zip(values["Rights:locks"], values["Rights:lock_stamps"].tolist(), values["Rights:engaged"], strict=True)
    holder, stamp = values["Rights:holder"], values["Rights:lease_stamp"].tolist()
    return (
        tuple(Lock(name, stamp_ns, bool(engaged)) for name, stamp_ns, engaged in locks),
        Lease(holder[0], stamp[0]) if stamp else None,
        Stops(*values["Rights:stops"].tolist()),
    )


def _decision(now: dict[str, dict[str, Any]]) -> Decision:
    target = now["guidance/cue"]["Cue:target_yaw"].tolist()
    q = now["guidance/q"]["Scalars:scalars"].tolist()
    intention = int(now["intent/intention"]["Intention:wedge"][0])
    wanted = now["cmd/wanted"]
    return Decision(
        cue=Cue(now["guidance/cue"]["StateChange:state"][0]),
        target_yaw=target[0] if target else None,
        wedges=tuple(int(value) for value in now["scene/wedges"]["Scalars:scalars"]),
        q=(q[0], q[1], q[2]) if q else None,
        belief=tuple(now["intent/belief"]["Scalars:scalars"].tolist()),
        intention=None if intention == NO_INTENTION else intention,
        wanted=Twist(*wanted["Scalars:scalars"].tolist()),
        reasons=tuple(wanted["Command:reasons"]),
        target_chances=tuple(now["guidance/target"]["Scalars:scalars"].tolist()) if now["guidance/target"] else (),
    )


def _applied(values: dict[str, Any]) -> Applied:
    clearance = values["Command:clearance_m"].tolist()
    return Applied(
        Twist(*values["Scalars:scalars"].tolist()),
        ArmState(values["Command:arm"][0]),
        tuple(values["Command:reasons"]),
        clearance[0] if clearance else None,
        values["Command:source"][0],
    )
