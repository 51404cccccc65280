"""sim.truth: which obstacles are in our lane, how we stand in it, and what each pixel shows."""

import math
from typing import Any, Iterator, Optional, Tuple

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.types import Box, Kind
from obst_avoid.sim.renderer import Renderer, Scene
from obst_avoid.sim.things import Thing
from obst_avoid.sim.town import Route, Town, WorldPose, follow
from obst_avoid.sim.truth import box_of, obstacles_of, truth_of
from unit.towns import DULL, SIZE, TIGHT, WIDE, town

STRAIGHT = town('────')
BEND = town('─┘')
CROSSING = town('.│..', '─┼──', '.│..')


def in_lane(place: Town, route: Route, x: float, y: float, along: float = 0.2, **more: Any) -> Optional[bool]:
    """What the truth says of a duckie, or a ball's width of one, at a place of the world."""
    thing = Thing('cone', x, y, height=0.08, **more)  # its base is 60 mm square
    (found,) = obstacles_of([thing], place, route, along, WorldPose(along, 0.17, 0.0))
    return found.in_lane


@pytest.mark.parametrize(
    'y, expected',
    [
        (0.17, True),
        (0.10, True),
        (0.08, True),
        (0.035, True),
        (0.025, False),
        (0.0, False),
        (0.305, True),
        (0.315, False),
        (0.42, False),
        (-0.2, False),
    ],
    ids=[
        'middle', 'beside the right line', 'partly over it', 'just over it', 'just beyond it', 'off the road',
        'just over the middle line', 'just beyond it', 'opposite lane', 'beyond the road',
    ],
)  # fmt: skip
def test_in_lane_on_a_straight(y: float, expected: bool) -> None:
    # our lane reaches from y = 0.06 to 0.28, the base 0.03 to each side
    assert in_lane(STRAIGHT, follow(STRAIGHT, 0, 0, 'east'), 0.7, y) is expected


def test_a_turned_base_reaches_farther() -> None:
    # 42 mm to its corners
    route = follow(STRAIGHT, 0, 0, 'east')
    assert in_lane(STRAIGHT, route, 0.7, 0.32, yaw=math.pi / 4) is True
    assert in_lane(STRAIGHT, route, 0.7, 0.325, yaw=math.pi / 4) is False


@pytest.mark.parametrize(
    'degrees, radius, expected',
    [
        (60, WIDE, True),
        (60, WIDE + 0.1, True),
        (60, WIDE - 0.1, True),
        (45, WIDE + 0.16, False),
        (45, WIDE - 0.16, False),
        (80, WIDE, True),
    ],
)
def test_in_lane_in_a_bend_goes_by_the_bend(degrees: float, radius: float, expected: bool) -> None:
    # left about (0.585, 0.585)
    x, y = SIZE + radius * math.sin(math.radians(degrees)), SIZE - radius * math.cos(math.radians(degrees))
    assert in_lane(BEND, follow(BEND, 0, 0, 'east'), x, y, along=0.3) is expected


def test_straight_ahead_is_outside_where_the_lane_bends_away() -> None:
    # 0.5 m into the bend's tile the lane is 0.24 m farther left
    route = follow(BEND, 0, 0, 'east')
    assert in_lane(BEND, route, SIZE + 0.5, 0.17, along=0.3) is False
    assert in_lane(STRAIGHT, follow(STRAIGHT, 0, 0, 'east'), SIZE + 0.5, 0.17, along=0.3) is True


@pytest.mark.parametrize(
    'turn, x, y, expected',
    [
        ('straight', 0.9, SIZE + 0.17, True),
        ('straight', 0.9, SIZE + 0.42, None),
        ('straight', 0.75, SIZE + 0.5, None),
        ('straight', 1.5, SIZE + 0.17, True),
        ('straight', 1.5, SIZE + 0.42, False),
        ('straight', 0.9, 0.3, False),
        ('left', SIZE + WIDE * 0.7071, 2 * SIZE - WIDE * 0.7071, True),
        ('left', 1.1, SIZE + 0.08, None),
        ('right', SIZE + TIGHT * 0.7071, SIZE + TIGHT * 0.7071, True),
        ('right', 1.0, SIZE + 0.4, None),
        ('right', 1.5, SIZE + 0.17, False),
    ],
)
def test_in_lane_at_an_intersection(turn: str, x: float, y: float, expected: Optional[bool]) -> None:
    assert in_lane(CROSSING, follow(CROSSING, 0, 1, 'east', [turn]), x, y) is expected


def test_what_is_behind_is_in_no_lane_of_ours_and_what_is_far_ahead_is_unknown() -> None:
    long = town('──────────')
    route = follow(long, 0, 0, 'east')
    # at least from 0.3 m behind to 3 m ahead, and not much more
    places = [(0.6, False), (1.25, True), (2.0, True), (4.45, True), (5.2, None)]
    assert [in_lane(long, route, x, 0.17, along=1.5) for x, _ in places] == [expected for _, expected in places]


