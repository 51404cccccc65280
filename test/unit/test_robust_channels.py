"""core.detection.robust.channels: logarithms of light, heights, their integral image, paint opened, bands closed."""

import math
from dataclasses import replace
from typing import Any, Callable, Dict, List, Sequence, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.detection.robust.channels import (
    BLUE_LEVELS,
    BLUELESS,
    BRIGHT,
    BRIGHT_LEVELS,
    CHANNELS,
    COLORS,
    DARK,
    DARK_LEVELS,
    DIRECTIONS,
    FAINT,
    GREEN_LEVELS,
    JOINED,
    RANGE,
    RED,
    SUMS,
    UNIT,
    WIDE,
    YELLOW,
    YELLOW_LEVELS,
    Channels,
    channels_of,
    joined,
    opened,
    tables_of,
)
from obst_avoid.core.detection.robust.light import LINEAR, Light
from obst_avoid.core.detection.robust.view import BAND, TAPE, View, make_view
from unit.cameras import Camera, calibration_of

Color = Tuple[float, float, float]
Morphology = Callable[[np.ndarray, np.ndarray, np.ndarray], None]
ASPHALT = 60
"""Its pixel value, unless said otherwise."""
LIGHT = Light((float(LINEAR[ASPHALT]),) * 3)
LIGHTS = [
    (0.042, 0.042, 0.042),
    (0.3, 0.25, 0.2),
    (0.002, 0.004, 0.006),
    (0.8, 0.9, 1.0),
]
"""Linear light of asphalt in B, G, R: indoors, warm, dark and warmer still, in the sun."""
DUCKIE, ORANGE, WHITE = (0.3, 4.0, 5.0), (0.3, 0.8, 4.0), (6.0, 6.0, 6.0)
"""Light of a duckie, of a cone and of its band, asphalt's being 1."""


@pytest.fixture(scope='module')
def view() -> View:
    """Of a camera without roll or yaw."""
    return make_view(calibration_of(Camera()))


def whole(view: View, rows: int, columns: int) -> View:
    """A view of another size, from its first row down, that opens and closes nothing."""
    bands = np.array([[0, rows, 1]], dtype=np.int32)
    return replace(view, width=columns, height=rows, top=0, foot=0, opening=bands, closing=bands)


def pixel(light: Color) -> Tuple[int, ...]:
    """The pixel value that so much light, asphalt's being 1, has in LIGHT."""
    return tuple(int(value) for value in np.rint(256 * (np.array(light) * LIGHT.road) ** (1 / 2.2) - 1).clip(0, 255))


def road(view: View, *patches: Tuple[Tuple[int, int, int, int], Color]) -> np.ndarray:
    """A working picture of asphalt with boxes, left, top, width, height, of so much light."""
    picture = np.full((view.height, view.width, 3), ASPHALT, np.uint8)
    for (left, top, width, height), light in patches:
        picture[top : top + height, left : left + width] = pixel(light)
    return picture


