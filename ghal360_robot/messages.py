"""What flows through the robot: frozen values in SI units, radians and nanoseconds.

Every message carries `stamp_ns`, an instant of this machine's monotonic clock (`time.monotonic_ns`).
Frames follow REP-103: x forward, y left, yaw counter-clockwise, zero straight ahead of the base.
Clockwise bearings exist only inside `guidance`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Cue(Enum):
    """What the operator is shown (paper, section III: the three guidance actions, or nothing)."""

    NONE = "none"
    LEFT = "left"
    RIGHT = "right"
    CONFIRM = "confirm"


class BaseMode(Enum):
    """The base's operational state, as far as driving is concerned."""

    UNKNOWN = "unknown"
    STARTING = "starting"
    STANDBY = "standby"
    DRIVE = "drive"
    OFF = "off"


class ArmState(Enum):
    """Whether the safety chain lets motion through."""

    DISARMED = "disarmed"
    ARMED = "armed"
    ESTOP = "estop"


@dataclass(frozen=True, slots=True)
class Twist:
    """A planar velocity in the base frame: `v` m/s forward, `w` rad/s counter-clockwise."""

    v: float = 0.0
    w: float = 0.0


@dataclass(frozen=True, slots=True)
class Pose2:
    """A planar pose: metres and radians (yaw counter-clockwise)."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0


STILL = Twist()


@dataclass(frozen=True, slots=True)
class BaseState:
    """One complete feedback packet of the base, in REP-103 signs."""

    stamp_ns: int
    mode: BaseMode
    pose: Pose2
    """Odometry since connection, frame `odom`."""
    twist: Twist
    battery_percent: float
    faults: tuple[str, ...] = ()
    """Latched faults in words; empty when healthy."""
    temperature_degc: float | None = None
    """The hottest of its batteries; None where the base does not say."""
    covariance: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Of `pose` since connection: xx, xy, x yaw, yy, y yaw, yaw yaw (m^2, m rad, rad^2)."""
    warnings: tuple[str, ...] = ()
    """What its wheels do that they were not told to, in words: one slips, stands, or turns by itself."""


@dataclass(frozen=True, slots=True)
class LidarScan:
    """One revolution: `ranges` (n,) float32 metres, NaN where the device saw nothing usable.

    `yaw` (n,) float32 radians is each beam's direction in the lidar frame; `stamp_ns` is the last beam.
    """

    stamp_ns: int
    ranges: NDArray[np.float32]
    yaw: NDArray[np.float32]
    scan_counter: int
    telegram_counter: int
    device_time_us: int
    device_ok: bool = True
    rssi: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True)
class Surroundings:
    """One scan as the base sees it, worked out once for everybody (`surroundings.look_around`).

    `points` (m, 2) are its usable returns in the base frame, metres; `beam` (m,) the beam of each.
    `bearings` (n,) are all beams' directions in the base frame, radians in [-pi, pi); `ranges` (n,) their
    smoothed ranges from the lidar and `raw` (n,) those measured, metres, NaN where nothing usable came back.
    """

    stamp_ns: int
    points: NDArray[np.float64]
    beam: NDArray[np.intp]
    bearings: NDArray[np.float64]
    ranges: NDArray[np.float32]
    raw: NDArray[np.float32]
    origin: tuple[float, float] = (0.0, 0.0)
    """The lidar's place in the base frame, metres."""


@dataclass(frozen=True, slots=True)
class Detection:
    """One object in the panorama: direction of its centre in the base frame and angular size, radians."""

    name: str
    score: float
    yaw: float
    pitch: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class Detections:
    """Everything one detector found in one picture; `stamp_ns` is the picture's."""

    stamp_ns: int
    picture: int
    """Running number of the picture since the camera was connected."""
    detector: str
    objects: tuple[Detection, ...]


@dataclass(frozen=True, slots=True)
class HeadPose:
    """Where the operator looks, relative to the base frame; `fov` is horizontal."""

    yaw: float = 0.0
    pitch: float = 0.0
    fov: float = 1.5707963267948966


@dataclass(frozen=True, slots=True)
class OperatorInput:
    """One message of the operator. Presses are running counts, so that a lost message loses no press.

    `stick` is None while the operator drives by looking (the paper's way); with a value it is a wish
    of the hand and counts only while `deadman` is held.
    """

    stamp_ns: int
    head: HeadPose
    deadman: bool = False
    stick: Twist | None = None
    arm_presses: int = 0
    disarm_presses: int = 0
    estop_presses: int = 0
    found_presses: int = 0
    holder: str = ""
    """Who sends this; has to be the holder of the lease for anything but a stop."""
    latency_s: float = 0.0
    """Measured round trip between robot and operator; 0 where both are the same machine."""


