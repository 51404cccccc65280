"""core.geometry: there and back again."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from unit.cameras import Camera, calibration_of

from obst_avoid.core.geometry import image_from_rectified, lane_from_robot, rectified_from_image, robot_from_lane
from obst_avoid.core.types import LanePose
from property.strategies import cameras, lane_poses, numbers


@given(x=numbers(-2, 2), y=numbers(-2, 2), pose=lane_poses)
def test_what_goes_to_the_lane_comes_back_to_the_robot(x: float, y: float, pose: LanePose) -> None:
    np.testing.assert_allclose(robot_from_lane(*lane_from_robot(x, y, pose), pose), (x, y), atol=1e-9)


@given(along=numbers(-1, 1), left=numbers(-0.3, 0.3), pose=lane_poses)
def test_what_goes_to_the_robot_comes_back_to_the_lane(along: float, left: float, pose: LanePose) -> None:
    # nearer to the centre than the middle of the bend, 1/3 m at least, and less than half way round
    np.testing.assert_allclose(lane_from_robot(*robot_from_lane(along, left, pose), pose), (along, left), atol=1e-9)


@given(x=numbers(-2, 2), y=numbers(-2, 2), pose=lane_poses)
def test_left_is_how_far_the_lanes_centre_is_away(x: float, y: float, pose: LanePose) -> None:
    along, left = lane_from_robot(x, y, pose)
    centre = robot_from_lane(along, 0.0, pose)
    np.testing.assert_allclose(np.hypot(x - centre[0], y - centre[1]), abs(left), atol=1e-9)


@given(pose=lane_poses)
def test_the_robot_itself_is_where_its_pose_says(pose: LanePose) -> None:
    np.testing.assert_allclose(lane_from_robot(0.0, 0.0, pose), (0.0, pose.d), atol=1e-9)


@given(first=numbers(-0.5, 0.5), second=numbers(-0.5, 0.5), pose=lane_poses)
def test_the_lanes_centre_is_a_circle(first: float, second: float, pose: LanePose) -> None:
    one, other = (np.array(robot_from_lane(along, 0.0, pose)) for along in (first, second))
    turned = pose.curvature * (second - first)
    chord = abs(second - first) * np.sinc(turned / 2 / np.pi)  # np.sinc(x) is sin(pi x) / (pi x)
    np.testing.assert_allclose(np.hypot(*(other - one)), chord, atol=1e-9)


@given(x=numbers(-2, 2), y=numbers(-2, 2), pose=lane_poses)
def test_a_mirrored_robot_sees_a_mirrored_lane(x: float, y: float, pose: LanePose) -> None:
    along, left = lane_from_robot(x, y, pose)
    mirrored = lane_from_robot(x, -y, LanePose(-pose.d, -pose.phi, -pose.curvature))
    np.testing.assert_allclose(mirrored, (along, -left), atol=1e-9)
    back = robot_from_lane(along, -left, LanePose(-pose.d, -pose.phi, -pose.curvature))
    np.testing.assert_allclose(back, (x, -y), atol=1e-9)


@given(x=numbers(-2, 2), y=numbers(-2, 2), pose=lane_poses)
def test_a_straight_lane_does_not_stretch_what_the_robot_sees(x: float, y: float, pose: LanePose) -> None:
    along, left = lane_from_robot(x, y, replace(pose, curvature=0.0))
    np.testing.assert_allclose(np.hypot(along, left - pose.d), np.hypot(x, y), atol=1e-12)


@given(camera=cameras, u=numbers(0, 639), v=numbers(0, 479))
def test_lens_and_rectification_are_each_others_inverse(camera: Camera, u: float, v: float) -> None:
    calibration = calibration_of(camera)
    rectified = rectified_from_image(calibration, np.array([[u, v]]))
    np.testing.assert_allclose(image_from_rectified(calibration, rectified), [[u, v]], atol=0.05)
