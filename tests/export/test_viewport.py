from __future__ import annotations

import math

import numpy as np
import pytest

from ghal360_robot.export.viewport import ViewportSize, viewport
from ghal360_robot.messages import HeadPose
from ghal360_robot.perception.sphere import PictureSize, direction_of_pixel

SIZE = PictureSize(720, 360)


def compass() -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    """A panorama whose colours say the direction: red the yaw, green the pitch, half a degree to a step at least."""
    u, v = np.meshgrid(np.arange(SIZE.width) + 0.5, np.arange(SIZE.height) + 0.5)
    yaw, pitch = direction_of_pixel(u, v, SIZE)
    red = np.abs(yaw) / math.pi * 255
    green = (pitch / math.pi + 0.5) * 255
    return np.stack((red, green, np.where(yaw > 0, 255, 0)), axis=-1).astype(np.uint8)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5, 3.0])
@pytest.mark.parametrize("pitch", [0.0, 0.4, -0.7])
def test_the_middle_of_the_view_is_where_the_head_looks(yaw: float, pitch: float) -> None:
    seen = viewport(compass(), HeadPose(yaw, pitch, math.radians(80)), ViewportSize(161, 91))
    red, green, _ = seen[45, 80]
    assert red == pytest.approx(abs(yaw) / math.pi * 255, abs=2)
    assert green == pytest.approx((pitch / math.pi + 0.5) * 255, abs=2)


def test_left_in_the_view_is_counter_clockwise_and_the_edges_are_half_the_field_of_view_away() -> None:
    fov = math.radians(90)
    seen = viewport(compass(), HeadPose(0.0, 0.0, fov), ViewportSize(160, 90))
    left, right = seen[45, 0], seen[45, 159]
    assert (left[2], right[2]) == (255, 0)
    assert left[0] == pytest.approx(fov / 2 / math.pi * 255, abs=2)
    assert right[0] == pytest.approx(fov / 2 / math.pi * 255, abs=2)


def test_the_view_across_the_seam_has_no_crack() -> None:
    panorama = np.full((360, 720, 3), 200, np.uint8)
    seen = viewport(panorama, HeadPose(math.pi, 0.0, 1.2), ViewportSize(160, 90))
    assert seen.min() == seen.max() == 200
