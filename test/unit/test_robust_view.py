"""core.detection.robust.view: where each pixel of the working picture lies on the road."""

import math
from dataclasses import replace

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration, scaled
from obst_avoid.core.detection.robust.view import (
    BAND,
    FARTHEST,
    FARTHEST_FOOT,
    GROWTH,
    ROOM,
    TAPE,
    WIDTH,
    View,
    in_view,
    make_view,
    working_picture,
)
from obst_avoid.core.geometry import ground_from_pixel, image_from_rectified, pixel_from_ground, rectified_from_image
from unit.cameras import Camera, calibration_of

CAMERAS = {
    'level': Camera(),
    'steep': Camera(pitch=30.0, height=0.12),
    'rolled': Camera(roll=3.0),
    'turned': Camera(yaw=4.0, left=0.01),
    'tele': Camera(focal=420.0, projection=(420.0, 420.0), distortion=(0.0,) * 5),
}
WIDE_LENS = Camera(focal=311.0, projection=(311.0, 310.0), distortion=(-0.342, 0.1525, 0.0, 0.0, -0.0372))
"""As a lens of the fleet's was fitted: beyond 54 degrees its model folds back into the picture."""
SIZES = [(176, 132), (320, 240), (432, 324), (640, 480), (800, 600), (1280, 960), (1296, 972)]


@pytest.fixture(scope='module', params=sorted(CAMERAS))
def calibration(request: pytest.FixtureRequest) -> Calibration:
    """Made-up cameras."""
    return calibration_of(CAMERAS[request.param])


@pytest.fixture(scope='module')
def view(calibration: Calibration) -> View:
    """Its working picture."""
    return make_view(calibration)


def test_each_pixel_knows_its_place_on_the_road(calibration: Calibration, view: View) -> None:
    rows, columns = np.mgrid[view.top + 10 : view.height : 11, 3 : view.width : 17]
    rows, columns = rows.ravel(), columns.ravel()
    below = view.nearness[rows, columns] > 0.05
    rows, columns = rows[below], columns[below]
    assert len(rows) > 100
    pixels = (np.column_stack([columns, rows]) + 0.5) * view.scale - 0.5
    ground = ground_from_pixel(calibration.homography, rectified_from_image(calibration, pixels))
    np.testing.assert_allclose(1 / view.nearness[rows, columns], ground[:, 0], rtol=1e-3)
    np.testing.assert_allclose(view.bearing[rows, columns], ground[:, 1] / ground[:, 0], atol=1e-3)


def test_nothing_is_infinite(view: View) -> None:
    assert np.isfinite(view.nearness).all()
    assert np.isfinite(view.bearing).all()
    assert view.nearness.shape == view.bearing.shape == (view.height, view.width)


