"""core.detection.robust.regions: a component tree of every channel; regions of drawn and degenerate pictures."""

from dataclasses import replace
from typing import Dict, List, Optional, Sequence, Set, Tuple

import cv2
import numpy as np
import pytest
from skimage.measure import label

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.channels import (
    BLUELESS,
    BRIGHT,
    CHANNELS,
    COLORS,
    DARK,
    JOINED,
    RED,
    SUMS,
    WIDE,
    YELLOW,
    Channels,
    channels_of,
)
from obst_avoid.core.detection.robust.light import LINEAR, Light, estimate_light
from obst_avoid.core.detection.robust.regions import (
    AT,
    COLUMNS,
    FLATTEST,
    SLIMMEST,
    SMALLEST,
    WIDEST,
    Regions,
    find_regions,
)
from obst_avoid.core.detection.robust.view import FARTHEST_FOOT, View, make_view, working_picture
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

Box = Tuple[int, int, int, int]
CAMERA = calibration_of(Camera())
SIZES = [(320, 240), (640, 480), (1280, 960)]
ASPHALT = 60
LIGHT = Light((float(LINEAR[ASPHALT]),) * 3)
DUCKIE, ORANGE, WHITE = (0.3, 4.0, 5.0), (0.3, 0.8, 4.0), (6.0, 6.0, 6.0)
"""Light of a duckie, of a cone and of its band, asphalt's being 1."""
NONE = [-1] * 6


@pytest.fixture(scope='module')
def view() -> View:
    """Of a camera without roll or yaw."""
    return make_view(CAMERA)


def raised(
    view: View, heights: Dict[int, np.ndarray], planes: Optional[np.ndarray] = None, top: int = 0, foot: int = 0
) -> Tuple[Channels, View]:
    """Channels of given heights, all others flat, over pixels of given colours; and the view of such a picture."""
    shape = next(iter(heights.values())).shape
    stack = np.zeros((CHANNELS, *shape), np.uint8)
    for channel, height in heights.items():
        stack[channel] = height
    sums = np.zeros((shape[0] + 1, shape[1] + 1, SUMS), np.int32)
    if planes is not None:
        sums[1:, 1:, : planes.shape[2]] = planes.cumsum(axis=0).cumsum(axis=1)
    return Channels(stack, sums), replace(view, width=shape[1], height=shape[0] + top, top=top, foot=foot)


def field(rows: int, columns: int, *boxes: Tuple[Box, int]) -> np.ndarray:
    """Nothing but boxes, left, top, width, height, of so many levels, one over the other."""
    height = np.zeros((rows, columns), np.uint8)
    for (left, top, width, tall), value in boxes:
        height[top : top + tall, left : left + width] = value
    return height


def road(view: View, *patches: Tuple[Box, Tuple[float, float, float]]) -> np.ndarray:
    """A working picture of asphalt with boxes of so much light."""
    picture = np.full((view.height, view.width, 3), ASPHALT, np.uint8)
    for (left, top, width, height), light in patches:
        values = 256 * (np.array(light) * LIGHT.road) ** (1 / 2.2) - 1
        picture[top : top + height, left : left + width] = np.rint(values).clip(0, 255)
    return picture


def found_on(view: View, *patches: Tuple[Box, Tuple[float, float, float]]) -> Regions:
    """Regions of such a picture."""
    return find_regions(channels_of(road(view, *patches), LIGHT, view), view)


def seen(picture: np.ndarray, calibration: Calibration) -> Tuple[Regions, Channels, View]:
    """Regions of a camera picture."""
    view = make_view(calibration)
    channels = channels_of(working_picture(picture, view), estimate_light(picture), view)
    return find_regions(channels, view), channels, view


def columns(regions: Regions, *names: str) -> np.ndarray:
    """(N, len(names))."""
    return regions.table[:, [AT[name] for name in names]]


def boxes(regions: Regions, channel: int) -> List[Tuple[int, ...]]:
    """Different boxes of one channel, in the working picture."""
    return sorted(
        {tuple(box) for box in regions.box[columns(regions, 'channel')[:, 0] == channel].astype(int).tolist()}
    )


def near(found: Sequence[Tuple[int, ...]], box: Tuple[int, ...]) -> bool:
    """Whether a box is among those found, to a pixel."""
    return any(np.abs(np.subtract(one, box)).max() <= 1 for one in found)


