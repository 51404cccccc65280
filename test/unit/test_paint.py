"""sim.paint: the tape's places and widths, measured on the picture of the ground against the specification."""

import functools
from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.sim.paint import ASPHALT, RED, WHITE, YELLOW, ground_picture, on_road
from obst_avoid.sim.town import Town
from unit.towns import LANE, MIDDLE, SIZE, shipped_town, town

TOLERANCE = 0.0015
"""[m]"""
CORNERS = {'┌': (1, 0), '┐': (0, 0), '└': (1, 1), '┘': (0, 1)}
"""The corner of the tile, in tiles, about which its road bends."""
FROM = {'┌': 90, '┐': 0, '└': 180, '┘': 270}
"""[degrees] where the quarter about that corner begins."""
SIDES = {'E': (1, 0), 'N': (0, 1), 'W': (-1, 0), 'S': (0, -1)}
REACHED = {'├': 'ENS', '┤': 'NSW', '┬': 'ESW', '┴': 'ENW', '┼': 'ENSW'}

Edges = List[Tuple[float, float]]


@functools.lru_cache(maxsize=None)
def whole_paint(small: Town) -> Any:
    """The paint of several seeds laid over one another: where one is worn, another is whole."""
    return np.max([ground_picture(small, seed) for seed in range(8)], axis=0)


def along(small: Town, channel: int, points: Any) -> Any:
    """(N,) share of paint, 0 to 1, at (N, 2) points of the world in m."""
    picture = whole_paint(small)
    per_metre = picture.shape[1] / small.size[0]
    u = points[:, 0] * per_metre - 0.5
    v = picture.shape[0] - points[:, 1] * per_metre - 0.5
    maps = np.stack([u, v], axis=-1)[None].astype(np.float32)
    return cv2.remap(np.ascontiguousarray(picture[..., channel]), maps, None, cv2.INTER_LINEAR)[0] / 255.0


