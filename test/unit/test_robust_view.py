"""core.detection.robust.view: where each pixel of the working picture lies on the road."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import math
from dataclasses import replace
from typing import Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration, scaled
from obst_avoid.core.detection.robust.view import (
    BAND,
    FARTHEST,
    FARTHEST_FOOT,
    GROWTH,
    NEAREST,
    ROAD_STEPS,
    ROOM,
    TAPE,
    WIDEST_BEARING,
    WIDTH,
    View,
    in_view,
    make_view,
    shown,
    working_picture,
)
from obst_avoid.core.geometry import ground_from_pixel, image_from_rectified, pixel_from_ground, rectified_from_image
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

CAMERAS = {
    'level': Camera(),
    'steep': Camera(pitch=30.0, height=0.12),
    'rolled': Camera(roll=3.0),
    'turned': Camera(yaw=4.0, left=0.01),
    'tele': Camera(focal=420.0, projection=(420.0, 420.0), distortion=(0.0,) * 5),
}
WIDE_LENS = Camera(focal=311.0, projection=(311.0, 310.0), distortion=(-0.342, 0.1525, 0.0, 0.0, -0.0372))
"""As a lens of the fleet's was fitted: beyond 54 degrees its model folds back into the picture."""
HEIGHT = 180
"""[px] of the working picture."""
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
def test_the_working_picture_is_the_same_whatever_the_cameras_size(size: Tuple[int, int]) -> None:
    calibration = calibration_of(CAMERAS['level'])
    same, view = make_view(calibration), make_view(scaled(calibration, *size))
    assert (view.width, view.height, view.top, view.foot) == (WIDTH, HEIGHT, same.top, same.foot)
    assert view.scale == size[0] / WIDTH
    np.testing.assert_allclose(view.nearness[view.top :], same.nearness[view.top :], atol=2e-3)
    np.testing.assert_allclose(view.bearing[view.top + 20 :], same.bearing[view.top + 20 :], atol=3e-3)
    np.testing.assert_array_equal(view.opening, same.opening)
    np.testing.assert_array_equal(view.closing, same.closing)


def test_the_bands_cover_all_rows_once_and_grow_downwards(view: View) -> None:
    for bands in (view.opening, view.closing):
        assert bands.dtype == np.int32
        assert bands.flags.c_contiguous
        assert bands.shape[1] == 3
        first, past, pixels = bands.T
        assert first[0] == 0
        assert past[-1] == view.height - view.top
        assert (past > first).all()
        assert (first[1:] == past[:-1]).all()
        assert (pixels >= 1).all()
        assert (pixels % 2 == 1).all(), 'an even one moves things'
        assert (np.diff(pixels) >= 0).all()
        assert pixels[-1] > pixels[0]


@pytest.mark.parametrize('name, size', [('opening', TAPE), ('closing', BAND)])
def test_bands_are_as_wide_as_tape_and_as_a_cones_band_at_their_distance(view: View, name: str, size: float) -> None:
    """In each row, but for whole pixels, the growth that rows of one band share, and the step to an odd number."""
    middle = view.width // 2
    looked_at = 0
    for first, past, pixels in getattr(view, name).tolist():
        for row in range(view.top + first, view.top + past):
            if view.nearness[row, middle] < 0.6:
                continue  # it is a pixel wide
            metres = abs(view.bearing[row, middle + 5] - view.bearing[row, middle - 5]) / 10
            wide = size / metres * view.nearness[row, middle]
            least = min((wide - 0.5) / GROWTH, wide - 1.5)
            assert least <= pixels <= max((wide + 0.5) * GROWTH, wide + 1.5) + 1, row
            looked_at += 1
    assert looked_at > 50


def test_the_camera_is_where_the_calibration_says() -> None:
    view = make_view(calibration_of(Camera(height=0.12)))
    assert view.camera.height == pytest.approx(0.12, abs=1e-3)
    assert view.camera.ahead == pytest.approx(Camera().position[0], abs=1e-3)