def pixels_of(regions: Regions, channels: Channels, index: int) -> np.ndarray:
    """(R, W) bool: the pixels of one region, by their numbers in place."""
    channel, first, past = columns(regions, 'channel', 'first', 'past')[index]
    place = regions.place[channel]
    return (channels.heights[channel] > 0) & (place >= first) & (place < past)


# A tree, by hand


def test_a_tree_by_hand(view: View) -> None:
    """Two hills on a plateau, one of them with a step too small to be a region of its own, and a hill alone."""
    height = field(
        40,
        60,
        ((10, 5, 20, 12), 2),
        ((12, 7, 6, 5), 6),
        ((13, 8, 4, 3), 9),
        ((22, 8, 5, 6), 4),
        ((23, 9, 3, 2), 7),
        ((40, 20, 8, 8), 3),
    )
    planes = np.zeros((40, 60, 3), dtype=int)
    planes[..., 0], planes[..., 1] = 5, np.arange(60)
    planes[..., 2] = -np.arange(40)[:, None]
    channels, small = raised(view, {BLUELESS: height}, planes)
    regions = find_regions(channels, small)
    plateau, hill = [2, 10, 5, 20, 12, 240], [6, 12, 7, 6, 5, 30]
    expected = []
    for level, since, left, top, wide, tall, part, parent, double in (
        (2, 0, 10, 5, 20, 12, 30, NONE, NONE),
        (6, 2, 12, 7, 6, 5, 12, plateau, plateau),
        (9, 6, 13, 8, 4, 3, 0, hill, hill),
        (4, 2, 22, 8, 5, 6, 0, plateau, plateau),
        (3, 0, 40, 20, 8, 8, 0, NONE, NONE),
    ):
        area = wide * tall
        u, v = area * (left + (wide - 1) / 2), area * (top + (tall - 1) / 2)
        row = [BLUELESS, level, since, left, top, wide, tall, area, u, v, 5 * area, u, -v]
        expected.append([*row, part, *parent, *double])
    kept = [index for name, index in AT.items() if name not in ('first', 'past')]
    assert sorted(regions.table[:, kept].tolist()) == sorted(expected)
    assert regions.top == 0
    assert regions.table.dtype == np.int32


def test_the_double_is_the_smallest_at_least_twice_as_large(view: View) -> None:
    """Areas 25, 49, 50, 51 and 100, one in the other."""
    squares = ((5, 5, 10, 10), 1), ((5, 5, 7, 7), 4), ((5, 5, 5, 5), 5)
    height = field(30, 40, *squares, ((12, 5, 1, 1), 3), ((12, 6, 1, 1), 2))
    regions = find_regions(*raised(view, {YELLOW: height}))
    rows = columns(regions, 'area', 'parent_area', 'double_area').tolist()
    assert sorted(rows) == [[25, 49, 50], [49, 50, 100], [50, 51, 100], [51, 100, -1], [100, -1, -1]]


def test_what_stays_the_same_over_several_levels_is_one_region(view: View) -> None:
    regions = find_regions(*raised(view, {RED: field(20, 30, ((5, 6, 7, 8), 7))}))
    assert columns(regions, 'channel', 'level', 'since', 'area').tolist() == [[RED, 7, 0, 56]]


def test_what_touches_at_a_corner_alone_is_two_regions(view: View) -> None:
    corner = field(20, 30, ((5, 5, 4, 4), 3), ((9, 9, 4, 4), 3))
    assert len(find_regions(*raised(view, {DARK: corner}))) == 2
    edge = field(20, 30, ((5, 5, 4, 4), 3), ((8, 9, 4, 4), 3))
    assert len(find_regions(*raised(view, {DARK: edge}))) == 1


def test_each_channel_has_regions_of_its_own(view: View) -> None:
    heights = {channel: field(20, 60, ((5 + 7 * channel, 5, 5, 5), channel + 1)) for channel in range(CHANNELS)}
    regions = find_regions(*raised(view, heights))
    rows = columns(regions, 'channel', 'level', 'left').tolist()
    assert rows == [[channel, channel + 1, 5 + 7 * channel] for channel in range(CHANNELS)]


def test_boxes_are_in_the_working_picture_and_the_table_from_the_views_first_row_on(view: View) -> None:
    channels, small = raised(view, {YELLOW: field(20, 30, ((5, 6, 7, 8), 1))}, top=33)
    regions = find_regions(channels, small)
    assert columns(regions, 'left', 'top', 'width', 'height').tolist() == [[5, 6, 7, 8]]
    assert regions.box.tolist() == [[5, 39, 7, 8]]
    assert regions.box.dtype == np.float64
    assert regions.top == 33


