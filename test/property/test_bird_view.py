"""core.bird_view: metric whatever the camera."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from unit.cameras import Camera, calibration_of

from obst_avoid.core.bird_view import (
    BirdViewSettings,
    bird_from_ground,
    ground_from_bird,
    image_from_bird,
    make_bird_view,
)
from obst_avoid.core.calibration import horizon_row, scaled
from property.strategies import cameras, numbers

SETTINGS = BirdViewSettings(crop_distance=1.7, horizon_margin=0.021)
points = st.lists(st.tuples(numbers(0.2, 1.5), numbers(-0.6, 0.6)), min_size=1, max_size=5)


@given(camera=cameras, ground=points)
def test_road_and_bird_view_are_each_others_inverse(camera: Camera, ground: list) -> None:
    view = make_bird_view(calibration_of(camera), SETTINGS)
    bird = bird_from_ground(view, np.array(ground))
    np.testing.assert_allclose(ground_from_bird(view, bird), ground, atol=1e-9)


@given(camera=cameras, ground=points)
def test_bird_view_and_picture_agree_with_the_camera(camera: Camera, ground: list) -> None:
    view = make_bird_view(calibration_of(camera), SETTINGS)
    image = image_from_bird(view, bird_from_ground(view, np.array(ground)))
    seen = camera.image_from_robot(np.column_stack([ground, np.zeros(len(ground))]))
    inside = ((seen > 0) & (seen < (640, 480))).all(axis=1)
    # the corners of the warp are float32
    np.testing.assert_allclose(image[inside], seen[inside], atol=0.1)


@given(camera=cameras, places=st.tuples(*[st.tuples(numbers(0.2, 1.5), numbers(-0.6, 0.6))] * 2))
def test_distances_on_the_road_are_distances_in_the_bird_view(camera: Camera, places: tuple) -> None:
    view = make_bird_view(calibration_of(camera), SETTINGS)
    first, second = bird_from_ground(view, np.array(places))
    expected = np.hypot(*np.subtract(*places)) * view.pixels_per_metre
    np.testing.assert_allclose(np.linalg.norm(first - second), expected, atol=1e-6)


@given(camera=cameras, size=st.sampled_from([(320, 240), (640, 480), (800, 600)]))
def test_every_camera_has_a_usable_bird_view(camera: Camera, size: tuple) -> None:
    calibration = scaled(calibration_of(camera), *size)
    view = make_bird_view(calibration, SETTINGS)
    assert view.width == 640 and 0 < view.height < 4000
    assert view.map_u.shape == view.map_v.shape == (size[1] - view.crop_row, size[0])
    assert view.pixels_per_metre > 60
    lowest = max(horizon_row(calibration.homography, u) for u in (0, size[0] - 1))
    assert view.crop_row >= lowest + SETTINGS.horizon_margin * size[1] or view.crop_row == 0
