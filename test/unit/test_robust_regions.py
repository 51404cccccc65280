"""core.detection.robust.regions: components at every level, paint that is opened away, and bands that are closed."""

from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.light import estimate_light, relative
from obst_avoid.core.detection.robust.regions import (
    BLUE_LEVELS,
    BLUELESS,
    BRIGHT,
    BRIGHT_LEVELS,
    DARK,
    DARK_LEVELS,
    FLATTEST,
    GREEN_LEVELS,
    JOINED,
    RED,
    SLIMMEST,
    SMALLEST,
    WIDE,
    WIDEST,
    YELLOW,
    YELLOW_LEVELS,
    Regions,
    find_regions,
    joined,
    opened,
)
from obst_avoid.core.detection.robust.view import BAND, FARTHEST_FOOT, TAPE, View, make_view, working_picture
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

CHANNELS = (YELLOW, RED, BLUELESS, WIDE, JOINED, BRIGHT, DARK)
CAMERA = calibration_of(Camera())
SIZES = [(320, 240), (640, 480), (1280, 960)]
PLACE = (120, 110)
"""Left and top of a patch on the road, in the working picture."""
DUCKIE, ORANGE, WHITE = (0.3, 4.0, 5.0), (0.3, 0.8, 4.0), (6.0, 6.0, 6.0)
"""Light of a duckie, of a cone and of its band."""


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
    assert (top + height > view.foot).all()
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


def test_levels_rise_for_light_and_fall_for_ratios() -> None:
    for levels in (YELLOW_LEVELS, BRIGHT_LEVELS, DARK_LEVELS):
        assert (np.diff(levels) > 0).all()
        steps = np.diff(np.log(levels))
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
        pytest.param(DUCKIE, {YELLOW, BLUELESS, WIDE, BRIGHT}, id='a duckie'),
        pytest.param(ORANGE, {YELLOW, RED, BLUELESS, WIDE, JOINED, DARK}, id='a cone'),
        pytest.param((0.03, 0.1, 0.12), {BLUELESS, DARK}, id='a duckie in the dark'),
        pytest.param((3.0, 3.0, 1.5), {BRIGHT}, id='a duckie in blue and green light'),
        pytest.param((5.0, 5.0, 0.9), {BRIGHT}, id='cyan'),
        pytest.param(WHITE, {BRIGHT}, id='white'),
        pytest.param((0.2, 0.2, 0.2), {DARK}, id='a shadow'),
        pytest.param((0.02, 0.02, 0.02), {DARK}, id='the underside of a cone'),
        pytest.param((0.9, 0.9, 0.9), set(), id='hardly a shadow'),
        pytest.param((4.0, 1.0, 0.9), set(), id='blue'),
    ],
)
def test_each_channel_sees_its_colour(view: View, color: Tuple[float, float, float], channels: set) -> None:
    regions = find_regions(patch(asphalt(view), (*PLACE, 30, 30), color), view)
    check(regions, view)
    assert {channel for channel in CHANNELS if near(boxes(regions, channel), (*PLACE, 30, 30))} == channels


def test_the_levels_of_a_thing_are_those_below_its_value(view: View) -> None:
    for yellow in (0.5, 2.0, 20.0, 200.0):
        regions = find_regions(patch(asphalt(view), (*PLACE, 20, 20), (1.0, 1.0 + yellow, 1.0 + yellow)), view)
        levels = regions.level[regions.channel == YELLOW]
        assert sorted(levels) == list(range(len(levels)))  # each once
        assert len(levels) == (YELLOW_LEVELS < yellow).sum()


def test_green_light_reaches_the_levels_below_it(view: View) -> None:
    for green in (1.1, 1.5, 6.0, 70.0):
        regions = find_regions(patch(asphalt(view), (*PLACE, 20, 20), (green, green, green)), view)
        assert set(regions.channel) <= {BRIGHT}
        assert sorted(regions.level) == list(range((BRIGHT_LEVELS < green).sum()))  # each once


def test_darkness_is_asphalts_green_against_the_things(view: View) -> None:
    for green in (0.9, 0.8, 0.3, 0.05):
        regions = find_regions(patch(asphalt(view), (*PLACE, 20, 20), (green, green, green)), view)
        assert set(regions.channel) <= {DARK}
        assert sorted(regions.level) == list(range((DARK_LEVELS < 1 / green).sum()))  # each once


