"""The robot's configuration: every setting with its unit, bound and meaning.

`robot.toml` in the repository's root shows all of them with their defaults. Unknown keys are errors.
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ghal360_robot.errors import UsageError

Metres = Annotated[float, Field(ge=-10, le=10, allow_inf_nan=False)]
Degrees = Annotated[float, Field(ge=-360, le=360, allow_inf_nan=False)]
SmallTilt = Annotated[float, Field(ge=-45, le=45, allow_inf_nan=False)]
Seconds = Annotated[float, Field(gt=0, le=60, allow_inf_nan=False)]
Port = Annotated[int, Field(ge=1, le=65535)]
ClassName = Annotated[str, Field(min_length=1, max_length=64)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
BodyBox = tuple[
    Degrees,
    Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)],
    Annotated[float, Field(gt=0, le=360, allow_inf_nan=False)],
    Annotated[float, Field(gt=0, le=180, allow_inf_nan=False)],
]
"""Yaw and pitch of its centre in the base frame, width and height, degrees."""
Length = Annotated[float, Field(gt=0, le=20, allow_inf_nan=False)]
SizeBounds = tuple[Length, Length]
"""Metres, at least and at most."""


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RobotSection(_Section):
    name: str = Field("ghal360", min_length=1, max_length=64, description="Shown in recordings")
    startup_s: float = Field(15.0, ge=1, le=300, description="A device that is not there by then ends the run")


class ThetaSection(_Section):
    transport: Literal["usb", "usbip"] = Field("usb", description="usb: libusb; usbip: a USB/IP server")
    host: str = Field("127.0.0.1", description="USB/IP server, with transport = usbip")
    port: Port = Field(3240, description="USB/IP port")
    serial: str = Field("", description="Eight digits on the camera; empty takes the only one found")
    resolution: Literal["2k", "4k"] = Field("2k", description="1920x960 or 3840x1920")
    rate_hz: float = Field(29.97, gt=1, le=60, description="Pictures a second; far fewer hold the robot still")


class Tim571Section(_Section):
    transport: Literal["tcp", "usb"] = Field("tcp", description="usb needs the extra [usb]")
    host: str = Field("192.168.0.1", description="The device's address; 192.168.0.1 as delivered")
    port: Port = Field(2112, description="SOPAS port; 2112 is for measurement data")
    serial: str = Field("", description="With transport = usb: the one with this serial number; empty takes the first")
    dialect: Literal["auto", "a", "b"] = Field("auto", description="CoLa-A, CoLa-B, or try both")
    switch_to: Literal["leave", "a", "b"] = Field("leave", description="Have it change its dialect; logs in")
    rssi: Literal["leave", "off", "8", "16"] = Field(
        "leave", description="Bits of signal strength in each scan; a change logs in, no scans for half a second"
    )
    insist: bool = Field(False, description="No scans rather than scans other than configured")


class Rmp110Section(_Section):
    protocol: Literal["can", "v3-udp", "v3-usb"] = Field(
        "can", description="v3 only for a base known to have that firmware: it is said to ruin an older one"
    )
    interface: str = Field("socketcan", description="python-can interface")
    channel: str = Field("can0", description="Channel of that interface")
    dialect: Literal["auto", "b1", "b2", "b3"] = Field("auto", description="On CAN; auto tells b2 from b3")
    host: str = Field("", description="Of a socketcand server, or of the base with protocol = v3-udp")
    port: int = Field(0, ge=0, le=65535, description="Port of that host; 0 with v3-udp means 8080")
    device: str = Field("/dev/ttyACM0", description="The base's serial device, with protocol = v3-usb")

    @model_validator(mode="after")
    def _reachable(self) -> Rmp110Section:
        if self.protocol == "can" and self.interface == "socketcand" and not (self.host and self.port):
            raise ValueError("interface = socketcand needs host and port of its server")
        if self.protocol == "v3-udp" and not self.host:
            raise ValueError("protocol = v3-udp needs the base's address in host")
        return self

    track_m: float = Field(0.481224, gt=0.2, lt=1.5, description="Distance between the driven wheels")
    tire_m: float = Field(0.46228, ge=0.1524, le=1.0, description="Rolling diameter of the tires, as stored")
    gear_ratio: float = Field(24.2667, ge=1, le=200, description="As stored")
    stored_accel: float = Field(0.5, gt=0, le=7.848, description="m/s^2 that the base has stored")
    stored_w_accel: float = Field(1.5, gt=0, le=28.274, description="rad/s^2 that the base has stored")
    write_parameters: bool = Field(False, description="Write stored parameters that differ; without, refuse to move")
    write_feedback_set: bool = Field(True, description="Write the compact feedback set if another one is stored")


class MountingSection(_Section):
    lidar_x_m: Metres = 0.20
    lidar_y_m: Metres = 0.0
    lidar_z_m: Metres = 0.25
    lidar_yaw_deg: Degrees = 0.0
    lidar_upside_down: bool = False
    camera_x_m: Metres = 0.0
    camera_y_m: Metres = 0.0
    camera_z_m: Metres = 1.20
    camera_yaw_deg: Degrees = Field(0.0, description="Where the picture's centre column looks in the base frame")
    camera_pitch_deg: SmallTilt = Field(0.0, description="How far the camera leans forward (its zenith towards x)")
    camera_roll_deg: SmallTilt = Field(0.0, description="How far the camera leans to the right (its zenith towards -y)")


class ControlSection(_Section):
    rate_hz: float = Field(50.0, ge=10, le=100, description="Control ticks per second")


class PerceptionSection(_Section):
    detector: str = Field("none", description="none, painted (simulated pictures only), or one of `detectors list`")
    plan: Literal["default", "floor", "fine", "round-robin", "full"] = Field(
        "default", description="How a network is given the panorama: see perception/tiles.py"
    )
    rate_hz: float = Field(
        4.0, gt=0, le=30, description="Panoramas (with round-robin: tiles) searched a second, at most"
    )
    threads: int = Field(1, ge=0, le=64, description="Of a network on the CPU; 0 takes all")
    device: Literal["auto", "cpu", "cuda"] = Field("auto", description="auto takes CUDA where there is some")
    precision: Literal["auto", "float32", "bfloat16", "float16"] = Field("auto", description="auto: half on CUDA")
    score: float = Field(0.0, ge=0, le=1, description="Least score a network reports; 0 takes the network's own")
    scores: dict[ClassName, Share] = Field(
        {"backpack": 0.15, "bottle": 0.2, "laptop": 0.2},
        max_length=80,
        description="The same by class, for those hard to see",
    )
    min_score: float = Field(
        0.5, ge=0, le=2, description="Scores of the last seconds, added up, from which an object is believed"
    )
    believe: dict[ClassName, Annotated[float, Field(ge=0, le=2)]] = Field(
        {"backpack": 0.3, "bottle": 0.4, "laptop": 0.4},
        max_length=80,
        description="The same by class: lower for those hard to see, higher for those seen where there are none",
    )
    memory_s: Seconds = Field(2.0, description="How long an object in plain view is believed in that is not seen")
    body: tuple[BodyBox, ...] = Field(
        ((0.0, -75.0, 360.0, 30.0),),
        max_length=16,
        description="Where the robot sees itself: yaw, pitch, width and height in degrees; nothing is found there",
    )
    target: str = Field("", description="Class name of the object searched for; empty: no search")


class GuidanceSection(_Section):
    policy: Literal["plan", "rule", "fgs", "fgs-right", "fgs-clutter", "none", "learned"] = Field(
        "plan", description="How cues are chosen; learned: the values in memory"
    )
    act_on: Literal["belief", "tracks"] = Field(
        "belief",
        description="belief: what cues are worth over all wedges the target may be in; tracks: in one",
    )
    hit_rate: float = Field(0.8, gt=0, lt=1, description="Chance that a picture with the target in view reports it")
    false_rate: float = Field(0.05, gt=0, lt=1, description="Chance that a wedge without the target reports it")
    sure: float = Field(
        0.97, ge=0, lt=1, description="Belief in the target from which the operator is asked to confirm; 0: ask at once"
    )
    ask_score: float = Field(
        0.45, ge=0, le=1, description="Score from which a sighting of the target bears a question out; 0: any"
    )
    ask_scores: dict[ClassName, Share] = Field(
        {"backpack": 0.23, "bottle": 0.3},
        max_length=80,
        description="The same by class: half again the score it is reported from",
    )
    sizes: dict[ClassName, SizeBounds] = Field(
        {"backpack": (0.05, 0.8), "bottle": (0.03, 0.5), "laptop": (0.05, 0.6), "television": (0.45, 2.5)},
        max_length=80,
        description="Metres of the longer side, at least and at most, at the lidar's range: else it is not asked about",
    )
    no_after_s: float = Field(
        4.0, ge=0, le=60, description="An operator asked so long who sees it and is silent says no; 0: silence is none"
    )
    again_m: Length = Field(1.5, description="What they said no to is asked about again from so far away")
    again_s: float = Field(120.0, gt=0, le=3600, description="... or after so long")
    arrow: Literal["wedges", "continuous"] = Field(
        "wedges", description="continuous: the page also points exactly at the target from the start (key B toggles)"
    )
    learn: Literal["off", "rates", "values"] = Field(
        "off", description="Learn from the operator: how reliably arrows are followed, or the values of cues"
    )
    memory: str = Field("", description="File of what is known of this operator, read at the start, written at the end")

    @model_validator(mode="after")
    def _coherent(self) -> GuidanceSection:
        if self.hit_rate <= self.false_rate:
            raise ValueError("hit_rate has to be above false_rate, or a report of the target would speak against it")
        for name, (least, most) in self.sizes.items():
            if least > most:
                raise ValueError(f"the least size of a {name} ({least:g} m) is more than its most ({most:g} m)")
        return self


class IntentSection(_Section):
    filter: Literal["exact", "particle"] = Field("exact", description="particle: the paper's, a noisy copy of exact")
    particles: int = Field(500, ge=8, le=100_000, description="Of the particle filter")
    seed: int = Field(0, ge=0, lt=2**32, description="Of the particle filter's draws")
    threshold: float = Field(0.7, gt=0.125, lt=1, description="Belief at which the robot drives (paper: 70 %)")
    drive_while_guiding: bool = Field(False, description="Allow driving while a left/right cue is shown")
    cue_patience_s: Seconds = Field(4.0, description="A gaze held so long against a left/right cue overrules it")


Thresholds = tuple[
    Annotated[float, Field(ge=0, le=200, allow_inf_nan=False)],
    Annotated[float, Field(ge=0, le=200, allow_inf_nan=False)],
    Annotated[float, Field(ge=0, le=200, allow_inf_nan=False)],
]
"""From which value on to warn, to slow down, and to stop."""

MAX_HOLD_S = {"operator": 0.25, "lidar": 0.5, "base": 0.25, "video": 1.0, "command": 1.0}
"""Longest silence before the base stands still: 0.3 s from the operator's last sign of life to the wire."""

