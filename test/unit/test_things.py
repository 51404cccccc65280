"""sim.things: the outline on the ground, and the foot that a detector shall report."""

import math
from typing import Any, Optional

import numpy as np
import pytest

from obst_avoid.core.types import Kind
from obst_avoid.sim.meshes import SORTS
from obst_avoid.sim.things import Thing, foot, footprint, outline
from obst_avoid.sim.town import WorldPose
from unit.views import corners_of

ORIGIN = WorldPose(0.0, 0.0, 0.0)


@pytest.mark.parametrize('sort', SORTS)
def test_kinds(sort: str) -> None:
    expected: Optional[Kind] = {'duckie': Kind.DUCKIE, 'cone': Kind.CONE, 'banded_cone': Kind.CONE}.get(sort)
    assert Thing(sort, 0, 0).kind is expected


@pytest.mark.parametrize('lying', [False, True], ids=['upright', 'lying'])
@pytest.mark.parametrize('sort', SORTS)
def test_the_footprint_holds_all_of_the_thing_and_no_more(sort: str, lying: bool) -> None:
    thing = Thing(sort, 2.0, -1.0, yaw=0.8, height=0.07, lying=lying)
    corners, polygon = corners_of(thing)[:, :2], footprint(thing)
    (left, low, right, high), middle = polygon.bounds, outline(thing)
    assert (left, low) == pytest.approx(tuple(corners.min(axis=0)), abs=1e-5)
    assert (right, high) == pytest.approx(tuple(corners.max(axis=0)), abs=1e-5)
    for angle in np.linspace(0, math.pi, 7):
        way = np.array([math.cos(angle), math.sin(angle)])
        assert (middle @ way).max() == pytest.approx((corners @ way).max(), abs=1e-5)


def test_a_box_turned_on_the_ground() -> None:
    # wood is 0.8 long and 0.6 wide for a height of 1
    found = outline(Thing('wood', 1.0, 2.0, yaw=math.pi / 2, height=0.1))
    corners = {(round(float(x), 6), round(float(y), 6)) for x, y in found}
    assert corners == {(1.03, 2.04), (0.97, 2.04), (0.97, 1.96), (1.03, 1.96)}
    assert footprint(Thing('wood', 1.0, 2.0, yaw=0.4, height=0.1)).area == pytest.approx(0.0048)


def test_a_lying_cone_is_longer_than_its_base() -> None:
    standing, lying = (footprint(Thing('cone', 0.0, 0.0, height=0.1, lying=lying)).bounds for lying in (False, True))
    assert standing == pytest.approx((-0.0375, -0.0375, 0.0375, 0.0375), abs=1e-4)
    # its base, 75 mm wide, now looks aside; from the base's upper edge to the tip there are about 0.1 m
    assert lying[2] - lying[0] == pytest.approx(0.075, abs=1e-4)
    assert 0.095 < lying[3] - lying[1] < 0.125
    assert lying[1] == pytest.approx(-lying[3], abs=1e-5), 'its middle is the middle of its footprint'


@pytest.mark.parametrize(
    'x, y, pose, nearest',
    [
        (0.5, 0.0, ORIGIN, (0.47, 0.0)),
        (0.3, 0.4, ORIGIN, (0.3 * 0.94, 0.4 * 0.94)),
        (0.3, -0.4, ORIGIN, (0.3 * 0.94, -0.4 * 0.94)),
        (-0.5, 0.0, ORIGIN, (-0.47, 0.0)),
        (2.0, 1.5, WorldPose(2.0, 1.0, math.pi / 2), (0.47, 0.0)),
        (2.5, 1.0, WorldPose(2.0, 1.0, math.pi / 2), (0.0, -0.47)),
    ],
    ids=['ahead', 'left', 'right', 'behind', 'north of a robot that faces north', 'east of it'],
)
def test_the_foot_of_a_ball(x: float, y: float, pose: WorldPose, nearest: Any) -> None:
    # 6 cm across and half a metre away; its mesh has corners, which are up to 2 % within the circle
    found = foot(Thing('ball', x, y, height=0.06), pose)
    assert found.radius == pytest.approx(0.03, rel=0.02)
    assert (found.x, found.y) == pytest.approx(nearest, abs=0.0006)


@pytest.mark.parametrize('sort', ['ball', 'duckie', 'cone', 'banded_cone'])
def test_the_middle_lies_one_radius_farther_on_the_same_ray(sort: str) -> None:
    pose = WorldPose(1.0, 2.0, 0.7)
    for angle, yaw in ((0.0, 0.3), (0.5, 2.0), (-0.6, -1.0)):
        x, y = pose.x + 0.6 * math.cos(0.7 + angle), pose.y + 0.6 * math.sin(0.7 + angle)
        found = foot(Thing(sort, x, y, yaw=yaw, height=0.07), pose)
        assert math.atan2(found.y, found.x) == pytest.approx(angle, abs=1e-6)
        # exact for what is round; a duckie is longer than wide, a cone's base is square
        assert math.hypot(found.x, found.y) + found.radius == pytest.approx(0.6, abs=0.001 if sort == 'ball' else 0.01)


def test_the_radius_is_half_the_width_across_the_line_of_sight() -> None:
    # a box 0.4 long and 0.3 wide: from its end it is 0.3 wide, from its side 0.4
    assert foot(Thing('wood', 1.0, 0.0, height=0.5), ORIGIN).radius == pytest.approx(0.15)
    assert foot(Thing('wood', 0.0, 1.0, height=0.5), ORIGIN).radius == pytest.approx(0.2)
    assert foot(Thing('wood', 1.0, 0.0, yaw=math.pi / 2, height=0.5), ORIGIN).radius == pytest.approx(0.2)
    assert foot(Thing('wood', 1.0, 0.0, height=0.5), ORIGIN).x == pytest.approx(0.8)


def test_a_robot_on_top_of_a_thing_gets_an_answer_all_the_same() -> None:
    found = foot(Thing('ball', 0.0, 0.0, height=0.06), ORIGIN)
    assert all(math.isfinite(value) for value in (found.x, found.y, found.radius))