def noise(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    """A picture of nothing else."""
    return np.random.RandomState(seed).randint(0, 256, (rows, columns, 3)).astype(np.uint8)


def planes_of(channels: Channels) -> np.ndarray:
    """(R, W, SUMS): what the integral image is of."""
    return np.diff(np.diff(channels.sums.astype(np.int64), axis=0), axis=1)


def ratios(picture: np.ndarray, light: Light) -> List[np.ndarray]:
    """Blue, green and red light, asphalt's being 1, with what is added to it, as far as logarithms reach."""
    linear = ((picture.astype(float) + 1) / 256) ** 2.2
    most = 2.0 ** (RANGE / 2 / UNIT)
    return [np.clip(linear[..., i] / light.road[i] + FAINT, 1 / most, most) for i in range(3)]


# Logarithms


@pytest.mark.parametrize('asphalt', LIGHTS)
def test_logarithms_are_of_light_against_asphalts(asphalt: Color) -> None:
    logarithms = tables_of(Light(asphalt)).logarithms
    assert logarithms.shape == (3, 256)
    assert logarithms.dtype == np.int16
    for i in range(3):
        for value in range(256):
            expected = 64 * math.log2(((value + 1) / 256) ** 2.2 / asphalt[i] + 0.02)
            assert logarithms[i, value] == pytest.approx(min(max(expected, -512), 511), abs=0.51), (i, value)


def test_logarithms_end_before_their_differences_leave_the_tables() -> None:
    logarithms = tables_of(Light((1e-5, 1e-5, 1e-5))).logarithms
    assert logarithms.max() == RANGE // 2 - 1
    assert int(logarithms.max()) - (-RANGE // 2) < RANGE
    assert tables_of(Light((1.0, 1.0, 1.0))).logarithms.min() == round(UNIT * math.log2(FAINT + 256**-2.2))


def test_the_logarithm_of_what_red_and_green_are_more_than_blue() -> None:
    less = tables_of(LIGHT).less
    for step in range(-RANGE, 0):
        assert less[step + RANGE] == pytest.approx(64 * math.log2(1 - 2.0 ** (step / 64)), abs=0.51)
    assert (less[RANGE:] + RANGE // 2 < -RANGE).all(), 'and of no more, whatever the light, is below all levels'


def test_levels_are_counted_by_logarithms() -> None:
    tables = tables_of(LIGHT)
    assert tables.steps.shape == (3, 2 * RANGE)
    for step in range(-RANGE, RANGE):
        ratio = 2.0 ** (step / 64)
        assert tables.steps[0, step + RANGE] == sum(ratio > level for level in YELLOW_LEVELS)
        assert tables.steps[1, step + RANGE] == sum(ratio < level for level in GREEN_LEVELS)
        assert tables.steps[2, step + RANGE] == sum(ratio < level for level in BLUE_LEVELS)


@pytest.mark.parametrize('asphalt', LIGHTS)
def test_levels_of_brightness_and_darkness_are_counted_by_the_pixels_green(asphalt: Color) -> None:
    light = tables_of(Light(asphalt)).light
    assert light.shape == (2, 256)
    slack = 2 ** (0.6 / UNIT)
    for value in range(256):
        green = ((value + 1) / 256) ** 2.2 / asphalt[1]
        found, seen = light[:, value], min(green + FAINT, 2.0 ** (RANGE / 2 / UNIT))
        assert (BRIGHT_LEVELS * slack < seen).sum() <= found[0] <= (BRIGHT_LEVELS / slack < seen).sum()
        most, least = (1 / np.maximum((green + FAINT) * factor - FAINT, 1e-9) for factor in (1 / slack, slack))
        assert (DARK_LEVELS < least).sum() <= found[1] <= (DARK_LEVELS < most).sum()


def test_levels_rise_for_light_and_fall_for_ratios() -> None:
    for levels in (YELLOW_LEVELS, BRIGHT_LEVELS, DARK_LEVELS):
        assert (np.diff(levels) > 0).all()
        steps = np.diff(np.log(levels))
        assert steps == pytest.approx(np.full(len(steps), steps[0]))
    for levels in (GREEN_LEVELS, BLUE_LEVELS):
        assert (np.diff(levels) < 0).all()


# Heights


def bounds(picture: np.ndarray, light: Light, slack: float) -> Dict[int, List[np.ndarray]]:
    """Fewest and most levels that each pixel reaches in each channel, if its logarithms are so many steps off."""
    blue, green, red = ratios(picture, light)
    both = np.sqrt(green * red)
    off = 2 ** (slack / UNIT)

    def above(values: np.ndarray, levels: np.ndarray) -> np.ndarray:
        return (values[..., None] > levels).sum(axis=-1)

    found: Dict[int, List[np.ndarray]] = {YELLOW: [], RED: [], BLUELESS: [], BRIGHT: [], DARK: []}
    for factor in (1 / off, off):
        found[YELLOW].append(above(factor * (both - blue / factor), YELLOW_LEVELS))
        found[RED].append(above(red / green * factor, 1 / GREEN_LEVELS))
        found[BLUELESS].append(above(both / blue * factor, 1 / BLUE_LEVELS))
        found[BRIGHT].append(above(green * factor, BRIGHT_LEVELS))
        found[DARK].append(above(1 / np.maximum(green / factor - FAINT, 1e-9), DARK_LEVELS))
    return found


@pytest.mark.parametrize('asphalt', LIGHTS)
def test_any_colour_is_as_high_as_the_levels_that_it_passes(view: View, asphalt: Color) -> None:
    """To the steps that logarithms are counted in."""
    picture, light = noise(40, 100), Light(asphalt)
    heights = channels_of(picture, light, whole(view, 40, 100)).heights
    bound, exact = bounds(picture, light, 2.0), bounds(picture, light, 0.0)
    for channel, (least, most) in bound.items():
        assert (heights[channel] >= least).all(), channel
        assert (heights[channel] <= most).all(), channel
        assert (heights[channel] == exact[channel][0]).mean() > 0.93, channel
        if asphalt == LIGHTS[0]:
            assert heights[channel].max() > 5, channel


@pytest.mark.parametrize(
    'color, channels',
    [
        pytest.param(DUCKIE, {YELLOW, BLUELESS, WIDE, BRIGHT}, id='a duckie'),
        pytest.param(ORANGE, {YELLOW, RED, BLUELESS, WIDE, JOINED}, id='a cone'),
        pytest.param((0.05, 0.15, 0.2), {BLUELESS, DARK}, id='a duckie in the dark'),
        pytest.param((6.0, 6.0, 3.0), {BRIGHT}, id='a duckie in blue and green light'),
        pytest.param((5.0, 5.0, 0.9), {BRIGHT}, id='cyan'),
        pytest.param(WHITE, {BRIGHT}, id='white'),
        pytest.param((0.2, 0.2, 0.2), {DARK}, id='a shadow'),
        pytest.param((0.05, 0.05, 0.05), {DARK}, id='the underside of a cone'),
        pytest.param((0.9, 0.9, 0.9), set(), id='hardly a shadow'),
        pytest.param((2.0, 2.0, 2.0), set(), id='hardly bright'),
        pytest.param((4.0, 1.0, 0.9), set(), id='blue'),
    ],
)
def test_each_channel_sees_its_colour(view: View, color: Color, channels: set) -> None:
    heights = channels_of(road(view, ((120, 100, 40, 40), color)), LIGHT, view).heights
    inside = heights[:, 100 - view.top : 140 - view.top, 120:160]
    assert {channel for channel in range(CHANNELS) if inside[channel].min() > 0} == channels
    assert {channel for channel in range(CHANNELS) if heights[channel].max() > 0} == channels


@pytest.mark.parametrize('gains', [(0.5, 0.5, 0.5), (0.4, 0.8, 1.0), (1.0, 0.8, 0.45), (3.0, 3.0, 3.0)])
def test_another_light_changes_nothing(view: View, gains: Color) -> None:
    """A factor a channel, where nothing is clipped: to what pixel values round."""
    colors = [(1.0, 1.0, 1.0), DUCKIE, ORANGE, WHITE, (0.3, 0.3, 0.3), (1.5, 0.8, 1.1)]
    seen = []
    for factors in ((1.0, 1.0, 1.0), gains):
        light = Light(tuple(0.04 * factor for factor in factors))
        linear = np.array(colors) * light.road
        picture = np.rint(256 * linear ** (1 / 2.2) - 1).astype(np.uint8)[None].repeat(3, axis=0)
        assert 1 < picture.min() <= picture.max() < 255
        seen.append(channels_of(picture, light, whole(view, 3, len(colors))))
    assert np.abs(seen[0].heights.astype(int) - seen[1].heights).max() <= 1
    difference = (planes_of(seen[0]) - planes_of(seen[1]))[..., : len(COLORS)]
    assert np.abs(difference).max() < 0.2 * UNIT


def test_rows_above_the_view_have_no_say(view: View) -> None:
    picture = noise(view.height, view.width)
    channels = channels_of(picture, LIGHT, view)
    assert 0 < view.top
    assert channels.heights.shape == (CHANNELS, view.height - view.top, view.width)
    assert channels.heights.dtype == np.uint8
    assert channels.sums.shape == (view.height - view.top + 1, view.width + 1, SUMS)
    assert channels.sums.dtype == np.int32
    picture[: view.top] = 7
    other = channels_of(picture, LIGHT, view)
    np.testing.assert_array_equal(other.heights, channels.heights)
    np.testing.assert_array_equal(other.sums, channels.sums)


@pytest.mark.parametrize('rows, columns', [(1, 1), (1, 9), (9, 1), (2, 3)])
def test_the_smallest_pictures_have_channels(view: View, rows: int, columns: int) -> None:
    channels = channels_of(noise(rows, columns), LIGHT, whole(view, rows, columns))
    assert channels.heights.shape == (CHANNELS, rows, columns)
    assert channels.sums.shape == (rows + 1, columns + 1, SUMS)


# Sums


def test_sums_are_an_integral_image_of_the_three_colours(view: View) -> None:
    picture = noise(30, 50)
    channels = channels_of(picture, Light(LIGHTS[1]), whole(view, 30, 50))
    assert not channels.sums[0].any()
    assert not channels.sums[:, 0].any()
    planes = planes_of(channels)
    assert planes[:17, :23].sum(axis=(0, 1)).tolist() == channels.sums[17, 23].tolist()
    blue, green, red = (np.log2(ratio) for ratio in ratios(picture, Light(LIGHTS[1])))
    assert COLORS == ('brightness', 'green', 'blue')
    for index, expected in enumerate(((green + red) / 2, green - red, blue - (green + red) / 2)):
        assert np.abs(planes[..., index] - UNIT * expected).max() <= 2, COLORS[index]
        assert np.abs(planes[..., index] - UNIT * expected).mean() < 0.6, COLORS[index]
    assert not planes[..., SUMS - 1].any()


def test_the_brightness_of_a_pixel_is_the_mean_of_its_two_logarithms_rounded_down(view: View) -> None:
    picture = noise(30, 50, 1)
    planes = planes_of(channels_of(picture, LIGHT, whole(view, 30, 50)))
    blue, green, red = (tables_of(LIGHT).logarithms[i][picture[..., i]].astype(int) for i in range(3))
    np.testing.assert_array_equal(planes[..., 0], np.floor((green + red) / 2))
    np.testing.assert_array_equal(planes[..., 1], green - red)
    np.testing.assert_array_equal(planes[..., 2], blue - planes[..., 0])


# Edges


def edges_of(view: View, picture: np.ndarray) -> np.ndarray:
    """(R, W, DIRECTIONS): strengths."""
    rows, columns = picture.shape[:2]
    return planes_of(channels_of(picture, LIGHT, whole(view, rows, columns)))[..., 3 : 3 + DIRECTIONS]


def test_edges_are_what_sobel_says_parted_into_an_axis_and_a_diagonal(view: View) -> None:
    """A slope is so much along the nearest axis and so much along the nearest diagonal (0.6 % less, rounded down)."""
    picture = noise(40, 60, 2)
    planes = planes_of(channels_of(picture, LIGHT, whole(view, 40, 60)))
    bright = planes[..., 0].astype(float)
    across, down = (
        cv2.Sobel(bright, cv2.CV_64F, *way, ksize=3, borderType=cv2.BORDER_REPLICATE) for way in ((1, 0), (0, 1))
    )
    most, least = np.maximum(np.abs(across), np.abs(down)), np.minimum(np.abs(across), np.abs(down))
    flat, rising = np.abs(across) >= np.abs(down), across * down > 0
    straight, slanting = planes[..., 3] + planes[..., 5], planes[..., 4] + planes[..., 6]
    np.testing.assert_array_equal(straight, most - least)
    assert (slanting <= math.sqrt(2) * least).all()
    assert (slanting >= 0.994 * math.sqrt(2) * least - 2.6).all()
    assert not planes[..., 5][flat].any()
    assert not planes[..., 3][~flat].any()
    assert not planes[..., 6][rising].any()
    assert not planes[..., 4][across * down < 0].any()
    for direction in range(DIRECTIONS):
        assert (planes[..., 3 + direction] > 0).mean() > 0.1


@pytest.mark.parametrize('up', [True, False], ids=['up', 'down'])
@pytest.mark.parametrize(
    'u, v, direction',
    [
        pytest.param(1, 0, 0, id='across'),
        pytest.param(1, 1, 1, id='to the lower right'),
        pytest.param(0, 1, 2, id='down'),
        pytest.param(-1, 1, 3, id='to the lower left'),
    ],
)
def test_a_step_has_one_direction(view: View, u: int, v: int, direction: int, up: bool) -> None:
    rows, columns = np.mgrid[-15:15, -15:15]
    beyond = (u * columns + v * rows > 0) == up
    picture = np.where(beyond[..., None], 120, ASPHALT).astype(np.uint8).repeat(3, axis=2)
    strength = edges_of(view, picture)[3:-3, 3:-3].sum(axis=(0, 1))
    assert [index for index in range(DIRECTIONS) if strength[index]] == [direction]


def test_a_step_is_as_strong_as_it_is_high(view: View) -> None:
    """Octaves over 8 pixels: each row of a step adds 8 times its height."""
    picture = np.full((20, 30, 3), ASPHALT, np.uint8)
    picture[:, 15:] = 140
    bright = planes_of(channels_of(picture, LIGHT, whole(view, 20, 30)))[0, :, 0]
    height = bright[-1] - bright[0]
    assert height == pytest.approx(UNIT * 2.2 * math.log2(141 / 61), abs=3)
    for turned in (False, True):
        edges = edges_of(view, picture.transpose(1, 0, 2).copy() if turned else picture)
        assert (edges[..., 2 if turned else 0].sum(axis=0 if turned else 1) == 8 * height).all()
        assert edges.sum() == 8 * 20 * height


def test_what_is_flat_has_no_edges_at_its_ends_either(view: View) -> None:
    for value in (0, ASPHALT, 255):
        assert not edges_of(view, np.full((9, 12, 3), value, np.uint8)).any()


def test_a_mirrored_picture_has_mirrored_edges(view: View) -> None:
    """What rises to the right and down rises to the left and down there."""
    picture = noise(30, 40, 3)
    edges = edges_of(view, picture)
    for mirrored in (np.s_[:, ::-1], np.s_[::-1]):
        found = edges_of(view, np.ascontiguousarray(picture[mirrored]))
        np.testing.assert_array_equal(found, edges[mirrored][..., [0, 3, 2, 1]])


def test_a_transposed_picture_has_transposed_edges(view: View) -> None:
    picture = noise(30, 40, 4)
    found = edges_of(view, np.ascontiguousarray(picture.transpose(1, 0, 2)))
    np.testing.assert_array_equal(found, edges_of(view, picture).transpose(1, 0, 2)[..., [2, 1, 0, 3]])


# Paint, and a cone's white band


def slid(values: np.ndarray, reach: Tuple[int, int], function: Callable[[np.ndarray], Any]) -> np.ndarray:
    """Least or most of each value and its neighbours, so far up and down and to both sides; by definition."""
    result = np.empty_like(values)
    for v in range(values.shape[0]):
        for u in range(values.shape[1]):
            part = values[max(v - reach[0], 0) : v + reach[0] + 1, max(u - reach[1], 0) : u + reach[1] + 1]
            result[v, u] = function(part)
    return result


def bands_of(pixels: Sequence[int], rows: int) -> np.ndarray:
    """Bands about as tall as each other."""
    ends = np.linspace(0, rows, len(pixels) + 1).astype(int)
    return np.array([ends[:-1], ends[1:], pixels], dtype=np.int32).T.copy()


ODD = [(1,), (3,), (5,), (1, 3, 7), (7, 3), (9, 1, 1), (31,)]
"""Pixels of bands: growing, shrinking, and more than the picture has."""


@pytest.mark.parametrize('pixels', ODD, ids=str)
def test_opening_is_the_most_of_the_least(pixels: Tuple[int, ...]) -> None:
    """What is outside the picture does not count."""
    for seed in range(3):
        height = np.random.RandomState(seed).randint(0, 10, (17, 14)).astype(np.uint8)
        bands = bands_of(pixels, 17)
        found = np.full_like(height, 99)
        opened(height, bands, found)
        for first, past, size in bands.tolist():
            reach = size // 2, size // 2
            expected = slid(slid(height, reach, np.min), reach, np.max)
            np.testing.assert_array_equal(found[first:past], expected[first:past])


@pytest.mark.parametrize('pixels', ODD, ids=str)
def test_closing_is_the_least_of_the_most_up_and_down(pixels: Tuple[int, ...]) -> None:
    """Outside the picture there is nothing: things do not grow to an edge that is near."""
    for seed in range(3):
        height = np.random.RandomState(seed).randint(0, 10, (17, 14)).astype(np.uint8)
        bands = bands_of(pixels, 17)
        found = np.full_like(height, 99)
        joined(height, bands, found)
        padded = np.pad(height, ((80, 80), (0, 0)))
        for first, past, size in bands.tolist():
            reach = size // 2, 0
            expected = slid(slid(padded, reach, np.max), reach, np.min)[80:-80]
            np.testing.assert_array_equal(found[first:past], expected[first:past])


def test_wide_is_yellow_opened_and_joined_is_red_closed(view: View) -> None:
    blurred = cv2.normalize(cv2.GaussianBlur(noise(view.height, view.width), (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)
    heights = channels_of(blurred, LIGHT, view).heights
    for channel, function, bands, result in (
        (YELLOW, opened, view.opening, WIDE),
        (RED, joined, view.closing, JOINED),
    ):
        expected = np.empty_like(heights[channel])
        function(heights[channel], bands, expected)
        np.testing.assert_array_equal(heights[result], expected)
        assert (expected != heights[channel]).mean() > 0.1


def level(view: View) -> np.ndarray:
    """Nothing anywhere."""
    return np.zeros((view.height - view.top, view.width), np.uint8)


def morphed(function: Morphology, height: np.ndarray, bands: np.ndarray) -> np.ndarray:
    result = np.full_like(height, 99)
    function(height, bands, result)
    return result


def test_what_is_flat_stays_flat(view: View) -> None:
    for value in (0, 7):
        height = level(view) + np.uint8(value)
        assert (morphed(opened, height, view.opening) == value).all()
    assert (morphed(joined, level(view), view.closing) == 0).all()
    assert (morphed(joined, level(view) + np.uint8(7), view.closing)[40:-40] == 7).all()


@pytest.mark.parametrize('row', [65, 82, 108, 132, 148])
def test_opening_removes_what_is_narrower_and_leaves_what_is_wider(view: View, row: int) -> None:
    at = row - view.top
    (pixels,) = (size for first, past, size in view.opening.tolist() if first <= at < past)
    assert pixels >= 3
    for across in (True, False):
        for width, stays in ((pixels - 1, False), (pixels + 2, True)):
            height = level(view)
            if across:
                height[at - width // 2 : at - width // 2 + width] = 9
            else:
                height[:, 150 : 150 + width] = 9
            after = morphed(opened, height, view.opening)
            assert bool(after[at, 150 : 150 + width].max()) is stays, (across, width)
            assert after.max() <= 9


@pytest.mark.parametrize('bend', [0.0, -0.25, 0.2])
def test_the_yellow_line_is_opened_away_and_what_is_wider_is_not(view: View, bend: float) -> None:
    """A stripe on the road, left of the robot by 0.1 m; bend: slope."""
    ahead = 1 / np.maximum(view.nearness, 1e-3)
    aside = view.bearing * ahead - bend * ahead
    found = []
    for width in (0.024, 0.09):
        picture = road(view)
        picture[(np.abs(aside - 0.1) < width / 2) & (view.nearness > 0.4)] = pixel(DUCKIE)
        found.append(channels_of(picture, LIGHT, view).heights[:, 90 - view.top :])
    tape, thing = found
    assert tape[YELLOW].max() >= 5
    assert tape[WIDE].max() == 0
    assert thing[WIDE].max() >= 5
    assert 0.025 < TAPE < 0.09


def pixels_a_metre(view: View, row: int) -> float:
    """[px/m] on the road across the middle of a row."""
    middle = view.width // 2
    across = abs(view.bearing[row, middle + 5] - view.bearing[row, middle - 5]) / 10
    return float(view.nearness[row, middle] / across)


def row_of(view: View, ahead: float) -> int:
    """Row of a point of the road so many metres ahead of the robot."""
    return int(np.abs(view.nearness[:, view.width // 2] - 1 / ahead).argmin())


def parts(view: View, row: int, gap: int, size: int) -> np.ndarray:
    """Levels of red: two parts, one above the other, with so many rows between them."""
    height = level(view)
    above = row - view.top - gap // 2
    height[above - size : above, 150:170] = 7
    height[above + gap : above + gap + size, 150:170] = 5
    return height


@pytest.mark.parametrize('ahead', [0.2, 0.3, 0.45, 0.7])
def test_parts_are_joined_across_less_than_a_band_and_not_across_more(view: View, ahead: float) -> None:
    row = row_of(view, ahead)
    for metres, joins in ((0.02, True), (0.042, False)):
        gap = round(metres * pixels_a_metre(view, row))
        after = morphed(joined, parts(view, row, gap, size=18), view.closing)
        assert set(after[row - view.top, 150:170]) == ({5} if joins else {0}), 'the lesser of the two'
        assert cv2.connectedComponents((after > 0).view(np.uint8))[0] - 1 == (1 if joins else 2)
    assert 0.02 < BAND < 0.042


@pytest.mark.parametrize('row', [64, 82, 108])
def test_parts_side_by_side_are_not_joined(view: View, row: int) -> None:
    for gap in (1, 3):
        height = parts(view, row, 0, size=12)
        height[:, 160 : 160 + gap] = 0
        after = morphed(joined, height, view.closing)
        assert not after[:, 160 : 160 + gap].any()
        np.testing.assert_array_equal(after.any(axis=0), height.any(axis=0))


def test_nothing_grows_to_the_pictures_edges(view: View) -> None:
    height = level(view)
    height[2:12, 40:60] = 4
    height[-12:-2, 40:60] = 4
    assert view.closing[-1, 2] > 20
    np.testing.assert_array_equal(morphed(joined, height, view.closing), height)
