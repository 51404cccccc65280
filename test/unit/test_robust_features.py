"""core.detection.robust.features: what is measured on a region."""

import math
from dataclasses import replace
from typing import Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np
import pytest
from skimage.measure import label

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.channels import (
    BLUELESS,
    CHANNELS,
    COLORS,
    DARK,
    DIRECTIONS,
    FAINT,
    RED,
    SUMS,
    UNIT,
    WIDE,
    YELLOW,
    Channels,
    channels_of,
)
from obst_avoid.core.detection.robust.features import (
    AROUND,
    AROUND_CELLS,
    CELLS,
    DIFFERENCE,
    EVEN,
    GROWN,
    NAMES,
    NO_LINE,
    NOTHING,
    OWN_CELLS,
    OWN_GROWN,
    QUICK,
    measure,
    measure_all,
)
from obst_avoid.core.detection.robust.light import LINEAR, estimate_light
from obst_avoid.core.detection.robust.lines import Line, find_lines
from obst_avoid.core.detection.robust.regions import AT, Regions, find_regions
from obst_avoid.core.detection.robust.view import View, make_view, working_picture
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

Box = Tuple[int, int, int, int]
CAMERA = calibration_of(Camera())
BOX = (100, 60, 24, 24)
"""Left, top, width, height from the view's first row on: a cell of its colours is 6 by 6 pixels."""
NEAR = {'rtol': 1e-5, 'atol': 1e-5}
"""Measurements are float32."""


@pytest.fixture(scope='module')
def view() -> View:
    """Of a camera without roll or yaw."""
    return make_view(CAMERA)


def made(view: View, heights: Dict[int, np.ndarray], planes: Optional[np.ndarray] = None) -> Channels:
    """Channels of given heights, all others flat, over given colours and edges, in steps of 1 / UNIT octaves."""
    rows, columns = view.height - view.top, view.width
    stack = np.zeros((CHANNELS, rows, columns), np.uint8)
    for channel, height in heights.items():
        stack[channel] = height
    sums = np.zeros((rows + 1, columns + 1, SUMS), np.int32)
    if planes is not None:
        sums[1:, 1:, : planes.shape[2]] = planes.cumsum(axis=0).cumsum(axis=1)
    return Channels(stack, sums)


def field(view: View, *boxes: Tuple[Box, int]) -> np.ndarray:
    """Nothing but boxes, left, top, width, height, of so many levels, one over the other."""
    height = np.zeros((view.height - view.top, view.width), np.uint8)
    for (left, top, width, tall), value in boxes:
        height[top : top + tall, left : left + width] = value
    return height


def of_size(view: View, rows: int, columns: int) -> View:
    """A view of all of so large a picture."""
    return replace(view, top=0, foot=0, height=rows, width=columns)