def test_green_against_red_falls_through_its_levels(view: View) -> None:
    for ratio in (0.9, 0.72, 0.33, 0.07):
        regions = find_regions(patch(asphalt(view), (*PLACE, 20, 20), (1.0, ratio, 1.0)), view)
        levels = regions.level[regions.channel == RED]
        assert sorted(levels) == list(range(len(levels)))
        assert len(levels) == (GREEN_LEVELS > ratio).sum()


@pytest.mark.parametrize('channel', [BRIGHT, DARK])
def test_mirrored_light_has_mirrored_regions(view: View, channel: int) -> None:
    noise = np.random.RandomState(0).randn(view.height, view.width, 3).astype(np.float32)
    light = np.exp(20 * cv2.GaussianBlur(noise, (0, 0), 5))
    regions = find_regions(light, view)
    mirrored = find_regions(np.ascontiguousarray(light[:, ::-1]), view)

    def table(one: Regions, left: np.ndarray) -> List[List[float]]:
        rows = np.column_stack([one.level, left, one.box[:, 1:], one.area])
        return sorted(rows[one.channel == channel].tolist())

    here = table(regions, view.width - regions.box[:, 0] - regions.box[:, 2])
    assert len(here) > 30
    assert here == table(mirrored, mirrored.box[:, 0])
    assert here != table(regions, regions.box[:, 0])


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
    regions = find_regions(patch(asphalt(view), box, DUCKIE), view)
    check(regions, view)
    assert box not in boxes(regions, YELLOW)


STEEP = {
    'pitched by 25 degrees': calibration_of(Camera(pitch=25.0)),
    'pitched by 30 degrees': calibration_of(Camera(pitch=30.0)),
    'pitched by 35 degrees, high': calibration_of(Camera(pitch=35.0, height=0.14)),
    'pitched by 40 degrees': calibration_of(Camera(pitch=40.0)),
}


