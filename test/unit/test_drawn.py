"""drawn.py: the drawn world must be where the tests that rest on it believe it to be."""

import math
from typing import Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.types import Kind, LanePose
from unit import drawn
from unit.cameras import Camera, calibration_of
from unit.drawn import RobotPose, Scene, Thing, draw, robot_from_world
from unit.scenes import cone, duckie, picture_of

CAMERA = Camera(roll=2.0)
CALIBRATION = calibration_of(CAMERA)
QUARTER = math.pi / 2


@pytest.mark.parametrize(
    'pose, world, robot',
    [
        pytest.param(RobotPose(), (0.5, 0.1), (0.5, 0.1), id='at the origin'),
        pytest.param(RobotPose(0.2, 0.0, 0.0), (0.5, 0.1), (0.3, 0.1), id='farther on: nearer'),
        pytest.param(RobotPose(0.0, 0.05, 0.0), (0.5, 0.1), (0.5, 0.05), id='farther left: less to the left'),
        pytest.param(RobotPose(0.0, 0.0, QUARTER), (0.5, 0.0), (0.0, -0.5), id='turned left: ahead comes to the right'),
        pytest.param(RobotPose(0.1, 0.0, QUARTER), (0.1, 0.3), (0.3, 0.0), id='turned left: left comes ahead'),
        pytest.param(RobotPose(0.0, 0.0, -QUARTER), (0.5, 0.0), (0.0, 0.5), id='turned right: ahead comes to the left'),
    ],
)
def test_points_of_the_world_seen_from_the_robot(
    pose: RobotPose, world: Tuple[float, float], robot: Tuple[float, float]
) -> None:
    assert robot_from_world(world[0], world[1], pose) == pytest.approx(robot, abs=1e-12)


def test_points_may_be_arrays() -> None:
    x, y = robot_from_world(np.array([0.5, 0.6]), np.array([0.0, 0.1]), RobotPose(0.1, 0.0, 0.0))
    np.testing.assert_allclose([x, y], [[0.4, 0.5], [0.0, 0.1]])


def test_the_lane_pose_is_that_of_the_robot() -> None:
    assert RobotPose(3.0, -0.02, 0.1).lane_pose == LanePose(-0.02, 0.1)


def pixel(picture: np.ndarray, pose: RobotPose, x: float, y: float, z: float = 0.0) -> np.ndarray:
    """What the picture shows of a point of the world, by the made-up camera's own projection. BGR."""
    ahead, left = robot_from_world(x, y, pose)
    u, v = np.rint(CAMERA.image_from_robot([[ahead, left, z]])[0]).astype(int)
    assert 0 <= u < 640 and 0 <= v < 480, 'outside the picture'
    around: np.ndarray = picture[v - 1 : v + 2, u - 1 : u + 2].reshape(-1, 3).mean(axis=0)
    return around


POSES = [RobotPose(), RobotPose(1.0, 0.04, 0.15), RobotPose(-0.5, -0.03, -0.2)]


@pytest.mark.parametrize('pose', POSES, ids=['in the middle', 'left, turned left', 'right, turned right'])
def test_paint_is_where_the_road_has_it(pose: RobotPose) -> None:
    begin = math.ceil((pose.x + 0.3) / 0.075) * 0.075  # of a dash
    stop = pose.x + 0.45
    picture = draw(Scene(stop_line=stop), CALIBRATION, pose)
    points = [
        (pose.x + 0.4, -0.11 - 0.024, drawn.WHITE),
        (pose.x + 0.4, -0.11 + 0.015, drawn.ASPHALT),
        (pose.x + 0.4, -0.11 - 0.048 - 0.015, drawn.ASPHALT),
        (pose.x + 0.5, 0.11 + 0.025 + 0.22 + 0.024, drawn.WHITE),
        (begin + 0.025, 0.11 + 0.0125, drawn.YELLOW),
        (begin + 0.0625, 0.11 + 0.0125, drawn.ASPHALT),
        (begin + 0.025, 0.11 - 0.012, drawn.ASPHALT),
        (pose.x + 0.35, 0.0, drawn.ASPHALT),
        (stop + 0.024, 0.0, drawn.RED),
        (stop + 0.024, -0.1, drawn.RED),
        (stop - 0.015, 0.0, drawn.ASPHALT),
        (stop + 0.07, 0.0, drawn.ASPHALT),
    ]
    shown = np.array([pixel(picture, pose, x, y) for x, y, _ in points])
    np.testing.assert_allclose(shown, [color for _, _, color in points], atol=25)