# Any heights, against the definition


def regions_by_definition(channels: Channels, lowest: int) -> List[List[int]]:
    """Rows without first and past: each different component at each level, pixel by pixel."""
    planes = np.diff(np.diff(channels.sums[..., : len(COLORS)].astype(np.int64), axis=0), axis=1)
    rows = []
    for channel, height in enumerate(channels.heights):
        levels: Dict[bytes, int] = {}
        for level in range(1, int(height.max()) + 1):
            labels = label(height >= level, connectivity=1)
            for number in range(1, int(labels.max()) + 1):
                mask = labels == number
                if mask.sum() >= 8:
                    levels[mask.tobytes()] = level
        components = [(np.frombuffer(key, bool).reshape(height.shape), level) for key, level in levels.items()]
        six = [[level, *box_of(mask), int(mask.sum())] for mask, level in components]
        for (mask, level), own in zip(components, six):
            area, (_, left, top, width, tall, _) = own[5], own
            at = np.argmax(mask)
            around = [other for (there, _), other in zip(components, six) if there.flat[at] and other[5] > area]
            inside = [
                other[5]
                for (there, _), other in zip(components, six)
                if other[5] < area and mask.flat[np.argmax(there)]
            ]
            if width >= 3.5 * tall or tall >= 4 * width or width >= 120 or top + tall <= lowest:
                continue
            parent = min(around, key=lambda other: other[5], default=NONE)
            double = min((other for other in around if other[5] >= 2 * area), key=lambda other: other[5], default=NONE)
            v, u = np.nonzero(mask)
            colors = planes[mask].sum(axis=0).tolist()
            since = parent[0] if around else 0
            row = [channel, level, since, left, top, width, tall, area, int(u.sum()), int(v.sum()), *colors]
            rows.append([*row, max(inside, default=0), *parent, *double])
    return sorted(rows)


def box_of(mask: np.ndarray) -> Box:
    """Left, top, width, height."""
    v, u = np.nonzero(mask)
    return int(u.min()), int(v.min()), int(u.max() - u.min()) + 1, int(v.max() - v.min()) + 1


def hills(seed: int, rows: int = 30, columns: int = 44, levels: int = 9, size: float = 2.0) -> np.ndarray:
    """Hills and valleys, about half of it flat."""
    noise = cv2.GaussianBlur(np.random.RandomState(seed).randn(rows, columns), (0, 0), size)
    return np.clip(noise / noise.max() * levels + 0.5, 0, levels).astype(np.uint8)


@pytest.mark.parametrize('size', [0.6, 1.0, 1.5, 2.5])
@pytest.mark.parametrize('foot', [0, 15])
def test_regions_of_hills_are_those_of_the_definition(view: View, size: float, foot: int) -> None:
    heights = {channel: hills(10 * channel, size=size) for channel in (YELLOW, RED, DARK)}
    planes = np.random.RandomState(1).randint(-500, 500, (30, 44, 3))
    channels, small = raised(view, heights, planes, foot=foot)
    regions = find_regions(channels, small)
    kept = [index for name, index in AT.items() if name not in ('first', 'past')]
    expected = regions_by_definition(channels, foot)
    assert len(expected) > 15
    assert sorted(regions.table[:, kept].tolist()) == expected


@pytest.mark.parametrize('size', [0.6, 1.5, 2.5])
def test_the_pixels_of_a_region_follow_each_other_in_place(view: View, size: float) -> None:
    channels, small = raised(view, {channel: hills(channel, size=size) for channel in range(CHANNELS)})
    regions = find_regions(channels, small)
    assert regions.place.shape == channels.heights.shape
    assert len(regions) > 20
    check(regions, channels, small)


