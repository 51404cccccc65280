"""core.detection.robust.features: what is measured on a region."""

import math
from typing import Dict, Optional, Sequence, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.features import (
    AROUND_CELLS,
    CELLS,
    COLORS,
    DIRECTIONS,
    EDGE_CELLS,
    EDGE_GROWN,
    EVEN,
    FAINT,
    NAMES,
    NO_LINE,
    measure,
)
from obst_avoid.core.detection.robust.light import LINEAR, estimate_light, relative
from obst_avoid.core.detection.robust.lines import Line, find_lines
from obst_avoid.core.detection.robust.regions import BLUELESS, RED, WIDE, YELLOW, Regions, find_regions
from obst_avoid.core.detection.robust.view import View, make_view, working_picture
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

CAMERA = calibration_of(Camera())
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
    **{
        'edge%d_%d%d' % (direction, i, j): 'edge%d_%d%d' % (-direction % DIRECTIONS, i, EDGE_CELLS - 1 - j)
        for direction in range(DIRECTIONS)
        for i in range(EDGE_CELLS)
        for j in range(EDGE_CELLS)
    },
    **{name + '_left': name + '_right' for name in COLORS},
    **{name + '_right': name + '_left' for name in COLORS},
}
"""What a measurement is called in a mirrored picture, where that is another name."""


def measured(picture: np.ndarray, calibration: Calibration = CAMERA) -> Tuple[Regions, np.ndarray, View]:
    """Regions of a camera picture and what is measured on them."""
    view = make_view(calibration)
    asphalt = estimate_light(picture)
    light = relative(working_picture(picture, view), asphalt)
    regions = find_regions(light, view)
    lines = find_lines(picture, view.sampling, asphalt.as_array())
    return regions, measure(regions, light, view, lines), view


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


# Lines

LINE_NAMES = ('line_distance', 'line_beyond', 'line_width', 'line_blue')
X, Y = 0.4, 0.05
"""[m] ahead and left of a thing's foot."""


@pytest.fixture(scope='module')
def view() -> View:
    """Of a camera without roll or yaw."""
    return make_view(CAMERA)


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


def standing(view: View, x: float, y: float) -> Tuple[Regions, np.ndarray]:
    """The light of something yellow with the middle of its foot there, by the calibration, and its region."""
    pixel = image_from_rectified(CAMERA, pixel_from_ground(CAMERA.homography, np.array([[x, y]])))[0]
    u, v = np.rint((pixel + 0.5) / view.scale - 0.5).astype(int)
    light = np.ones((view.height, view.width, 3), np.float32)
    light[v - 19 : v + 1, u - 10 : u + 10] = (0.3, 4.0, 5.0)
    return find_regions(light, view), light


def beside(view: View, lines: Sequence[Line], x: float = X, y: float = Y) -> Dict[str, float]:
    """What is measured on a thing there."""
    regions, light = standing(view, x, y)
    values = measure(regions, light, view, lines)[np.flatnonzero(regions.channel == YELLOW)[0]]
    return dict(zip(NAMES, values.tolist()))


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
    dashes = (regions.channel == YELLOW) & (regions.level >= 5)
    dashes &= (column(values, 'ahead') > 0.2) & (column(values, 'ahead') < 0.6)
    assert len({tuple(box) for box in regions.box[dashes]}) >= 4
    assert column(values, 'line_distance')[dashes].max() < 0.015
    assert column(values, 'line_beyond')[dashes].max() == 0
    assert column(values, 'line_width')[dashes] == pytest.approx(0.025, abs=0.004)
    assert column(values, 'line_blue')[dashes].max() < 0.5


# Edges

BOX = (120, 110, 24, 24)
"""Left, top, width, height in the working picture: an edge's cell is 6 by 6 pixels."""
STEP = math.log2((4 + FAINT) / (1 + FAINT))
"""[octaves] from asphalt to light of 4."""


def edges(view: View, light: np.ndarray, box: Tuple[int, ...] = BOX) -> Tuple[float, np.ndarray]:
    """Steepness, and shares by row, column and direction, of whatever light there is in a box."""
    left, top, width, height = box
    yellow = np.ones_like(light)
    yellow[top : top + height, left : left + width] = (0.3, 4.0, 5.0)
    regions = find_regions(yellow, view)
    values = measure(regions, light, view, [])
    index = np.flatnonzero(regions.channel == YELLOW)[0]
    assert tuple(regions.box[index]) == box
    names = ['edge%d_%d%d' % (k, i, j) for i in range(EDGE_CELLS) for j in range(EDGE_CELLS) for k in range(DIRECTIONS)]
    shares = np.array([column(values, name)[index] for name in names])
    return float(column(values, 'steepness')[index]), shares.reshape(EDGE_CELLS, EDGE_CELLS, DIRECTIONS)


def ramp(view: View, across: float, down: float) -> np.ndarray:
    """Light that grows by so many octaves a pixel, bright all over the box."""
    v, u = np.mgrid[0 : view.height, 0 : view.width] - np.array([122, 132])[:, None, None]
    return np.repeat(np.exp2(6 + across * u + down * v)[..., None], 3, axis=2).astype(np.float32)


