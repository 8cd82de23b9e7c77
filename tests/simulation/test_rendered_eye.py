"""A detector's pictures in simulated time."""

from __future__ import annotations

from math import atan2, remainder, tau

from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.messages import Detections, Pose2
from ghal360_robot.simulation.lockstep import Camera, Lockstep
from ghal360_robot.simulation.rendered_eye import RenderedEye
from ghal360_robot.simulation.vantage import vantage_pose
from ghal360_robot.simulation.world import build_world

CONFIG = with_overrides(RobotConfig(), {"perception": {"target": "backpack", "detector": "painted"}})


def test_a_rendered_picture_shows_the_target_where_it_stands() -> None:
    world = build_world("office", 5, "backpack")
    pose, target = vantage_pose(world), world.target_object()
    with RenderedEye(world, CONFIG) as eye:
        first, again = eye.look(pose, 1, 1), eye.look(pose, 2, 2)
    found = [item for item in first.objects if item.name == "backpack"]
    bearing = atan2(target.y - pose.y, target.x - pose.x) - pose.yaw
    assert len(found) == 1
    assert abs(remainder(found[0].yaw - bearing, tau)) < 0.05
    assert (again.stamp_ns, again.picture, again.objects) == (2, 2, first.objects)


def test_detections_come_at_the_camera_s_pace_and_as_late_as_it_says() -> None:
    taken: list[int] = []
    known: list[tuple[int, int]] = []

    def look(pose: Pose2, stamp_ns: int, picture: int) -> Detections:
        taken.append(picture)
        return Detections(stamp_ns, picture, "test", ())

    robot = Lockstep(
        build_world("office", 5, "backpack"),
        CONFIG,
        5,
        lambda inputs, *_: known.append((inputs.tick, inputs.detections.picture)) if inputs.detections else None,
        Camera(look, every_ticks=20, delay_ticks=25),
    )
    for _ in range(70):
        robot.step()
    assert taken == [0, 20, 40, 60]
    assert known[0] == (25, 0)
    assert [tick for tick, picture in known if picture == 20] == list(range(45, 65))
    assert max(picture for _, picture in known) == 40