def stripes(small: Town, channel: int, start: Any, end: Any) -> Edges:
    """[m] from `start` on the line to `end`: where stripes of paint begin and end, at half of the full paint."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    length = float(np.linalg.norm(end - start))
    steps = np.arange(0, length, 0.0002)
    share = along(small, channel, start + np.outer(steps / length, end - start))
    begins = np.flatnonzero((share[:-1] < 0.5) & (share[1:] >= 0.5)) + 1
    ends = np.flatnonzero((share[:-1] >= 0.5) & (share[1:] < 0.5)) + 1
    return [(float(steps[b]), float(steps[e])) for b, e in zip(begins, ends)] if len(begins) == len(ends) else []


def typical(found: List[Edges], count: int) -> Any:
    """(count, 2) the median of those cross sections that show so many stripes; the yellow line has gaps."""
    whole = [edges for edges in found if len(edges) == count]
    assert len(whole) > 0.5 * len(found), 'stripes: %s' % [len(edges) for edges in found]
    return np.median(whole, axis=0)


def check_cross_sections(white: Any, yellow: Any) -> None:
    """white: the two outer lines. yellow: the middle line. Rows of begin and end, m across the road."""
    (left_outer, left_inner), (right_inner, right_outer) = white
    ((yellow_left, yellow_right),) = yellow
    assert left_inner - left_outer == pytest.approx(0.048, abs=TOLERANCE)
    assert right_outer - right_inner == pytest.approx(0.048, abs=TOLERANCE)
    assert yellow_right - yellow_left == pytest.approx(0.025, abs=TOLERANCE)
    assert yellow_left - left_inner == pytest.approx(LANE, abs=TOLERANCE)
    assert right_inner - yellow_right == pytest.approx(LANE, abs=TOLERANCE)


@pytest.mark.parametrize('tile', ['─', '│'])
def test_lines_of_a_straight(tile: str) -> None:
    small = town(tile + tile) if tile == '─' else town(tile, tile)
    across = (lambda s: ((s, 0), (s, SIZE))) if tile == '─' else (lambda s: ((0, s), (SIZE, s)))
    places = np.arange(0.02, 2 * SIZE, 0.013)
    white, yellow = (typical([stripes(small, c, *across(s)) for s in places], n) for c, n in ((WHITE, 2), (YELLOW, 1)))
    check_cross_sections(white, yellow)
    assert yellow.mean() == pytest.approx(MIDDLE, abs=0.0005)


@pytest.mark.parametrize('tile', list(CORNERS))
def test_lines_of_a_bend(tile: str) -> None:
    small, corner = town(tile), SIZE * np.array(CORNERS[tile], dtype=float)
    ways = [np.array([np.cos(a), np.sin(a)]) for a in np.radians(FROM[tile] + np.arange(1, 90, 1.5))]
    found = [[stripes(small, c, corner, corner + 0.58 * way) for way in ways] for c in (WHITE, YELLOW)]
    white, yellow = typical(found[0], 2), typical(found[1], 1)
    check_cross_sections(white, yellow)
    assert yellow.mean() == pytest.approx(MIDDLE, abs=0.0005)


def test_dashes_of_a_straight_also_from_tile_to_tile() -> None:
    dashes = np.array(stripes(town('──'), YELLOW, (0, MIDDLE), (2 * SIZE, MIDDLE)))
    assert len(dashes) == 16
    assert np.median(np.diff(dashes, axis=1)) == pytest.approx(0.050, abs=0.002)
    gaps = dashes[1:, 0] - dashes[:-1, 1]
    assert np.median(gaps) == pytest.approx(0.025, abs=0.002)
    assert gaps[7] == pytest.approx(np.median(gaps), abs=TOLERANCE), "at the tiles' border"


@pytest.mark.parametrize('tile', list(CORNERS))
def test_dashes_of_a_bend(tile: str) -> None:
    angles = np.radians(FROM[tile]) + np.linspace(0, np.pi / 2, 4001)
    points = SIZE * np.array(CORNERS[tile]) + MIDDLE * np.column_stack([np.cos(angles), np.sin(angles)])
    changes = np.flatnonzero(np.diff((along(town(tile), YELLOW, points) > 0.5).astype(int)))
    lengths = np.diff(changes) * MIDDLE * np.pi / 2 / 4000
    assert len(lengths) == 11
    assert np.median(lengths[::2]) == pytest.approx(0.050, abs=0.002)
    assert np.median(lengths[1::2]) == pytest.approx(0.025, abs=0.002)


@pytest.mark.parametrize('tile', ['─', *CORNERS])
def test_a_solid_yellow_line_has_no_gaps(tile: str) -> None:
    if tile == '─':
        points = np.column_stack([np.linspace(0.001, 0.584, 500), np.full(500, MIDDLE)])
    else:
        angles = np.radians(FROM[tile]) + np.linspace(0.002, np.pi / 2 - 0.002, 500)
        points = SIZE * np.array(CORNERS[tile]) + MIDDLE * np.column_stack([np.cos(angles), np.sin(angles)])
    assert along(town(tile, dashed=False), YELLOW, points).min() > 0.9
    assert along(town(tile), YELLOW, points).min() == 0


@pytest.mark.parametrize('tile', list(REACHED))
def test_stop_lines_lie_across_the_lanes_that_enter(tile: str) -> None:
    small, middle = town(tile), np.array([MIDDLE, MIDDLE])
    for side, (x, y) in SIDES.items():
        out, right = np.array([x, y]), np.array([-y, x])  # right: of who drives in over this side
        for lane, expected in ((right, side in REACHED[tile]), (-right, False)):
            inward = [middle + lane * o + out * MIDDLE for o in np.arange(0.03, 0.22, 0.01)]
            found = [stripes(small, RED, start + 0.01 * out, start - 0.2 * out) for start in inward]
            if not expected:
                assert not any(found)
                continue
            ((begin, end),) = typical(found, 1)
            assert (begin, end) == pytest.approx((0.010, 0.058), abs=TOLERANCE)
            rows = [middle + out * (MIDDLE - inset) for inset in np.arange(0.006, 0.045, 0.003)]
            ((begin, end),) = typical([stripes(small, RED, row, row + 0.28 * lane) for row in rows], 1)
            assert (begin, end) == pytest.approx((0.0125, 0.0125 + LANE), abs=TOLERANCE)


@pytest.mark.parametrize('tile', list(REACHED))
def test_an_intersection_has_a_white_line_along_its_closed_side_and_nothing_yellow(tile: str) -> None:
    small = town(tile)
    assert not ground_picture(small, 5)[..., YELLOW].any()
    for side, (x, y) in SIDES.items():
        out, beside = np.array([x, y]), np.array([-y, x])
        starts = [np.array([MIDDLE, MIDDLE]) + o * beside for o in np.arange(-0.2, 0.2, 0.02)]
        found = [stripes(small, WHITE, start, start + 0.29 * out) for start in starts]
        if side in REACHED[tile]:
            assert not any(found)
        else:
            assert typical(found, 1)[0] == pytest.approx((0.0125 + LANE, 0.0125 + LANE + 0.048), abs=TOLERANCE)


def test_lines_are_where_the_map_says() -> None:
    # a road through the two northern of six tiles
    small = town('──', '..', '..')
    v, _ = np.nonzero(ground_picture(small, 5)[..., WHITE] > 128)
    assert v.max() < 512
    np.testing.assert_array_equal(on_road(small), [[True, True], [False, False], [False, False]])


def test_wear_thins_a_little_of_the_paint() -> None:
    worn, whole = ground_picture(shipped_town('straight'), 5)[..., WHITE], whole_paint(town('─'))[..., WHITE]
    inner = np.tile(whole == 255, (1, 8))
    assert 0.01 < (worn[inner] < 230).mean() < 0.15
    assert not worn[np.tile(whole == 0, (1, 8))].any()


def test_a_seed_gives_one_picture_and_another_seed_another() -> None:
    small = shipped_town('straight')
    first, again, other = (ground_picture.__wrapped__(small, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    for channel in (WHITE, YELLOW, ASPHALT):
        assert (first[..., channel] != other[..., channel]).any()


def test_the_ground_is_read_only_since_it_is_shared() -> None:
    with pytest.raises(ValueError, match='read-only'):
        ground_picture(town('─'), 5)[0, 0, 0] = 1


def test_asphalt_is_grey_on_the_average() -> None:
    asphalt = ground_picture(shipped_town('straight'), 1)[..., ASPHALT]
    assert asphalt.mean() == pytest.approx(128, abs=5) and 10 < asphalt.std() < 50