def hilly(view: View, seed: int) -> np.ndarray:
    """Light of hills and valleys of all sizes, some octaves deep."""
    noise = np.random.RandomState(seed).randn(view.height, view.width, 3).astype(np.float32)
    return np.exp2(8 * cv2.GaussianBlur(noise, (0, 0), 2)) + np.float32(0.3)


@pytest.mark.parametrize('value', [0.01, 1.0, 30.0])
def test_what_is_flat_has_no_edges(view: View, value: float) -> None:
    steepness, shares = edges(view, np.full((view.height, view.width, 3), value, np.float32))
    assert steepness == pytest.approx(math.log2(EVEN))
    assert not shares.any()


def test_what_is_flat_amid_hills_has_none_either(view: View) -> None:
    """Sums over all of the picture are taken from each other."""
    light = hilly(view, 0)
    light[90:160, 100:180] = 2.0
    steepness, shares = edges(view, light)
    assert steepness == pytest.approx(math.log2(EVEN), abs=0.01)
    np.testing.assert_allclose(shares, 0, atol=0.01)


@pytest.mark.parametrize('up', [True, False], ids=['up', 'down'])
@pytest.mark.parametrize('cell', [0, 2, 5])
def test_a_step_is_in_its_cells_and_its_direction(view: View, cell: int, up: bool) -> None:
    """From left to right it is across, direction 0; from above to below it is direction 2."""
    mean = STEP / 6 / EDGE_CELLS  # [octaves a pixel]
    for direction in (0, 2):
        light = np.ones((view.height, view.width, 3), np.float32)
        along = light.swapaxes(0, 1) if direction == 0 else light
        at = BOX[0 if direction == 0 else 1] - 6 + 6 * cell + 3  # the middle of the cell
        along[at:] = 4.0 if up else 1.0
        along[:at] = 1.0 if up else 4.0
        steepness, shares = edges(view, light)
        expected = np.zeros((EDGE_CELLS, EDGE_CELLS, DIRECTIONS))
        expected[(slice(None), cell) if direction == 0 else (cell, slice(None))][:, direction] = STEP / 6
        assert steepness == pytest.approx(math.log2(mean + EVEN), abs=1e-3)
        np.testing.assert_allclose(shares, expected / (mean + EVEN), atol=0.01)
    assert EDGE_GROWN * BOX[2] == 6


@pytest.mark.parametrize(
    'across, down, direction',
    [(0.1, 0.0, 0), (-0.1, 0.0, 0), (0.1, 0.1, 1), (-0.1, -0.1, 1), (0.0, 0.1, 2), (0.0, -0.1, 2), (-0.1, 0.1, 3)],
)
def test_a_slope_is_as_steep_as_it_is_whatever_its_direction(
    view: View, across: float, down: float, direction: int
) -> None:
    steepness, shares = edges(view, ramp(view, across, down))
    slope = math.hypot(across, down)
    assert 2**steepness - EVEN == pytest.approx(slope, rel=0.05)
    expected = np.zeros(DIRECTIONS)
    expected[direction] = slope / (slope + EVEN)
    np.testing.assert_allclose(shares, np.broadcast_to(expected, shares.shape), atol=0.05)


def test_between_two_directions_both_have_their_share(view: View) -> None:
    for turn, expected in ((22.5, (0.5, 0.5, 0, 0)), (60.0, (0, 2 / 3, 1 / 3, 0)), (165.0, (2 / 3, 0, 0, 1 / 3))):
        angle = math.radians(turn)
        _, shares = edges(view, ramp(view, 0.1 * math.cos(angle), 0.1 * math.sin(angle)))
        assert shares.mean(axis=(0, 1)) / shares.sum(axis=2).mean() == pytest.approx(expected, abs=0.02)


def test_a_mirrored_picture_has_mirrored_edges(view: View) -> None:
    """What rises to the right and down rises to the left and down there."""
    light = hilly(view, 1)
    for left, top, width, height in (BOX, (40, 150, 17, 30), (0, 100, 13, 11), (281, 190, 39, 50)):
        steepness, shares = edges(view, light, (left, top, width, height))
        mirrored = edges(view, np.ascontiguousarray(light[:, ::-1]), (view.width - left - width, top, width, height))
        assert mirrored[0] == pytest.approx(steepness, abs=1e-3)
        np.testing.assert_allclose(mirrored[1], shares[:, ::-1][..., [0, 3, 2, 1]], atol=5e-3)
        assert np.abs(mirrored[1] - shares[:, ::-1]).max() > 0.1, 'and slopes there are'


def test_edges_are_the_same_in_brighter_light(view: View) -> None:
    """Four times all light, where what is faint plays no part."""
    light = 4 * hilly(view, 2)
    steepness, shares = edges(view, light)
    brighter = edges(view, 4 * light)
    assert steepness > math.log2(2 * EVEN), 'there are edges'
    assert brighter[0] == pytest.approx(steepness, abs=0.03)
    np.testing.assert_allclose(brighter[1], shares, atol=0.02)


def test_what_is_faint_is_not_steep(view: View) -> None:
    """In the dark the noise of a camera is a large ratio."""
    light = hilly(view, 3)
    assert edges(view, light * np.float32(1e-3))[0] < edges(view, light)[0] - 1
