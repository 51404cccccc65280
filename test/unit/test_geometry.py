"""core.geometry: picture, rectified picture, road and lane."""

import math
from dataclasses import replace
from typing import Tuple

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.geometry import (
    ground_from_pixel,
    image_from_rectified,
    lane_from_robot,
    pixel_from_ground,
    rectified_from_image,
    robot_from_lane,
)
from obst_avoid.core.types import LanePose
from unit.cameras import Camera, calibration_of

CAMERA = Camera(roll=2.0, yaw=-3.0)
HOMOGRAPHY = calibration_of(CAMERA).homography
ROAD = np.array([[0.15, 0.0], [0.3, -0.1], [0.5, 0.2], [1.5, -0.6]])


def raised(ground: np.ndarray) -> np.ndarray:
    """Points of the road as points of the robot frame, (N, 3) in m."""
    return np.column_stack([ground, np.zeros(len(ground))])


def test_no_points_give_no_points() -> None:
    none = np.empty((0, 2))
    assert ground_from_pixel(HOMOGRAPHY, none).shape == (0, 2)
    assert pixel_from_ground(HOMOGRAPHY, none).shape == (0, 2)


def test_pixels_fall_on_the_road_where_the_camera_saw_them() -> None:
    pixels = CAMERA.rectified_from_robot(raised(ROAD))
    np.testing.assert_allclose(ground_from_pixel(HOMOGRAPHY, pixels), ROAD, atol=1e-9)


def test_the_road_appears_where_the_camera_sees_it() -> None:
    np.testing.assert_allclose(
        pixel_from_ground(HOMOGRAPHY, ROAD), CAMERA.rectified_from_robot(raised(ROAD)), atol=1e-6
    )


@pytest.mark.parametrize('above', [0.0, 0.5, 100.0], ids=['on it', 'just above', 'far above'])
def test_a_pixel_on_or_above_the_horizon_has_no_ground(above: float) -> None:
    level = calibration_of(replace(CAMERA, roll=0.0))
    horizon = replace(CAMERA, roll=0.0).rectified_from_robot([[1e12, 0, 0]])[0]
    pixels = np.array([horizon - (0, above + 1e-6), [320.0, 400.0]])
    with pytest.raises(ValueError, match='^1 of 2 pixels lie on or above the horizon$'):
        ground_from_pixel(level.homography, pixels)


def test_a_point_behind_the_camera_has_no_pixel() -> None:
    with pytest.raises(ValueError, match='^2 of 3 points lie behind the camera$'):
        pixel_from_ground(HOMOGRAPHY, np.array([[0.5, 0.0], [-0.5, 0.0], [-1.0, 0.3]]))


@pytest.mark.parametrize('twist', [0.0, 3.0], ids=['not turned', 'turned by the rectification'])
def test_rectified_pixels_lie_in_the_picture_where_the_lens_puts_them(twist: float) -> None:
    camera = replace(CAMERA, twist=twist)
    rectified, image = camera.rectified_from_robot(raised(ROAD)), camera.image_from_robot(raised(ROAD))
    calibration = calibration_of(camera)
    np.testing.assert_allclose(image_from_rectified(calibration, rectified), image, atol=1e-6)
    np.testing.assert_allclose(rectified_from_image(calibration, image), rectified, atol=0.1)
    assert np.abs(rectified - image).max() > 10, 'the lens must matter here'


def test_every_pixel_of_the_picture_comes_back(calibration: Calibration) -> None:
    # towards the corners of a wide lens, undoing the distortion takes more than a few iterations
    u, v = np.meshgrid(np.append(np.arange(0.0, 639.0, 20.0), 639.0), np.append(np.arange(0.0, 479.0, 20.0), 479.0))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    back = image_from_rectified(calibration, rectified_from_image(calibration, pixels))
    np.testing.assert_allclose(back, pixels, atol=0.05)


def test_a_pixel_of_a_plain_lens_is_not_moved() -> None:
    camera = Camera(distortion=(0.0,) * 5, projection=(320.0, 320.0))
    pixels = np.array([[0.0, 0.0], [319.5, 239.5], [639.0, 479.0]])
    np.testing.assert_allclose(image_from_rectified(calibration_of(camera), pixels), pixels, atol=1e-9)


QUARTER = math.pi / 2


