"""core.detection.robust.native: the compiled path gives the numbers that numpy gives, or is not used."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import _ctypes
import functools
import os
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Sequence, Tuple
from unittest import mock

import cv2
import numpy as np
import pytest

import obst_avoid
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust import lines, native, trees
from obst_avoid.core.detection.robust.channels import (
    CHANNELS,
    RED,
    SUMS,
    WIDE,
    YELLOW,
    Channels,
    channels_of,
    joined,
    opened,
    tables_of,
)
from obst_avoid.core.detection.robust.features import NAMES, QUICK, measure, measure_all
from obst_avoid.core.detection.robust.light import LINEAR, Light, estimate_light
from obst_avoid.core.detection.robust.lines import Crossings, Line, LineSampling, find_crossings, find_lines
from obst_avoid.core.detection.robust.regions import AT, COLUMNS, Regions, find_regions
from obst_avoid.core.detection.robust.trees import NODE, Forest
from obst_avoid.core.detection.robust.view import View, make_view, working_picture
from unit import drawn, rendered, shipped
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

CLOSE: Dict[str, float] = {'rtol': 1e-5, 'atol': 1e-6}
"""Measurements are float32, with 7 digits, and what is added up is added in another order; differences of colours are
near 0 where these are not."""
CAMERAS = {
    'level': Camera(),
    'rolled': Camera(roll=5.0),
    'turned': Camera(yaw=8.0, pitch=15.0),
    'steep, all of the picture is looked at': Camera(pitch=55.0),
    'tele': Camera(focal=420.0, projection=(420.0, 420.0), distortion=(0.0,) * 5),
    'small': Camera().resized(176, 132),
}
LIGHT = Light((0.1, 0.1, 0.1))
LIBRARY = native.LIBRARY
needs_library = pytest.mark.skipif(LIBRARY is None, reason='the compiled path is not built: nothing to compare with')


def both(function: Callable[[], Any]) -> Tuple[Any, Any]:
    """What it gives by the compiled path, and by numpy."""
    assert native.LIBRARY is LIBRARY is not None
    compiled = function()
    with mock.patch.object(native, 'LIBRARY', None):
        return compiled, function()


@functools.lru_cache(maxsize=None)
def camera(name: str) -> Tuple[Calibration, View]:
    """One of CAMERAS."""
    calibration = calibration_of(CAMERAS[name])
    return calibration, make_view(calibration)


# Pictures


def noise(size: Tuple[int, int], seed: int = 0) -> np.ndarray:
    """Nothing else; size: width, height."""
    return np.random.RandomState(seed).randint(0, 256, (size[1], size[0], 3)).astype(np.uint8)


def blotches(size: Tuple[int, int], sigma: float, seed: int = 0) -> np.ndarray:
    """Coloured noise, blurred and as strong as before."""
    blurred = cv2.GaussianBlur(noise(size, seed), (0, 0), sigma * size[0] / 640)
    return cv2.normalize(blurred, None, 0, 255, cv2.NORM_MINMAX)


def specks(size: Tuple[int, int]) -> np.ndarray:
    """Tiny things at all edges of the picture and in its corners."""
    width, height = size
    picture = np.full((height, width, 3), 60, np.uint8)
    unit = width // 80
    for index, color in enumerate(((0, 210, 250), (20, 60, 250), (250, 250, 250), (2, 2, 2))):
        for at in range(index, 80, 7):
            for row in (0, height // 3, height - 3 * unit):
                picture[row : row + 3 * unit, at * unit : (at + 3) * unit] = color
            picture[at * height // 80 :, :unit][: 4 * unit] = color
            picture[at * height // 80 :, -unit:][: 4 * unit] = color
    return picture


def stripes(size: Tuple[int, int]) -> np.ndarray:
    """Lines of all widths and colours, some of tape's, without any noise."""
    random = np.random.RandomState(0)
    picture = np.full((size[1], size[0], 3), 60, np.uint8)
    for _ in range(25):
        ends = (random.rand(2, 2) * size).astype(int).tolist()
        color = tuple(int(value) for value in random.randint(0, 256, 3))
        cv2.line(picture, tuple(ends[0]), tuple(ends[1]), color, int(random.randint(1, 30)))
    return picture


PICTURES: Dict[str, Callable[[Calibration], np.ndarray]] = {
    'drawn': lambda one: picture_of(one, (duckie(0.35, 0.03), cone(0.5, -0.1), duckie(0.25, -0.12))),
    'noise': lambda one: noise((one.width, one.height)),
    'fine blotches': lambda one: blotches((one.width, one.height), 3.0),
    'blotches': lambda one: blotches((one.width, one.height), 9.0),
    'dark blotches': lambda one: blotches((one.width, one.height), 6.0) // 40,
    'specks': lambda one: specks((one.width, one.height)),
    'stripes': lambda one: stripes((one.width, one.height)),
    'black': lambda one: np.zeros((one.height, one.width, 3), np.uint8),
    'white': lambda one: np.full((one.height, one.width, 3), 255, np.uint8),
    'yellow': lambda one: np.full((one.height, one.width, 3), (20, 200, 240), np.uint8),
}
FEW = ('drawn', 'fine blotches', 'specks')
CASES = [
    pytest.param(name, picture, id='%s, %s' % (name, picture))
    for name in CAMERAS
    for picture in PICTURES
    if name == 'level' or picture in FEW
]


def seen(name: str, picture: str) -> Tuple[np.ndarray, View, Light]:
    """A camera's picture, its view and its light."""
    calibration, view = camera(name)
    taken = PICTURES[picture](calibration)
    return taken, view, estimate_light(taken)


