"""core.detection.paper.color: the linear colour correction and the colour filters."""

import cv2
import numpy as np
import pytest

from obst_avoid.core.detection.paper.color import correct, estimate_correction, in_color
from obst_avoid.core.detection.paper.settings import ColorRange
from obst_avoid.core.detection.settings import DetectionSettings
from unit import drawn


def ramps(low: tuple, high: tuple) -> np.ndarray:
    """A picture whose channels B, G, R run evenly between two limits, without their first and last hundredth."""
    share = np.linspace(0, 1, 256)[:, None]
    lines = np.clip(np.array(low) + (share * 1.0204 - 0.0102) * (np.array(high) - np.array(low)), 0, 255)
    return np.broadcast_to(np.rint(lines).astype(np.uint8), (128, 256, 3)).copy()


@pytest.mark.parametrize('grey', [0, 128, 255])
def test_a_flat_picture_says_nothing_about_its_light(grey: int) -> None:
    assert estimate_correction(np.full((48, 64, 3), grey, np.uint8), 4.0) is None


def test_a_picture_of_little_contrast_gives_no_correction() -> None:
    assert estimate_correction(ramps((100,) * 3, (125,) * 3), 4.0) is None
    assert estimate_correction(ramps((100,) * 3, (160,) * 3), 4.0) is not None


def test_without_a_correction_the_picture_stays_the_same_object() -> None:
    picture = np.zeros((4, 4, 3), np.uint8)
    assert correct(picture, None) is picture


def test_each_channel_is_stretched_from_black_to_white() -> None:
    picture = ramps((40, 60, 80), (200, 160, 240))
    corrected = correct(picture, estimate_correction(picture, 4.0))
    assert corrected.dtype == np.uint8 and corrected.shape == picture.shape
    for channel in range(3):
        values = corrected[:, :, channel]
        np.testing.assert_allclose(np.percentile(values, [1, 50, 99]), [0, 127.5, 255], atol=4)


def test_the_correction_is_linear() -> None:
    picture = ramps((50,) * 3, (177,) * 3)
    correction = estimate_correction(picture, 4.0)
    assert correction is not None
    table = correction.table[0, :, 0].astype(int)
    inside = np.arange(60, 170)
    np.testing.assert_allclose(table[inside], (inside - 50) * 255 / 127, atol=3)
    assert table[40] == 0 and table[190] == 255


def test_a_tint_is_taken_out() -> None:
    tinted = ramps((20, 10, 60), (120, 200, 250))  # reddish light, little blue
    corrected = correct(tinted, estimate_correction(tinted, 4.0)).astype(int)
    assert np.abs(corrected - corrected.mean(axis=2, keepdims=True)).max() <= 4, 'what was grey is grey again'


def test_the_gain_is_limited() -> None:
    picture = ramps((10,) * 3, (50,) * 3)  # 255 / 40 = 6.4 would be needed
    limited = correct(picture, estimate_correction(picture, 4.0))
    assert int(limited.max()) == pytest.approx(4.0 * 40, abs=6)
    assert int(correct(picture, estimate_correction(picture, 1.0)).max()) == pytest.approx(40, abs=2)


def test_a_lamp_or_a_speck_does_not_count() -> None:
    picture = ramps((40,) * 3, (140,) * 3)
    spoilt = picture.copy()
    spoilt[0:4, 0:4], spoilt[4:8, 0:4] = 255, 0
    plain, corrected = (correct(picture, estimate_correction(image, 4.0)).astype(int) for image in (picture, spoilt))
    assert np.abs(plain - corrected).max() <= 6


HUE_SAT_VALUE = [
    pytest.param('yellow', (25, 200, 220), True, id='duckie yellow'),
    pytest.param('yellow', (15, 100, 200), True, id='the lower corner of yellow'),
    pytest.param('yellow', (35, 255, 255), True, id='the upper corner of yellow'),
    pytest.param('yellow', (14, 200, 220), False, id='too red for yellow'),
    pytest.param('yellow', (36, 200, 220), False, id='too green for yellow'),
    pytest.param('yellow', (25, 99, 220), False, id='too pale for yellow'),
    pytest.param('yellow', (25, 200, 199), False, id='too dark for yellow'),
    pytest.param('orange', (8, 220, 240), True, id='cone orange'),
    pytest.param('orange', (175, 220, 240), False, id='red beyond the wrap, as in 2018'),
    pytest.param('white', (60, 10, 230), True, id='white paint'),
    pytest.param('white', (60, 10, 149), False, id='grey asphalt'),
    pytest.param('white', (25, 60, 240), False, id='pale yellow'),
]


@pytest.mark.parametrize('name, pixel, inside', HUE_SAT_VALUE)
def test_the_shipped_filters(detection_settings: DetectionSettings, name: str, pixel: tuple, inside: bool) -> None:
    color: ColorRange = getattr(detection_settings.paper, name)
    assert in_color(np.array([[pixel]], np.uint8), color).tolist() == [[255 if inside else 0]]


def test_the_colours_of_the_drawn_things_pass_their_filters(detection_settings: DetectionSettings) -> None:
    paper = detection_settings.paper
    colors = np.array([[drawn.DUCK, drawn.CONE, drawn.WHITE, drawn.YELLOW, drawn.ASPHALT]], np.uint8)
    hsv = cv2.cvtColor(colors, cv2.COLOR_BGR2HSV)
    masks = [in_color(hsv, color)[0] > 0 for color in (paper.yellow, paper.orange, paper.white)]
    np.testing.assert_array_equal(masks, [[1, 0, 0, 1, 0], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0]])
