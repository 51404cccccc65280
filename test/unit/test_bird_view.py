"""core.bird_view: metric, 640 wide and of one scale for every picture size, also from a rolled camera."""

import math
from dataclasses import replace
from typing import List, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.bird_view import (
    BirdView,
    BirdViewSettings,
    bird_from_ground,
    crop,
    footprint_box,
    ground_from_bird,
    image_box_from_bird,
    image_from_bird,
    make_bird_view,
    warp,
)
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.types import Box
from unit.cameras import Camera, calibration_of

SETTINGS = BirdViewSettings(crop_distance=1.7, horizon_margin=0.021)
CAMERA = Camera()
SIZES = [(640, 480), (320, 240), (352, 264), (800, 600), (1296, 972)]
SQUARE = np.array([[0.5, 0.05], [0.5, -0.05], [0.4, -0.05], [0.4, 0.05]])
"""[m] corners of a square on the road: far left, far right, near right, near left."""


def view_of(camera: Camera) -> BirdView:
    """The bird view of a made-up camera."""
    return make_bird_view(calibration_of(camera), SETTINGS)


def on_road(points: np.ndarray) -> np.ndarray:
    """(N, 2) points of the road as (N, 3) points of the robot frame."""
    return np.column_stack([points, np.zeros(len(points))])


def marks(camera: Camera, points: np.ndarray) -> List[np.ndarray]:
    """Pictures of one disc each, 12 mm wide and painted on the road at the given points."""
    around = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    pictures = []
    for x, y in points:
        disc = np.column_stack([x + 0.006 * np.cos(around), y + 0.006 * np.sin(around)])
        pixels = np.rint(camera.image_from_robot(on_road(disc)) * 16).astype(np.int32)
        picture = np.zeros((camera.picture_height, camera.width, 3), dtype=np.uint8)
        cv2.fillPoly(picture, [pixels], (255, 255, 255), lineType=cv2.LINE_AA, shift=4)
        pictures.append(picture)
    return pictures


def centre_of(picture: np.ndarray) -> np.ndarray:
    """(u, v) of what is bright in a picture."""
    moments = cv2.moments(picture[:, :, 0])
    assert moments['m00'] > 0, 'nothing to see'
    return np.array([moments['m10'], moments['m01']]) / moments['m00']


@pytest.mark.parametrize('size', SIZES, ids='%dx%d'.__mod__)
def test_the_bird_view_is_640_wide_at_every_picture_size(size: Tuple[int, int]) -> None:
    camera = CAMERA.resized(*size)
    view = view_of(camera)
    cropped = crop(np.zeros((size[1], size[0], 3), dtype=np.uint8), view)
    assert cropped.shape == (size[1] - view.crop_row, size[0], 3)
    assert warp(cropped, view).shape == (view.height, 640, 3)


@pytest.mark.parametrize('size', SIZES, ids='%dx%d'.__mod__)
def test_the_scale_does_not_depend_on_the_picture_size(size: Tuple[int, int]) -> None:
    # the crop begins at a whole row: at 320x240 a row is 3 % of the distance there
    assert view_of(CAMERA.resized(*size)).pixels_per_metre == pytest.approx(view_of(CAMERA).pixels_per_metre, rel=0.05)


def test_the_road_beyond_the_distance_limit_is_cut_off() -> None:
    near, far = (make_bird_view(calibration_of(CAMERA), replace(SETTINGS, crop_distance=d)) for d in (1.0, 1.7))
    row = CAMERA.rectified_from_robot([[1.7, 0, 0]])[0, 1]
    assert far.crop_row == math.ceil(row)
    assert near.crop_row > far.crop_row
    assert near.x_top <= 1.0 and 1.6 < far.x_top <= 1.7


@pytest.mark.parametrize('size', [(640, 480), (320, 240), (1296, 972)], ids='%dx%d'.__mod__)
@pytest.mark.parametrize('roll, twist', [(0.0, 0.0), (4.0, 0.0), (0.0, 5.0)], ids=['level', 'rolled', 'rectified'])
def test_marks_on_the_road_land_where_the_road_is(size: Tuple[int, int], roll: float, twist: float) -> None:
    points = np.concatenate([SQUARE, [[0.25, 0.0], [0.3, -0.12], [0.7, 0.2]]])
    camera = replace(CAMERA, roll=roll, twist=twist).resized(*size)
    view = view_of(camera)
    for point, picture in zip(points, marks(camera, points)):
        found = centre_of(warp(crop(picture, view), view))
        expected = np.array([view.y_left - point[1], view.x_top - point[0]]) * view.pixels_per_metre
        # 1 px is 7 mm here; a 320 px wide picture has rows 1 cm apart at 0.5 m
        np.testing.assert_allclose(found, expected, atol=0.6 if size[0] >= 640 else 1.2, err_msg=str(point))


@pytest.mark.parametrize('camera', [CAMERA, Camera(roll=-5.0, yaw=6.0)], ids=['level', 'rolled and turned'])
def test_squares_stay_squares(camera: Camera) -> None:
    view = view_of(camera)
    corners = [centre_of(warp(crop(picture, view), view)) for picture in marks(camera, SQUARE)]
    sides = [np.linalg.norm(corners[i] - corners[i - 1]) / view.pixels_per_metre for i in range(4)]
    np.testing.assert_allclose(sides, 0.1, atol=0.004)
    np.testing.assert_allclose(
        np.linalg.norm(corners[0] - corners[2]), np.linalg.norm(corners[1] - corners[3]), rtol=0.04
    )