FootprintDisc = tuple[
    Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)],
    Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)],
    Annotated[float, Field(gt=0.05, le=1, allow_inf_nan=False)],
]
"""x, y and radius of a part of the robot's outline, base frame."""

MAX_STOPPING_M = 4.0
"""What a TiM571 surely sees of a dark wall (10 % remission: 8 m), halved."""


class SafetySection(_Section):
    v_max: float = Field(0.5, gt=0, le=1.5, description="m/s")
    w_max: float = Field(0.8, gt=0, le=2.0, description="rad/s")
    accel: float = Field(0.5, gt=0, le=2.0, description="m/s^2, speeding up")
    decel: float = Field(0.5, gt=0, le=3.0, description="m/s^2, the base's own deceleration; zones are sized by it")
    w_accel: float = Field(1.5, gt=0, le=6.0, description="rad/s^2")
    reverse_max: float = Field(0.15, ge=0, le=0.5, description="m/s backwards: the lidar is blind there")
    wheel_max: float = Field(0.7, gt=0, le=3.0, description="m/s of the faster wheel")
    footprint: tuple[FootprintDisc, ...] = Field(
        ((0.0, 0.0, 0.40),), min_length=1, max_length=8, description="The robot's outline as discs: x, y, radius"
    )
    margin_m: float = Field(0.04, ge=0.0, le=1.0, description="Kept beside the footprint: three sigma of a scan")
    standoff_m: float = Field(0.10, ge=0.0, le=1.0, description="Kept in front when stopped by an obstacle")
    slow_margin_m: float = Field(0.12, ge=0.0, le=1.0, description="Things closer beside the way are passed slowly")
    slow_max: float = Field(0.3, gt=0, le=1.5, description="m/s past such things")
    person_margin_m: float = Field(0.25, ge=0.0, le=1.0, description="A body reaches this far beyond its legs")
    person_speed: float = Field(1.2, ge=0.0, le=2.0, description="m/s at which people may walk up to the robot")
    person_memory_s: Seconds = Field(30.0, description="Who moved so lately may walk on at any time")
    ground_memory_s: Seconds = Field(5.0, description="Ground seen or driven over so lately may be backed onto")
    reaction_s: float = Field(0.25, gt=0, le=2.0, description="Scan, one missed scan, processing, bus, base")
    operator_hold_s: Seconds = Field(0.2, description="Operator silent this long: zero on the wire")
    operator_lost_s: Seconds = Field(1.0, description="Operator silent this long: disarmed")
    lidar_hold_s: Seconds = Field(0.25, description="Three scans missed: zero")
    lidar_lost_s: Seconds = 1.0
    base_hold_s: Seconds = Field(0.25, description="Feedback missing: zero")
    base_lost_s: Seconds = 1.0
    video_hold_s: Seconds = Field(0.7, description="Nobody drives on a frozen picture")
    video_lost_s: Seconds = 2.0
    lease_s: float = Field(3.0, ge=0.5, le=10, description="A lease not renewed for so long is void: disarmed")
    command_hold_s: Seconds = Field(0.3, description="Another source (a program under test) silent this long: zero")
    command_lost_s: Seconds = Field(1.0, description="Silent this long: the next source is taken")
    locks: dict[Annotated[str, Field(min_length=1, max_length=64)], Annotated[int, Field(ge=1, le=255)]] = Field(
        {}, max_length=8, description="Locks that have to be published, each with the priority it holds back"
    )
    lock_hold_s: Seconds = Field(0.5, description="A lock whose publisher is silent this long holds")
    tick_gap_s: float = Field(0.15, ge=0.05, le=0.18, description="A control loop that stood still this long: disarmed")
    latency_s: Thresholds = Field((0.3, 0.5, 0.8), description="Operator's round trip: warn, half speed, stop")
    battery_percent: Thresholds = Field((25.0, 15.0, 8.0), description="Warn, half speed, disarm")
    temperature_degc: Thresholds = Field((50.0, 55.0, 60.0), description="Hottest battery: warn, half speed, disarm")

    @model_validator(mode="after")
    def _coherent(self) -> SafetySection:
        """What no robot should be told, even where each number alone is possible."""
        for name, longest_s in MAX_HOLD_S.items():
            hold_s, lost_s = getattr(self, f"{name}_hold_s"), getattr(self, f"{name}_lost_s")
            if hold_s > longest_s:
                raise ValueError(f"{name}_hold_s is {hold_s:g} s: longer than {longest_s:g} s is no hold")
            if lost_s < hold_s:
                raise ValueError(f"{name}_lost_s ({lost_s:g} s) is shorter than {name}_hold_s ({hold_s:g} s)")
        for name, worse in (("latency_s", 1), ("battery_percent", -1), ("temperature_degc", 1)):
            warn, derate, stop = (worse * value for value in getattr(self, name))
            if not warn <= derate <= stop or warn == stop:
                order = "rise" if worse > 0 else "fall"
                raise ValueError(f"{name} has to {order} from warning over slowing down to stopping")
        if not any(radius - math.hypot(x, y) > 0.1 for x, y, radius in self.footprint):
            raise ValueError("no disc of the footprint covers the base's origin, around which it turns")
        if self.slow_margin_m < self.margin_m:
            raise ValueError("slow_margin_m is smaller than margin_m: nothing would be passed slowly")
        stopping_m = self.v_max * self.reaction_s + self.v_max**2 / (2.0 * self.decel)
        if stopping_m > MAX_STOPPING_M:
            raise ValueError(
                f"from v_max = {self.v_max:g} m/s the robot needs {stopping_m:.1f} m to stop with "
                f"decel = {self.decel:g} m/s^2: more than {MAX_STOPPING_M:g} m; lower v_max"
            )
        return self


