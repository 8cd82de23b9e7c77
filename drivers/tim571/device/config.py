"""How the device driver behaves; every waiting time has its reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.tim571.codec.access import Level
from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.device.scan import Beam

ANSWER_TIMEOUT_S = 1.0  # answers take 1 to 6 ms; a busy network adds, a dead one never ends
DIALECT_TIMEOUT_S = 0.5  # a device is silent in the wrong dialect, and the right one answers in milliseconds
FIRST_SCAN_TIMEOUT_S = 3.0  # the first scan follows sEN by about 0.2 s
IDLE_TIMEOUT_S = 1.0  # 15 revolutions without a scan: the motor or the link is gone
BACKOFF_FIRST_S = 0.25  # a cable plugged back in should not cost a second
BACKOFF_MAX_S = 5.0  # a device that is off for the night need not be asked more often
WAKE_AFTER_S = 1.0  # the first scan follows sEN by 0.2 s; a device that was stopped waits to be started
QUEUED_SCANS = 4  # a consumer a quarter of a second late wants the newest scans, not all


@dataclass(frozen=True, slots=True)
class TimConfig:
    """Settings of a TiM571. As they stand, nothing in the device is changed and no login is needed."""

    dialect: Dialect | None = None
    """The one the device speaks; None: find out."""
    dialects: tuple[Dialect, ...] = (Dialect.B, Dialect.A)
    """The order to find out in. CoLa-B is half as long and has a checksum; CoLa-A is how a device is delivered."""
    output: OutputContent | None = None
    """What the telegrams shall contain; None leaves it as it is. A change logs in: no scans for half a second."""
    output_range: OutputRange | None = None
    """Which part of the revolution they shall contain; None leaves it as it is. A change logs in."""
    switch_to: Dialect | None = None
    """Have the device change its dialect, which needs a login and a reconnect, and lasts until power-off."""
    insist: bool = False
    """Rather have no scans than scans other than configured, where the device refuses to be configured."""
    level: Level = Level.AUTHORISED_CLIENT
    password: str = field(default="client", repr=False)
    """The one every device is delivered with (manual). Only its hash is sent, and it is never shown."""
    tick_marks: Beam = Beam.LAST
    """The beam at which the device takes its scan tick: the last by every measurement (fact sheet section 5)."""
    stamp_marks: Beam = Beam.LAST
    """The beam that a scan's `stamp_ns` shall mean."""
    answer_timeout_s: float = ANSWER_TIMEOUT_S
    dialect_timeout_s: float = DIALECT_TIMEOUT_S
    first_scan_timeout_s: float = FIRST_SCAN_TIMEOUT_S
    idle_timeout_s: float = IDLE_TIMEOUT_S
    backoff_first_s: float = BACKOFF_FIRST_S
    backoff_max_s: float = BACKOFF_MAX_S
    wake_after_s: float = WAKE_AFTER_S
    queued_scans: int = QUEUED_SCANS