def check(regions: Regions, channels: Channels, view: View) -> None:
    """What holds for all regions of any picture."""
    assert regions.table.shape == (len(regions), len(COLUMNS))
    assert regions.box.shape == (len(regions), 4)
    left, top, width, height = regions.box.T
    assert (left >= 0).all()
    assert (left + width <= view.width).all()
    assert (top >= view.top).all()
    assert (top + height <= view.height).all()
    assert (width < WIDEST).all()
    assert (width < FLATTEST * height).all()
    assert (height < SLIMMEST * width).all()
    assert (top + height > view.foot).all()
    for index, row in enumerate(regions.table.tolist()):
        one = dict(zip(COLUMNS, row))
        mask = pixels_of(regions, channels, index)
        assert mask.sum() == one['area'] >= SMALLEST
        assert (*box_of(mask), view.top) == (one['left'], one['top'], one['width'], one['height'], regions.top)
        assert channels.heights[one['channel']][mask].min() == one['level'] > one['since'] >= 0
        around = cv2.dilate(mask.view(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))) > mask
        assert channels.heights[one['channel']][around].max(initial=0) < one['level']
        assert one['since'] == max(one['parent_level'], 0)
        assert one['part'] < one['area']
        for who, factor in (('parent_', 1.001), ('double_', 2)):
            assert one[who + 'level'] == -1 or one[who + 'area'] >= factor * one['area']


# Forms


@pytest.mark.parametrize(
    'box, stays',
    [
        pytest.param((5, 5, 7, 1), False, id='smaller than the smallest'),
        pytest.param((5, 5, 4, 2), True, id='the smallest'),
        pytest.param((5, 5, 7, 2), False, id='flat'),
        pytest.param((5, 5, 6, 2), True, id='nearly flat'),
        pytest.param((5, 5, 34, 10), True, id='nearly as flat'),
        pytest.param((5, 5, 35, 10), False, id='as flat'),
        pytest.param((5, 5, 3, 12), False, id='slim'),
        pytest.param((5, 5, 3, 11), True, id='nearly slim'),
        pytest.param((5, 2, 120, 40), False, id='wider than the widest'),
        pytest.param((5, 2, 119, 40), True, id='the widest'),
    ],
)
def test_forms_that_nothing_has_are_left_out(view: View, box: Box, stays: bool) -> None:
    regions = find_regions(*raised(view, {YELLOW: field(50, 140, (box, 3))}))
    assert [tuple(one) for one in regions.box.tolist()] == ([box] if stays else [])


def test_what_is_left_out_is_still_what_others_are_part_of(view: View) -> None:
    """A duckie on a yellow line: the line is no region, but the duckie's parent."""
    regions = find_regions(*raised(view, {YELLOW: field(40, 80, ((2, 20, 70, 4), 2), ((30, 14, 10, 10), 5))}))
    assert columns(regions, 'level', 'area', 'parent_level', 'parent_width').tolist() == [[5, 100, 2, 70]]


def test_what_is_too_small_is_no_part(view: View) -> None:
    regions = find_regions(*raised(view, {YELLOW: field(30, 30, ((5, 5, 9, 9), 2), ((6, 6, 7, 1), 5))}))
    assert columns(regions, 'level', 'area', 'part').tolist() == [[2, 81, 0]]


@pytest.mark.parametrize(
    'box', [(0, 0, 4, 4), (26, 0, 4, 4), (0, 16, 4, 4), (26, 16, 4, 4), (0, 0, 30, 20), (29, 0, 1, 3)], ids=str
)
def test_what_lies_at_an_edge_of_the_picture_ends_there(view: View, box: Box) -> None:
    channels, small = raised(view, {YELLOW: field(20, 30, (box, 255))})
    regions = find_regions(channels, small)
    assert [tuple(one) for one in regions.box.tolist()] == [box] * (box[2] * box[3] >= SMALLEST)
    check(regions, channels, small)


# Levels of a thing


@pytest.mark.parametrize('channel', [YELLOW, BRIGHT, DARK])
def test_a_patch_is_one_region_as_high_as_its_light(view: View, channel: int) -> None:
    light = {YELLOW: DUCKIE, BRIGHT: WHITE, DARK: (0.2, 0.2, 0.2)}[channel]
    box = (120, 110, 20, 20)
    channels = channels_of(road(view, (box, light)), LIGHT, view)
    regions = find_regions(channels, view)
    own = regions.table[columns(regions, 'channel')[:, 0] == channel]
    assert own[:, [AT[name] for name in ('since', 'left', 'width', 'height', 'area')]].tolist() == [
        [0, 120, 20, 20, 400]
    ]
    assert own[0, AT['level']] == channels.heights[channel].max() > 2
    assert boxes(regions, channel) == [box]