@pytest.mark.parametrize('calibration', [CAMERA, *STEEP.values()], ids=['as it is', *STEEP])
def test_what_hangs_above_the_road_is_left_out(calibration: Calibration) -> None:
    view = make_view(calibration)
    column = view.nearness[:, view.width // 2]
    assert column[view.foot - 1] <= 1 / FARTHEST_FOOT < column[view.foot]
    above, on = ((100, view.foot - 12 + lower, 12, 12) for lower in (0, 1))
    assert above[1] >= view.top, 'the rows above the road are looked at'
    left = find_regions(patch(asphalt(view), above, DUCKIE), view)
    assert set(left.channel) <= {WIDE}, 'opening by an even number of pixels shifts by one'
    assert on in boxes(find_regions(patch(asphalt(view), on, DUCKIE), view), YELLOW)


@pytest.mark.parametrize('calibration', list(STEEP.values()), ids=list(STEEP))
def test_a_steep_camera_sees_a_duckie_at_a_metre(calibration: Calibration) -> None:
    """Whose feet are higher in the picture than any thing's of a camera that looks ahead."""
    view = make_view(calibration)
    foot = row_of(view, 1.0)
    assert foot + 1 < 75 / 240 * view.height
    for width in (8, 12):  # 5 cm at a metre, about
        box = (150, foot - 9, width, 10)
        regions = find_regions(patch(asphalt(view), box, DUCKIE), view)
        check(regions, view)
        assert box in boxes(regions, YELLOW)


def test_a_drawn_duckie_at_a_metre_is_a_region_of_a_steep_camera() -> None:
    calibration = STEEP['pitched by 25 degrees']
    regions, view = seen(picture_of(calibration, (duckie(1.0, 0.0),)), calibration)
    check(regions, view)
    foot = row_of(view, 1.0 - 0.02)
    left, top, width, height = regions.box[regions.channel == YELLOW].T
    middle, low = left + width / 2, top + height - 1
    assert ((np.abs(middle - view.width / 2) < 6) & (np.abs(low - foot) <= 2) & (height >= 5)).any()


def test_a_camera_that_looks_at_its_feet_leaves_nothing_out() -> None:
    """All its rows are nearer than anything is too far away."""
    view = make_view(calibration_of(Camera(pitch=55.0)))
    assert (view.top, view.foot) == (0, 0)
    box = (100, 0, 12, 12)
    assert box in boxes(find_regions(patch(asphalt(view), box, DUCKIE), view), YELLOW)


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
    light[on] = DUCKIE
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


# A cone's white band


def pixels_a_metre(view: View, row: int) -> float:
    """[px/m] on the road across the middle of a row."""
    middle = view.width // 2
    across = abs(view.bearing[row, middle + 5] - view.bearing[row, middle - 5]) / 10
    return float(view.nearness[row, middle] / across)


def row_of(view: View, ahead: float, height: float = 0.0) -> int:
    """Row of a point so many metres ahead of the robot and above the road: it hides the road behind it."""
    behind = (ahead - view.camera.ahead) * view.camera.height / (view.camera.height - height) + view.camera.ahead
    return int(np.abs(view.nearness[:, view.width // 2] - 1 / behind).argmin())


def parts(view: View, row: int, gap: int, size: int) -> np.ndarray:
    """Levels of red: two parts, one above the other, with so many rows between them."""
    height = np.zeros((view.height - view.top, view.width), np.uint8)
    above = row - view.top - gap // 2
    height[above - size : above, 150:170] = 7
    height[above + gap : above + gap + size, 150:170] = 5
    return height


@pytest.mark.parametrize('ahead', [0.2, 0.3, 0.45, 0.7])
def test_parts_are_joined_across_less_than_a_band_and_not_across_more(view: View, ahead: float) -> None:
    row = row_of(view, ahead)
    for metres, joins in ((0.02, True), (0.04, False)):
        gap = round(metres * pixels_a_metre(view, row))
        after = joined(parts(view, row, gap, size=20), view.closing)
        assert set(after[row - view.top, 150:170]) == ({5} if joins else {0}), 'the lesser of the two'
        assert cv2.connectedComponents((after > 0).view(np.uint8))[0] - 1 == (1 if joins else 2)
    assert 0.02 < BAND < 0.04


@pytest.mark.parametrize('row', [85, 110, 145])
def test_parts_side_by_side_are_not_joined(view: View, row: int) -> None:
    for gap in (1, 3):
        height = parts(view, row, 0, size=12)
        height[:, 160 : 160 + gap] = 0
        after = joined(height, view.closing)
        assert not after[:, 160 : 160 + gap].any()
        np.testing.assert_array_equal(after.any(axis=0), height.any(axis=0))


def test_joining_a_flat_picture_changes_nothing(view: View) -> None:
    for value in (0, 7):
        height = np.full((view.height - view.top, view.width), value, np.uint8)
        assert (joined(height, view.closing) == value).all()


@pytest.mark.parametrize('ahead', [0.25, 0.4, 0.6, 0.8])
def test_a_cone_with_a_white_band_is_one_region(view: View, ahead: float) -> None:
    """6 cm high; its band reaches from 0.45 to 0.65 of that."""
    rows = [row_of(view, ahead, share * 0.06) for share in (0.0, 0.45, 0.65, 1.0)]
    foot, low, high, top = rows
    width = round(0.03 * pixels_a_metre(view, foot))
    whole = (140, top, width, foot - top)
    light = patch(patch(asphalt(view), whole, ORANGE), (140, high, width, low - high), WHITE)
    regions = find_regions(light, view)
    check(regions, view)
    assert near(boxes(regions, JOINED), whole)
    assert not near(boxes(regions, RED), whole)
    assert near(boxes(regions, RED), (140, low, width, foot - low))


def test_cones_side_by_side_are_two_regions(view: View) -> None:
    light = patch(patch(asphalt(view), (120, 110, 16, 24), ORANGE), (138, 110, 16, 24), ORANGE)
    regions = find_regions(light, view)
    found = boxes(regions, JOINED)
    assert len(found) == 2
    assert near(found, (120, 110, 16, 24))
    assert near(found, (138, 110, 16, 24))


def test_what_is_whole_is_the_same_joined(view: View) -> None:
    """But for a row: closing by an even number of pixels shifts by one."""
    regions = find_regions(patch(asphalt(view), (*PLACE, 24, 30), ORANGE), view)
    red, closed = (np.flatnonzero(regions.channel == channel) for channel in (RED, JOINED))
    assert len(red) > 3
    np.testing.assert_array_equal(regions.level[red], regions.level[closed])
    assert np.abs(regions.box[red] - regions.box[closed]).max() <= 1
