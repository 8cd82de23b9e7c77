"""What a detector finds in rendered pictures of a world, without wires or clocks: for searches in simulated time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Self

from ghal360_robot.assembly import camera_view, detector_options
from ghal360_robot.perception.detectors.base import make_detector
from ghal360_robot.perception.panorama import around_robot
from ghal360_robot.perception.sphere import PictureSize

if TYPE_CHECKING:
    from ghal360_robot.config import RobotConfig
    from ghal360_robot.messages import Detections, Pose2
    from ghal360_robot.simulation.world import World


class RenderedEye:
    """Draws the panorama from where the robot is and searches it as the robot would; use as a context manager.

    The same pose gives the same detections: neither the camera's encoder nor its noise is in between.
    """

    def __init__(self, world: World, config: RobotConfig) -> None:
        """The world wears paint for the detector `painted` and looks natural for all others."""
        # The renderer needs the extra [sim], which searches with an ideal detector do without.
        from ghal360_robot.simulation.renderer import PanoramaRenderer  # noqa: PLC0415

        name = config.perception.detector
        self._renderer = PanoramaRenderer(world, painted=name == "painted")
        self._size = PictureSize(self._renderer.width, self._renderer.height)
        self._detector = make_detector(name, detector_options(config))
        self._view = camera_view(config)
        self._height_m = config.mounting.camera_z_m
        self._last: tuple[Pose2, Detections] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def look(self, pose: Pose2, stamp_ns: int, picture: int) -> Detections:
        """What is found in a picture taken from the base's `pose`."""
        if self._last is None or self._last[0] != pose:
            rgb = self._renderer.render(pose.x, pose.y, pose.yaw, self._height_m)
            found = around_robot(
                self._detector.detect(rgb),
                self._size,
                self._view,
                stamp_ns=stamp_ns,
                picture=picture,
                detector=self._detector.name,
            )
            self._last = pose, found
        return replace(self._last[1], stamp_ns=stamp_ns, picture=picture)