def anything(view: View, seed: int = 0, most: int = 500) -> np.ndarray:
    """(R, W, 7) random colours and edges, each pixel's its own and on the whole different from place to place."""
    random = np.random.RandomState(seed)
    shape = view.height - view.top, view.width
    coarse = random.randint(-most, most, (shape[0] // 5 + 1, shape[1] // 5 + 1, 7)).repeat(5, axis=0).repeat(5, axis=1)
    planes = coarse[: shape[0], : shape[1]] + random.randint(-9, 10, (*shape, 7))
    planes[..., 3:] = np.abs(planes[..., 3:])
    return planes


def hills(view: View, seed: int, size: float = 3.0) -> np.ndarray:
    """Nine levels of hills and valleys, about half of the picture flat."""
    noise = np.random.RandomState(seed).randn(view.height - view.top, view.width)
    noise = cv2.GaussianBlur(noise, (0, 0), size)
    return np.clip(noise / noise.max() * 9 + 0.5, 0, 9).astype(np.uint8)


def rows_of(channels: Channels, view: View, lines: Sequence[Line] = ()) -> List[Dict[str, float]]:
    """Everything that is measured, by name, with the region's numbers under table_ names."""
    regions = find_regions(channels, view)
    values = measure(regions, np.arange(len(regions)), measure_all(regions, channels, view), channels, view, lines)
    found = [dict(zip(NAMES, row)) for row in values.tolist()]
    for row, table in zip(found, regions.table.tolist()):
        row.update({'table_' + name: table[index] for name, index in AT.items()})
    return found


def row_of(channels: Channels, view: View, box: Optional[Box] = None, lines: Sequence[Line] = ()) -> Dict[str, float]:
    """The same of the only region, or of the one with a box."""
    found = rows_of(channels, view, lines)
    names = ['table_' + name for name in ('left', 'top', 'width', 'height')]
    (row,) = (row for row in found if box is None or tuple(row[name] for name in names) == box)
    return row


def mask_of(channels: Channels, row: Dict[str, float]) -> np.ndarray:
    """The region's pixels, by its channel, level, box and area."""
    labels = label(channels.heights[int(row['channel'])] >= row['level'], connectivity=1)
    left, top, width, height = (int(row['table_' + name]) for name in ('left', 'top', 'width', 'height'))
    inside = np.zeros(labels.shape, bool)
    inside[top : top + height, left : left + width] = True
    numbers = np.unique(labels[inside & (labels > 0)])
    for number in numbers:
        mask = labels == number
        v, u = np.nonzero(mask)
        if (u.min(), v.min(), u.max() - u.min() + 1, v.max() - v.min() + 1) == (left, top, width, height):
            return mask
    raise AssertionError(row)


def measured(picture: np.ndarray, calibration: Calibration = CAMERA) -> Tuple[Regions, np.ndarray, View]:
    """Regions of a camera picture and everything that is measured on them."""
    view = make_view(calibration)
    light = estimate_light(picture)
    channels = channels_of(working_picture(picture, view), light, view)
    regions = find_regions(channels, view)
    lines = find_lines(picture, view.sampling, light.as_array())
    quick = measure_all(regions, channels, view)
    return regions, measure(regions, np.arange(len(regions)), quick, channels, view, lines), view


def column(values: np.ndarray, name: str) -> np.ndarray:
    """One measurement of all regions."""
    return values[:, NAMES.index(name)]


def grid(row: Dict[str, float], name: str, cells: int) -> np.ndarray:
    """(cells, cells) of one region."""
    return np.array([[row['%s%d%d' % (name, i, j)] for j in range(cells)] for i in range(cells)])


# Names, and pictures with hardly anything in them


def test_each_column_has_a_name_of_its_own(view: View) -> None:
    assert len(set(NAMES)) == len(NAMES)
    assert NAMES[: len(QUICK)] == QUICK
    channels = made(view, {YELLOW: hills(view, 0)}, anything(view))
    regions = find_regions(channels, view)
    quick = measure_all(regions, channels, view)
    assert len(regions) > 10
    assert quick.shape == (len(regions), len(QUICK))
    assert quick.dtype == np.float32
    values = measure(regions, np.arange(len(regions)), quick, channels, view, [])
    assert values.shape == (len(regions), len(NAMES))
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values[:, : len(QUICK)], quick)


def test_the_chosen_regions_are_measured_in_their_order(view: View) -> None:
    channels = made(view, {YELLOW: hills(view, 0), RED: hills(view, 1)}, anything(view))
    regions = find_regions(channels, view)
    quick = measure_all(regions, channels, view)
    every = measure(regions, np.arange(len(regions)), quick, channels, view, [line(0.1)])
    for chosen in ([], [3], [5, 0, 7, 5, len(regions) - 1]):
        some = measure(regions, np.array(chosen, dtype=int), quick, channels, view, [line(0.1)])
        assert some.shape == (len(chosen), len(NAMES))
        np.testing.assert_array_equal(some, every[chosen])


@pytest.mark.parametrize('value', [0, 128, 255])
def test_no_region_is_no_row(value: int) -> None:
    regions, values, _ = measured(np.full((480, 640, 3), value, np.uint8))
    assert len(regions) == 0
    assert values.shape == (0, len(NAMES))
    assert values.dtype == np.float32


def blotches(seed: int, size: Tuple[int, int] = (640, 480)) -> np.ndarray:
    """Coloured noise of the size of things."""
    noise = np.random.RandomState(seed).randint(0, 256, (size[1], size[0], 3)).astype(np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), size[0] / 90), None, 0, 255, cv2.NORM_MINMAX)