def test_without_a_stop_line_nothing_is_red() -> None:
    picture = draw(Scene(), CALIBRATION, RobotPose()).astype(int)
    assert (picture[:, :, 2] - picture[:, :, 1]).max() < 60


@pytest.mark.parametrize('pose', POSES, ids=['in the middle', 'left, turned left', 'right, turned right'])
@pytest.mark.parametrize('make, color', [(duckie, drawn.DUCK), (cone, drawn.CONE)], ids=['duckie', 'cone'])
def test_things_stand_where_they_are_put(pose: RobotPose, make: type, color: Tuple[int, int, int]) -> None:
    thing = make(pose.x + 0.4, 0.03)
    picture = draw(Scene((thing,)), CALIBRATION, pose)
    for share in (0.2, 0.4):
        np.testing.assert_allclose(pixel(picture, pose, thing.x, thing.y, share * thing.height), color, atol=12)
    above = pixel(picture, pose, thing.x, thing.y, 1.3 * thing.height)
    assert np.abs(above - color).max() > 40


def test_the_nearer_thing_hides_the_farther() -> None:
    near, far = cone(0.3, 0.0), duckie(0.35, 0.0)
    for things in ((near, far), (far, near)):
        picture = draw(Scene(things), CALIBRATION, RobotPose())
        np.testing.assert_allclose(pixel(picture, RobotPose(), 0.3, 0.0, 0.02), drawn.CONE, atol=12)


@pytest.mark.parametrize(
    'thing', [duckie(-0.5, 0.0), cone(0.05, 0.0), duckie(0.2, 3.0)], ids=['behind', 'below', 'far beside']
)
def test_what_the_camera_cannot_see_is_not_drawn(thing: Thing) -> None:
    picture = draw(Scene((thing,)), CALIBRATION, RobotPose())
    np.testing.assert_array_equal(picture, draw(Scene(), CALIBRATION, RobotPose()))


def test_above_the_horizon_is_the_wall() -> None:
    picture = draw(Scene(), CALIBRATION, RobotPose())
    np.testing.assert_allclose(picture[:40].reshape(-1, 3).mean(axis=0), drawn.WALL, atol=2)


@pytest.mark.parametrize('size', [(640, 480), (320, 240), (160, 120)], ids='%dx%d'.__mod__)
def test_the_picture_has_the_cameras_size(size: Tuple[int, int]) -> None:
    picture = picture_of(calibration_of(CAMERA.resized(*size)))
    assert (picture.shape, picture.dtype) == ((size[1], size[0], 3), np.uint8)


def test_noise_depends_on_the_seed_alone() -> None:
    scene = Scene((Thing(Kind.DUCKIE, 0.4, 0.0),))
    first, second = (draw(scene, CALIBRATION, RobotPose(), seed=1) for _ in range(2))
    other = draw(scene, CALIBRATION, RobotPose(), seed=2)
    np.testing.assert_array_equal(first, second)
    difference = (first.astype(int) - other).reshape(-1, 3)
    np.testing.assert_allclose(difference.std(axis=0), math.sqrt(2) * drawn.NOISE, rtol=0.1, err_msg='blue, green, red')
    np.testing.assert_allclose(difference.mean(axis=0), 0, atol=0.1)


def test_a_drawing_can_be_sent_and_read() -> None:
    picture = picture_of(CALIBRATION, (duckie(0.4, 0.0),))
    done, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, 90])
    assert done and np.abs(cv2.imdecode(data, cv2.IMREAD_COLOR).astype(int) - picture).mean() < 4
