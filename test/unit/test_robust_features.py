"""core.detection.robust.features: what is measured on a region."""

from typing import Optional, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.features import AROUND_CELLS, CELLS, COLORS, FAINT, NAMES, measure
from obst_avoid.core.detection.robust.light import LINEAR, estimate_light, relative
from obst_avoid.core.detection.robust.regions import Regions, find_regions
from obst_avoid.core.detection.robust.view import View, make_view, working_picture
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

CAMERA = calibration_of(Camera())
YELLOW, RED, BLUELESS, WIDE = range(4)
MIRRORED = {
    **{
        '%s%d%d' % (name, i, j): '%s%d%d' % (name, i, 4 - j)
        for name in (*COLORS, 'own')
        for i in range(5)
        for j in range(5)
    },
    **{
        'around_%s%d%d' % (name, i, j): 'around_%s%d%d' % (name, i, AROUND_CELLS - 1 - j)
        for name in ('brightness', 'blue')
        for i in range(AROUND_CELLS)
        for j in range(AROUND_CELLS)
    },
    **{name + '_left': name + '_right' for name in COLORS},
    **{name + '_right': name + '_left' for name in COLORS},
}
"""What a measurement is called in a mirrored picture, where that is another name."""


def measured(picture: np.ndarray, calibration: Calibration = CAMERA) -> Tuple[Regions, np.ndarray, View]:
    """Regions of a camera picture and what is measured on them."""
    view = make_view(calibration)
    light = relative(working_picture(picture, view), estimate_light(picture))
    regions = find_regions(light, view)
    return regions, measure(regions, light, view), view


def column(values: np.ndarray, name: str) -> np.ndarray:
    """One measurement of all regions."""
    return values[:, NAMES.index(name)]


def best(regions: Regions, picture: np.ndarray, without: np.ndarray, view: View, channel: Optional[int] = None) -> int:
    """The region that covers best where two pictures differ, by intersection over union."""
    change = np.abs(working_picture(picture, view).astype(int) - working_picture(without, view)).max(axis=2) > 40
    rows, columns = np.flatnonzero(change.any(axis=1)), np.flatnonzero(change.any(axis=0))
    low, high = np.array([columns[0], rows[0]]), np.array([columns[-1] + 1, rows[-1] + 1])
    corners = regions.box[:, :2] + regions.box[:, 2:]
    common = np.prod(np.maximum(np.minimum(corners, high) - np.maximum(regions.box[:, :2], low), 0), axis=1)
    ratio = common / (np.prod(regions.box[:, 2:], axis=1) + np.prod(high - low) - common)
    if channel is not None:
        ratio[regions.channel != channel] = -1
    assert ratio.max() > 0.6
    return int(np.argmax(ratio))


def test_each_column_has_a_name_of_its_own() -> None:
    assert len(set(NAMES)) == len(NAMES)
    regions, values, _ = measured(picture_of(CAMERA, (duckie(0.4, 0.0), cone(0.5, -0.2))))
    assert len(regions) > 10
    assert values.shape == (len(regions), len(NAMES))
    assert values.dtype == np.float32


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


@pytest.mark.parametrize('size', [(320, 240), (640, 480), (1280, 960)], ids='%dx%d'.__mod__)
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
    if what != 'noise':
        assert len(regions) > 0
    assert np.isfinite(values).all()


def test_everything_in_a_picture_of_one_yellow_has_no_neighbours() -> None:
    """Nothing to compare with: as wide as the widest, from the first level to the last."""
    picture = np.full((480, 640, 3), 100, np.uint8)
    picture[300:400, 200:300] = (0, 220, 250)
    regions, values, _ = measured(picture)
    first = np.flatnonzero((regions.channel == YELLOW) & (regions.level == 0))
    last = np.flatnonzero(
        (regions.channel == YELLOW) & (regions.level == regions.level[regions.channel == YELLOW].max())
    )
    assert column(values, 'parent')[first].tolist() == [6.0]
    assert column(values, 'child')[last].max() < -4  # nothing is left a level later, or nearly
    between = np.flatnonzero((regions.channel == YELLOW) & (regions.level > 0))
    np.testing.assert_allclose(column(values, 'parent')[between], 0, atol=0.15)
    for name in ('parent_width', 'parent_height', 'parent_foot', 'parent_top'):
        np.testing.assert_allclose(column(values, name)[between], 0, atol=0.15)


