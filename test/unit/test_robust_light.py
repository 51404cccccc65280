"""core.detection.robust.light: what asphalt looks like now, and everything relative to it."""

from typing import Tuple

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.light import (
    BRIGHTER,
    DARKER,
    DARKEST,
    FASTEST,
    FIRST_ROW,
    LAST_ROW,
    LINEAR,
    LONGEST,
    ROWS,
    Light,
    estimate_light,
    followed,
)
from unit import drawn
from unit.scenes import cone, duckie, picture_of

ASPHALT = (62, 60, 57)
"""Pixel values of B, G, R."""


def flat(color: Tuple[int, int, int], height: int = 480, width: int = 640) -> np.ndarray:
    """A picture of one colour."""
    return np.full((height, width, 3), color, dtype=np.uint8)


def level(light: float) -> float:
    """The pixel value of a light, the inverse of LINEAR."""
    return 256 * light ** (1 / 2.2) - 1


def test_light_grows_with_the_pixel_value_from_nearly_nothing_to_one() -> None:
    assert LINEAR.shape == (256,)
    assert LINEAR.dtype == np.float32
    assert (np.diff(LINEAR) > 0).all()
    assert 0 < LINEAR[0] < 1e-4
    assert LINEAR[255] == 1.0
    assert LINEAR[127] == pytest.approx(0.5**2.2)


@pytest.mark.parametrize('color', [ASPHALT, (128, 128, 128), (255, 255, 255), (200, 90, 30)])
def test_a_flat_picture_gives_its_own_colour(color: Tuple[int, int, int]) -> None:
    assert estimate_light(flat(color)).road == pytest.approx([LINEAR[value] for value in color])


def test_darkness_is_limited_so_that_ratios_stay_finite() -> None:
    assert estimate_light(flat((0, 0, 0))).road == pytest.approx([DARKEST**2.2] * 3)
    assert estimate_light(flat((0, 60, 0))).road == pytest.approx([DARKEST**2.2, LINEAR[60], DARKEST**2.2])
    assert 0 < LINEAR[0] / DARKEST**2.2 < 1