@pytest.mark.parametrize('size', [(320, 240), (640, 480)], ids='%dx%d'.__mod__)
@pytest.mark.parametrize(
    'what', ['noise', 'blotches', 'dark blotches', 'black but for a corner', 'white but for a corner']
)
def test_all_values_are_finite(what: str, size: Tuple[int, int]) -> None:
    calibration = calibration_of(Camera(roll=2.0).resized(*size))
    picture = blotches(1, size)
    if what == 'noise':
        picture = np.random.RandomState(0).randint(0, 256, (size[1], size[0], 3)).astype(np.uint8)
    elif what == 'dark blotches':
        picture = (picture // 40).astype(np.uint8)
    elif 'corner' in what:
        picture = np.full((size[1], size[0], 3), 0 if 'black' in what else 255, np.uint8)
        picture[-size[1] // 4 :, : size[0] // 5] = (0, 200, 250)
        picture[-size[1] // 3 :, -size[0] // 5 :] = (0, 80, 250)
    regions, values, _ = measured(picture, calibration)
    assert len(regions) > 0
    assert np.isfinite(values).all()


# Form


def test_a_form_by_hand(view: View) -> None:
    """An L with feet of 6 by 4 and a stem of 6 by 8, two levels above a plateau, with a part of 9 pixels."""
    height = field(view, ((90, 50, 40, 30), 2), ((100, 60, 12, 8), 4), ((106, 60, 6, 4), 2), ((101, 61, 3, 3), 7))
    row = row_of(made(view, {RED: height}), view, (100, 60, 12, 8))
    area = 6 * 8 + 6 * 4
    u, v = (48 * 102.5 + 24 * 108.5) / area, (48 * 63.5 + 24 * 65.5) / area
    expected = {
        'channel': RED,
        'level': 4,
        'alive': 2,
        'aspect': 12 / 8,
        'fill': area / 96,
        'pixels_across': 12,
        'pixels_up': 8,
        'off_middle': abs((u - 100) / 12 - 0.5),
        'low_middle': (v - 60) / 8,
        'part': 9 / area,
    }
    assert {name: row[name] for name in expected} == pytest.approx(expected)


def test_a_plateau_is_alive_since_the_ground(view: View) -> None:
    row = row_of(made(view, {RED: field(view, (BOX, 5))}), view)
    assert (row['level'], row['alive'], row['part']) == (5, 5, 0)


def test_what_a_region_is_part_of_by_hand(view: View) -> None:
    """Areas 48, 60 and 200: the parent is less than twice as large."""
    height = field(view, ((100, 60, 20, 10), 2), ((103, 62, 10, 6), 4), ((104, 62, 8, 6), 9))
    channels = made(view, {RED: height})
    row = row_of(channels, view, (104, 62, 8, 6))
    expected = {
        'levels': (9 - 4, 9 - 2),
        'area': (60 / 48, 200 / 48),
        'width': (10 / 8, 20 / 8),
        'height': (1, 10 / 6),
        'foot': (0, (70 - 68) / 6),
        'top': (0, (62 - 60) / 6),
    }
    for name, (parent, double) in expected.items():
        assert row['parent_' + name] == pytest.approx(parent), name
        assert row['double_' + name] == pytest.approx(double), name
    row = row_of(channels, view, (103, 62, 10, 6))
    assert row['parent_area'] == row['double_area'] == pytest.approx(200 / 60)
    row = row_of(channels, view, (100, 60, 20, 10))
    assert {row[who + name] for who in ('parent_', 'double_') for name in expected} == {NOTHING}


def test_only_what_is_there_is_nothing_to_the_double(view: View) -> None:
    row = row_of(made(view, {RED: field(view, ((100, 60, 10, 10), 1), ((100, 60, 8, 10), 2))}), view, (100, 60, 8, 10))
    assert row['parent_area'] == pytest.approx(100 / 80)
    assert row['double_area'] == row['double_levels'] == NOTHING


@pytest.mark.parametrize(
    'box, cut',
    [
        pytest.param((1, 1, 12, 12), '', id='a pixel inside'),
        pytest.param((0, 30, 12, 12), 'side', id='left'),
        pytest.param((228, 30, 12, 12), 'side', id='right'),
        pytest.param((227, 30, 12, 12), '', id='a pixel from the right'),
        pytest.param((30, -12, 12, 12), 'low', id='low'),
        pytest.param((30, -13, 12, 12), '', id='a pixel from below'),
        pytest.param((30, 0, 12, 12), 'top', id='top'),
        pytest.param((0, -12, 12, 12), 'side low', id='in a corner'),
    ],
)
def test_what_is_cut_is_marked(view: View, box: Box, cut: str) -> None:
    left, top, width, height = box
    box = left, top % (view.height - view.top), width, height
    row = row_of(made(replace(view, foot=view.top), {YELLOW: field(view, (box, 1))}), replace(view, foot=view.top))
    assert {end: row['cut_' + end] for end in ('side', 'low', 'top')} == {
        end: float(end in cut.split()) for end in ('side', 'low', 'top')
    }


# On the road


def on_road(row: Dict[str, float], view: View) -> Dict[str, float]:
    """By definition: its lowest row is its foot."""

    def limited(value: float, low: float, high: float) -> float:
        return min(max(value, low), high)

    left, width = int(row['table_left']), int(row['table_width'])
    head = int(row['table_top']) + view.top
    foot, middle = head + int(row['table_height']) - 1, min(left + width // 2, view.width - 2)
    there, above = float(view.nearness[foot, middle]), float(view.nearness[head, middle])
    ahead = 1 / limited(there, 0.2, 20)
    right = min(left + width, view.width - 1)
    across = abs(float(view.bearing[foot, left]) - float(view.bearing[foot, right])) * ahead
    rise = 1 - limited(above / max(there, 1e-3), -2, 1)
    return {
        'ahead': ahead,
        'aside': abs(float(view.bearing[foot, middle])) * ahead,
        'width': across,
        'rise': rise,
        'rise_to_width': max(rise, 0.01) / max(across, 0.001),
        'length': limited(1 / limited(above, 0.2, 20) - ahead, 0.001, 5),
    }


@pytest.mark.parametrize('most', [1.0, 4.0, 40.0])
def test_sizes_are_looked_up_at_foot_and_head(view: View, most: float) -> None:
    """In a picture in which every pixel lies somewhere else, beyond all limits too."""
    random = np.random.RandomState(0)
    shape = view.height, view.width
    tangled = replace(
        view,
        nearness=random.uniform(-0.2 * most, most, shape).astype(np.float32),
        bearing=random.uniform(-2, 2, shape).astype(np.float32),
    )
    rows = rows_of(made(view, {YELLOW: hills(view, 2), DARK: hills(view, 3, 2.0)}), tangled)
    assert len(rows) > 100
    for row in rows:
        expected = on_road(row, tangled)
        assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-5)


def test_the_middle_of_what_is_at_the_right_is_a_pixel_inside(view: View) -> None:
    """At its edge a lens may see nothing of the road."""
    odd = np.ones((view.height, view.width), np.float32)
    odd[:, -2] = 2.0
    odd[:, -1] = 9.0
    row = row_of(made(view, {YELLOW: field(view, ((view.width - 2, 60, 2, 5), 1))}), replace(view, nearness=odd))
    assert row['ahead'] == 0.5


@pytest.mark.parametrize('x, y', [(0.3, 0.0), (0.4, 0.06), (0.6, -0.1), (0.8, 0.0)])
def test_a_drawn_duckie_is_as_large_as_it_is(x: float, y: float) -> None:
    thing = duckie(x, y, 0.06)
    picture = picture_of(CAMERA, (thing,))
    regions, values, view = measured(picture)
    row = dict(zip(NAMES, values[best(regions, picture, picture_of(CAMERA), view)].tolist()))
    assert row['ahead'] == pytest.approx(x, rel=0.08)
    assert row['aside'] == pytest.approx(abs(y), abs=0.015)
    pixel = x / (Camera().projection[0] * view.width / Camera().width)
    assert row['width'] == pytest.approx(2 * thing.radius, abs=1.5 * pixel)
    assert row['rise'] == pytest.approx(0.06 / Camera().height, rel=0.3)


def best(regions: Regions, picture: np.ndarray, without: np.ndarray, view: View, channel: Optional[int] = None) -> int:
    """The region that covers best where two pictures differ, by intersection over union."""
    change = np.abs(working_picture(picture, view).astype(int) - working_picture(without, view)).max(axis=2) > 40
    v, u = np.nonzero(change)
    low, high = np.array([u.min(), v.min()]), np.array([u.max() + 1, v.max() + 1])
    corners = regions.box[:, :2] + regions.box[:, 2:]
    common = np.prod(np.maximum(np.minimum(corners, high) - np.maximum(regions.box[:, :2], low), 0), axis=1)
    ratio = common / (np.prod(regions.box[:, 2:], axis=1) + np.prod(high - low) - common)
    if channel is not None:
        ratio[regions.table[:, AT['channel']] != channel] = -1
    assert ratio.max() > 0.6
    return int(np.argmax(ratio))


# Colours


def test_colours_are_means_over_the_region_in_octaves(view: View) -> None:
    channels, planes = made(view, {YELLOW: hills(view, 4), RED: hills(view, 5)}, anything(view)), anything(view)
    rows = rows_of(channels, view)
    assert len(rows) > 50
    for row in rows:
        mask = mask_of(channels, row)
        for index, name in enumerate(COLORS):
            assert row[name] == pytest.approx(planes[mask, index].mean() / UNIT, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize('box', [BOX, (101, 61, 7, 5), (0, 30, 9, 9), (231, 128, 9, 12), (60, 0, 20, 30)], ids=str)
def test_the_ring_is_half_a_size_on_each_side(view: View, box: Box) -> None:
    """Rounded up, and cut where the picture ends; a form with a notch has some of it in its box."""
    left, top, width, height = box
    low = replace(view, foot=view.top)
    shape = field(view, (box, 3), ((left + width // 2, top, 2, 2), 0))
    planes = anything(view, 1)
    row = row_of(made(low, {YELLOW: shape}, planes), low, box)
    v, u = np.mgrid[0 : len(shape), 0 : view.width]
    aside, above = (width + 1) // 2, (height + 1) // 2
    ring = (u >= left - aside) & (u < left + width + aside) & (v >= top - above) & (v < top + height + above)
    ring &= shape == 0
    for index, name in enumerate(COLORS):
        expected = (planes[ring, index].mean() - planes[shape > 0, index].mean()) / UNIT
        assert row['ring_' + name] == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_what_fills_the_picture_has_no_ring(view: View) -> None:
    small = of_size(view, 20, 30)
    row = row_of(made(small, {YELLOW: field(small, ((0, 0, 30, 20), 3))}, anything(small)), small)
    for name in COLORS:
        assert row['ring_' + name] == -row[name]


def test_colours_are_those_of_the_thing() -> None:
    picture = np.full((480, 640, 3), 90, np.uint8)
    color = np.array([70, 180, 240])
    picture[304:384, 280:360] = color
    regions, values, _ = measured(picture)
    row = dict(zip(NAMES, values[np.flatnonzero(regions.table[:, AT['channel']] == YELLOW)[0]].tolist()))
    blue, green, red = LINEAR[color] / LINEAR[90] + FAINT
    both = math.sqrt(green * red)
    asphalt = math.log2(1 + FAINT)
    assert row['brightness'] == pytest.approx(np.log2(both), abs=0.1)
    assert row['green'] == pytest.approx(np.log2(green / red), abs=0.1)
    assert row['blue'] == pytest.approx(np.log2(blue / both), abs=0.15)
    assert row['ring_brightness'] == pytest.approx(asphalt - row['brightness'], abs=0.1)
    assert row['ring_green'] == pytest.approx(-row['green'], abs=0.1)
    assert row['ring_blue'] == pytest.approx(-row['blue'], abs=0.1)
    assert grid(row, 'brightness', CELLS)[2:4, 2:4] == pytest.approx(np.zeros((2, 2)), abs=0.1)
    assert grid(row, 'around_brightness', AROUND_CELLS)[0] == pytest.approx(asphalt - row['brightness'], abs=0.1)
    assert grid(row, 'around_blue', AROUND_CELLS)[0] == pytest.approx(-row['blue'], abs=0.1)
    assert grid(row, 'own', 5)[1:4, 1:4].tolist() == np.ones((3, 3)).tolist()


@pytest.mark.parametrize('gains', [(0.6, 0.6, 0.6), (0.5, 0.8, 1.0), (1.0, 0.8, 0.55)])
def test_another_light_changes_no_colour(gains: Tuple[float, float, float]) -> None:
    """Light times a factor a channel, where nothing is clipped: colours and the form of the thing stay."""
    things = (duckie(0.4, 0.0, 0.06), cone(0.5, -0.2, 0.06))

    def lit(picture: np.ndarray) -> np.ndarray:
        light = LINEAR[picture] * 0.9 * np.array(gains, np.float32)
        return np.clip(np.rint(256 * light ** (1 / 2.2) - 1), 0, 255).astype(np.uint8)

    picture = picture_of(CAMERA, things)
    (regions, values, view), (others, there, _) = measured(picture), measured(lit(picture))
    for thing, channel in ((things[0], YELLOW), (things[1], RED), (things[0], BLUELESS)):
        without = picture_of(CAMERA, tuple(one for one in things if one is not thing))
        here = best(regions, picture, without, view, channel)
        other = best(others, picture, without, view, channel)
        assert np.abs(others.box[other] - regions.box[here]).max() <= 2
        for name in (*COLORS, 'green22', 'brightness22', 'around_brightness33'):
            assert column(there, name)[other] == pytest.approx(column(values, name)[here], abs=0.3), name


# Cells


def cells_of(low: int, size: int, grid: int, across: float, count: int, most: int) -> List[slice]:
    """By definition: equal parts of so many grids across about the middle, at least a pixel and in the picture."""
    at = [math.floor(low + size / 2 + grid * ((k / count - 0.5) * across) + 0.5) for k in range(count + 1)]
    found = []
    for one, other in zip(at, at[1:]):
        first = min(max(one, 0), most - 1)
        found.append(slice(first, max(min(max(other, 0), most), first + 1)))
    return found


def means_of(plane: np.ndarray, box: Box, count: int, across: float, grid: Tuple[int, int]) -> np.ndarray:
    """(count, count) means over cells, rows first, in octaves."""
    columns = cells_of(box[0], box[2], grid[0], across, count, plane.shape[1])
    rows = cells_of(box[1], box[3], grid[1], across, count, plane.shape[0])
    return np.array([[plane[row, column].mean() for column in columns] for row in rows]) / UNIT


def test_cells_by_hand(view: View) -> None:
    """From 6 pixels before a box of 24 to 6 behind it."""
    planes = anything(view, 2, most=200)
    row = row_of(made(view, {YELLOW: field(view, (BOX, 3))}, planes), view)
    for index, name in enumerate(COLORS):
        found = grid(row, name, 6)
        for i in range(6):
            for j in range(6):
                cell = planes[54 + 6 * i : 60 + 6 * i, 94 + 6 * j : 100 + 6 * j, index]
                assert found[i, j] == pytest.approx(min(max(cell.mean() / 64 - row[name], -4), 4), abs=1e-5)
        assert len(np.unique(found)) > 30


def test_surroundings_by_hand(view: View) -> None:
    """3.4 times the longer side, 35, in seven cells of 17 pixels; a box of 21 rows begins at a whole one."""
    planes = anything(view, 3, most=200)
    row = row_of(made(view, {YELLOW: field(view, ((100, 60, 35, 21), 3))}, planes), view)
    for index, name in ((0, 'brightness'), (2, 'blue')):
        found = grid(row, 'around_' + name, 7)
        for i in range(7):
            for j in range(7):
                cell = planes[11 + 17 * i : 28 + 17 * i, 58 + 17 * j : 75 + 17 * j, index]
                assert found[i, j] == pytest.approx(min(max(cell.mean() / 64 - row[name], -4), 4), abs=1e-5)
    assert (100 + 17.5 - 59.5, 60 + 10.5 - 59.5) == (58, 11)


BOXES = [
    BOX,
    (100, 60, 23, 17),
    (101, 63, 14, 31),
    (80, 70, 3, 3),
    (80, 70, 2, 7),
    (0, 0, 4, 4),
    (0, 50, 30, 20),
    (236, 136, 4, 4),
    (200, 90, 40, 50),
    (61, 0, 110, 140),
]
"""Odd ones, tiny ones whose cells are less than a pixel, at edges, and nearly as large as the picture."""


@pytest.mark.parametrize('box', BOXES, ids=str)
def test_cells_are_those_of_the_definition(view: View, box: Box) -> None:
    low = replace(view, foot=view.top)
    planes = anything(view, 4)
    row = row_of(made(low, {YELLOW: field(view, (box, 3))}, planes), low)
    for index, name in enumerate(COLORS):
        expected = np.clip(means_of(planes[..., index], box, 6, 1.5, box[2:]) - row[name], -DIFFERENCE, DIFFERENCE)
        np.testing.assert_allclose(grid(row, name, 6), expected, **NEAR)
    edges = np.array([means_of(planes[..., 3 + direction], box, 6, 1.5, box[2:]) for direction in range(4)])
    assert row['steepness'] == pytest.approx(edges.sum(axis=0).mean(), rel=1e-5)
    for direction in range(DIRECTIONS):
        shares = edges[direction] / (edges.sum(axis=0).mean() + EVEN)
        np.testing.assert_allclose(grid(row, 'edge%d_' % direction, 6), shares, **NEAR)
    square = max(box[2:]), max(box[2:])
    for index, name in ((0, 'brightness'), (2, 'blue')):
        expected = np.clip(means_of(planes[..., index], box, 7, 3.4, square) - row[name], -DIFFERENCE, DIFFERENCE)
        np.testing.assert_allclose(grid(row, 'around_' + name, 7), expected, **NEAR)
    assert (CELLS, 1 + 2 * GROWN, AROUND_CELLS, AROUND) == (6, 1.5, 7, 3.4)


def test_differences_end_where_colours_are_simply_different(view: View) -> None:
    planes = np.zeros((view.height - view.top, view.width, 3), dtype=int)
    left, top, width, height = BOX
    planes[:, : left + 12, 0] = 500
    planes[:, left + 12 :, 0] = -500
    row = row_of(made(view, {YELLOW: field(view, (BOX, 3))}, planes), view)
    assert row['brightness'] == 0
    for cells, name in ((CELLS, 'brightness'), (AROUND_CELLS, 'around_brightness')):
        assert (grid(row, name, cells)[:, :3] == DIFFERENCE).all()
        assert (grid(row, name, cells)[:, -3:] == -DIFFERENCE).all()


# Silhouette


def own_of(mask: np.ndarray, row: Dict[str, float]) -> np.ndarray:
    """(10, 10) of which points of a grid over the box, grown by 0.3 of it on each side, lie in it."""
    left, top, width, height = (int(row['table_' + name]) for name in ('left', 'top', 'width', 'height'))
    own = np.zeros((10, 10), bool)
    for j in range(10):
        for i in range(10):
            u = math.floor(left + width * ((i + 0.5) / 10 * 1.6 - 0.3))
            v = math.floor(top + height * ((j + 0.5) / 10 * 1.6 - 0.3))
            own[j, i] = 0 <= u < mask.shape[1] and 0 <= v < mask.shape[0] and mask[v, u]
    return own


def test_a_square_has_the_silhouette_of_one(view: View) -> None:
    row = row_of(made(view, {YELLOW: field(view, ((100, 60, 20, 20), 3))}), view)
    expected = np.zeros((5, 5))
    expected[1:4, 1:4] = 1
    assert grid(row, 'own', 5).tolist() == expected.tolist()
    assert [row['row%d' % i] for i in range(6)] == pytest.approx([0.6] * 6)
    assert row['lean'] == 0


def test_a_slanting_stem_leans(view: View) -> None:
    """Five pixels of twenty wide, from the upper left to the lower right: three columns of ten from row to row."""
    height = field(view, *(((100 + 15 * i // 19, 60 + i, 5, 1), 3) for i in range(20)))
    row = row_of(made(view, {YELLOW: height}), view)
    own = own_of(height > 0, row)
    rows = own[2:8, 2:8]
    assert [row['row%d' % i] for i in range(6)] == pytest.approx(own[2:8].mean(axis=1))
    first, last = (np.flatnonzero(one).mean() for one in (rows[0], rows[5]))
    assert last - first > 3
    assert row['lean'] == pytest.approx(last - first)
    mirrored = row_of(made(view, {YELLOW: np.ascontiguousarray(height[:, ::-1])}), view)
    assert mirrored['lean'] == pytest.approx(row['lean'], abs=0.51)


@pytest.mark.parametrize('seed', [6, 7])
def test_silhouettes_are_those_of_the_definition(view: View, seed: int) -> None:
    """With their parts and without what they are part of, at the picture's edges too."""
    low = replace(view, foot=view.top)
    channels = made(low, {YELLOW: hills(view, seed), WIDE: hills(view, seed, 4.0), DARK: hills(view, seed + 9, 1.5)})
    rows = rows_of(channels, low)
    assert len(rows) > 150
    assert sum(row['cut_side'] + row['cut_low'] + row['cut_top'] > 0 for row in rows) > 20
    for row in rows:
        mask = mask_of(channels, row)
        own = own_of(mask, row)
        np.testing.assert_allclose(grid(row, 'own', 5), own.reshape(5, 2, 5, 2).mean(axis=(1, 3)))
        np.testing.assert_allclose([row['row%d' % i] for i in range(6)], own[2:8].mean(axis=1), rtol=1e-6)
        first, last = (np.flatnonzero(one).mean() if one.any() else 0 for one in (own[2, 2:8], own[7, 2:8]))
        assert row['lean'] == pytest.approx(abs(first - last), abs=1e-6)
    assert (OWN_CELLS, OWN_GROWN) == (10, 0.3)


def test_how_yellow_it_gets_with_and_without_paint(view: View) -> None:
    """Where it is, not beside it."""
    beside = 110, 60, 3, 10
    yellow = field(view, ((100, 60, 20, 20), 6), ((100, 60, 10, 10), 9), (beside, 13), ((118, 78, 2, 2), 15))
    wide = field(view, ((100, 60, 20, 20), 4), (beside, 10), ((118, 78, 2, 2), 12))
    dark = field(view, ((98, 58, 12, 12), 2))
    channels = made(view, {YELLOW: yellow, WIDE: wide, DARK: dark})
    whole = (100, 60, 20, 20)
    rows = {int(row['channel']): row for row in rows_of(channels, view) if row['level'] in (6, 4, 2)}
    assert {channel: (row['table_left'], row['table_top']) for channel, row in rows.items()} == {
        YELLOW: whole[:2],
        WIDE: whole[:2],
        DARK: (98, 58),
    }
    found = {channel: (row['yellow'], row['narrowness'], row['wide']) for channel, row in rows.items()}
    assert found == {YELLOW: (15, 3, 12 - 6), WIDE: (15, 3, 12 - 4), DARK: (9, 5, 4)}


def test_paint_is_narrow_and_a_duckie_is_not() -> None:
    picture = picture_of(CAMERA, (duckie(0.4, 0.0, 0.06),))
    regions, values, view = measured(picture)
    thing = best(regions, picture, picture_of(CAMERA), view, YELLOW)
    assert column(values, 'narrowness')[thing] <= 2
    left, top, width, _ = regions.box.T
    line = (regions.table[:, AT['channel']] == YELLOW) & (left + width < left[thing]) & (top > 0.45 * view.height)
    assert line.sum() >= 2
    assert (column(values, 'narrowness')[line] >= 4).all()


# Edges


@pytest.mark.parametrize('direction', range(DIRECTIONS))
@pytest.mark.parametrize('cell', [0, 2, 5])
def test_an_edge_is_in_its_cell_and_its_direction(view: View, cell: int, direction: int) -> None:
    """3 octaves over 8 pixels on every pixel of one cell of 36."""
    planes = np.zeros((view.height - view.top, view.width, 7), dtype=int)
    planes[54 + 6 * cell : 60 + 6 * cell, 94:100, 3 + direction] = 3 * 64
    row = row_of(made(view, {YELLOW: field(view, (BOX, 3))}, planes), view)
    steepness = 3 / 36
    assert row['steepness'] == pytest.approx(steepness)
    for other in range(DIRECTIONS):
        expected = np.zeros((6, 6))
        expected[cell, 0] = 3 / (steepness + 0.4) if other == direction else 0
        np.testing.assert_allclose(grid(row, 'edge%d_' % other, 6), expected, **NEAR)


def test_what_is_flat_amid_edges_has_none(view: View) -> None:
    """Sums over all of the picture are taken from each other."""
    planes = anything(view, 5)
    planes[54:90, 94:130] = 0
    row = row_of(made(view, {YELLOW: field(view, (BOX, 3))}, planes), view)
    assert row['steepness'] == 0
    assert not any(row[name] for name in NAMES if name.startswith('edge'))


# Mirrored

MIRRORED = {
    **{'own%d%d' % (i, j): 'own%d%d' % (i, 4 - j) for i in range(5) for j in range(5)},
    **{
        '%s%d%d' % (name, i, j): '%s%d%d' % (name, i, CELLS - 1 - j)
        for name in COLORS
        for i in range(CELLS)
        for j in range(CELLS)
    },
    **{
        'around_%s%d%d' % (name, i, j): 'around_%s%d%d' % (name, i, AROUND_CELLS - 1 - j)
        for name in ('brightness', 'blue')
        for i in range(AROUND_CELLS)
        for j in range(AROUND_CELLS)
    },
    **{
        'edge%d_%d%d' % (direction, i, j): 'edge%d_%d%d' % (-direction % DIRECTIONS, i, CELLS - 1 - j)
        for direction in range(DIRECTIONS)
        for i in range(CELLS)
        for j in range(CELLS)
    },
}
"""What a measurement is called in a mirrored picture, where that is another name."""


def test_a_mirrored_picture_gives_mirrored_values() -> None:
    """The middle of the camera's picture is the middle of the camera, so a mirrored picture is of a mirrored road."""
    calibration = calibration_of(Camera(distortion=(-0.2, 0.03, 0.0, 0.0, 0.0)))
    picture = picture_of(calibration, (duckie(0.4, 0.07, 0.06), cone(0.5, -0.12, 0.06)))
    regions, values, view = measured(picture, calibration)
    mirrored, other, _ = measured(np.ascontiguousarray(picture[:, ::-1]), calibration)
    np.testing.assert_allclose(view.nearness, view.nearness[:, ::-1], atol=2e-3)
    order = [NAMES.index(MIRRORED.get(name, name)) for name in NAMES]
    exact = [i for i, name in enumerate(NAMES) if name.startswith(('parent', 'double', 'ring', 'cut'))]
    exact += [NAMES.index(name) for name in (*COLORS, 'aspect', 'fill', 'alive', 'part', 'low_middle')]
    cells = [i for i, name in enumerate(NAMES) if name in MIRRORED]  # of odd sizes they are not symmetric
    road = [NAMES.index(name) for name in ('ahead', 'aside', 'width', 'rise', 'length')]
    differences = []
    kept = [AT[name] for name in ('channel', 'level', 'top', 'width', 'height', 'area')]
    for index in range(len(regions)):
        left, width = regions.table[index, [AT['left'], AT['width']]]
        same = (mirrored.table[:, kept] == regions.table[index, kept]).all(axis=1)
        (there,) = np.flatnonzero(same & (mirrored.table[:, AT['left']] == view.width - left - width))
        difference = np.abs(values[index] - other[there][order])
        assert difference[exact].max() < 1e-3, NAMES[exact[int(np.argmax(difference[exact]))]]
        assert difference[NAMES.index('off_middle')] < 1.01 / width  # counted from pixels' edges
        differences.append(difference)
    assert len(differences) > 20
    table = np.array(differences)
    assert np.median(table[:, cells]) < 0.1
    assert np.median(table[:, road], axis=0).max() < 0.01
    for name in ('lean', 'narrowness', 'wide', 'yellow', 'steepness', 'line_distance'):
        assert np.median(table[:, NAMES.index(name)]) < 0.3, name


# Lines

LINE_NAMES = ('line_distance', 'line_beyond', 'line_width', 'line_blue')
X, Y = 0.4, 0.05
"""[m] ahead and left of a thing's foot."""


def line(
    a: float = 0.0,
    b: float = 0.0,
    c: float = 0.0,
    begin: float = 0.2,
    end: float = 1.0,
    width: float = 0.048,
    blueness: float = 1.0,
) -> Line:
    """A line of white tape to the left of the robot by a, unless said otherwise."""
    nothing = np.zeros(0)
    return Line(a, b, c, np.eye(3) * 1e-6, begin, end, 20, 0.002, width, blueness, 8.0, nothing, nothing)


def circle(x: float, y: float, radius: float) -> Line:
    """A bend about a point of the road. [m]"""
    return line((x**2 + y**2 - radius**2) / (2 * y), -x / y, 1 / y)


def beside(view: View, lines: Sequence[Line], x: float = X, y: float = Y) -> Dict[str, float]:
    """What is measured on a thing with the middle of its foot there, by the calibration."""
    pixel = image_from_rectified(CAMERA, pixel_from_ground(CAMERA.homography, np.array([[x, y]])))[0]
    u, v = np.rint((pixel + 0.5) / view.scale - 0.5).astype(int)
    box = int(u) - 8, int(v) - view.top - 14, 16, 15
    return row_of(made(view, {YELLOW: field(view, (box, 3))}), view, lines=lines)


def test_without_lines_there_is_none_near(view: View) -> None:
    row = beside(view, [])
    assert [row[name] for name in LINE_NAMES] == [NO_LINE] * 4


@pytest.mark.parametrize(
    'tape, distance, beyond',
    [
        pytest.param(line(Y), 0.0, 0.0, id='on it'),
        pytest.param(line(Y - 0.1), 0.1, 0.0, id='10 cm left of it'),
        pytest.param(line(Y + 0.1), 0.1, 0.0, id='10 cm right of it'),
        pytest.param(line(Y, end=X - 0.15), 0.0, 0.15, id='15 cm beyond its end'),
        pytest.param(line(Y, begin=X + 0.1), 0.0, 0.1, id='10 cm before its begin'),
        pytest.param(line(Y, begin=1.0, end=X + 0.1), 0.0, 0.1, id='whose begin is farther than its end'),
        pytest.param(line(Y - 0.1, end=X - 0.15), 0.1, 0.15, id='beside it and beyond its end'),
        pytest.param(line(Y - X + 0.1, 1.0), 0.1 * math.sqrt(0.5), 0.0, id='beside a slanted one'),
        pytest.param(circle(0.2, 0.75, 0.7), math.hypot(X - 0.2, Y - 0.75) - 0.7, 0.0, id='beside a wide bend'),
        pytest.param(circle(0.75, 0.25, 0.36), math.hypot(X - 0.75, Y - 0.25) - 0.36, 0.0, id='outside a narrow bend'),
        pytest.param(circle(0.75, 0.25, 0.44), 0.44 - math.hypot(X - 0.75, Y - 0.25), 0.0, id='inside a narrow bend'),
    ],
)
def test_a_line_is_as_far_as_it_is_on_the_road(view: View, tape: Line, distance: float, beyond: float) -> None:
    """To a pixel, and in bends to the first order."""
    row = beside(view, [tape])
    assert row['line_distance'] == pytest.approx(distance, abs=0.006)
    assert row['line_beyond'] == pytest.approx(beyond, abs=0.01)
    assert (row['line_width'], row['line_blue']) == pytest.approx((0.048, 1.0))


@pytest.mark.parametrize(
    'nearer, other',
    [
        pytest.param(line(Y - 0.04), line(Y + 0.08), id='beside both'),
        pytest.param(line(Y - 0.1), line(Y, end=X - 0.2), id='beside one and beyond the other'),
        pytest.param(line(Y, end=X - 0.1), line(Y - 0.2), id='beyond one and beside the other'),
        pytest.param(line(Y - 0.1), line(Y - 3.0), id='the other is no neighbour at all'),
    ],
)
def test_the_nearest_line_counts(view: View, nearer: Line, other: Line) -> None:
    yellow = line(nearer.a, nearer.b, nearer.c, nearer.begin, nearer.end, width=0.025, blueness=0.2)
    alone = beside(view, [yellow])
    assert (alone['line_width'], alone['line_blue']) == pytest.approx((0.025, 0.2))
    for lines in ([yellow, other], [other, yellow]):
        assert beside(view, lines) == alone


def test_left_and_right_are_told_apart_for_lines_alone(view: View) -> None:
    """A line to the left is near what stands left, and both stand as far aside."""
    left, right = (beside(view, [line(0.1)], y=y) for y in (0.1, -0.1))
    assert left['aside'] == pytest.approx(0.1, abs=0.004)
    assert right['aside'] == pytest.approx(0.1, abs=0.004)
    assert left['line_distance'] == pytest.approx(0.0, abs=0.004)
    assert right['line_distance'] == pytest.approx(0.2, abs=0.004)
    other = beside(view, [line(-0.1)], y=-0.1)
    assert other['line_distance'] == pytest.approx(0.0, abs=0.004)


def test_dashes_lie_on_the_yellow_line() -> None:
    regions, values, _ = measured(picture_of(CAMERA))
    dashes = (column(values, 'channel') == YELLOW) & (column(values, 'level') >= 5)
    dashes &= (column(values, 'ahead') > 0.2) & (column(values, 'ahead') < 0.6)
    dashes &= column(values, 'fill') > 0.3  # or it is more than one
    assert len({tuple(box) for box in regions.box[dashes]}) >= 4
    assert column(values, 'line_distance')[dashes].max() < 0.015
    assert column(values, 'line_beyond')[dashes].max() == 0
    assert column(values, 'line_width')[dashes] == pytest.approx(0.025, abs=0.004)
    assert column(values, 'line_blue')[dashes].max() < 0.5