class PageSection(_Section):
    listen: str = Field(
        "127.0.0.1", description="Address of the page; any but loopback needs TLS, and asks for a token"
    )
    port: int = Field(8360, ge=0, le=65535, description="Port of the page; 0 takes a free one")
    names: tuple[Annotated[str, Field(min_length=1, max_length=253)], ...] = Field(
        (), max_length=16, description="What browsers call the robot: its host name, its addresses"
    )
    certificate: str = Field("", description="PEM file; `ghal360 tls init` makes one")
    key: str = Field("", description="PEM file of its private key")
    token_file: Path = Field(
        Path("~/.config/ghal360/page-tokens.json"), description="Made with new tokens where it is missing; mode 0600"
    )
    ask_token: bool = Field(False, description="Ask for the token on loopback as well")
    viewers: int = Field(8, ge=1, le=32, description="Pages that may be open at once")
    small_codec: Literal["none", "libx264", "h264_vaapi", "h264_nvenc", "h264_qsv", "h264_v4l2m2m"] = Field(
        "none", description="Encoder of a second, smaller stream for slow links; libx264 takes half a core at 2K"
    )
    small_width: int = Field(1280, ge=320, le=3840, description="Pixels")
    small_kbps: int = Field(1500, ge=100, le=40_000)
    small_hz: float = Field(15.0, ge=1, le=30)

    @model_validator(mode="after")
    def _guarded(self) -> PageSection:
        if bool(self.certificate) != bool(self.key):
            raise ValueError("certificate and key belong together: name both")
        if self.listen not in {"127.0.0.1", "::1", "localhost"} and not self.certificate:
            raise ValueError(
                f"listen = {self.listen} can be reached from outside, which needs TLS: "
                "`ghal360 tls init` makes a certificate and key"
            )
        return self


