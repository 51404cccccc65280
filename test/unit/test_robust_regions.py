"""core.detection.robust.regions: components at every level, and paint that is opened away."""

from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.light import estimate_light, relative
from obst_avoid.core.detection.robust.regions import (
    BLUE_LEVELS,
    CHANNELS,
    FLATTEST,
    GREEN_LEVELS,
    LOWEST_FOOT,
    SLIMMEST,
    SMALLEST,
    WIDEST,
    YELLOW_LEVELS,
    Regions,
    find_regions,
    opened,
)
from obst_avoid.core.detection.robust.view import TAPE, View, make_view, working_picture
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

YELLOW, RED, BLUELESS, WIDE = range(CHANNELS)
CAMERA = calibration_of(Camera())
SIZES = [(320, 240), (640, 480), (1280, 960)]
PLACE = (120, 110)
"""Left and top of a patch on the road, in the working picture."""


@pytest.fixture(scope='module')
def view() -> View:
    """Of a camera without roll or yaw."""
    return make_view(CAMERA)


def asphalt(view: View) -> np.ndarray:
    """(height, width, 3) float32 light of an empty road."""
    return np.ones((view.height, view.width, 3), np.float32)


def patch(light: np.ndarray, box: Tuple[int, int, int, int], color: Tuple[float, float, float]) -> np.ndarray:
    """Paint a box, left, top, width, height, in a light of B, G, R."""
    left, top, width, height = box
    light[top : top + height, left : left + width] = color
    return light


def boxes(regions: Regions, channel: int) -> List[Tuple[int, ...]]:
    """Different boxes of one channel."""
    return sorted({tuple(box) for box in regions.box[regions.channel == channel].astype(int).tolist()})


def near(found: List[Tuple[int, ...]], box: Tuple[int, ...]) -> bool:
    """Whether a box is among those found, to a pixel: opening by an even number of pixels shifts by one."""
    return any(np.abs(np.subtract(one, box)).max() <= 1 for one in found)


def seen(picture: np.ndarray, calibration: Calibration) -> Tuple[Regions, View]:
    """Regions of a camera picture."""
    view = make_view(calibration)
    return find_regions(relative(working_picture(picture, view), estimate_light(picture)), view), view


def check(regions: Regions, view: View) -> None:
    """What holds for all regions of any picture."""
    count = len(regions)
    for name in ('channel', 'level', 'layer', 'label', 'area'):
        assert getattr(regions, name).shape == (count,), name
    left, top, width, height = regions.box.T
    assert (left >= 0).all()
    assert (left + width <= view.width).all()
    assert (top >= view.top).all()
    assert (top + height <= view.height).all()
    assert (regions.area >= SMALLEST).all()
    assert (regions.area <= width * height).all()
    assert (width < WIDEST).all()
    assert (width < FLATTEST * height).all()
    assert (height < SLIMMEST * width).all()
    assert (top + height >= LOWEST_FOOT * view.height).all()
    u, v = regions.middle.T
    assert ((u >= left) & (u <= left + width) & (v >= top) & (v <= top + height)).all()
    for index in range(count):
        layer = regions.layers[regions.layer[index]]
        assert (layer.channel, layer.level) == (regions.channel[index], regions.level[index])
        own = layer.labels == regions.label[index]
        assert own.sum() == regions.area[index]
        rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
        expected = columns[0], rows[0] + view.top, columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1
        assert tuple(regions.box[index]) == expected


def test_levels_rise_for_yellow_and_fall_for_ratios() -> None:
    assert (np.diff(YELLOW_LEVELS) > 0).all()
    steps = np.diff(np.log(YELLOW_LEVELS))
    assert steps == pytest.approx(np.full(len(steps), steps[0]))  # _reached counts on it
    for levels in (GREEN_LEVELS, BLUE_LEVELS):
        assert (np.diff(levels) < 0).all()
        assert levels * 20 == pytest.approx(np.rint(levels * 20))  # _fallen counts on it


@pytest.mark.parametrize('value', [0, 1, 128, 255])
@pytest.mark.parametrize('size', SIZES, ids='%dx%d'.__mod__)
def test_a_flat_picture_has_no_regions(value: int, size: Tuple[int, int]) -> None:
    calibration = calibration_of(Camera().resized(*size))
    regions, view = seen(np.full((size[1], size[0], 3), value, np.uint8), calibration)
    assert len(regions) == 0
    assert regions.box.shape == (0, 4)
    assert regions.middle.shape == (0, 2)
    check(regions, view)