@pytest.fixture(scope='module')
def simulated() -> Tuple[np.ndarray, View, Light]:
    """A picture of the simulated town."""
    calibration = shipped.default_calibration()
    eye = rendered.Camera(calibration)
    things = rendered.standing('duckie', 0.4, 0.05), rendered.standing('cone', 0.55, -0.06)
    picture, _ = eye.take(things, phi=0.2, seed=1)
    eye.close()
    return picture, make_view(calibration), estimate_light(picture)


# What a picture goes through


def same_channels(picture: np.ndarray, view: View, light: Light) -> Channels:
    small = working_picture(picture, view)
    compiled, other = both(lambda: channels_of(small, light, view))
    np.testing.assert_array_equal(compiled.heights, other.heights)
    np.testing.assert_array_equal(compiled.sums, other.sums)
    assert compiled.sums.dtype == other.sums.dtype
    return compiled


def sorted_rows(regions: Regions) -> np.ndarray:
    """Numbers of the rows, whatever the order of siblings."""
    keys = ('area', 'top', 'left', 'level', 'channel')
    return np.lexsort([regions.table[:, AT[name]] for name in keys])


def members(regions: Regions, channels: Channels, index: int) -> np.ndarray:
    """Pixels of one region, by their numbers in place."""
    channel, first, past = regions.table[index, [AT['channel'], AT['first'], AT['past']]]
    place = regions.place[channel]
    return np.flatnonzero((channels.heights[channel] > 0) & (place >= first) & (place < past))


