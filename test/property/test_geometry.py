"""core.geometry: there and back again."""

import numpy as np
from hypothesis import given
from unit.cameras import Camera, calibration_of

from obst_avoid.core.geometry import image_from_rectified, lane_from_robot, rectified_from_image, robot_from_lane
from obst_avoid.core.types import LanePose
from property.strategies import cameras, lane_poses, numbers


@given(x=numbers(-2, 2), y=numbers(-2, 2), pose=lane_poses)
def test_robot_and_lane_are_each_others_inverse(x: float, y: float, pose: LanePose) -> None:
    np.testing.assert_allclose(robot_from_lane(*lane_from_robot(x, y, pose), pose), (x, y), atol=1e-12)
    np.testing.assert_allclose(lane_from_robot(*robot_from_lane(x, y, pose), pose), (x, y), atol=1e-12)


@given(x=numbers(-2, 2), y=numbers(-2, 2), pose=lane_poses)
def test_a_mirrored_robot_sees_a_mirrored_lane(x: float, y: float, pose: LanePose) -> None:
    along, left = lane_from_robot(x, y, pose)
    mirrored = lane_from_robot(x, -y, LanePose(-pose.d, -pose.phi, -pose.curvature))
    np.testing.assert_allclose(mirrored, (along, -left), atol=1e-12)


@given(x=numbers(-2, 2), y=numbers(-2, 2), pose=lane_poses)
def test_the_lane_does_not_stretch_what_the_robot_sees(x: float, y: float, pose: LanePose) -> None:
    along, left = lane_from_robot(x, y, pose)
    np.testing.assert_allclose(np.hypot(along, left - pose.d), np.hypot(x, y), atol=1e-12)


@given(camera=cameras, u=numbers(0, 639), v=numbers(0, 479))
def test_lens_and_rectification_are_each_others_inverse(camera: Camera, u: float, v: float) -> None:
    calibration = calibration_of(camera)
    rectified = rectified_from_image(calibration, np.array([[u, v]]))
    np.testing.assert_allclose(image_from_rectified(calibration, rectified), [[u, v]], atol=0.05)