@pytest.mark.parametrize('x, y', [(0.3, 0.0), (0.4, 0.06), (0.6, -0.1), (0.8, 0.0)])
def test_sizes_are_those_on_the_road(x: float, y: float) -> None:
    thing = duckie(x, y, 0.06)
    picture = picture_of(CAMERA, (thing,))
    regions, values, view = measured(picture)
    index = best(regions, picture, picture_of(CAMERA), view)
    named = dict(zip(NAMES, values[index].tolist()))
    assert named['ahead'] == pytest.approx(x, rel=0.08)
    assert named['aside'] == pytest.approx(abs(y), abs=0.015)
    assert 2 ** named['width'] == pytest.approx(2 * thing.radius, rel=0.25)
    assert named['rise'] == pytest.approx(0.06 / Camera().height, rel=0.3)
    assert 2 ** named['rise_to_width'] == pytest.approx(named['rise'] / 2 ** named['width'], rel=1e-3)
    left, top, width, height = (float(value) for value in regions.box[index])
    assert 2 ** named['log_width'] == pytest.approx(width)
    assert 2 ** named['log_height'] == pytest.approx(height)
    assert 2 ** named['aspect'] == pytest.approx(width / height, rel=1e-5)
    assert named['fill'] == pytest.approx(regions.area[index] / (width * height))
    assert named['off_middle'] == pytest.approx(abs(regions.middle[index, 0] - left - width / 2) / width, abs=1e-5)
    assert named['low_middle'] == pytest.approx((regions.middle[index, 1] - top) / height, abs=1e-5)


def test_colours_are_those_of_the_thing() -> None:
    picture = np.full((480, 640, 3), 90, np.uint8)
    color = np.array([20, 180, 240])
    picture[300:380, 280:360] = color
    regions, values, _ = measured(picture)
    row = dict(zip(NAMES, values[np.flatnonzero(regions.channel == YELLOW)[0]].tolist()))
    blue, green, red = LINEAR[color] / LINEAR[90] + FAINT
    assert row['brightness'] == pytest.approx(np.log2((blue + green + red) / 3), abs=0.1)
    assert row['green'] == pytest.approx(np.log2(green / red), abs=0.1)
    assert row['blue'] == pytest.approx(np.log2(2 * blue / (green + red)), abs=0.2)
    for name in COLORS:
        assert row[name + '_spread'] == pytest.approx(0, abs=0.4)
    for end in ('above', 'below', 'left', 'right'):
        assert row['brightness_' + end] < -1.5, 'asphalt is darker'
        assert row['blue_' + end] > 2, 'and bluer'
    middle = [row['brightness%d%d' % (i, j)] for i in (1, 2, 3) for j in (1, 2, 3)]
    assert middle == pytest.approx([0.0] * 9, abs=0.25)
    assert row['own22'] == 1
    assert row['own00'] == 0
    assert row['around_brightness00'] == pytest.approx(-row['brightness'], abs=0.1)
    assert row['around_brightness33'] == pytest.approx(0, abs=0.2)
    assert (row['cut_side'], row['cut_low'], row['cut_top']) == (0, 0, 0)


@pytest.mark.parametrize(
    'rows, columns, name',
    [
        pytest.param(slice(300, 380), slice(0, 60), 'cut_side', id='left'),
        pytest.param(slice(300, 380), slice(580, 640), 'cut_side', id='right'),
        pytest.param(slice(400, 480), slice(280, 360), 'cut_low', id='low'),
        pytest.param(slice(90, 190), slice(280, 380), 'cut_top', id='top'),
    ],
)
def test_what_is_cut_is_marked(rows: slice, columns: slice, name: str) -> None:
    picture = np.full((480, 640, 3), 90, np.uint8)
    picture[rows, columns] = (20, 180, 240)
    regions, values, _ = measured(picture)
    row = dict(zip(NAMES, values[np.flatnonzero(regions.channel == YELLOW)[0]].tolist()))
    assert {end: bool(row[end]) for end in ('cut_side', 'cut_low', 'cut_top')} == {
        end: end == name for end in ('cut_side', 'cut_low', 'cut_top')
    }


