"""sim.town: lanes keep to the right, join without a kink, and a place on them is found again."""

import math
import re
from typing import Any, List, Optional

import numpy as np
import pytest
from shapely.geometry import Point

from obst_avoid.core.settings import SettingsError
from obst_avoid.sim.town import (
    WorldPose,
    crossing_at,
    follow,
    lane_strip,
    locate,
    pose_at,
    robot_from_world,
    town_from_mapping,
    world_from_robot,
)
from unit.towns import LANE, MIDDLE, OFFSET, SIZE, TIGHT, WIDE, beside, shipped_town, town, turned, walked

ENTRY = {'east': (0.0, 0.17), 'north': (0.415, 0.0), 'west': (0.585, 0.415), 'south': (0.17, 0.585)}
EXIT = {'east': (0.585, 0.17), 'north': (0.415, 0.585), 'west': (0.0, 0.415), 'south': (0.17, 0.0)}
"""[m] where the right-hand lane crosses a tile's border, by the heading in which it does."""
ANGLE = {'east': 0.0, 'north': math.pi / 2, 'west': math.pi, 'south': -math.pi / 2}

BENDS = [
    ('─', 'east', 'east'), ('─', 'west', 'west'), ('│', 'north', 'north'), ('│', 'south', 'south'),
    ('┌', 'north', 'east'), ('┌', 'west', 'south'), ('┐', 'east', 'south'), ('┐', 'north', 'west'),
    ('└', 'south', 'east'), ('└', 'west', 'north'), ('┘', 'east', 'north'), ('┘', 'south', 'west'),
]  # fmt: skip
INTERSECTIONS = [
    ('├', 'north', 'straight', 'north'), ('├', 'north', 'right', 'east'), ('├', 'south', 'straight', 'south'),
    ('├', 'south', 'left', 'east'), ('├', 'west', 'right', 'north'), ('├', 'west', 'left', 'south'),
    ('┤', 'north', 'straight', 'north'), ('┤', 'north', 'left', 'west'), ('┤', 'south', 'straight', 'south'),
    ('┤', 'south', 'right', 'west'), ('┤', 'east', 'right', 'south'), ('┤', 'east', 'left', 'north'),
    ('┬', 'east', 'straight', 'east'), ('┬', 'east', 'right', 'south'), ('┬', 'west', 'straight', 'west'),
    ('┬', 'west', 'left', 'south'), ('┬', 'north', 'right', 'east'), ('┬', 'north', 'left', 'west'),
    ('┴', 'east', 'straight', 'east'), ('┴', 'east', 'left', 'north'), ('┴', 'west', 'straight', 'west'),
    ('┴', 'west', 'right', 'north'), ('┴', 'south', 'right', 'west'), ('┴', 'south', 'left', 'east'),
    *(('┼', come, 'straight', come) for come in ENTRY),
    ('┼', 'east', 'left', 'north'), ('┼', 'north', 'left', 'west'), ('┼', 'west', 'left', 'south'),
    ('┼', 'south', 'left', 'east'), ('┼', 'east', 'right', 'south'), ('┼', 'north', 'right', 'east'),
    ('┼', 'west', 'right', 'north'), ('┼', 'south', 'right', 'west'),
]  # fmt: skip
ALL = [(tile, come, None, go) for tile, come, go in BENDS] + INTERSECTIONS


@pytest.mark.parametrize('tile, come, turn, go', ALL, ids=['%s %s %s %s' % case for case in ALL])
def test_the_lane_through_a_tile(tile: str, come: str, turn: Optional[str], go: str) -> None:
    route = follow(town(tile), 0, 0, come, [turn] if turn else [])
    assert len(route.segments) == 1 and route.starts == (0.0,)
    segment = route.segments[0]
    quarter = turned(ANGLE[go], ANGLE[come])
    radius = {0: math.inf, 1: WIDE, -1: TIGHT}[round(quarter / (math.pi / 2))]
    length = SIZE if go == come else radius * math.pi / 2
    assert (segment.x, segment.y) == pytest.approx(ENTRY[come], abs=1e-12)
    assert turned(segment.heading, ANGLE[come]) == pytest.approx(0, abs=1e-12)
    assert segment.length == route.length == pytest.approx(length)
    assert segment.curvature == pytest.approx(math.copysign(1, quarter) / radius)
    assert segment.crossing is (tile in '├┤┬┴┼')
    left = pose_at(route, length)
    assert (left.x, left.y) == pytest.approx(EXIT[go], abs=1e-12)
    assert turned(left.heading, ANGLE[go]) == pytest.approx(0, abs=1e-12)


def test_half_way_through_a_bend() -> None:
    root = math.sqrt(0.5)
    left = pose_at(follow(town('┘'), 0, 0, 'east'), WIDE * math.pi / 4)
    assert (left.x, left.y, left.heading) == pytest.approx((WIDE * root, SIZE - WIDE * root, math.pi / 4))
    right = pose_at(follow(town('┐'), 0, 0, 'east'), TIGHT * math.pi / 4)
    assert (right.x, right.y, right.heading) == pytest.approx((TIGHT * root, TIGHT * root, -math.pi / 4))