@pytest.mark.parametrize('roll', [-5.9, -3.4, 0.0, 3.4, 5.9])
@pytest.mark.parametrize('pitch', [10.0, 21.0, 30.0])
def test_a_rolled_camera_keeps_a_usable_scale(roll: float, pitch: float) -> None:
    view = view_of(replace(CAMERA, roll=roll, pitch=pitch))
    assert view.pixels_per_metre > 100
    assert view.x_top > 0.5, 'the road half a metre ahead must be seen'


@pytest.mark.parametrize('roll', [-5.9, 5.9])
def test_the_crop_stays_below_a_rolled_horizon(roll: float) -> None:
    camera = replace(CAMERA, roll=roll)
    view = view_of(camera)
    ends = camera.rectified_from_robot([[1e9, 1e9, 0], [1e9, -1e9, 0]])
    slope = (ends[1, 1] - ends[0, 1]) / (ends[1, 0] - ends[0, 0])
    lowest = max(ends[0, 1] + slope * (u - ends[0, 0]) for u in (0, 639))
    assert lowest + 0.021 * 480 <= view.crop_row < lowest + 0.021 * 480 + 1


def test_a_camera_that_looks_down_is_not_cropped() -> None:
    assert view_of(Camera(pitch=60.0)).crop_row == 0


@pytest.mark.parametrize('pitch', [-29.0, -40.0], ids=['little road left', 'horizon below the picture'])
def test_a_camera_that_sees_too_little_road_is_refused(pitch: float) -> None:
    with pytest.raises(CalibrationError, match='^camera_extrinsic/duck1.yaml: homography has the horizon at row '):
        view_of(Camera(pitch=pitch))


@pytest.mark.parametrize(
    'camera', [CAMERA, Camera(roll=4.0), CAMERA.resized(320, 240)], ids=['level', 'rolled', 'small']
)
def test_pixels_of_the_bird_view_lie_in_the_picture_where_the_camera_saw_them(camera: Camera) -> None:
    view = view_of(camera)
    bird = bird_from_ground(view, SQUARE)
    np.testing.assert_allclose(ground_from_bird(view, bird), SQUARE, atol=1e-12)
    # cv2.getPerspectiveTransform takes its corners in float32
    np.testing.assert_allclose(image_from_bird(view, bird), camera.image_from_robot(on_road(SQUARE)), atol=0.02)


def test_no_pixels_stay_no_pixels(view: BirdView) -> None:
    assert ground_from_bird(view, np.empty((0, 2))).shape == (0, 2)
    assert bird_from_ground(view, np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize('size', [(640, 480), (320, 240)], ids='%dx%d'.__mod__)
def test_a_box_comes_back_around_the_same_pixels(size: Tuple[int, int]) -> None:
    camera = CAMERA.resized(*size)
    view = view_of(camera)
    picture = np.zeros((size[1], size[0], 3), dtype=np.uint8)
    corners = camera.image_from_robot(on_road(SQUARE))
    cv2.fillConvexPoly(picture, np.rint(corners).astype(np.int32), (255, 255, 255))
    left, top, width, height = cv2.boundingRect(picture[:, :, 0])
    v, u = np.nonzero(warp(crop(picture, view), view)[:, :, 0] > 127)
    box = image_box_from_bird(view, np.column_stack([u, v]))
    np.testing.assert_allclose(
        [box.left, box.top, box.right, box.bottom], [left, top, left + width, top + height], atol=0.008 * size[0]
    )


def test_one_pixel_has_a_box_of_its_own_size() -> None:
    view = view_of(CAMERA)
    u, v = np.rint(bird_from_ground(view, np.array([[0.4, 0.0]]))[0])
    box = image_box_from_bird(view, np.array([[u, v]]))
    ground = ground_from_bird(view, np.array([[u - 0.5, v + 0.5], [u + 0.5, v + 0.5]]))
    (left, bottom), (right, _) = CAMERA.image_from_robot(on_road(ground)) + 0.5
    assert (box.left, box.right, box.bottom) == pytest.approx((left, right, bottom), abs=0.02)
    assert box.top < box.bottom


def test_a_box_is_clipped_to_the_picture(view: BirdView) -> None:
    everything = np.array([[0, 0], [639, 0], [0, view.height - 1], [639, view.height - 1]])
    box = image_box_from_bird(view, everything)
    assert 0 <= box.left and 0 <= box.top and box.right <= 640 and box.bottom == pytest.approx(480, abs=1.0)
    assert box != Box(0, 0, 0, 0)


@pytest.mark.parametrize('x, y', [(0.5, 0.0), (0.3, -0.1), (0.1, 0.02), (-0.1, 0.05)])
def test_the_box_of_a_footprint_stands_where_the_thing_stands(view: BirdView, x: float, y: float) -> None:
    box = footprint_box(view, x, y, 0.03)
    corners = [((box.left + box.right - 1) / 2, box.bottom - 0.5), (box.right - 0.5, box.top - 0.5)]
    middle, right = ground_from_bird(view, np.array(corners))
    assert tuple(middle) == pytest.approx((x, y), abs=1e-9)
    assert tuple(right) == pytest.approx((x + 0.06, y - 0.03), abs=1e-9)


@pytest.mark.parametrize('x, y', [(0.3, 0.9), (0.3, -0.9), (2.5, 0.0), (9.0, 9.0), (-0.15, 0.0)])
def test_the_box_of_a_footprint_beside_the_bird_view_stays_a_box(view: BirdView, x: float, y: float) -> None:
    box = footprint_box(view, x, y, 0.03)
    assert 0 <= box.left < box.right <= 640
    assert 0 <= box.top < box.bottom <= 640