def same_regions(channels: Channels, view: View) -> Regions:
    compiled, other = both(lambda: find_regions(channels, view))
    assert compiled.table.dtype == other.table.dtype == np.int32
    assert compiled.place.shape == other.place.shape
    assert compiled.top == other.top
    one, two = sorted_rows(compiled), sorted_rows(other)
    kept = [index for name, index in AT.items() if name not in ('first', 'past')]
    np.testing.assert_array_equal(compiled.table[one][:, kept], other.table[two][:, kept])
    for here, there in zip(one[:: len(one) // 100 + 1], two[:: len(two) // 100 + 1]):
        own = members(compiled, channels, here)
        np.testing.assert_array_equal(own, members(other, channels, there))
        assert len(own) == compiled.table[here, AT['area']]
    return compiled


def same_measurements(regions: Regions, channels: Channels, view: View, found: Sequence[Line]) -> None:
    compiled, other = both(lambda: measure_all(regions, channels, view))
    assert compiled.shape == other.shape == (len(regions), len(QUICK))
    assert compiled.dtype == other.dtype == np.float32
    np.testing.assert_allclose(compiled, other, **CLOSE)
    for chosen in (np.arange(len(regions)), np.arange(len(regions))[::-3]):
        values, more = both(lambda chosen=chosen: measure(regions, chosen, other, channels, view, found))
        assert values.shape == more.shape == (len(chosen), len(NAMES))
        assert values.dtype == more.dtype == np.float32
        np.testing.assert_allclose(values, more, **CLOSE)
        assert np.isfinite(values).all()


def same_lines(compiled: Sequence[Line], other: Sequence[Line]) -> None:
    """The same crossings in the same order; a metre, a slope, a curvature of 1/m are what numbers are compared with."""
    assert len(compiled) == len(other)
    for one, two in zip(compiled, other):
        np.testing.assert_allclose([one.x, one.y], [two.x, two.y], rtol=0, atol=1e-9)
        assert (one.begin, one.end, one.count) == (one.x[0], one.x[-1], len(one.x))
        for name in ('a', 'b', 'c', 'residual', 'width', 'blueness', 'brightness'):
            assert getattr(one, name) == pytest.approx(getattr(two, name), rel=1e-5, abs=1e-6), name
        most = np.abs(two.covariance).max()
        np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-5, atol=1e-5 * most)


def same_crossings(picture: np.ndarray, view: View, light: Light) -> Crossings:
    compiled, other = both(lambda: find_crossings(picture, view.sampling, light.as_array()))
    np.testing.assert_array_equal(compiled.row, other.row)
    for name in ('x', 'y', 'across', 'color'):
        np.testing.assert_allclose(getattr(compiled, name), getattr(other, name), err_msg=name, **CLOSE)
    return other


def check(picture: np.ndarray, view: View, light: Light) -> Tuple[Regions, Crossings, List[Line]]:
    """All steps, each from what the one before gave."""
    channels = same_channels(picture, view, light)
    regions = same_regions(channels, view)
    crossings = same_crossings(picture, view, light)
    compiled, other = both(lambda: lines.curves(crossings, view.sampling.trials))
    same_lines(compiled, other)
    same_lines(*both(lambda: find_lines(picture, view.sampling, light.as_array())))
    same_measurements(regions, channels, view, other)
    return regions, crossings, other


@needs_library
@pytest.mark.parametrize('name, picture', CASES)
def test_a_picture_gives_the_same_numbers(name: str, picture: str) -> None:
    regions, crossings, _ = check(*seen(name, picture))
    if picture in ('black', 'white', 'yellow'):
        assert len(regions) == len(crossings.x) == 0
    else:
        assert len(regions) > 20


@needs_library
def test_a_picture_of_the_simulator_gives_the_same_numbers(simulated: Tuple[np.ndarray, View, Light]) -> None:
    regions, crossings, found = check(*simulated)
    assert len(regions) > 50
    assert len(crossings.x) > 30
    assert len(found) >= 2


@needs_library
@pytest.mark.parametrize('phi', [-0.5, 0.0, 0.3])
def test_drawn_roads_have_the_same_lines(phi: float) -> None:
    calibration, view = camera('level')
    scene = drawn.Scene(stop_line=0.7)
    picture = drawn.draw(scene, calibration, drawn.RobotPose(0, 0.05, phi), seed=int(10 * phi) + 9)
    light = estimate_light(picture)
    same_crossings(picture, view, light)
    compiled, other = both(lambda: find_lines(picture, view.sampling, light.as_array()))
    same_lines(compiled, other)
    assert len(other) >= 2


@needs_library
@pytest.mark.parametrize('road', [(1e-5, 1e-5, 1e-5), (1.0, 1.0, 1.0), (0.5, 0.01, 0.0001), (0.0001, 0.01, 0.5)])
def test_any_light_gives_the_same_numbers(road: Tuple[float, float, float]) -> None:
    _, view = camera('level')
    picture = blotches((640, 480), 8.0, seed=3)
    channels = same_channels(picture, view, Light(road))
    same_regions(channels, view)
    same_crossings(picture, view, Light(road))


# Heights that no picture has


def flat_view(rows: int, columns: int, top: int = 0, foot: int = 0) -> View:
    """Of all of a picture of another size."""
    _, view = camera('level')
    random = np.random.RandomState(rows)
    shape = rows + top, columns
    return replace(
        view,
        width=columns,
        height=rows + top,
        top=top,
        foot=foot,
        nearness=random.uniform(-1, 9, shape).astype(np.float32),
        bearing=random.uniform(-2, 2, shape).astype(np.float32),
        opening=np.array([[0, rows, 3]], np.int32),
        closing=np.array([[0, rows, 5]], np.int32),
    )


def channels_from(heights: np.ndarray, seed: int = 0) -> Channels:
    """(7, R, W) heights over random colours and edges."""
    rows, columns = heights.shape[1:]
    planes = np.random.RandomState(seed).randint(-500, 500, (rows, columns, SUMS))
    planes[..., 3:] = np.abs(planes[..., 3:])
    planes[..., 7] = 0
    sums = np.zeros((rows + 1, columns + 1, SUMS), np.int32)
    sums[1:, 1:] = planes.cumsum(axis=0).cumsum(axis=1)
    return Channels(np.ascontiguousarray(heights, dtype=np.uint8), sums)


SIZES = [(40, 60), (7, 61), (61, 7), (1, 50), (50, 2), (3, 3)]
"""Rows and columns, not only multiples of 8."""


@needs_library
@pytest.mark.parametrize('rows, columns', SIZES)
@pytest.mark.parametrize('kind', ['two levels', 'few levels', 'all levels', 'hills', 'full', 'comb'])
def test_any_heights_have_the_same_regions_and_measurements(kind: str, rows: int, columns: int) -> None:
    random = np.random.RandomState(rows + columns)
    shape = CHANNELS, rows, columns
    if kind == 'hills':
        heights = np.array([cv2.GaussianBlur(random.rand(rows, columns), (0, 0), 0.5 + i / 2) for i in range(7)])
        heights = np.maximum(20 * (heights / heights.max(axis=(1, 2), keepdims=True)) - 8, 0)
    elif kind == 'comb':
        heights = np.zeros(shape)
        heights[:, ::2] = 3
        heights[:, :, ::5] = np.arange(7)[:, None, None] + 1
    elif kind == 'full':
        heights = np.full(shape, 255)
    else:
        heights = random.randint(0, {'two levels': 2, 'few levels': 4, 'all levels': 256}[kind], shape)
    for top, foot in ((0, 0), (9, 9 + rows // 2)):
        view, channels = flat_view(rows, columns, top, foot), channels_from(heights)
        regions = same_regions(channels, view)
        if columns > 2:  # and a pixel beside the middle
            same_measurements(regions, channels, view, [])
        if kind == 'hills' and rows * columns > 400:
            assert len(regions) > 10


@needs_library
def test_forms_at_the_limits_are_left_out_alike() -> None:
    sizes = [(7, 1), (4, 2), (7, 2), (6, 2), (34, 10), (35, 10), (3, 12), (3, 11), (119, 40), (120, 40), (121, 40)]
    heights = np.zeros((CHANNELS, 50, 50 + sum(width + 1 for width, _ in sizes)))
    left = 2
    for width, height in sizes:
        heights[YELLOW, 5 : 5 + height, left : left + width] = 3
        left += width + 1
    regions = same_regions(channels_from(heights), flat_view(50, heights.shape[2]))
    assert len(regions) == 5


@needs_library
@pytest.mark.parametrize('rows, columns', [(1, 1), (1, 9), (9, 1), (2, 2), (30, 41)])
def test_pictures_of_any_size_have_the_same_channels(rows: int, columns: int) -> None:
    picture, view = noise((columns, rows), seed=rows), flat_view(rows, columns)
    compiled, other = both(lambda: channels_of(picture, Light((0.1, 0.05, 0.02)), view))
    np.testing.assert_array_equal(compiled.heights, other.heights)
    np.testing.assert_array_equal(compiled.sums, other.sums)


@needs_library
@pytest.mark.parametrize('function', [opened, joined])
@pytest.mark.parametrize('rows, columns', [(40, 60), (9, 100), (100, 9), (1, 1), (5, 3)])
def test_any_bands_are_opened_and_closed_alike(function: Callable[..., None], rows: int, columns: int) -> None:
    random = np.random.RandomState(rows)
    for _ in range(12):
        height = random.randint(0, 9, (rows, columns)).astype(np.uint8)
        height[random.rand(rows, columns) < 0.4] = random.randint(0, 9)
        inner = np.unique(random.randint(0, rows + 1, random.randint(0, 5)))
        ends = np.unique(np.concatenate([[0], inner, [rows]]))
        pixels = 2 * random.randint(0, 31, len(ends) - 1) + 1
        bands = np.array([ends[:-1], ends[1:], pixels], np.int32).T.copy()

        def done(height: np.ndarray = height, bands: np.ndarray = bands) -> np.ndarray:
            result = np.full_like(height, 99)
            function(height, bands, result)
            return result

        compiled, other = both(done)
        np.testing.assert_array_equal(compiled, other)


@needs_library
def test_more_regions_than_there_is_room_for_are_left_out() -> None:
    """The compiled path fills its table and no more."""
    tile = np.zeros((4, 4), np.uint8)
    tile[:3, :3] = 5
    heights = np.zeros((CHANNELS, 600, 800), np.uint8)
    heights[[YELLOW, RED]] = np.tile(tile, (150, 200))
    regions = find_regions(channels_from(heights), flat_view(600, 800))
    assert len(regions) == native.MOST < 2 * 150 * 200
    assert len(np.unique(regions.table, axis=0)) == native.MOST
    own = regions.table[:, [AT[name] for name in ('width', 'height', 'area', 'level')]]
    assert np.unique(own, axis=0).tolist() == [[3, 3, 9, 5]]


@needs_library
def test_pictures_of_more_rows_than_are_counted_have_the_same_regions() -> None:
    """Rows of the compiled path are numbers of 16 bits."""
    heights = np.zeros((CHANNELS, 33000, 3))
    heights[:, 32790:32794] = 3
    regions = same_regions(channels_from(heights), flat_view(33000, 3))
    assert regions.table[:, AT['top']].tolist() == [32790] * CHANNELS


@needs_library
@pytest.mark.parametrize(
    'rows, columns, fits', [(2184, 240, True), (2185, 240, False), (4096, 9, True), (4097, 9, False)]
)
def test_pictures_whose_sums_are_too_large_for_32_bits_are_left_to_numpy(rows: int, columns: int, fits: bool) -> None:
    """A narrow camera picture that stands on end: at 4230 rows, those of one white region sum up to more than 2^31."""
    heights, sums = np.full((1, rows, columns), 3, np.uint8), np.zeros((rows + 1, columns + 1, SUMS), np.int32)
    found = native.regions(heights, sums, 1, (8, 2 * rows, 4 * rows, 4 * rows, 0), len(COLUMNS))
    assert (found is not None) is fits
    if found is not None:
        assert found[0][:, [AT['area'], AT['sum_v']]].tolist() == [[rows * columns, rows * (rows - 1) // 2 * columns]]
    tables = tables_of(LIGHT)
    given = np.zeros((rows, columns, 3), np.uint8), tables.logarithms, tables.less, tables.steps, tables.light
    assert (native.channels(*given) is not None) is fits
    table, road = np.zeros((0, len(COLUMNS)), np.int32), np.ones((rows, columns), np.float32)
    quick = native.quick(table, sums, 0, road, road, len(QUICK))
    assert (quick is not None) is fits
    values, place = np.zeros((0, len(QUICK)), np.float32), np.zeros((1, rows, columns), np.int32)
    of = table, values, place, heights, sums, 0, road, road, np.zeros((0, 7)), (0.0,) * 6, len(NAMES)
    assert (native.full(*of) is not None) is fits


@needs_library
@pytest.mark.parametrize('closing', [False, True])
@pytest.mark.parametrize('band', [(0, 50, 3), (-9, 40, 3), (0, 41, 1), (-1, 40, 1), (30, 10, 3), (0, 40, 0)])
def test_bands_beyond_the_picture_write_nothing_beyond_it(band: Tuple[int, int, int], closing: bool) -> None:
    room = np.full((60, 30), 7, np.uint8)
    height, bands = np.zeros((40, 30), np.uint8), np.array([band], np.int32)
    assert not native.morphed(height, bands, closing, room[10:50])
    assert (room == 7).all()


def of_other_nodes() -> Forest:
    forest = forest_of(5, 0)
    fields = [(name, np.dtype(np.int32) if name == 'left' else kind) for name, (kind, _) in NODE.fields.items()]
    return replace(forest, nodes=forest.nodes.astype(np.dtype(fields)))


@needs_library
@pytest.mark.parametrize(
    'wrong',
    [
        lambda view, channels, regions: channels_of(np.zeros((view.height, view.width), np.uint8), LIGHT, view),
        lambda view, channels, regions: channels_of(np.zeros((view.height, view.width, 4), np.uint8), LIGHT, view),
        lambda view, channels, regions: channels_of(np.zeros((view.height, view.width, 3)), LIGHT, view),
        lambda view, channels, regions: opened(channels.heights[0], view.opening.astype(np.int64), channels.heights[3]),
        lambda view, channels, regions: opened(channels.heights[0], view.opening, channels.heights[3, :-1]),
        lambda view, channels, regions: find_regions(replace(channels, heights=channels.heights[:3]), view),
        lambda view, channels, regions: find_regions(replace(channels, heights=channels.heights[..., ::2]), view),
        lambda view, channels, regions: find_regions(replace(channels, sums=channels.sums[:-1]), view),
        lambda view, channels, regions: measure_all(replace(regions, table=regions.table[:, 1:]), channels, view),
        lambda view, channels, regions: measure_all(regions, channels, replace(view, nearness=view.nearness[:-1])),
        lambda view, channels, regions: measure_all(regions, channels, replace(view, bearing=view.bearing[:, ::2])),
        lambda view, channels, regions: measure_all(regions, channels, replace(view, top=view.top + 1)),
        lambda view, channels, regions: trees.summed(trees.shipped()['first'], np.zeros((9, len(NAMES)))),
        lambda view, channels, regions: trees.summed(of_other_nodes(), np.zeros((9, 16), np.float32)),
        lambda view, channels, regions: trees.summed(forest_of(5, 0), np.zeros((9, 16), np.float32)[:, ::2]),
        lambda view, channels, regions: find_lines(np.zeros((480, 640), np.uint8), view.sampling, LIGHT.as_array()),
        lambda view, channels, regions: find_lines(np.zeros((480, 640, 3)), view.sampling, LIGHT.as_array()),
    ],
    ids=[
        *('a grey picture', 'a picture with alpha', 'a picture of numbers', 'wide bands', 'rows that are missing'),
        *('few channels', 'every second column', 'sums of fewer rows', 'a narrow table', 'a low view', 'a narrow view'),
        *(
            'a view from further down',
            'double precision',
            'other nodes',
            'every second value',
            'grey tape',
            'tape of numbers',
        ),
    ],
)
def test_arrays_of_another_type_or_shape_are_refused(wrong: Callable[[View, Channels, Regions], Any]) -> None:
    picture, view, light = seen('level', 'specks')
    channels = channels_of(working_picture(picture, view), light, view)
    regions = find_regions(channels, view)
    with pytest.raises(ValueError, match='expected'):
        wrong(view, channels, regions)


@needs_library
def test_no_regions_have_no_measurements() -> None:
    view, channels = flat_view(20, 30), channels_from(np.zeros((CHANNELS, 20, 30)))
    regions = same_regions(channels, view)
    assert regions.table.shape == (0, len(COLUMNS))
    same_measurements(regions, channels, view, [])


@needs_library
@pytest.mark.parametrize('count', [0, 1, 2, 7])
def test_any_lines_are_beside_the_same_things(count: int) -> None:
    """Across the road, behind the robot, bent as no tape is, and so narrow a bend that it has no side."""
    random = np.random.RandomState(count)
    nothing = np.zeros(0)
    found = [
        Line(
            *values, np.eye(3), *random.uniform(-0.5, 1.5, 2), 9, 0.01, *random.uniform(0, 1, 2), 1.0, nothing, nothing
        )
        for values in random.uniform(-8, 8, (count, 3)).tolist()
    ]
    heights = np.array([cv2.GaussianBlur(random.rand(60, 90), (0, 0), 1.5) for _ in range(CHANNELS)])
    channels, view = channels_from(np.maximum(40 * heights - 18, 0)), flat_view(60, 90)
    regions = same_regions(channels, view)
    assert len(regions) > 50
    same_measurements(regions, channels, view, found)


# Trees


def grown(random: np.random.RandomState, columns: int, depth: int) -> List[Tuple[int, int, int, int, float]]:
    """Nodes of a sound tree: children after their parents, a leaf leads to itself, a root knows its depth."""
    rows: List[List[float]] = []

    def add(left: int) -> int:
        at = len(rows)
        if not left or (at and random.rand() < 0.2):
            rows.append([random.randint(columns), at, at, 0, random.randn()])
            return 0
        row = [random.randint(columns), at + 1, 0, 0, random.randint(-3, 4) / 2]
        rows.append(row)
        one = add(left - 1)
        row[2] = len(rows)
        return 1 + max(one, add(left - 1))

    deepest = add(depth)
    rows[0][3] = deepest
    return [tuple(row) for row in rows]


def forest_of(count: int, seed: int, columns: int = 8, stages: Sequence[Tuple[int, float]] = ()) -> Forest:
    """Random trees of all depths; stages: (trees, least sum)."""
    random = np.random.RandomState(seed)
    given = [grown(random, columns, int(random.randint(0, 6))) for _ in range(count)]
    size = max(map(len, given))
    nodes = np.zeros((count, size), NODE)
    for tree, rows in zip(nodes, given):
        tree['left'] = tree['right'] = np.arange(size)
        tree[: len(rows)] = rows
    assert trees._sound(nodes)
    ends, least = [stage for stage, _ in stages], [limit for _, limit in stages]
    return Forest(nodes, 0.3, np.array(ends, np.int32), np.array(least, np.float32))


def plain_sum(forest: Forest, row: np.ndarray) -> float:
    """By definition: tree by tree, in single precision."""
    total, stages = np.float32(forest.base), dict(zip(forest.stages.tolist(), forest.hopeless.tolist()))
    for number, tree in enumerate(forest.nodes):
        node = 0
        while tree['left'][node] != node:
            node = tree['left' if row[tree['feature'][node]] < tree['value'][node] else 'right'][node]
        total = total + tree['value'][node]
        if number + 1 in stages and total < np.float32(stages[number + 1]):
            return -np.inf
    return float(total)


STAGES: Dict[str, Sequence[Tuple[int, float]]] = {
    'no stages': (),
    'one stage': ((5, 0.0),),
    'stages': ((3, -1.0), (10, 0.0), (11, 0.5), (25, 0.5)),
    'a stage that all pass': ((4, -1000.0),),
    'a stage that none passes': ((4, 1000.0), (9, 0.0)),
}


@needs_library
@pytest.mark.parametrize('stages', list(STAGES.values()), ids=list(STAGES))
@pytest.mark.parametrize('rows', [0, 1, 2, 5, 11, 12, 13, 24, 61])
def test_rows_are_summed_to_the_last_digit(rows: int, stages: Sequence[Tuple[int, float]]) -> None:
    """Rows go down by the dozen; values at thresholds too."""
    for seed in range(3):
        forest = forest_of(30, seed, stages=stages)
        values = (np.random.RandomState(seed).randint(-4, 5, (rows, 8)) / 2).astype(np.float32)
        compiled, other = both(lambda forest=forest, values=values: trees.summed(forest, values))
        assert compiled.shape == other.shape == (rows,)
        assert compiled.dtype == other.dtype == np.float32
        np.testing.assert_array_equal(compiled, other)
        assert compiled.tolist() == [plain_sum(forest, row) for row in values]


@needs_library
def test_rows_that_are_dropped_leave_the_others_alone() -> None:
    """After each stage another remainder of twelve is left."""
    forest = forest_of(30, 7, stages=((3, -2.0), (10, -2.0), (11, -1.5), (25, -2.0)))
    values = np.random.RandomState(0).randn(60, 8).astype(np.float32)
    expected = [plain_sum(forest, row) for row in values]
    for count in range(61):
        assert trees.summed(forest, values[:count]).tolist() == expected[:count]
    assert 5 < np.isfinite(expected).sum() < 55


@needs_library
@pytest.mark.parametrize('stages', [((6, 0.2),), ((3, -0.5), (6, 0.2)), ((6, 0.2), (9, 0.5))], ids=str)
def test_a_stage_may_end_with_the_last_tree(stages: Sequence[Tuple[int, float]]) -> None:
    """All trees are then summed before it, and nothing is left to add."""
    forest = forest_of(6, 1, stages=stages)
    values = np.random.RandomState(0).randn(20, 8).astype(np.float32)
    compiled, other = both(lambda: trees.summed(forest, values))
    np.testing.assert_array_equal(compiled, other)


@needs_library
@pytest.mark.parametrize('name', trees.FORESTS)
def test_the_shipped_forests_sum_alike(name: str) -> None:
    forest = trees.shipped()[name]
    values = np.random.RandomState(0).uniform(-3, 8, (301, len(NAMES))).astype(np.float32)
    compiled, other = both(lambda: trees.summed(forest, values))
    np.testing.assert_array_equal(compiled, other)


# Tape


def signal(grey: Sequence[Any], scan: Any = 0, shown: int = 0) -> Tuple[np.ndarray, LineSampling]:
    """A picture one of whose rows is the given pixels, grey values or colours, and the scan along it."""
    row = np.array(grey, dtype=np.uint8)
    row = row.reshape(len(row), -1) * np.ones(3, np.uint8)
    picture = np.repeat(row[None], 3, axis=0)
    count = len(row)
    _, view = camera('level')
    pixel = np.zeros((1, count, 2), np.int16)
    pixel[0, :, 0], pixel[0, :, 1] = np.arange(count), shown
    scan = np.broadcast_to(np.asarray(scan, np.int32), count).copy()
    whole = np.ones((1, count), np.float32)
    for shift in range(1, lines.LOBE + 2):
        other = scan[shift:] != scan[:-shift]
        whole[0, shift:][other] = whole[0, :-shift][other] = 0
    whole[0, :4] = whole[0, -4:] = 0
    part = np.zeros((1, count), np.uint16)
    sampling = replace(view.sampling, map_pixel=pixel, map_part=part, scan=scan, whole=whole)
    return picture, sampling


def same_tapes(picture: np.ndarray, sampling: LineSampling, share: int = 128, least: float = 3.0) -> int:
    limits = least, lines.NOISE_FACTOR, lines.EVENNESS, lines.LOCAL_CONTRAST, lines.LONGEST
    compiled = native.tapes(picture, sampling, (share, 256 - share), limits, LINEAR)
    other = lines._tapes(picture, sampling, share, least)
    assert compiled is not None
    for one, two in zip(compiled, other):
        assert one.shape == two.shape
        np.testing.assert_allclose(one, two, **CLOSE)
    return len(other[0])


@needs_library
@pytest.mark.parametrize('kind', ['tape', 'coloured tape', 'tape with grain', 'noise', 'between pixels', 'flat'])
def test_any_scan_crosses_the_same_tape(kind: str) -> None:
    """Steps and widths around all limits, some of them symmetric, so that what is found lies on the halves."""
    found = 0
    for seed in range(60):
        random = np.random.RandomState(seed)
        count = int(random.randint(20, 900))
        grey = np.full((count, 3), 60)
        at = 5
        while at < count and kind != 'flat':
            width = int(random.randint(2, 95 if seed % 4 else 20))
            grey[at : at + width] = random.randint(60, 256, 3 if kind == 'coloured tape' else 1)
            at += width + int(random.randint(1, 30))
        if kind == 'tape with grain':
            grey = grey + random.randint(-6, 7, grey.shape)
        elif kind == 'noise':
            grey = random.randint(0, 256, grey.shape)
        picture, sampling = signal(np.clip(grey, 0, 255), np.sort(random.randint(0, 4, count)))
        if kind == 'between pixels':
            picture[1:] = np.roll(picture[1:], 1, axis=1)
            sampling.map_part[0, :-1] = random.randint(0, 1024, count - 1)
        found += same_tapes(picture, sampling, int(random.randint(0, 257)), float(random.choice([3.0, 8.4, 20.0])))
    assert found > 20 or kind == 'flat'


@needs_library
def test_pixels_at_the_pictures_last_row_and_column_are_sampled_alike() -> None:
    picture = noise((200, 3), seed=5)
    _, sampling = signal(picture[0], shown=2)
    sampling.map_part[0] = np.arange(200) % 32  # to the right only
    sampling.map_part[0, -1] = 0
    same_tapes(picture, sampling)
    assert sampling.map_pixel[0].max(axis=0).tolist() == [199, 2]


@needs_library
def test_a_camera_that_sees_none_of_the_road_crosses_no_tape() -> None:
    _, view = camera('level')
    nothing = np.zeros(0, np.int32)
    ground, whole = view.sampling.ground[:0], view.sampling.whole[:, :0]
    sampling = replace(view.sampling, map_pixel=None, map_part=None, scan=nothing, ground=ground, whole=whole)
    assert len(find_crossings(noise((640, 480)), sampling, LIGHT.as_array()).x) == 0


@needs_library
@pytest.mark.parametrize('width, height', [(640, 400), (500, 480), (320, 240)])
def test_samples_that_a_picture_does_not_have_are_black_on_both_paths(width: int, height: int) -> None:
    """A part of the camera's picture, with other things behind it in memory."""
    _, view = camera('level')
    room = noise((640, 480))
    part = room.ravel()[: width * height * 3].reshape(height, width, 3)
    part[:] = stripes((640, 480))[:height, :width]
    same_crossings(part, view, Light((0.05, 0.05, 0.05)))


@needs_library
@pytest.mark.parametrize('up, down', [(21, 70), (70, 21), (33, 110), (24, 80)])
def test_steps_as_uneven_as_they_may_be_are_tape_on_both_paths_or_on_neither(up: int, down: int) -> None:
    """Three to ten exactly, of sums of three grey values; in thirds of them that is a matter of rounding."""
    small, large = sorted((up, down))
    top = large // 3 + 3
    low, high = top - large // 3, top - small // 3
    grey = [high] * 40 + [top] * 6 + [low, low - large % 3] + [low] * 40
    grey = grey if up < down else grey[::-1]
    change = np.convolve(grey, [1, 1, 1, 0, -1, -1, -1], 'valid')
    assert (change.max(), -change.min()) == (up, down)
    same_tapes(*signal(grey))


# Curves


def crossings_of(kind: str, seed: int) -> Crossings:
    """Up to as many as are looked at, from near to far."""
    random = np.random.RandomState(seed)
    count = int(random.randint(0, lines.MOST_CROSSINGS + 1))
    x, y = random.uniform(0.15, 1.3, count), random.uniform(-0.7, 0.7, count)
    if kind == 'on curves':
        which = random.randint(0, 4, count)
        a, b, c = random.uniform(-0.3, 0.3, 4), random.uniform(-1, 1, 4), random.uniform(-2, 2, 4)
        y = a[which] + b[which] * x + c[which] * x * x / 2 + 0.001 * random.randn(count)
    elif kind == 'on a circle':
        turn, radius = random.uniform(0, 1.5, count), random.uniform(0.15, 0.6)
        x, y = 0.3 + radius * np.sin(turn), radius * (1 - np.cos(turn))
    elif kind == 'across the road':
        x = 0.4 + 0.002 * random.randn(count)
    elif kind == 'at one place':
        x, y = np.full(count, 0.4), np.full(count, 0.1)
    elif kind == 'on a lattice':
        x, y = 0.05 * random.randint(3, 26, count), 0.05 * random.randint(-8, 9, count)
        x, y = x + 1e-5 * random.randn(count), y + 1e-5 * random.randn(count)
    row = np.searchsorted(np.geomspace(0.15, 1.3, lines.ROWS), x)
    order = np.argsort(row, kind='stable')
    across, color = random.uniform(-0.06, 0.06, (count, 2)), random.uniform(0.1, 10, (count, 3))
    return Crossings(row[order], x[order], y[order], across, color)


KINDS = ['anywhere', 'on curves', 'on a circle', 'across the road', 'at one place', 'on a lattice']


@needs_library
@pytest.mark.parametrize('kind', KINDS)
def test_any_crossings_share_the_same_curves(kind: str) -> None:
    _, view = camera('level')
    found = 0
    for seed in range(25):
        crossings = crossings_of(kind, seed)
        compiled, other = both(lambda crossings=crossings: lines.curves(crossings, view.sampling.trials))
        same_lines(compiled, other)
        found += len(other)
    assert found > 15 or kind not in ('on curves', 'on a circle')


@needs_library
@pytest.mark.parametrize('count', [191, 192, 193, 400])
def test_more_crossings_than_there_is_room_for_share_the_same_curves(count: int) -> None:
    _, view = camera('level')
    random = np.random.RandomState(count)
    x = np.sort(random.uniform(0.15, 1.3, count))
    y = random.choice([-0.1, 0.1, 0.25], count) + 0.0005 * random.randn(count)
    row = np.searchsorted(np.geomspace(0.15, 1.3, lines.ROWS), x)
    across, color = random.uniform(-0.06, 0.06, (count, 2)), random.uniform(0.1, 10, (count, 3))
    compiled, other = both(lambda: lines.curves(Crossings(row, x, y, across, color), view.sampling.trials))
    same_lines(compiled, other)
    assert len(other) == 3


LIMITS = (lines.LEAST_APART, lines.SHARPEST, lines.STEEPEST, lines.DENSITY, lines.LEAST_CROSSINGS)
FIT = (
    *(lines.ERROR, lines.ERROR_GROWTH, lines.LEAST_ERROR, lines.LEAST_CROSSINGS, lines.LEAST_LENGTH),
    *(lines.GAP, lines.GAP_GROWTH, lines.FEW, lines.PRIOR[0], lines.PRIOR[2]),
)


@needs_library
@pytest.mark.parametrize('kind', KINDS[:3])
def test_the_same_crossings_are_chosen_and_fitted(kind: str) -> None:
    """Each step by itself: curves, and the least squares from what numpy chose."""
    _, view = camera('level')
    for seed in range(10):
        crossings = crossings_of(kind, seed)
        if len(crossings.x) < lines.LEAST_CROSSINGS:
            continue
        x, y = crossings.x, crossings.y
        design = np.array([np.ones(len(x)), x, (x * x + y * y) / 2])
        tolerance = lines.TOLERANCE + lines.TOLERANCE_GROWTH * x
        kindred = lines._kindred(crossings, view.sampling.trials)
        chosen = lines._chosen(design, crossings, tolerance, kindred)
        compiled = native.curves(x, y, crossings.row, tolerance, kindred, LIMITS, lines.MOST_LINES)
        assert compiled is not None
        np.testing.assert_array_equal(compiled, chosen)
        if len(chosen):
            other = lines._fitted(chosen, design, tolerance, crossings)
            fitted = native.fitted(x, y, crossings.across, crossings.color, tolerance, chosen.copy(), FIT)
            assert fitted is not None
            same_lines([lines._from_numbers(*one, crossings) for one in zip(*fitted)], other)


@needs_library
def test_trials_with_crossings_that_there_are_none_of_are_left_to_numpy() -> None:
    x, y = np.linspace(0.2, 1.0, 30), np.zeros(30)
    trials = np.random.RandomState(0).randint(0, 30, (3, 50))
    of = x, y, np.arange(30), y + 0.01
    assert native.curves(*of, trials, LIMITS, lines.MOST_LINES) is not None
    for wrong in (-1, 30):
        trials[2, -1] = wrong
        assert native.curves(*of, trials, LIMITS, lines.MOST_LINES) is None
    nothing = np.zeros(0)
    assert native.curves(nothing, nothing, nothing, nothing, trials, LIMITS, lines.MOST_LINES) is None


@needs_library
def test_more_curves_than_there_is_room_for_are_left_to_numpy() -> None:
    x, nothing = np.linspace(0.2, 1.0, 90), np.zeros(90)
    chosen = np.arange(90) // 10 == np.arange(9)[:, None]
    of = x, nothing, np.zeros((90, 2)), np.ones((90, 3)), nothing + 0.01
    assert native.fitted(*of, chosen[:8].copy(), FIT) is not None
    assert native.fitted(*of, chosen, FIT) is None


@needs_library
def test_without_curves_nothing_is_fitted_and_nothing_written() -> None:
    """chosen is the first, here no, rows of a larger array, as native.curves gives it."""
    x = np.linspace(0.2, 1.0, 30)
    room = np.full((lines.MOST_LINES, 30), 7, np.uint8)
    nothing = np.zeros(30)
    fitted = native.fitted(x, nothing, np.zeros((30, 2)), np.ones((30, 3)), nothing + 0.01, room[:0].view(bool), FIT)
    assert fitted is not None
    assert (fitted[0].shape, fitted[1]) == ((0, 16), [])
    assert (room == 7).all(), 'what is behind no rows is not its own'


# Loading


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the package looks for its library, with none in it."""
    monkeypatch.setattr(obst_avoid, '__path__', [str(tmp_path)])
    monkeypatch.setattr(sys, 'path', [path for path in sys.path if not os.path.isdir(os.path.join(path, 'obst_avoid'))])
    return tmp_path


def test_without_a_file_there_is_no_library_and_no_warning(folder: Path, recwarn: pytest.WarningsRecorder) -> None:
    assert native._load() is None
    assert not recwarn.list


@needs_library
def test_a_library_beside_the_package_is_used(folder: Path, recwarn: pytest.WarningsRecorder) -> None:
    shutil.copy(LIBRARY._name, str(folder / '_native.cpython-38-x86_64-linux-gnu.so'))
    library = native._load()
    assert library is not None
    assert library.interface() == native.INTERFACE
    assert not recwarn.list


@needs_library
def test_a_library_of_another_version_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(LIBRARY._name, str(folder / '_native.so'))
    monkeypatch.setattr(native, 'INTERFACE', native.INTERFACE + 1)
    with pytest.warns(UserWarning, match=r'_native\.so is not used.*another version'):
        assert native._load() is None


def test_a_library_of_something_else_is_refused(folder: Path) -> None:
    shutil.copy(_ctypes.__file__, str(folder / '_native.so'))
    with pytest.warns(UserWarning, match=r'_native\.so is not used.*interface'):
        assert native._load() is None


@pytest.mark.parametrize('content', [b'', b'no library', b'\x7fELF\x02\x01\x01'], ids=['empty', 'text', 'cut off'])
def test_a_broken_file_is_refused(folder: Path, content: bytes) -> None:
    (folder / '_native.so').write_bytes(content)
    with pytest.warns(UserWarning, match=r'_native\.so is not used, and detection is slow without it: '):
        assert native._load() is None


@needs_library
def test_a_broken_file_hides_no_sound_one(folder: Path) -> None:
    (folder / '_native.a.so').write_bytes(b'no library')
    shutil.copy(LIBRARY._name, str(folder / '_native.b.so'))
    with pytest.warns(UserWarning, match=r'_native\.a\.so'):
        library = native._load()
    assert library is not None
    assert library._name.endswith('_native.b.so')


def test_without_a_library_numpy_does_all_the_work(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / '_native.so').write_bytes(b'no library')
    with pytest.warns(UserWarning, match='not used'):
        monkeypatch.setattr(native, 'LIBRARY', native._load())
    picture, view, light = seen('level', 'drawn')
    channels = channels_of(working_picture(picture, view), light, view)
    regions = find_regions(channels, view)
    found = find_lines(picture, view.sampling, light.as_array())
    quick = measure_all(regions, channels, view)
    values = measure(regions, np.arange(len(regions)), quick, channels, view, found)
    assert channels.heights[WIDE].max() > 0
    assert len(found) >= 2
    assert len(regions) == len(quick) == len(values) > 50
    forest = forest_of(5, 0, stages=((2, 0.0),))
    assert trees.summed(forest, values).tolist() == [plain_sum(forest, row) for row in values]


def test_every_function_says_that_it_has_no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, 'LIBRARY', None)
    nothing: Any = np.zeros((1, 1))
    assert native.channels(nothing, nothing, nothing, nothing, nothing) is None
    assert native.morphed(nothing, nothing, True, nothing) is False
    assert native.regions(nothing, nothing, 1, (), 1) is None
    assert native.quick(nothing, nothing, 0, nothing, nothing, 1) is None
    assert native.full(*(nothing,) * 5, 0, *(nothing,) * 3, (), 1) is None
    assert native.summed(nothing, nothing, nothing, nothing, 0.0) is None
    assert native.tapes(nothing, None, (), (), nothing) is None
    assert native.curves(*(nothing,) * 5, (), 1) is None
    assert native.fitted(*(nothing,) * 6, ()) is None