@dataclass(frozen=True, slots=True)
class Received:
    """A wish of a remote operator as it came in, and whether it counts; for the recording."""

    stamp_ns: int
    sent_ns: int
    """When it was sent, by the page's idea of this machine's clock."""
    holder: str
    sequence: int
    verdict: str
    """`taken`, or why not."""
    deadman: bool
    stick: tuple[float, float] | None = None
    """Shares of the most that the robot may do."""


@dataclass(frozen=True, slots=True)
class Bookmark:
    """This moment of the run is to be found again."""

    stamp_ns: int
    holder: str
    """Who wants that: a connection of the page, a signal, or the robot itself."""
    note: str = ""


@dataclass(frozen=True, slots=True)
class Command:
    """A velocity somebody asks for; `source` is one of the mux's (teleop, autonomy, test)."""

    source: str
    stamp_ns: int
    twist: Twist


@dataclass(frozen=True, slots=True)
class Lock:
    """Holds back every source of lower priority while `engaged`, or while its publisher is silent."""

    name: str
    stamp_ns: int
    engaged: bool


@dataclass(frozen=True, slots=True)
class Lease:
    """Who may drive; renewed by its holder, void when it grows old.

    Without a lease only the operator at the robot itself may drive, whose `holder` is empty.
    """

    holder: str
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Stops:
    """Stops asked for by anybody but the one who drives, as running counts: a stop needs no lease."""

    disarm: int = 0
    estop: int = 0


@dataclass(frozen=True, slots=True)
class LinkStats:
    """How one device is doing; the same three words for all devices."""

    link: str = "closed"
    """State of the link in one word: closed, connecting, identifying, configuring, streaming, backoff."""
    detail: str = ""
    """Why, in words for the person at the robot; empty when all is well."""
    received: int = 0
    lost: int = 0
    damaged: int = 0
    reconnects: int = 0
    rate_hz: float = 0.0
    last_ns: int | None = None
    condition: str = ""
    """What the device tells of itself, in words; empty where it tells nothing."""


@dataclass(frozen=True, slots=True)
class Freshness:
    """One input as the control tick sees it (openpilot's alive / freq_ok / valid)."""

    alive: bool
    rate_ok: bool
    valid: bool
    age_s: float


@dataclass(frozen=True, slots=True)
class Inputs:
    """The newest value of every input at one tick, with the age and health of each."""

    stamp_ns: int
    tick: int
    base: BaseState | None
    scan: LidarScan | None
    detections: Detections | None
    operator: OperatorInput | None
    freshness: dict[str, Freshness]
    """Keys: `theta`, `tim571`, `rmp110`, `operator`."""
    armed: bool = False
    """Whether the safety chain let motion through on the tick before."""
    commands: tuple[Command, ...] = ()
    """Velocities asked for by others than the brain; the newest of each source."""
    locks: tuple[Lock, ...] = ()
    lease: Lease | None = None
    stops: Stops = Stops()
    surroundings: Surroundings | None = None
    """What `scan` shows, in the base frame."""


@dataclass(frozen=True, slots=True)
class Decision:
    """What the brain made of one tick, and why."""

    cue: Cue
    target_yaw: float | None
    """Direction of the target in the base frame, when it is in view of the camera."""
    wedges: tuple[int, ...]
    """Egocentric wedge values W_0..W_7 (0 empty, 1 clutter, 2 target, 3 both), clockwise from the gaze."""
    q: tuple[float, float, float] | None
    """Value of left, right, confirm in this state; None while no target is in view."""
    belief: tuple[float, ...]
    """Probability that the operator wants to go to world wedge 0..7, clockwise from the odometry's x."""
    intention: int | None
    wanted: Twist
    reasons: tuple[str, ...]
    target_chances: tuple[float, ...] = ()
    """Chance that the target is in world wedge 0..7, and that it is in none; empty before a search's first picture."""


@dataclass(frozen=True, slots=True)
class Applied:
    """What the safety chain let through, and why not more."""

    twist: Twist
    arm: ArmState
    reasons: tuple[str, ...]
    clearance_m: float | None = None
    """Free distance in the direction of motion, from the last scan."""
    source: str = ""
    """Whose command it is; empty while nobody's was taken."""