def averaged(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    """(height, width, 3): plain means of what each pixel covers, written down anew."""
    mean = picture.astype(np.float64)
    for axis, count in ((0, height), (1, width)):
        mean = np.moveaxis(mean, axis, 0)
        sums = np.concatenate([np.zeros_like(mean[:1]), mean.cumsum(axis=0)])
        at = np.arange(count + 1) * len(mean) / count
        whole = np.minimum(at.astype(int), len(mean) - 1)
        until = sums[whole] + (at - whole)[:, None, None] * mean[whole]
        mean = np.moveaxis(np.diff(until, axis=0) * count / picture.shape[axis], 0, axis)
    return mean


def shift_of(one: np.ndarray, other: np.ndarray, axis: int) -> float:
    """[px] by which other lies further on than one, by least squares."""
    slope = np.gradient(one, axis=axis)
    return float(-(slope * (other - one)).sum() / (slope**2).sum())


def test_the_plain_average_is_one_and_a_shift_is_seen() -> None:
    random = np.random.RandomState(0).randint(0, 256, (60, 80, 3)).astype(np.uint8)
    np.testing.assert_allclose(averaged(random, 40, 30), random.reshape(30, 2, 40, 2, 3).mean(axis=(1, 3)))
    np.testing.assert_allclose(averaged(random, 32, 30).sum(axis=(0, 1)) * 5, random.sum(axis=(0, 1)))
    soft = cv2.GaussianBlur(random, (0, 0), 3).astype(np.float64)
    assert shift_of(soft[:, :-1], soft[:, 1:], 1) == pytest.approx(-1, abs=0.1)


@pytest.mark.parametrize('size', [*SIZES, (240, 180), (720, 540), (500, 375)], ids='%dx%d'.__mod__)
def test_the_working_picture_is_averaged(size: Tuple[int, int]) -> None:
    """Within a few grey levels of a plain average where it is smooth, and nowhere moved."""
    view = make_view(calibration_of(Camera().resized(*size)))
    noise = np.random.RandomState(size[0]).randint(0, 256, (size[1] // 8 + 1, size[0] // 8 + 1, 3)).astype(np.uint8)
    soft = cv2.GaussianBlur(cv2.resize(noise, size), (0, 0), max(size[0] / 120, 3.0))
    sharp = cv2.resize(picture_of(calibration_of(Camera()), (duckie(0.4, 0.0), cone(0.5, 0.1))), size)
    for picture, most in ((soft, 4), (sharp, 80)):
        small = working_picture(picture, view)
        assert small.shape == (HEIGHT, WIDTH, 3)
        assert small.dtype == np.uint8
        expected = averaged(picture, WIDTH, HEIGHT)
        off = np.abs(small - expected)
        assert off.max() < most
        assert off.mean() < 1.5
        for axis in (0, 1):
            assert shift_of(expected, small.astype(np.float64), axis) == pytest.approx(0, abs=0.02)


@pytest.mark.parametrize('size', [size for size in SIZES if size[0] > WIDTH], ids='%dx%d'.__mod__)
def test_noise_is_averaged_out(size: Tuple[int, int]) -> None:
    """Hardly worse than by a plain average."""
    noise = np.random.RandomState(0).randint(0, 256, (size[1], size[0], 3)).astype(np.uint8)
    small = working_picture(noise, make_view(calibration_of(Camera().resized(*size))))
    assert small.std() < 1.6 * averaged(noise, WIDTH, HEIGHT).std()


def test_a_picture_of_the_working_size_stays_as_it_is() -> None:
    picture = np.random.RandomState(0).randint(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    view = make_view(calibration_of(Camera().resized(WIDTH, HEIGHT)))
    np.testing.assert_array_equal(working_picture(picture, view), picture)


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


# Looked up


MORE_CAMERAS = {
    **CAMERAS,
    'wide': WIDE_LENS,
    'small': Camera().resized(320, 240),
    'low': Camera(height=0.06, pitch=10.0),
}


@pytest.mark.parametrize('name', sorted(MORE_CAMERAS))
def test_what_is_shown_is_in_view_but_for_a_step_of_the_table(name: str) -> None:
    """Where the two differ, in_view changes within one step."""
    calibration = calibration_of(MORE_CAMERAS[name])
    view = make_view(calibration)
    assert view.road.shape == ROAD_STEPS
    random = np.random.RandomState(0)
    nearness = np.concatenate([random.uniform(0.01, 1.2 * NEAREST, 800), random.uniform(0.1, 8, 800)])
    bearing = np.concatenate([random.uniform(-1.2, 1.2, 800) * WIDEST_BEARING, random.uniform(-1.5, 1.5, 800)])
    step, aside = NEAREST / ROAD_STEPS[0], 2 * WIDEST_BEARING / ROAD_STEPS[1]
    near = [(i * step, j * aside) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    counts = {True: 0, False: 0, 'differ': 0}
    for n, b in zip(nearness.tolist(), bearing.tolist()):
        found = shown(view, 1 / n, b / n)
        assert type(found) is bool
        counts[found] += 1
        if found is in_view(calibration, 1 / n, b / n):
            continue
        counts['differ'] += 1
        around = [in_view(calibration, 1 / (n + dn), (b + db) / (n + dn)) for dn, db in near if n + dn > 0]
        assert found in around, (n, b)
    assert counts[True] > 100
    assert counts[False] > 100
    assert counts['differ'] < 100


@pytest.mark.parametrize(
    'x, y, seen',
    [
        pytest.param(0.5, 0.0, True, id='ahead'),
        pytest.param(100.0, 0.0, True, id='very far'),
        pytest.param(0.0, 0.0, False, id='under the robot'),
        pytest.param(0.0, 0.3, False, id='beside the robot'),
        pytest.param(-0.5, 0.0, False, id='behind'),
        pytest.param(1 / NEAREST, 0.0, False, id='too near'),
        pytest.param(float(np.nextafter(1 / NEAREST, 1)), 0.0, False, id='nearly too near'),
        pytest.param(0.3, 0.3 * WIDEST_BEARING, False, id='too far left'),
        pytest.param(0.3, -0.3 * WIDEST_BEARING, False, id='too far right'),
        pytest.param(0.5, 1.0 * WIDEST_BEARING, False, id='twice as far left'),
        pytest.param(0.5, -1.0 * WIDEST_BEARING, False, id='twice as far right'),
        pytest.param(0.1, 9.0, False, id='very far left'),
        pytest.param(0.1, -9.0, False, id='very far right'),
    ],
)
def test_shown_wherever_it_is(x: float, y: float, seen: bool) -> None:
    assert shown(make_view(calibration_of(CAMERAS['level'])), x, y) is seen


def test_what_is_nearly_too_far_aside_is_looked_up_too() -> None:
    """At the very end of the table, where a slope is rounded up."""
    view = make_view(calibration_of(CAMERAS['level']))
    for x in np.random.RandomState(0).uniform(0.06, 3, 100).tolist():
        for side in (-1, 1):
            assert shown(view, x, side * float(np.nextafter(WIDEST_BEARING * x, 0))) is False