@pytest.mark.parametrize('size', [(24, 32), (240, 320), (480, 640), (960, 1280)], ids='%dx%d'.__mod__)
def test_asphalt_is_found_among_paint_things_and_shadows(calibration: Calibration, size: Tuple[int, int]) -> None:
    height, width = size
    picture = flat(ASPHALT, height, width)
    picture[: height // 2] = (10, 200, 240)  # above the road's part: a wall
    picture[:, : width // 5] = (240, 240, 240)  # paint, a fifth
    picture[:, -width // 10 :] = (5, 5, 5)  # a shadow, a tenth
    assert estimate_light(picture).road == pytest.approx([LINEAR[value] for value in ASPHALT], rel=1e-6)


def test_the_drawn_roads_asphalt_is_found_with_things_on_it(calibration: Calibration) -> None:
    for things in ((), (duckie(0.3, 0.0), cone(0.4, -0.1), duckie(0.35, 0.1))):
        light = estimate_light(picture_of(calibration, things))
        assert [level(value) for value in light.road] == pytest.approx(drawn.ASPHALT, abs=2)


def test_only_the_roads_rows_count() -> None:
    picture = np.random.RandomState(0).randint(0, 256, (480, 640, 3)).astype(np.uint8)
    expected = estimate_light(picture)
    picture[: int(FIRST_ROW * 480)] = 255
    picture[int(LAST_ROW * 480) + 1 :] = 255
    assert estimate_light(picture) == expected
    picture[int(FIRST_ROW * 480) : int(LAST_ROW * 480) + 1] = 255
    assert estimate_light(picture) != expected


def test_what_is_darker_and_brighter_than_the_percentiles_does_not_count() -> None:
    picture = flat(ASPHALT)
    dark, bright = int(640 * (DARKER - 3) / 100), int(640 * (100 - BRIGHTER - 3) / 100)
    picture[:, :dark] = (0, 0, 0)
    picture[:, -bright:] = (0, 180, 250)
    assert estimate_light(picture).road == pytest.approx([LINEAR[value] for value in ASPHALT], rel=1e-6)


@pytest.mark.parametrize('gains', [(1.0, 1.0, 1.0), (0.4, 0.4, 0.4), (1.6, 1.0, 0.6), (0.5, 0.9, 1.8)])
def test_ratios_do_not_depend_on_the_lights_colour_and_strength(gains: Tuple[float, float, float]) -> None:
    reflecting = np.array([(0.06, 0.06, 0.06), (0.07, 0.25, 0.3), (0.02, 0.06, 0.28), (0.4, 0.4, 0.4)])
    picture = flat((0, 0, 0))
    expected = reflecting / reflecting[0]
    for index, color in enumerate(reflecting):
        patch = slice(200 * index - 200, 200 * index - 100) if index else slice(None)
        values = np.rint(256 * (color * gains) ** (1 / 2.2) - 1)
        picture[:, patch] = np.clip(values, 0, 255)
    seen = LINEAR[picture] / estimate_light(picture).as_array()
    for index, ratio in enumerate(expected):
        column = 200 * index - 150 if index else 620
        np.testing.assert_allclose(seen[300, column], ratio, rtol=0.12)  # pixel values are whole


def test_without_a_picture_before_the_light_is_what_is_seen() -> None:
    seen = Light((0.1, 0.2, 0.3))
    assert followed(None, seen, 0.1) == seen


def test_a_slow_change_is_followed_at_once() -> None:
    before, seen = Light((0.1, 0.2, 0.3)), Light((0.105, 0.19, 0.31))
    assert followed(before, seen, 0.1) == seen


@pytest.mark.parametrize('seconds', [0.033, 0.1, 1.0])
@pytest.mark.parametrize('factor', [100.0, 0.01])
def test_a_jump_is_followed_by_at_most_its_factor_a_second(seconds: float, factor: float) -> None:
    before = Light((0.1, 0.1, 0.1))
    after = followed(before, Light((0.1 * factor, 0.1, 0.1)), seconds)
    limit = FASTEST**seconds if factor > 1 else FASTEST**-seconds
    assert after.road == pytest.approx((0.1 * limit, 0.1, 0.1))


def test_no_time_and_time_backwards_change_nothing() -> None:
    before = Light((0.1, 0.2, 0.3))
    for seconds in (0.0, -5.0):
        assert followed(before, Light((0.9, 0.001, 0.5)), seconds).road == pytest.approx(before.road)


@pytest.mark.parametrize('seconds', [LONGEST + 0.1, 1100.0, 1e9])
def test_after_a_long_gap_the_light_before_says_nothing(seconds: float) -> None:
    seen = Light((0.9, 0.001, 0.5))
    for before in (Light((1e-4, 1e-4, 1e-4)), Light((1.0, 1.0, 1.0))):
        assert followed(before, seen, seconds) == seen


@pytest.mark.parametrize('size', [(1, 1), (2, 1), (1, 2), (4, 3), (8, 6), (12, 9), (20, 15)], ids='%dx%d'.__mod__)
def test_a_picture_of_a_few_pixels_has_a_light_too(size: Tuple[int, int]) -> None:
    picture = np.random.RandomState(1).randint(30, 256, (size[1], size[0], 3)).astype(np.uint8)
    for channel, value in enumerate(estimate_light(picture).road):
        assert value in LINEAR[picture[..., channel]], 'one of its own'


@pytest.mark.parametrize('times', [2, 4, 8, 16])
def test_a_larger_picture_of_the_same_has_the_same_light(times: int) -> None:
    picture = np.random.RandomState(times).randint(0, 256, (ROWS, 80, 3)).astype(np.uint8)
    larger = picture.repeat(times, axis=0).repeat(times, axis=1)
    assert estimate_light(larger) == estimate_light(picture)


def test_few_pixels_of_a_large_picture_are_looked_at() -> None:
    """Of 480 rows ROWS, and as many columns: a light costs little."""
    picture = np.random.RandomState(0).randint(0, 256, (480, 640, 3)).astype(np.uint8)
    few = np.full_like(picture, 255)
    every = 480 // ROWS
    few[::every, ::every] = picture[::every, ::every]
    assert estimate_light(few) == estimate_light(picture)
    few[::every, ::every] = 255
    assert estimate_light(few) != estimate_light(picture)


def wanted(picture: np.ndarray) -> np.ndarray:
    """(3,) pixel values, written down anew: the median of what lies between the percentiles of brightness."""
    height = len(picture)
    part = picture[int(FIRST_ROW * height) : int(LAST_ROW * height) + 1].reshape(-1, 3)
    brightness = LINEAR[part].sum(axis=1)
    low, high = np.percentile(brightness, (DARKER, BRIGHTER))
    median: np.ndarray = np.median(part[(brightness >= low) & (brightness <= high)], axis=0)
    return median


def test_the_light_is_the_median_between_the_percentiles(calibration: Calibration) -> None:
    """Of asphalt that fades, blotches of all colours, and the drawn road; not each pixel is looked at."""
    fading = np.zeros((480, 640, 3), np.uint8)
    fading[...] = np.linspace(20, 250, 640).astype(np.uint8)[None, :, None]
    noise = np.random.RandomState(3).randint(0, 256, (480, 640, 3)).astype(np.uint8)
    drawn_road = picture_of(calibration, (duckie(0.3, 0.0), cone(0.4, -0.1)))
    for picture, within in ((fading, 4), (noise, 6), (drawn_road, 1)):
        found = [level(value) for value in estimate_light(picture).road]
        assert found == pytest.approx(list(wanted(picture)), abs=within)