def test_d_and_phi_count_to_the_left() -> None:
    route = follow(town('──'), 0, 0, 'east')
    pose = pose_at(route, 0.3, 0.05, 0.2)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((0.3, 0.17 + 0.05, 0.2))


TOURS = [
    pytest.param(1, 0, 'east', ['left', 'left', 'straight'], id='counter-clockwise'),
    pytest.param(6, 0, 'west', ['straight', 'right', 'left', 'left'], id='clockwise'),
    pytest.param(0, 2, 'north', ['right', 'right', 'right'], id='western half'),
]


@pytest.mark.parametrize('column, row, heading, turns', TOURS)
def test_segments_join_without_gap_or_kink(column: int, row: int, heading: str, turns: List[str]) -> None:
    route = follow(shipped_town('town'), column, row, heading, turns, length=20)
    assert route.length >= 20
    for before, start, after in zip(route.segments, route.starts[1:], route.segments[1:]):
        angle = before.heading + before.curvature * before.length
        assert turned(angle, after.heading) == pytest.approx(0, abs=1e-9)
        place, _ = walked(route, start)
        assert abs(place - complex(after.x, after.y)) < 1e-9
    ends = np.cumsum([segment.length for segment in route.segments])
    np.testing.assert_allclose(route.starts, np.concatenate([[0], ends[:-1]]))


@pytest.mark.parametrize('column, row, heading, turns', TOURS)
def test_a_pose_on_a_route_is_where_one_walks_to(column: int, row: int, heading: str, turns: List[str]) -> None:
    route = follow(shipped_town('town'), column, row, heading, turns, length=8)
    for along in np.linspace(0, route.length, 40):
        expected = beside(*walked(route, along), -0.07, 0.3)
        pose = pose_at(route, along, -0.07, 0.3)
        assert (pose.x, pose.y) == pytest.approx((expected.x, expected.y), abs=1e-9)
        assert turned(pose.heading, expected.heading) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize('d', [-0.09, 0.0, 0.1, 0.15])
@pytest.mark.parametrize('phi', [-0.6, 0.0, 0.6])
def test_a_pose_is_found_again(d: float, phi: float) -> None:
    route = follow(shipped_town('town'), 1, 0, 'east', ['left', 'left', 'straight'], length=10)
    stops = np.linspace(0.01, route.length - 0.01, 61)
    for along in stops:
        near = min(max(along + 0.25 * math.sin(1000 * along), 0), route.length)
        found, lane_pose = locate(route, beside(*walked(route, along), d, phi), near)
        assert found == pytest.approx(along, abs=1e-9)
        assert lane_pose.d == pytest.approx(d, abs=1e-9) and lane_pose.phi == pytest.approx(phi, abs=1e-9)
        segment = route.segments[int(np.flatnonzero(np.array(route.starts) <= found)[-1])]
        assert lane_pose.curvature == segment.curvature


def test_before_the_beginning_and_after_the_end_the_lane_goes_on() -> None:
    route = follow(town('──'), 0, 0, 'east')
    before, lane_pose = locate(route, WorldPose(-0.2, 0.2, 0.1), 0.0)
    assert (before, lane_pose.d, lane_pose.phi) == pytest.approx((-0.2, 0.03, 0.1))
    after, lane_pose = locate(route, WorldPose(1.3, 0.1, -0.1), 1.17)
    assert (after, lane_pose.d, lane_pose.phi) == pytest.approx((1.3, -0.07, -0.1))


def test_a_route_that_crosses_itself_is_located_where_the_robot_was() -> None:
    loop = town('┌┐', '└┘')
    route = follow(loop, 0, 1, 'north', length=6)
    around = 4 * TIGHT * math.pi / 2
    pose = pose_at(route, 0.1)
    assert [locate(route, pose, lap * around + 0.1)[0] for lap in (0, 1, 2)] == pytest.approx(
        [lap * around + 0.1 for lap in (0, 1, 2)]
    )


@pytest.mark.parametrize('name, column, heading, tiles', [('straight', 0, 'east', 8), ('straight', 5, 'west', 6)])
def test_a_route_ends_where_the_road_leaves_the_map(name: str, column: int, heading: str, tiles: int) -> None:
    assert follow(shipped_town(name), column, 0, heading).length == pytest.approx(tiles * SIZE)


@pytest.mark.parametrize('length, tiles', [(0.1, 1), (0.585, 1), (0.6, 2)])
def test_a_route_is_as_long_as_asked(length: float, tiles: int) -> None:
    assert len(follow(town('────'), 0, 0, 'east', length=length).segments) == tiles


@pytest.mark.parametrize(
    'tile, come, go',
    [('┼', 'north', 'north'), ('┬', 'north', 'east'), ('┤', 'east', 'south'), ('├', 'north', 'north')],
)
def test_without_a_turn_straight_on_else_right(tile: str, come: str, go: str) -> None:
    route = follow(town(tile), 0, 0, come)
    left = pose_at(route, route.length)
    assert (left.x, left.y) == pytest.approx(EXIT[go])


