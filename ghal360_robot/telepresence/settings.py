"""What the page's process has to know: one JSON object, handed over at its start."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from calibration.mounting import beam_bearings
from drivers.tim571.geometry import BEAM_YAW
from ghal360_robot.assembly import lidar_mount
from ghal360_robot.telepresence.access import is_loopback
from ghal360_robot.telepresence.state import blind_sector

if TYPE_CHECKING:
    from ghal360_robot.config import RobotConfig


@dataclass(frozen=True, slots=True)
class PageSettings:
    """Addresses, names and limits. Radians, m/s, seconds."""

    listen: str = "127.0.0.1"
    port: int = 8360
    names: tuple[str, ...] = ()
    """What the robot is called besides its address: what a Host header may say."""
    certificate: str = ""
    key: str = ""
    token_file: str = ""
    need_token: bool = False
    viewers: int = 8
    small_codec: str = ""
    """Encoder of the second stream; empty for none."""
    small_width: int = 1280
    small_kbps: int = 1500
    small_hz: float = 15.0
    robot: str = "ghal360"
    target: str = ""
    arrow: Literal["wedges", "continuous"] = "wedges"
    v_max: float = 0.5
    w_max: float = 0.8
    camera_yaw: float = 0.0
    picture_hold_s: float = 0.7
    blind: tuple[float, float] = (2.356, -2.356)

    @property
    def tls(self) -> bool:
        return bool(self.certificate)

    @classmethod
    def of(cls, config: RobotConfig) -> PageSettings:
        """What this robot's configuration says of the page."""
        page, safety = config.page, config.safety
        return cls(
            listen=page.listen,
            port=page.port,
            names=page.names,
            certificate=_absolute(page.certificate),
            key=_absolute(page.key),
            token_file=_absolute(str(page.token_file)),
            need_token=page.ask_token or not is_loopback(page.listen),
            viewers=page.viewers,
            small_codec="" if page.small_codec == "none" else page.small_codec,
            small_width=page.small_width,
            small_kbps=page.small_kbps,
            small_hz=page.small_hz,
            robot=config.robot.name,
            target=config.perception.target[:64],
            arrow=config.guidance.arrow,
            v_max=safety.v_max,
            w_max=safety.w_max,
            camera_yaw=math.radians(config.mounting.camera_yaw_deg),
            picture_hold_s=safety.video_hold_s,
            blind=blind_sector(beam_bearings(BEAM_YAW, lidar_mount(config)).tolist()),
        )

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> PageSettings:
        data = json.loads(text)
        return cls(**{**data, "names": tuple(data["names"]), "blind": tuple(data["blind"])})


def _absolute(path: str) -> str:
    """As seen from wherever the process runs; empty stays empty."""
    return str(Path(path).expanduser().absolute()) if path else ""