def test_noise_breaks_nothing() -> None:
    random = np.random.RandomState(0)
    for calibration in (CAMERA, calibration_of(Camera(roll=3.0))):
        noise = random.randint(0, 256, (480, 640, 3)).astype(np.uint8)
        check(*seen(noise, calibration))
        blurred = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 7), None, 0, 255, cv2.NORM_MINMAX)
        regions, view = seen(blurred, calibration)
        assert len(regions) > 50
        check(regions, view)


@pytest.mark.parametrize('size', SIZES, ids='%dx%d'.__mod__)
def test_a_drawn_duckie_and_a_drawn_cone_are_regions_of_their_size(size: Tuple[int, int]) -> None:
    calibration = calibration_of(Camera().resized(*size))
    things = (duckie(0.4, 0.03), cone(0.45, -0.06))
    regions, view = seen(picture_of(calibration, things), calibration)
    check(regions, view)
    for thing, channel in zip(things, (YELLOW, RED)):
        without = picture_of(calibration, tuple(other for other in things if other is not thing))
        change = np.abs(
            working_picture(picture_of(calibration, things), view).astype(int) - working_picture(without, view)
        )
        rows = np.flatnonzero((change.max(axis=2) > 40).any(axis=1))
        columns = np.flatnonzero((change.max(axis=2) > 40).any(axis=0))
        expected = np.array([columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1])
        of_channel = regions.box[regions.channel == channel]
        assert np.abs(of_channel - expected).max(axis=1).min() <= 3, expected


@pytest.mark.parametrize(
    'color, channels',
    [
        pytest.param((0.3, 4.0, 5.0), {YELLOW, BLUELESS, WIDE}, id='a duckie'),
        pytest.param((0.3, 0.8, 4.0), {YELLOW, RED, BLUELESS, WIDE}, id='a cone'),
        pytest.param((0.03, 0.1, 0.12), {BLUELESS}, id='a duckie in the dark'),
        pytest.param((6.0, 6.0, 6.0), set(), id='white'),
        pytest.param((0.2, 0.2, 0.2), set(), id='a shadow'),
        pytest.param((4.0, 1.0, 0.9), set(), id='blue'),
    ],
)
def test_each_channel_sees_its_colour(view: View, color: Tuple[float, float, float], channels: set) -> None:
    regions = find_regions(patch(asphalt(view), (*PLACE, 30, 30), color), view)
    check(regions, view)
    assert {channel for channel in range(CHANNELS) if near(boxes(regions, channel), (*PLACE, 30, 30))} == channels


def test_the_levels_of_a_thing_are_those_below_its_value(view: View) -> None:
    for yellow in (0.5, 2.0, 20.0, 200.0):
        regions = find_regions(patch(asphalt(view), (*PLACE, 20, 20), (1.0, 1.0 + yellow, 1.0 + yellow)), view)
        levels = regions.level[regions.channel == YELLOW]
        assert sorted(levels) == list(range(len(levels)))  # each once
        assert len(levels) == (YELLOW_LEVELS < yellow).sum()


def test_green_against_red_falls_through_its_levels(view: View) -> None:
    for ratio in (0.9, 0.72, 0.33, 0.07):
        regions = find_regions(patch(asphalt(view), (*PLACE, 20, 20), (1.0, ratio, 1.0)), view)
        levels = regions.level[regions.channel == RED]
        assert sorted(levels) == list(range(len(levels)))
        assert len(levels) == (GREEN_LEVELS > ratio).sum()


def test_regions_shrink_from_level_to_level(view: View) -> None:
    """A component tree: each region lies in one of the level before."""
    v, u = np.mgrid[0 : view.height, 0 : view.width]
    hills = 30 * np.exp(-((u - 100) ** 2 + (v - 170) ** 2) / 200) + 60 * np.exp(
        -((u - 130) ** 2 + (v - 180) ** 2) / 150
    )
    light = asphalt(view)
    light[..., 1:] += hills[..., None]
    regions = find_regions(light.astype(np.float32), view)
    check(regions, view)
    yellow = [layer for layer in regions.layers if layer.channel == YELLOW]
    assert [layer.level for layer in yellow] == list(range(len(yellow)))
    assert len(yellow) == (YELLOW_LEVELS < hills.max()).sum()
    for wider, narrower in zip(yellow, yellow[1:]):
        assert (wider.labels[narrower.labels > 0] > 0).all()
    counts = np.bincount(regions.level[regions.channel == YELLOW], minlength=len(YELLOW_LEVELS))
    assert counts[0] == 1
    assert counts.max() == 2  # the hills fall apart
    assert regions.wide.max() <= regions.yellow.max()
    assert regions.wider.max() <= regions.wide.max()
    assert 0 < regions.wider.sum() < regions.wide.sum() < regions.yellow.sum()