def test_rows_are_nearer_the_lower_they_are_and_left_is_left(view: View) -> None:
    column = view.nearness[view.top :, view.width // 2]
    assert (np.diff(column) > 0).all()
    low = view.bearing[-1]
    assert low[0] > 0.2
    assert low[-1] < -0.2
    assert (np.diff(low) < 0).all()


def test_what_stands_on_the_farthest_road_is_in_the_rows(view: View) -> None:
    column = view.nearness[:, view.width // 2]
    farthest = int(np.flatnonzero(column > 1 / FARTHEST)[0])
    assert view.top == max(farthest - int(ROOM * view.height), 0)
    assert 0 < view.top < farthest


def test_a_foot_is_looked_at_from_the_first_row_that_is_near_enough(view: View) -> None:
    column = view.nearness[:, view.width // 2]
    assert view.foot == np.flatnonzero(column > 1 / FARTHEST_FOOT)[0]
    assert view.top < view.foot < view.height / 2


@pytest.mark.parametrize('size', SIZES, ids='%dx%d'.__mod__)
def test_the_working_picture_is_the_same_whatever_the_cameras_size(size: tuple) -> None:
    calibration = calibration_of(CAMERAS['level'])
    same, view = make_view(calibration), make_view(scaled(calibration, *size))
    assert (view.width, view.height, view.top, view.foot) == (WIDTH, 240, same.top, same.foot)
    assert view.scale == size[0] / WIDTH
    np.testing.assert_allclose(view.nearness[view.top :], same.nearness[view.top :], atol=2e-3)
    np.testing.assert_allclose(view.bearing[view.top + 20 :], same.bearing[view.top + 20 :], atol=3e-3)
    assert (view.openings, view.closing) == (same.openings, same.closing)
    picture = np.zeros((size[1], size[0], 3), np.uint8)
    assert working_picture(picture, view).shape == (240, WIDTH, 3)


def test_the_bands_cover_all_rows_once_and_grow_downwards(view: View) -> None:
    assert len(view.openings) == len(TAPE)
    for bands in (*view.openings, view.closing):
        assert bands[0][0] == 0
        assert bands[-1][1] == view.height - view.top
        assert [first for first, _, _ in bands[1:]] == [past for _, past, _ in bands[:-1]]
        pixels = [pixels for _, _, pixels in bands]
        assert pixels == sorted(pixels)
        assert min(pixels) >= 1
    (narrow, wide) = view.openings
    assert max(pixels for _, _, pixels in wide) > max(pixels for _, _, pixels in narrow)


def test_bands_are_as_wide_as_tape_and_as_a_cones_band_at_their_distance(view: View) -> None:
    for size, bands in zip((*TAPE, BAND), (*view.openings, view.closing)):
        for first, past, pixels in bands:
            row = view.top + (first + past) // 2
            if view.nearness[row, view.width // 2] < 0.6:
                continue  # it is a pixel wide
            middle = view.width // 2
            ahead = 1 / view.nearness[row, middle]
            metres = abs(view.bearing[row, middle + 5] - view.bearing[row, middle - 5]) / 10 * ahead
            assert pixels == pytest.approx(size / metres, rel=GROWTH - 1, abs=1.0)


def test_the_camera_is_where_the_calibration_says() -> None:
    view = make_view(calibration_of(Camera(height=0.12)))
    assert view.camera.height == pytest.approx(0.12, abs=1e-3)
    assert view.camera.ahead == pytest.approx(Camera().position[0], abs=1e-3)


def test_the_working_picture_is_averaged() -> None:
    view = make_view(calibration_of(CAMERAS['level']))
    picture = np.zeros((480, 640, 3), np.uint8)
    picture[::2, ::2] = 200  # each working pixel is made of four
    assert set(np.unique(working_picture(picture, view))) == {50}
    random = np.random.RandomState(0).randint(0, 256, (480, 640, 3)).astype(np.uint8)
    mean = random.reshape(240, 2, 320, 2, 3).mean(axis=(1, 3))
    assert np.abs(working_picture(random, view) - mean).max() <= 0.51


@pytest.mark.parametrize(
    'x, y, seen',
    [
        pytest.param(0.5, 0.0, True, id='ahead'),
        pytest.param(1.5, 0.5, True, id='far and left'),
        pytest.param(0.05, 0.0, False, id='below the picture'),
        pytest.param(0.3, 0.9, False, id='left of the picture'),
        pytest.param(0.3, -0.9, False, id='right of the picture'),
        pytest.param(-0.5, 0.0, False, id='behind'),
        pytest.param(-3.0, 0.3, False, id='far behind'),
    ],
)
def test_in_view(x: float, y: float, seen: bool) -> None:
    calibration = calibration_of(CAMERAS['level'])
    assert in_view(calibration, x, y) is seen


def test_in_view_is_where_the_picture_ends(calibration: Calibration) -> None:
    for x in np.linspace(0.25, 1.5, 6):
        for y in np.linspace(-0.6, 0.6, 13):
            pixel = pixel_from_ground(calibration.homography, np.array([[x, y]]))
            (u, v) = image_from_rectified(calibration, pixel)[0]
            inside = 0 <= u < calibration.width and 0 <= v < calibration.height
            assert in_view(calibration, float(x), float(y)) is bool(inside), (x, y)


def lens_angle(camera: Camera, x: float, y: float) -> float:
    """Tangent of the angle between the lens's axis and a point of the road; inf behind the camera."""
    right, down, ahead = camera.rotation @ (np.array([x, y, 0.0]) - camera.position)
    return math.hypot(right, down) / ahead if ahead > 0 else math.inf


def fold_of(camera: Camera) -> float:
    """The tangent up to which the lens model moves points outwards."""
    k1, k2, _, _, k3 = camera.distortion
    tangent = np.linspace(0, 3, 3001)
    moved = tangent * (1 + k1 * tangent**2 + k2 * tangent**4 + k3 * tangent**6)
    return float(tangent[np.argmax(np.diff(moved) < 0)])


WIDE_ROAD = [(float(x), float(y)) for x in np.linspace(0.1, 2.0, 20) for y in np.linspace(-3.0, 3.0, 41)]
"""[m] Far beyond both sides of the picture."""


def test_what_the_lens_model_folds_back_is_not_in_view() -> None:
    """A thing far aside need not be seen, though the model puts it in the middle of the picture."""
    calibration, fold = calibration_of(WIDE_LENS), fold_of(WIDE_LENS)
    assert 1.2 < fold < 1.5
    folded = shown = 0
    for x, y in WIDE_ROAD:
        angle = lens_angle(WIDE_LENS, x, y)
        if math.isinf(angle):
            continue
        u, v = WIDE_LENS.image_from_robot([(x, y, 0.0)])[0]
        inside = 0 <= u < calibration.width and 0 <= v < calibration.height
        if angle > 1.1 * fold:
            folded += inside
            assert not in_view(calibration, x, y), (x, y)
        elif angle < 0.97 * fold:
            shown += inside
            assert in_view(calibration, x, y) is bool(inside), (x, y)
    assert folded > 100
    assert shown > 100


@pytest.mark.parametrize('camera', [CAMERAS['level'], WIDE_LENS], ids=['level', 'wide'])
def test_left_and_right_are_in_view_alike(camera: Camera) -> None:
    calibration = calibration_of(camera)
    assert sum(in_view(calibration, x, y) for x, y in WIDE_ROAD) > 100
    for x, y in WIDE_ROAD:
        assert in_view(calibration, x, y) is in_view(calibration, x, -y), (x, y)


def test_a_camera_that_sees_no_far_road_still_has_a_view() -> None:
    """Steep down: all rows are looked at."""
    calibration = calibration_of(replace(Camera(), pitch=55.0, height=0.2))
    view = make_view(calibration)
    assert (view.top, view.foot) == (0, 0)
    assert math.isfinite(float(view.nearness.max()))