def test_only_obstacles_count_and_keep_their_order() -> None:
    sorts = ['wood', 'cone', 'ball', 'duckie', 'duckiebot', 'banded_cone']
    things = [Thing(sort, 0.5 + 0.1 * index, 0.17) for index, sort in enumerate(sorts)]
    found = obstacles_of(things, STRAIGHT, follow(STRAIGHT, 0, 0, 'east'), 0.2, WorldPose(0.2, 0.17, 0.0))
    assert [obstacle.kind for obstacle in found] == [Kind.CONE, Kind.DUCKIE, Kind.CONE]
    assert [obstacle.x + obstacle.radius for obstacle in found] == pytest.approx([0.4, 0.6, 0.8], abs=0.006)
    assert obstacles_of([], STRAIGHT, follow(STRAIGHT, 0, 0, 'east'), 0.2, WorldPose(0.2, 0.17, 0.0)) == []


@pytest.mark.parametrize(
    'pixels, expected',
    [
        ([], None),
        ([(3, 5)], Box(5, 3, 6, 4)),
        ([(3, 5), (7, 2)], Box(2, 3, 6, 8)),
        ([(0, 0), (9, 19)], Box(0, 0, 20, 10)),
    ],
    ids=['none', 'one', 'two', 'corners'],
)
def test_a_box_is_half_open(pixels: Any, expected: Optional[Box]) -> None:
    mask = np.zeros((10, 20), dtype=bool)
    for v, u in pixels:
        mask[v, u] = True
    assert box_of(mask) == expected


@pytest.fixture(scope='module')
def renderer(calibration: Calibration) -> Iterator[Renderer]:
    """Of the default camera."""
    one = Renderer(calibration)
    yield one
    one.close()


POSES = [
    pytest.param(STRAIGHT, WorldPose(0.5, 0.2, 0.1), 0.5, (0.03, 0.1, 0.0), id='straight'),
    pytest.param(STRAIGHT, WorldPose(0.5, 0.1, -0.3), 0.3, (-0.07, -0.3, 0.0), id='right of the middle'),
    # 30 degrees into the bend about (0.585, 0.585), 0.4 from there: 15 mm left of the middle
    pytest.param(
        BEND, WorldPose(SIZE + 0.2, SIZE - 0.4 * math.cos(math.pi / 6), math.pi / 6 + 0.2), 0.8,
        (0.015, 0.2, 1 / WIDE), id='bend',
    ),
]  # fmt: skip


@pytest.mark.parametrize('place, pose, near, expected', POSES)
def test_the_lane_pose(
    renderer: Renderer, place: Town, pose: WorldPose, near: float, expected: Tuple[float, float, float]
) -> None:
    truth = truth_of(renderer, Scene(place, (), DULL), follow(place, 0, 0, 'east'), near, pose)
    found = truth.lane_pose
    assert (found.d, found.phi, found.curvature) == pytest.approx(expected, abs=1e-9)
    assert truth.obstacles == ()


def test_each_obstacle_has_its_own_pixels(renderer: Renderer) -> None:
    things = (
        Thing('wood', 0.6, 0.25, height=0.05),
        Thing('duckie', 0.6, 0.17, height=0.06),
        Thing('cone', 0.75, 0.42, height=0.08),
        Thing('cone', 0.1, 0.17, height=0.08),
    )
    pose = WorldPose(0.3, 0.17, 0.0)
    truth = truth_of(renderer, Scene(STRAIGHT, things, DULL), follow(STRAIGHT, 0, 0, 'east'), 0.3, pose)
    duckie, cone, behind = truth.obstacles
    assert [seen.kind for seen in truth.obstacles] == [Kind.DUCKIE, Kind.CONE, Kind.CONE]
    assert [seen.in_lane for seen in truth.obstacles] == [True, False, True]
    # a duckie is longer than wide: its middle is a little more than one radius behind its nearest point
    assert duckie.x + duckie.radius == pytest.approx(0.3, abs=0.01) and duckie.y == pytest.approx(0, abs=1e-6)
    assert not behind.mask.any() and behind.box is None and behind.x < 0
    assert not (duckie.mask & cone.mask).any() and duckie.mask.sum() > 300 and cone.mask.sum() > 100
    assert duckie.box is not None and cone.box is not None
    assert duckie.box.left < 320 < duckie.box.right and cone.box.right < 280, 'left of the duckie'
    v, u = np.nonzero(duckie.mask)
    assert duckie.box == Box(u.min(), v.min(), u.max() + 1, v.max() + 1)


def test_a_hidden_obstacle_is_named_but_has_no_pixels(renderer: Renderer) -> None:
    things = (Thing('duckie', 0.7, 0.17, height=0.04), Thing('cardboard', 0.5, 0.17, height=0.12))
    pose = WorldPose(0.3, 0.17, 0.0)
    (seen,) = truth_of(renderer, Scene(STRAIGHT, things, DULL), follow(STRAIGHT, 0, 0, 'east'), 0.3, pose).obstacles
    assert seen.kind is Kind.DUCKIE and seen.box is None and seen.in_lane is True