@pytest.mark.parametrize(
    'box',
    [
        pytest.param((100, 170, 3, 4), id='smaller than the smallest'),
        pytest.param((100, 190, 60, 12), id='flat'),
        pytest.param((100, 130, 12, 60), id='slim'),
        pytest.param((20, 120, 170, 80), id='wider than the widest'),
    ],
)
def test_forms_that_nothing_has_are_left_out(view: View, box: Tuple[int, int, int, int]) -> None:
    regions = find_regions(patch(asphalt(view), box, (0.3, 4.0, 5.0)), view)
    check(regions, view)
    assert box not in boxes(regions, YELLOW)


def test_what_hangs_above_the_road_is_left_out() -> None:
    view = make_view(calibration_of(Camera(pitch=30.0)))
    high = (100, view.top + 2, 16, int(LOWEST_FOOT * view.height) - view.top - 4)
    assert high[3] > 12, 'the rows above the road are looked at'
    assert len(find_regions(patch(asphalt(view), high, (0.3, 4.0, 5.0)), view)) == 0
    low = (100, int(LOWEST_FOOT * view.height) - 6, 16, 16)
    assert low in boxes(find_regions(patch(asphalt(view), low, (0.3, 4.0, 5.0)), view), YELLOW)


# Paint


def pixels_at(view: View, row: int, which: int) -> int:
    """[px] of the opening in one row of the working picture."""
    for first, past, pixels in view.openings[which]:
        if first <= row - view.top < past:
            return pixels
    raise AssertionError(row)


@pytest.mark.parametrize('row', [85, 110, 145, 175])
@pytest.mark.parametrize('which', [0, 1])
def test_opening_removes_what_is_narrower_and_leaves_what_is_wider(view: View, row: int, which: int) -> None:
    pixels = pixels_at(view, row, which)
    assert pixels >= 2
    for across in (True, False):
        for width, stays in ((pixels - 1, False), (pixels + 4, True)):
            height = np.zeros((view.height - view.top, view.width), np.uint8)
            at = row - view.top
            if across:
                height[at - width // 2 : at - width // 2 + width] = 9
            else:
                height[:, 150 : 150 + width] = 9
            after = opened(height, view.openings[which])
            assert bool(after[at, 150 : 150 + width].max()) is stays, (across, width)
            assert after.max() <= 9


def test_opening_a_flat_picture_changes_nothing(view: View) -> None:
    for value in (0, 7):
        height = np.full((view.height - view.top, view.width), value, np.uint8)
        for bands in view.openings:
            assert (opened(height, bands) == value).all()


def ground_stripe(view: View, width: float, bend: float = 0.0) -> np.ndarray:
    """Light of a yellow stripe on the road, so many metres wide, left of the robot by 0.1 m; bend: slope."""
    light = asphalt(view)
    ahead = 1 / np.maximum(view.nearness, 1e-3)
    aside = view.bearing * ahead - bend * ahead
    on = (np.abs(aside - 0.1) < width / 2) & (view.nearness > 0.4)
    light[on] = (0.3, 4.0, 5.0)
    return light


@pytest.mark.parametrize('bend', [0.0, -0.25, 0.2])
def test_the_yellow_line_is_opened_away_and_what_is_wider_is_not(view: View, bend: float) -> None:
    tape, thing = (find_regions(ground_stripe(view, width, bend), view) for width in (0.024, 0.09))
    rows = slice(120 - view.top, None)
    assert tape.yellow[rows].max() >= 6
    assert tape.wide[rows].max() == 0
    assert WIDE not in tape.channel
    assert thing.wide[rows].max() >= 6
    assert thing.wider[rows].max() >= 6
    assert 0.025 < TAPE[0] < TAPE[1] < 0.09


def test_dashes_are_regions_of_the_channel_with_paint_only(view: View) -> None:
    light = ground_stripe(view, 0.024)
    light[(np.mod(1 / np.maximum(view.nearness, 1e-3), 0.073) < 0.025) & (view.nearness > 0)] = 1.0
    regions = find_regions(light, view)
    check(regions, view)
    assert len(boxes(regions, YELLOW)) >= 3
    assert not boxes(regions, WIDE)


def test_levels_are_monotonic(view: View) -> None:
    """More yellow light never reaches fewer levels."""
    ramp: Any = asphalt(view)
    ramp[..., 1:] += np.linspace(0, 400, view.width, dtype=np.float32)[None, :, None]
    regions = find_regions(ramp, view)
    row = regions.yellow[50].astype(int)
    assert (np.diff(row) >= 0).all()
    assert (row[0], row[-1]) == (0, len(YELLOW_LEVELS))
    expected = (YELLOW_LEVELS[None] < (ramp[view.top + 50, :, 1] - 1)[:, None]).sum(axis=1)
    assert np.abs(row - expected).max() <= 1
    assert (row == expected).mean() > 0.97