def test_turns_are_for_intersections_only() -> None:
    rows = [' │ ', '─┼─', ' │ ']
    route = follow(town(*rows), 0, 1, 'east', ['left'])
    assert [segment.crossing for segment in route.segments] == [False, True, False]
    end = pose_at(route, route.length)
    assert (end.x, end.y) == pytest.approx((SIZE + MIDDLE + OFFSET, 3 * SIZE))


GOOD = {'tile_size': 0.585, 'lane_width': 0.22, 'dashed': True, 'tiles': '──'}


@pytest.mark.parametrize(
    'change, message',
    [
        ({'tiles': '─x'}, "map/tiles has 'x' in line 1, column 2, expected one of: "),
        ({'tiles': '┌┐\n└?'}, "map/tiles has '?' in line 2, column 2, expected one of: "),
        ({'tiles': ''}, "map/tiles = '', expected rows of tiles drawn with "),
        ({'tiles': 7}, 'map/tiles = 7, expected rows of tiles drawn with '),
        ({'tiles': '─│'}, "map: the road of tile '─' at column 0, row 0 from the south ends at its E side, expected"),
        ({'tiles': '│\n.'}, "map: the road of tile '│' at column 0, row 1 from the south ends at its S side, expected"),
        ({'lane_width': 0.24}, 'map/lane_width = 0.24, expected at most 0.232 m on tiles of 0.585 m'),
        ({'lane_width': -0.2}, 'map/lane_width = -0.2, expected a number > 0.1 (m)'),
        ({'tile_size': 0.3}, 'map/tile_size = 0.3, expected a number >= 0.4 and <= 1 (m)'),
    ],
)
def test_a_map_that_cannot_be(change: Any, message: str) -> None:
    with pytest.raises(SettingsError, match='^' + re.escape(message)):
        town_from_mapping({**GOOD, **change}, 'map')


@pytest.mark.parametrize(
    'column, heading, turns, message',
    [
        (0, 'up', [], "heading = 'up', expected one of: east, north, west, south"),
        (0, 'north', [], 'no road enters the tile at column 0, row 0 heading north'),
        (7, 'east', [], 'no road enters the tile at column 7, row 0 heading east'),
        (0, 'east', ['left'], "turn 'left' at the intersection in column 1, row 0, expected one of: straight, right"),
        (0, 'east', ['back'], "turn 'back' at the intersection in column 1, row 0, expected one of: straight, right"),
    ],
)
def test_a_route_that_cannot_be(column: int, heading: str, turns: List[str], message: str) -> None:
    with pytest.raises(SettingsError, match='^%s$' % re.escape(message)):
        follow(town('─┬─'), column, 0, heading, turns)


def test_rows_count_from_the_south() -> None:
    small = town('┌─', '│.')
    assert [small.tile(0, 0), small.tile(0, 1), small.tile(1, 1), small.tile(2, 0)] == ['│', '┌', '─', ' ']
    assert small.size == pytest.approx((2 * SIZE, 2 * SIZE)) and small.lane_offset == pytest.approx(OFFSET)


def test_the_lane_between_its_lines() -> None:
    # heading east along y = 0.17, then left about the point (0.585, 0.585)
    strip = lane_strip(follow(town('─┘'), 0, 0, 'east'), 0.2, SIZE + WIDE * math.pi / 6)
    x, y = np.random.RandomState(3).uniform((0, -0.1), (1.2, 0.7), (4000, 2)).T
    angle = np.arctan2(x - SIZE, SIZE - y)
    off = np.where(x < SIZE, np.abs(y - 0.17), np.abs(np.hypot(x - SIZE, y - SIZE) - WIDE))
    within = np.where(x < SIZE, x > 0.2, angle < math.pi / 6)
    clear = (np.abs(off - LANE / 2) > 0.001) & (np.abs(x - 0.2) > 0.001) & (np.abs(angle - math.pi / 6) > 0.01)
    found = np.array([strip.contains(Point(*point)) for point in np.column_stack([x, y])])
    np.testing.assert_array_equal(found[clear], (within & (off < LANE / 2) & (y < SIZE))[clear])
    assert 300 < found.sum() < 1500


@pytest.mark.parametrize('x, y, inside', [(0.6, 0.1, True), (0.58, 0.1, False), (1.16, 0.58, True), (9, 9, False)])
def test_where_an_intersection_is(x: float, y: float, inside: bool) -> None:
    assert crossing_at(town('─┬─'), x, y) is inside


def test_robot_and_world() -> None:
    pose = WorldPose(2.0, 1.0, math.pi / 2)  # facing north
    np.testing.assert_allclose(robot_from_world([[2.0, 1.5], [1.7, 1.0]], pose), [[0.5, 0], [0, 0.3]], atol=1e-12)
    points = np.random.RandomState(1).uniform(-3, 3, (20, 2))
    turned_pose = WorldPose(-1.0, 0.4, 2.3)
    np.testing.assert_allclose(world_from_robot(robot_from_world(points, turned_pose), turned_pose), points)
    assert robot_from_world(np.empty((0, 2)), pose).shape == (0, 2)