class LogbookSection(_Section):
    directory: Path = Field(Path("runs"), description="Each run makes a folder in here")
    second_directory: str = Field("", description="Where a recording goes on when the first is full or gone")
    part_mb: int = Field(512, ge=1, le=100_000, description="A file ends at the next key picture after so many MB")
    part_minutes: float = Field(10.0, gt=0, le=1440, description="... or after so many minutes")
    video: Literal["always", "bookmarks"] = Field(
        "always", description="With bookmarks, pictures are recorded from 30 s before to 30 s after one only"
    )
    warn_free_gb: float = Field(5.0, ge=0, description="With less room than this the robot warns")
    no_video_free_gb: float = Field(2.0, ge=0, description="... records no more pictures")
    stop_free_gb: float = Field(0.5, ge=0, description="... records nothing")
    live: str = Field(
        "", pattern=r"^$|^[^\s]+:[0-9]{1,5}$", description="HOST:PORT where Rerun viewers may watch; empty: nobody"
    )
    live_web_port: int = Field(0, ge=0, le=65535, description="Port of that host for viewers in a browser; 0: none")

    @model_validator(mode="after")
    def _coherent(self) -> LogbookSection:
        if not self.stop_free_gb <= self.no_video_free_gb <= self.warn_free_gb:
            raise ValueError("warn_free_gb, no_video_free_gb and stop_free_gb have to fall in this order")
        return self