@pytest.mark.parametrize(
    'pose, robot, lane',
    [
        pytest.param(LanePose(0, 0), (0.0, 0.0), (0.0, 0.0), id='the robot itself, in the middle'),
        pytest.param(LanePose(0.05, 0), (0.0, 0.0), (0.0, 0.05), id='the robot itself, left of the middle'),
        pytest.param(LanePose(0.05, 0), (0.4, -0.1), (0.4, -0.05), id='ahead to the right, seen from the left'),
        pytest.param(LanePose(-0.03, 0), (0.4, 0.1), (0.4, 0.07), id='ahead to the left, seen from the right'),
        pytest.param(LanePose(0, QUARTER), (0.4, 0.0), (0.0, 0.4), id='turned left, ahead is left'),
        pytest.param(LanePose(0, -QUARTER), (0.4, 0.0), (0.0, -0.4), id='turned right, ahead is right'),
        pytest.param(LanePose(0.02, QUARTER), (0.4, 0.1), (-0.1, 0.42), id='turned left, left is back'),
        pytest.param(
            LanePose(0.02, 0.1), (0.5, 0.0), (0.5 * math.cos(0.1), 0.02 + 0.5 * math.sin(0.1)), id='turned a little'
        ),
        pytest.param(LanePose(0.05, 0.3, 2.0), (0.0, 0.0), (0.0, 0.05), id='the robot itself, in a left bend'),
        pytest.param(LanePose(0.05, 0.3, -2.0), (0.0, 0.0), (0.0, 0.05), id='the robot itself, in a right bend'),
        pytest.param(LanePose(0, 0, 2.0), (0.5, 0.5), (QUARTER / 2, 0.0), id='a quarter of a left bend on'),
        pytest.param(LanePose(0, 0, -2.0), (0.5, -0.5), (QUARTER / 2, 0.0), id='a quarter of a right bend on'),
        pytest.param(LanePose(0, 0, 2.0), (-0.5, 0.5), (-QUARTER / 2, 0.0), id='a quarter of a left bend back'),
        pytest.param(LanePose(0, 0, 2.0), (0.3, 0.5), (QUARTER / 2, 0.2), id='on the inner side of a left bend'),
        pytest.param(LanePose(0, 0, -2.0), (0.3, -0.5), (QUARTER / 2, -0.2), id='on the inner side of a right bend'),
        pytest.param(LanePose(0, 0, 2.0), (0.7, 0.5), (QUARTER / 2, -0.2), id='on the outer side of a left bend'),
        pytest.param(LanePose(0, 0, -2.0), (0.7, -0.5), (QUARTER / 2, 0.2), id='on the outer side of a right bend'),
        pytest.param(LanePose(0.1, 0, 2.0), (0.5, 0.4), (QUARTER / 2, 0.0), id='seen from the left'),
        pytest.param(LanePose(0, QUARTER, 2.0), (0.5, -0.5), (QUARTER / 2, 0.0), id='seen by a robot that is turned'),
        pytest.param(
            LanePose(0.02, 0.0, 2.0),
            (0.4, 0.0),
            (math.atan2(0.4, 0.48) / 2, 0.5 - math.hypot(0.4, 0.48)),
            id='straight on, the lane bends away to the left',
        ),
    ],
)
def test_points_of_the_robot_in_the_lane(pose: LanePose, robot: Tuple[float, float], lane: Tuple[float, float]) -> None:
    assert lane_from_robot(robot[0], robot[1], pose) == pytest.approx(lane, abs=1e-12)
    assert robot_from_lane(lane[0], lane[1], pose) == pytest.approx(robot, abs=1e-12)


@pytest.mark.parametrize('curvature', [2.4, -5.9, 0.1, -1e-3, 0.0])
@pytest.mark.parametrize('pose', [(0.0, 0.0), (0.03, 0.2), (-0.05, -0.4)])
def test_the_lanes_centre_is_driven_at_a_steady_turn(pose: Tuple[float, float], curvature: float) -> None:
    # an independent reckoning: from the point of the centre beside the robot, small chords of a circle
    d, phi = pose
    x, y, heading, step = d * math.sin(-phi), -d * math.cos(-phi), -phi, 1e-3
    for count in range(1, 301):
        heading += curvature * step / 2
        x, y = x + step * math.cos(heading), y + step * math.sin(heading)
        heading += curvature * step / 2
        assert lane_from_robot(x, y, LanePose(d, phi, curvature)) == pytest.approx((count * step, 0.0), abs=2e-6)
        assert robot_from_lane(count * step, 0.0, LanePose(d, phi, curvature)) == pytest.approx((x, y), abs=2e-6)


@pytest.mark.parametrize('curvature', [0.0, 1e-9, -1e-9, 0.9e-6, 1.1e-6, -1.1e-6, 1e-4])
def test_a_very_wide_bend_is_nearly_a_straight(curvature: float) -> None:
    x, y, d, phi = 1.5, -0.2, 0.03, 0.1
    along, left = lane_from_robot(x, y, LanePose(d, phi))
    aside = curvature * along**2 / 2
    bent = LanePose(d, phi, curvature)
    assert lane_from_robot(x, y, bent) == pytest.approx((along + curvature * along * left, left - aside), abs=2e-6)
    assert robot_from_lane(along, left - aside, bent) == pytest.approx((x, y), abs=1e-4)
    if abs(curvature) < 1e-6:
        assert lane_from_robot(x, y, bent) == pytest.approx((along, left), abs=2e-6)
        assert robot_from_lane(along, left, bent) == pytest.approx((x, y), abs=2e-6)