def test_paint_is_narrow_and_a_duckie_is_not() -> None:
    picture = picture_of(CAMERA, (duckie(0.4, 0.0, 0.06),))
    regions, values, view = measured(picture)
    thing = best(regions, picture, picture_of(CAMERA), view, YELLOW)
    assert column(values, 'narrowness')[thing] <= 2
    line = np.flatnonzero((regions.channel == YELLOW) & (regions.box[:, 0] + regions.box[:, 2] < regions.box[thing, 0]))
    line = line[regions.box[line, 1] > 0.45 * view.height]
    assert len(line) >= 2
    assert (column(values, 'narrowness')[line] >= 4).all()
    assert (column(values, 'narrowness_more') >= column(values, 'narrowness') - 1).all()


def test_a_mirrored_picture_gives_mirrored_values() -> None:
    """The middle of the camera's picture is the middle of the camera, so a mirrored picture is of a mirrored road."""
    calibration = calibration_of(Camera(distortion=(-0.2, 0.03, 0.0, 0.0, 0.0)))
    picture = picture_of(calibration, (duckie(0.4, 0.07, 0.06), cone(0.5, -0.12, 0.06)))
    regions, values, view = measured(picture, calibration)
    mirrored, other, _ = measured(np.ascontiguousarray(picture[:, ::-1]), calibration)
    np.testing.assert_allclose(view.nearness, view.nearness[:, ::-1], atol=2e-3)
    order = [NAMES.index(MIRRORED.get(name, name)) for name in NAMES]
    grid = [i for i, name in enumerate(NAMES) if name[-2:].isdigit() or name.endswith(('_left', '_right'))]
    exact = [NAMES.index(name) for name in ('aspect', 'fill', 'log_width', 'log_height', 'low_middle')]
    some = ('lean', 'narrowness', 'narrowness_more', 'wide', 'parent', 'child')  # depend on single cells
    loose = [i for i, name in enumerate(NAMES) if i not in grid and not name.startswith(some)]
    differences = []
    for index in np.flatnonzero(regions.channel != WIDE):  # opening by an even number of pixels shifts by one
        left, top, width, height = regions.box[index]
        same = (mirrored.channel == regions.channel[index]) & (mirrored.level == regions.level[index])
        same &= (mirrored.box == (view.width - left - width, top, width, height)).all(axis=1)
        (there,) = np.flatnonzero(same)
        difference = np.abs(values[index] - other[there][order])
        assert difference[exact].max() < 1e-4
        assert difference[NAMES.index('off_middle')] < 1.01 / width  # counted from pixels' edges
        assert difference[loose].max() < 0.6, NAMES[loose[int(np.argmax(difference[loose]))]]
        differences.append(difference)
    assert len(differences) > 20
    assert np.median(np.array(differences)[:, grid]) < 0.1
    for name in some:
        assert np.median(np.array(differences)[:, NAMES.index(name)]) < 0.3, name


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
        same = (others.channel == channel) & (others.level == regions.level[here])
        same &= np.abs(others.box - regions.box[here]).max(axis=1) <= 2
        (other,) = np.flatnonzero(same)
        for name in (*COLORS, 'green22', 'brightness22', 'around_brightness33'):
            assert column(there, name)[other] == pytest.approx(column(values, name)[here], abs=0.3), name


def test_cells_divide_by_two() -> None:
    assert CELLS % 2 == 0


def test_a_hill_of_yellow_shrinks_from_level_to_level() -> None:
    """Its child is smaller than it is, its parent larger: logarithms to the base 2 of the areas."""
    v, u = np.mgrid[0:480, 0:640]
    hill = np.exp(-((u - 300) ** 2 + (v - 340) ** 2) / 1500)
    picture = np.full((480, 640, 3), 90, np.uint8)
    picture[..., 1:] += (150 * hill[..., None]).astype(np.uint8)
    regions, values, _ = measured(picture)
    rows = np.flatnonzero(regions.channel == YELLOW)
    rows = rows[np.argsort(regions.level[rows])]
    assert len(rows) >= 4
    areas = regions.area[rows]
    steps = np.log2((areas[1:] + 1) / areas[:-1])
    assert (steps < -0.1).all()
    np.testing.assert_allclose(column(values, 'child')[rows[:-1]], steps, atol=1e-4)
    np.testing.assert_allclose(column(values, 'parent')[rows[1:]], np.log2((areas[:-1] + 1) / areas[1:]), atol=1e-4)
    assert (column(values, 'parent_width')[rows[1:]] > 0).all()