class RobotConfig(_Section):
    """All settings of one robot."""

    robot: RobotSection = RobotSection()
    theta: ThetaSection = ThetaSection()
    tim571: Tim571Section = Tim571Section()
    rmp110: Rmp110Section = Rmp110Section()
    mounting: MountingSection = MountingSection()
    control: ControlSection = ControlSection()
    perception: PerceptionSection = PerceptionSection()
    guidance: GuidanceSection = GuidanceSection()
    intent: IntentSection = IntentSection()
    safety: SafetySection = SafetySection()
    page: PageSection = PageSection()
    logbook: LogbookSection = LogbookSection()

    @model_validator(mode="after")
    def _base_can(self) -> RobotConfig:
        """Zones are sized by what the base can do, which is what it has stored."""
        for name in ("accel", "w_accel"):
            wanted, stored = getattr(self.safety, name), getattr(self.rmp110, f"stored_{name}")
            if wanted > stored:
                raise ValueError(f"safety.{name} ({wanted:g}) is more than rmp110.stored_{name} ({stored:g})")
        return self

    def sha256(self) -> str:
        """Hash of the effective settings; the same for the same robot, whatever the file looked like."""
        return hashlib.sha256(json.dumps(self.model_dump(mode="json"), sort_keys=True).encode()).hexdigest()


def load_config(path: Path | None) -> RobotConfig:
    """Read `robot.toml`, or the defaults where `path` is None.

    Raises UsageError with one sentence: unreadable file, broken TOML, unknown key, value out of bounds.
    """
    if path is None:
        return RobotConfig()
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(
            f"cannot read the configuration {path}: {getattr(error, 'strerror', None) or error}"
        ) from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from error
    return _validated(data, str(path))


def parse_config(text: str, origin: str) -> RobotConfig:
    """The settings in a recording: what `model_dump_json` wrote, checked like a file."""
    try:
        data = json.loads(text)
    except ValueError as error:
        raise UsageError(f"{origin}: its settings are not valid JSON: {error}") from error
    if not isinstance(data, dict):
        raise UsageError(f"{origin}: its settings are no table")
    return _validated(data, origin)


def with_overrides(config: RobotConfig, overrides: dict[str, dict[str, Any]]) -> RobotConfig:
    """The same configuration with some keys of some sections replaced, checked again."""
    data = config.model_dump()
    for section, values in overrides.items():
        data[section] = {**data[section], **values}
    return _validated(data, "the command line")


def _validated(data: dict[str, Any], origin: str) -> RobotConfig:
    try:
        return RobotConfig.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            raise UsageError(f"{origin}: unknown setting '{key}'; `ghal360 config schema` lists all") from error
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        if first["type"] == "value_error":
            raise UsageError(f"{origin}: [{key}] {first['ctx']['error']}{more}") from error
        raise UsageError(f"{origin}: setting '{key}': {first['msg']}, got {first['input']!r}{more}") from error