def test_regions_shrink_from_level_to_level(view: View) -> None:
    """Each lies in its parent, until the hills fall apart."""
    v, u = np.mgrid[0:60, 0:90]
    height = 9 * np.exp(-((u - 30) ** 2 + (v - 30) ** 2) / 200) + 12 * np.exp(-((u - 55) ** 2 + (v - 32) ** 2) / 150)
    channels, small = raised(view, {YELLOW: height.astype(np.uint8)})
    regions = find_regions(channels, small)
    check(regions, channels, small)
    levels, areas = columns(regions, 'level', 'area').T
    counts = np.bincount(levels, minlength=14).tolist()
    assert counts[0] == 0
    assert counts[1] == 1
    assert max(counts) == 2
    for index in range(len(regions)):
        parent = np.flatnonzero(
            (columns(regions, 'level', 'area') == columns(regions, 'parent_level', 'parent_area')[index]).all(axis=1)
        )
        assert len(parent) == (levels[index] > 1)
        for other in parent:
            assert areas[other] > areas[index]
            assert pixels_of(regions, channels, other)[pixels_of(regions, channels, index)].all()


@pytest.mark.parametrize('flipped', [np.s_[:, ::-1], np.s_[::-1]], ids=['left and right', 'above and below'])
def test_mirrored_heights_have_mirrored_regions(view: View, flipped: Tuple[slice, ...]) -> None:
    """Whichever run of pixels comes first."""
    height = hills(5, 60, 90, 12, 2.0)

    def rows(height: np.ndarray, back: bool) -> List[List[int]]:
        regions = find_regions(*raised(view, {YELLOW: height}))
        assert len(regions) > 30
        left, top, wide, tall = columns(regions, 'left', 'top', 'width', 'height').T
        if back and flipped == np.s_[:, ::-1]:
            left = 90 - left - wide
        elif back:
            top = 60 - top - tall
        others = columns(regions, 'level', 'since', 'area', 'part', 'parent_area', 'double_area', 'double_level')
        return sorted(np.column_stack([left, top, wide, tall, others]).tolist())

    assert rows(np.ascontiguousarray(height[flipped]), back=True) == rows(height, back=False)
    assert rows(np.ascontiguousarray(height[flipped]), back=False) != rows(height, back=False)


# Pictures


@pytest.mark.parametrize('value', [0, 1, 128, 255])
@pytest.mark.parametrize('size', SIZES, ids='%dx%d'.__mod__)
def test_a_flat_picture_has_no_regions(value: int, size: Tuple[int, int]) -> None:
    calibration = calibration_of(Camera().resized(*size))
    regions, channels, view = seen(np.full((size[1], size[0], 3), value, np.uint8), calibration)
    assert len(regions) == 0
    assert regions.table.dtype == np.int32
    check(regions, channels, view)


@pytest.mark.parametrize('camera', [Camera(), Camera(roll=3.0)], ids=['as it is', 'rolled'])
def test_noise_breaks_nothing(camera: Camera) -> None:
    noise = np.random.RandomState(0).randint(0, 256, (480, 640, 3)).astype(np.uint8)
    blurred = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 7), None, 0, 255, cv2.NORM_MINMAX)
    for picture in (noise, blurred):
        regions, channels, view = seen(picture, calibration_of(camera))
        assert len(regions) > 50
        check(regions, channels, view)


@pytest.mark.parametrize('size', SIZES[:2], ids='%dx%d'.__mod__)
def test_a_drawn_duckie_and_a_drawn_cone_are_regions_of_their_size(size: Tuple[int, int]) -> None:
    calibration = calibration_of(Camera().resized(*size))
    things = (duckie(0.4, 0.03), cone(0.45, -0.06))
    regions, channels, view = seen(picture_of(calibration, things), calibration)
    check(regions, channels, view)
    for thing, channel in zip(things, (YELLOW, RED)):
        without = picture_of(calibration, tuple(other for other in things if other is not thing))
        change = np.abs(
            working_picture(picture_of(calibration, things), view).astype(int) - working_picture(without, view)
        )
        expected = np.array(box_of(change.max(axis=2) > 40))
        of_channel = regions.box[columns(regions, 'channel')[:, 0] == channel]
        assert np.abs(of_channel - expected).max(axis=1).min() <= 3, expected


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
    size = view.foot - view.top if 0 < view.foot - view.top < 8 else 8
    above, on = ((100, view.foot - size + lower, 8, size) for lower in (0, 1))
    assert above[1] >= view.top, 'the rows above the road are looked at'
    assert len(found_on(view, (above, DUCKIE))) == 0
    assert on in boxes(found_on(view, (on, DUCKIE)), YELLOW)


