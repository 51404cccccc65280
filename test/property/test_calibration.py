"""core.calibration: a file says what the camera is, in every format and at every picture size."""

import tempfile
from pathlib import Path

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from unit.cameras import Camera, calibration_of, extrinsic_file, load_camera

from obst_avoid.core.calibration import camera_position, camera_roll, scaled
from obst_avoid.core.geometry import ground_from_pixel, pixel_from_ground
from property.strategies import cameras, numbers


@given(
    camera=cameras,
    form=st.sampled_from(['flat', 'nested', 'resolution-independent']),
    factor=st.sampled_from([-3.0, 0.5, 1.0]),
)
def test_a_camera_survives_its_files(camera: Camera, form: str, factor: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        plain = load_camera(Path(folder), camera, form)
        nine = factor * np.ravel(extrinsic_file(camera, form)['homography'])
        again = load_camera(Path(folder), camera, form, extrinsic={'homography': nine.tolist()})
    for loaded in (plain, again):
        np.testing.assert_allclose(camera_position(loaded), camera.position, atol=1e-7)
        assert abs(np.degrees(camera_roll(loaded)) - camera.roll) < 1e-6


@given(camera=cameras, size=st.sampled_from([(320, 240), (160, 120), (800, 600), (1280, 960), (1296, 972)]))
def test_a_camera_of_another_picture_size_stands_at_the_same_place(camera: Camera, size: tuple) -> None:
    resized = scaled(calibration_of(camera), *size)
    assert (resized.width, resized.height) == size
    np.testing.assert_allclose(camera_position(resized), camera.position, atol=1e-7)
    back = scaled(resized, 640, 480)
    for name in ('camera_matrix', 'projection', 'homography'):
        np.testing.assert_allclose(getattr(back, name), getattr(calibration_of(camera), name), rtol=1e-7, atol=1e-9)


@given(
    camera=cameras,
    size=st.sampled_from([(320, 240), (800, 600), (1280, 960)]),
    share=st.tuples(numbers(0.05, 0.95), numbers(0.7, 0.95)),
)
def test_a_point_of_a_resized_picture_is_at_the_same_place(camera: Camera, size: tuple, share: tuple) -> None:
    # cv2.resize itself says which point of the original a pixel of the resized picture shows
    column, row = (int(part * length) for part, length in zip(share, size))
    original = calibration_of(camera)
    across = cv2.resize(np.arange(640, dtype=np.float32)[None], (size[0], 1), interpolation=cv2.INTER_LINEAR)[0, column]
    along = cv2.resize(np.arange(480, dtype=np.float32)[:, None], (1, size[1]), interpolation=cv2.INTER_LINEAR)[row, 0]
    here = ground_from_pixel(original.homography, np.array([[across, along]], dtype=np.float64))
    there = ground_from_pixel(scaled(original, *size).homography, np.array([[column, row]], dtype=np.float64))
    np.testing.assert_allclose(there, here, rtol=1e-4, atol=1e-4)


@given(camera=cameras, x=numbers(0.2, 3.0), y=numbers(-1.0, 1.0))
def test_the_road_and_its_picture_are_each_others_inverse(camera: Camera, x: float, y: float) -> None:
    homography = calibration_of(camera).homography
    ground = np.array([[x, y]])
    pixels = pixel_from_ground(homography, ground)
    np.testing.assert_allclose(pixels, camera.rectified_from_robot([[x, y, 0.0]]), atol=1e-5)
    np.testing.assert_allclose(ground_from_pixel(homography, pixels), ground, atol=1e-7)