@pytest.mark.parametrize('calibration', list(STEEP.values()), ids=list(STEEP))
def test_a_steep_camera_sees_a_duckie_at_a_metre(calibration: Calibration) -> None:
    """Whose feet are higher in the picture than any thing's of a camera that looks ahead."""
    view = make_view(calibration)
    foot = row_of(view, 1.0)
    assert foot + 1 < 75 / 240 * view.height
    for width in (6, 9):  # 5 cm at a metre, about
        box = (110, foot - 6, width, 7)
        assert box in boxes(found_on(view, (box, DUCKIE)), YELLOW)


def test_a_drawn_duckie_at_a_metre_is_a_region_of_a_steep_camera() -> None:
    calibration = STEEP['pitched by 25 degrees']
    regions, _, view = seen(picture_of(calibration, (duckie(1.0, 0.0),)), calibration)
    foot = row_of(view, 1.0 - 0.02)
    left, top, width, height = regions.box[columns(regions, 'channel')[:, 0] == YELLOW].T
    middle, low = left + width / 2, top + height - 1
    assert ((np.abs(middle - view.width / 2) < 5) & (np.abs(low - foot) <= 2) & (height >= 4)).any()


def test_a_camera_that_looks_at_its_feet_leaves_nothing_out() -> None:
    """All its rows are nearer than anything is too far away."""
    view = make_view(calibration_of(Camera(pitch=55.0)))
    assert (view.top, view.foot) == (0, 0)
    box = (100, 0, 12, 12)
    assert box in boxes(found_on(view, (box, DUCKIE)), YELLOW)


# Paint, and a cone's white band


def row_of(view: View, ahead: float, height: float = 0.0) -> int:
    """Row of a point so many metres ahead of the robot and above the road: it hides the road behind it."""
    behind = (ahead - view.camera.ahead) * view.camera.height / (view.camera.height - height) + view.camera.ahead
    return int(np.abs(view.nearness[:, view.width // 2] - 1 / behind).argmin())


def width_of(view: View, row: int, metres: float) -> int:
    """[px] of so much road across the middle of a row."""
    middle = view.width // 2
    across = abs(view.bearing[row, middle + 5] - view.bearing[row, middle - 5]) / 10
    return round(float(metres * view.nearness[row, middle] / across))


def test_dashes_are_regions_of_the_channel_with_paint_only(view: View) -> None:
    ahead = 1 / np.maximum(view.nearness, 1e-3)
    on = (np.abs(view.bearing * ahead - 0.1) < 0.012) & (view.nearness > 0.4) & (np.mod(ahead, 0.073) >= 0.025)
    picture = road(view)
    picture[on] = road(view, ((0, 0, 1, 1), DUCKIE))[0, 0]
    regions = find_regions(channels_of(picture, LIGHT, view), view)
    assert len(boxes(regions, YELLOW)) >= 3
    assert not boxes(regions, WIDE)


@pytest.mark.parametrize('ahead', [0.25, 0.4, 0.6, 0.8])
def test_a_cone_with_a_white_band_is_one_region(view: View, ahead: float) -> None:
    """6 cm high; its band reaches from 0.45 to 0.65 of that."""
    foot, low, high, top = (row_of(view, ahead, share * 0.06) for share in (0.0, 0.45, 0.65, 1.0))
    width = width_of(view, foot, 0.03)
    whole = (110, top, width, foot - top)
    regions = found_on(view, (whole, ORANGE), ((110, high, width, low - high), WHITE))
    assert near(boxes(regions, JOINED), whole)
    assert not near(boxes(regions, RED), whole)
    assert near(boxes(regions, RED), (110, low, width, foot - low))


def test_cones_side_by_side_are_two_regions(view: View) -> None:
    cones = (90, 90, 16, 24), (108, 90, 16, 24)
    assert boxes(found_on(view, *((box, ORANGE) for box in cones)), JOINED) == sorted(cones)


def test_what_is_whole_is_the_same_joined(view: View) -> None:
    regions = found_on(view, ((90, 90, 24, 30), ORANGE))
    rows: Dict[int, Set[Tuple[int, ...]]] = {RED: set(), JOINED: set()}
    for row in columns(regions, 'channel', 'level', 'since', 'left', 'top', 'width', 'height', 'area').tolist():
        if row[0] in rows:
            rows[row[0]].add(tuple(row[1:]))
    assert len(rows[RED]) == 1
    assert rows[RED] == rows[JOINED]
