"""core.avoidance.path and plan: the way to an offset, which offset passes what, and how fast one may drive at it."""

import math
from dataclasses import replace
from typing import List, Optional, Sequence

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property.strategies import numbers

from obst_avoid.core.avoidance.corridor import Placed, Reach
from obst_avoid.core.avoidance.known import Known
from obst_avoid.core.avoidance.path import path
from obst_avoid.core.avoidance.plan import (
    braking_distance,
    braking_speed,
    clearance_on_path,
    groups_of,
    passing,
    passing_beyond,
    reached,
)
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import LanePose

MM = 0.001
MIDDLE = LanePose(0.0, 0.0)
ROOM = 0.05
"""[m] to each side, of the robot in the lane of these settings."""
STEP = 2 * ROOM / 40
"""[m] between two offsets that are tried."""
poses = st.builds(LanePose, d=numbers(-0.05, 0.05), phi=numbers(-0.5, 0.5))
repeatable = hypothesis.settings(deadline=None, derandomize=True)


@pytest.fixture(scope='module')
def settings(avoidance_settings: AvoidanceSettings) -> AvoidanceSettings:
    """A robot of 0.15 m with 5 cm on each side of it in its lane."""
    return replace(
        avoidance_settings,
        lane_width=0.25,
        robot_width=0.15,
        robot_ahead=0.07,
        robot_behind=0.11,
        margin=0.02,
        wanted_margin=0.04,
        least_margin=0.01,
        switch_distance=0.5,
        convergence_length=0.15,
        deceleration=0.4,
        delay=0.1,
    )


def at(left: float, along: float = 1.5, radius: float = 0.03, speed: float = 0.0) -> Placed:
    """Something that stands, or moves, so far along the lane."""
    known = Known(along, left, radius, None, 0, 0)
    return Placed(known, along - radius, along + radius, along - radius, left, 0.0, speed, Reach.INSIDE)


def mirrored(item: Placed) -> Placed:
    """The same thing at the other side."""
    return replace(item, left=-item.left)


@given(pose=poses, d_ref=numbers(-0.25, 0.25), length=numbers(0.05, 0.5))
@repeatable
def test_a_way_begins_with_the_robot_and_ends_at_the_offset(pose: LanePose, d_ref: float, length: float) -> None:
    lefts, slopes = path(np.array([0.0, 20 * length]), pose, d_ref, length)
    assert (lefts[0], slopes[0]) == pytest.approx((pose.d, math.tan(pose.phi)), abs=1e-9)
    assert (lefts[1], slopes[1]) == pytest.approx((d_ref, 0.0), abs=1e-6)


@given(pose=poses, d_ref=numbers(-0.25, 0.25), length=numbers(0.05, 0.5), along=numbers(0, 1))
@repeatable
def test_a_way_is_a_critically_damped_approach(pose: LanePose, d_ref: float, length: float, along: float) -> None:
    step = 1e-4
    before, here, after = (
        float(path(np.array([s]), pose, d_ref, length)[0][0]) for s in (along - step, along, along + step)
    )
    slope, bend = (after - before) / (2 * step), (after - 2 * here + before) / step**2
    assert float(path(np.array([along]), pose, d_ref, length)[1][0]) == pytest.approx(slope, abs=1e-4)
    assert bend == pytest.approx(-(here - d_ref) / length**2 - 2 * slope / length, abs=0.02)


def test_a_robot_that_stands_across_sets_out_steeply_but_not_backwards() -> None:
    slopes = [float(path(np.array([0.0]), LanePose(0.0, phi), 0.0, 0.15)[1][0]) for phi in (1.2, 1.6, -1.6)]
    assert slopes == pytest.approx([math.tan(1.2), math.tan(1.2), -math.tan(1.2)])
    assert path(np.array([]), MIDDLE, 0.0, 0.15)[0].shape == (0,)


@pytest.mark.parametrize(
    'alongs, groups',
    [
        pytest.param([], [], id='nothing'),
        pytest.param([0.5], [[0.5]], id='one'),
        pytest.param([0.5, 0.5], [[0.5, 0.5]], id='side by side'),
        pytest.param([0.5, 1.05], [[0.5, 1.05]], id='no room between them'),
        pytest.param([0.5, 1.07], [[0.5], [1.07]], id='room between them'),
        pytest.param([1.2, 0.1, 0.6], [[0.1, 0.6], [1.2]], id='in the order of the lane'),
        pytest.param([0.1, 0.6, 1.1, 1.6], [[0.1, 0.6, 1.1, 1.6]], id='a row'),
    ],
)
def test_groups_leave_the_room_to_change_the_offset_between_them(
    settings: AvoidanceSettings, alongs: List[float], groups: List[List[float]]
) -> None:
    found = groups_of([at(0.0, along) for along in alongs], settings)
    assert [[item.known.x for item in group] for group in found] == groups


def test_a_long_one_reaches_beside_a_short_one(settings: AvoidanceSettings) -> None:
    long, short, later = at(0.0, 0.7, radius=0.3), at(0.0, 0.6), at(0.0, 1.4)
    assert groups_of([later, short, long], settings) == [[long, short, later]]


@pytest.mark.parametrize(
    'lefts, d_ref, clearance',
    [
        pytest.param([0.3], 0.0, 0.195, id='nothing is needed'),
        pytest.param([0.146], 0.0, 0.041, id='just nothing'),
        pytest.param([0.13], -0.015, 0.04, id='a little to the right'),
        pytest.param([-0.13], 0.015, 0.04, id='a little to the left'),
        pytest.param([0.106], -0.04, 0.041, id='the wanted margin, rounded up to the next offset'),
        pytest.param([0.085], -0.05, 0.03, id='all the room, less than wanted'),
        pytest.param([-0.076], 0.05, 0.021, id='all the room to the left, just enough'),
        pytest.param([0.074], None, None, id='too little room'),
        pytest.param([0.0], None, None, id='in the middle'),
        pytest.param([0.13, 0.3], -0.015, 0.04, id='two on one side'),
        pytest.param([0.13, -0.17], -0.015, 0.04, id='between two'),
        pytest.param([0.12, -0.14], -0.01, 0.025, id='in the middle between two'),
        pytest.param([0.12, -0.12], None, None, id='no room between two'),
    ],
)
def test_the_smallest_offset_with_the_wanted_margin_else_the_greatest_margin(
    settings: AvoidanceSettings, lefts: List[float], d_ref: Optional[float], clearance: float
) -> None:
    found = passing([at(left) for left in lefts], None, MIDDLE, settings)
    if d_ref is None:
        assert found is None
    else:
        assert found is not None
        assert (found.d_ref, found.clearance) == pytest.approx((d_ref, clearance), abs=1e-9)


@pytest.mark.parametrize(
    'left, held, d_ref',
    [
        pytest.param(0.13, None, -0.015, id='nothing was held'),
        pytest.param(0.13, -0.03, -0.03, id='does not shrink'),
        pytest.param(0.13, -0.01, -0.015, id='may grow'),
        pytest.param(0.13, 0.03, None, id='does not change the side'),
        pytest.param(-0.13, 0.03, 0.03, id='does not shrink at the left'),
        pytest.param(-0.13, -0.03, None, id='does not change the side to the left'),
        pytest.param(0.13, -0.05, -0.05, id='all the room'),
        pytest.param(0.3, -0.03, -0.03, id='nothing is needed any more'),
        pytest.param(0.067, None, None, id='too little room to begin'),
        pytest.param(0.067, -0.05, -0.05, id='just enough to go on'),
        pytest.param(0.064, -0.05, None, id='not even that'),
    ],
)
def test_what_was_begun_is_kept(
    settings: AvoidanceSettings, left: float, held: Optional[float], d_ref: Optional[float]
) -> None:
    found = passing([at(left)], held, LanePose(held or 0.0, 0.0), settings)
    assert (None if found is None else round(found.d_ref, 9)) == d_ref


@pytest.mark.parametrize(
    'lane_width, left, d_ref',
    [
        pytest.param(0.14, 0.5, None, id='narrower than the robot'),
        pytest.param(0.15, 0.5, 0.0, id='as wide as the robot'),
        pytest.param(0.15, 0.12, None, id='as wide as the robot, and something reaches in'),
        pytest.param(0.40, 0.0, 0.125, id='so wide that there is room on both sides of one in the middle'),
    ],
)
def test_the_robots_side_stays_in_the_lane(
    settings: AvoidanceSettings, lane_width: float, left: float, d_ref: Optional[float]
) -> None:
    found = passing([at(left)], None, MIDDLE, replace(settings, lane_width=lane_width))
    assert (found is None) is (d_ref is None)
    if found is not None:
        assert abs(found.d_ref) == pytest.approx(d_ref if left else 0.125, abs=1e-9)
        assert abs(found.d_ref) + 0.075 <= lane_width / 2 + 1e-9


@pytest.mark.parametrize(
    'along, pose, passes',
    [
        pytest.param(0.8, MIDDLE, True, id='far'),
        pytest.param(0.2, MIDDLE, False, id='too near to get there'),
        pytest.param(0.2, LanePose(-0.05, 0.0), True, id='near, but the robot is there already'),
        pytest.param(0.2, LanePose(-0.05, 0.6), False, id='the robot is there, but turned towards it'),
        pytest.param(0.35, LanePose(0.05, 0.0), False, id='from the other side it takes more'),
        pytest.param(-0.2, LanePose(0.05, 0.0), True, id='it is behind already'),
    ],
)
def test_what_cannot_be_reached_in_time_is_no_way(
    settings: AvoidanceSettings, along: float, pose: LanePose, passes: bool
) -> None:
    assert (passing([at(0.085, along)], None, pose, settings) is not None) is passes


def beside(side: float, gap: float, radius: float, along: float) -> Placed:
    """Something whose edge is so far from the lane's centre."""
    return at(side * (radius + gap), along, radius)


sides, gaps, radii = st.sampled_from([-1.0, 1.0]), st.integers(40, 150).map(MM.__mul__), numbers(0.005, 0.06)
things = st.builds(beside, sides, gaps, radii, numbers(0.2, 1.5))
far_things = st.builds(beside, sides, gaps, radii, numbers(1.2, 2.0))
groups, far_groups = (st.lists(one, min_size=1, max_size=2) for one in (things, far_things))
helds = st.one_of(st.none(), numbers(-0.05, 0.05))


def left_beside(group: Sequence[Placed], offsets: np.ndarray) -> np.ndarray:
    """(N,) m between the robot's side and the nearest footprint, at (N,) offsets."""
    return np.min([np.abs(offsets - item.left) - item.radius - 0.075 for item in group], axis=0)


@given(group=groups, held=helds, pose=poses)
@repeatable
def test_a_mirrored_group_is_passed_on_the_other_side(
    settings: AvoidanceSettings, group: List[Placed], held: Optional[float], pose: LanePose
) -> None:
    tried = left_beside(group, np.linspace(-ROOM, ROOM, 41))
    hypothesis.assume(np.abs(tried - tried[::-1])[:20].min() > 1e-6)  # either side is as good
    limits = settings.wanted_margin, settings.margin, settings.least_margin
    hypothesis.assume(min(np.abs(tried - limit).min() for limit in limits) > 1e-6)  # rounding decides
    here = passing(group, held, pose, settings)
    other = None if held is None else -held
    there = passing([mirrored(item) for item in group], other, LanePose(-pose.d, -pose.phi), settings)
    assert (here is None) is (there is None)
    if here is not None and there is not None:
        assert (there.d_ref, there.clearance) == pytest.approx((-here.d_ref, here.clearance), abs=1e-9)


@given(group=far_groups)
@repeatable
def test_no_other_offset_is_better(settings: AvoidanceSettings, group: List[Placed]) -> None:
    offsets = np.linspace(-ROOM, ROOM, 2001)
    clearances = left_beside(group, offsets)
    found = passing(group, None, MIDDLE, settings)
    if found is None:
        assert clearances.max() < settings.margin + STEP / 2 + 1e-9
        return
    assert found.clearance == pytest.approx(float(left_beside(group, np.array([found.d_ref]))[0]), abs=1e-9)
    assert found.clearance >= settings.margin
    assert abs(found.d_ref) <= ROOM + 1e-9
    wide = offsets[clearances >= settings.wanted_margin + STEP]
    if len(wide):
        assert found.clearance >= settings.wanted_margin
        assert abs(found.d_ref) <= np.abs(wide).min() + STEP
    elif found.clearance < settings.wanted_margin:
        assert found.clearance >= clearances.max() - STEP / 2 - 1e-9


@given(group=groups, held=helds, pose=poses)
@repeatable
def test_a_way_that_is_found_is_free(
    settings: AvoidanceSettings, group: List[Placed], held: Optional[float], pose: LanePose
) -> None:
    found = passing(group, held, pose, settings)
    if found is not None:
        assert reached(group, pose, found.d_ref, settings)
        assert found.clearance >= (settings.margin if held is None else settings.least_margin)
        if held is not None:
            assert found.d_ref * held >= 0 and abs(found.d_ref) >= abs(held) - STEP / 2 - 1e-9


@pytest.mark.parametrize(
    'item, pose, d_ref, farthest, clearance',
    [
        pytest.param(at(0.15), MIDDLE, 0.0, math.inf, 0.045, id='beside a robot in the middle'),
        pytest.param(at(-0.15), LanePose(0.02, 0.0), 0.02, math.inf, 0.065, id='beside a robot at the left'),
        pytest.param(at(0.0), MIDDLE, 0.0, math.inf, -0.105, id='driven over'),
        pytest.param(at(0.08), MIDDLE, 0.0, math.inf, -0.025, id='touched'),
        pytest.param(at(0.15, 0.6), MIDDLE, 0.0, 0.49, math.inf, id='the way ends before it'),
        pytest.param(at(0.15, 0.6), MIDDLE, 0.0, 0.51, 0.045, id='the way ends with the bumper beside it'),
        pytest.param(at(0.15, 0.6), MIDDLE, 0.0, 0.0, math.inf, id='the robot does not move'),
        pytest.param(at(0.15, 0.05), MIDDLE, 0.0, 0.0, 0.045, id='the robot stands beside it'),
        pytest.param(at(0.15, -0.13), MIDDLE, 0.0, math.inf, 0.045, id='beside the tail'),
        pytest.param(at(0.0, -0.15), MIDDLE, 0.0, math.inf, math.inf, id='behind the tail'),
    ],
)
def test_the_clearance_on_a_way(
    settings: AvoidanceSettings, item: Placed, pose: LanePose, d_ref: float, farthest: float, clearance: float
) -> None:
    assert reached([], pose, d_ref, settings)
    assert clearance_on_path(item, pose, d_ref, farthest, settings) == pytest.approx(clearance, abs=1e-9)
    if farthest == math.inf:
        assert reached([at(1.0), item], pose, d_ref, settings) is (clearance >= settings.least_margin)


def test_a_robot_that_is_turned_is_wider(settings: AvoidanceSettings) -> None:
    item = at(0.15, 0.0)
    turned = clearance_on_path(item, LanePose(0.0, -0.3), 0.0, 0.0, settings)
    assert turned == pytest.approx(0.15 - 0.075 - math.tan(0.3) * 0.11 / 2 - 0.03)


@pytest.mark.parametrize('along', [0.2, 0.25, 0.3])
def test_a_way_across_something_is_not_free(settings: AvoidanceSettings, along: float) -> None:
    found = clearance_on_path(at(0.0, along, radius=0.01), LanePose(0.05, 0.0), -0.05, math.inf, settings)
    assert found < -0.085, 'its middle passes below the middle of the robot'


@given(left=numbers(-0.3, 0.3), d_ref=numbers(-0.05, 0.05), along=numbers(-0.1, 1.5), radius=numbers(0.005, 0.06))
@repeatable
def test_beside_a_settled_robot_it_is_the_distance_alone(
    settings: AvoidanceSettings, left: float, d_ref: float, along: float, radius: float
) -> None:
    found = clearance_on_path(at(left, along, radius), LanePose(d_ref, 0.0), d_ref, math.inf, settings)
    assert found == pytest.approx(abs(left - d_ref) - radius - 0.075, abs=1e-9)


@given(item=things, pose=poses, d_ref=numbers(-0.05, 0.05))
@repeatable
def test_the_clearance_on_a_way_is_what_the_drawn_way_shows(
    settings: AvoidanceSettings, item: Placed, pose: LanePose, d_ref: float
) -> None:
    alongs = np.linspace(max(item.begin - 0.07, 0.0), item.end + 0.11, 4001)
    lefts, slopes = path(alongs, pose, d_ref, 0.15)
    shown = float((np.abs(item.left - lefts) - np.abs(slopes) * 0.055).min()) - 0.075 - item.radius
    found = clearance_on_path(item, pose, d_ref, math.inf, settings)
    assert shown - 1e-9 <= found <= shown + 0.012, 'places 2 cm apart, at a slope of up to 0.5'


@given(near=numbers(0, 2), far=numbers(0, 2), item=things, pose=poses, d_ref=numbers(-0.05, 0.05))
@repeatable
def test_a_longer_way_never_leaves_much_more_room(
    settings: AvoidanceSettings, near: float, far: float, item: Placed, pose: LanePose, d_ref: float
) -> None:
    short, long = (clearance_on_path(item, pose, d_ref, end, settings) for end in sorted((near, far)))
    assert long <= short + 0.012


@pytest.mark.parametrize(
    'things, pose, passes',
    [
        pytest.param([at(0.0)], MIDDLE, True, id='something in our lane'),
        pytest.param([at(0.0), at(-0.2)], MIDDLE, True, id='and something at its right edge'),
        pytest.param([at(0.0), at(0.275)], MIDDLE, False, id='something in the other lane'),
        pytest.param([at(0.0), at(0.44)], MIDDLE, True, id='something beyond the other lane'),
        pytest.param([at(0.0), at(0.41)], MIDDLE, False, id='something at the edge of the other lane'),
        pytest.param([at(0.14)], MIDDLE, False, id='something on the yellow line'),
        pytest.param([at(0.0), at(-0.2, speed=-0.05)], MIDDLE, False, id='something moves, wherever'),
        pytest.param([at(0.0, 0.3)], MIDDLE, False, id='too near to get there'),
        pytest.param([at(0.0, 0.3)], LanePose(0.275, 0.0), True, id='near, but the robot is there'),
    ],
)
def test_the_way_beyond_the_yellow_line_needs_a_free_lane(
    settings: AvoidanceSettings, things: List[Placed], pose: LanePose, passes: bool
) -> None:
    found = passing_beyond(things, pose, settings)
    assert (found is not None) is passes
    if found is not None:
        assert found.d_ref == pytest.approx(0.275), 'the middle of the other lane'
        assert found.clearance == pytest.approx(min(abs(one.left - 0.275) for one in things) - 0.03 - 0.075)


@pytest.mark.parametrize(
    'gap, speed',
    [
        pytest.param(-0.1, 0.0, id='beyond where it shall stand'),
        pytest.param(0.0, 0.0, id='there'),
        pytest.param(0.05, 0.2, id='5 cm at 0.4 m/s^2'),
        pytest.param(0.2, 0.4, id='20 cm: twice as fast'),
    ],
)
def test_the_speed_from_which_a_robot_can_stand(settings: AvoidanceSettings, gap: float, speed: float) -> None:
    assert braking_speed(gap, settings) == pytest.approx(speed)


@pytest.mark.parametrize(
    'speed, distance',
    [
        pytest.param(0.0, 0.0, id='stands'),
        pytest.param(0.2, 0.07, id='2 cm until it decides, 5 cm to brake'),
        pytest.param(0.4, 0.24, id='twice as fast'),
    ],
)
def test_the_way_that_a_stop_takes(settings: AvoidanceSettings, speed: float, distance: float) -> None:
    assert braking_distance(speed, settings) == pytest.approx(distance)


@given(near=numbers(-1, 3), far=numbers(-1, 3), deceleration=numbers(0.05, 3))
@repeatable
def test_the_same_obstacle_farther_never_allows_less_speed(
    settings: AvoidanceSettings, near: float, far: float, deceleration: float
) -> None:
    rules = replace(settings, deceleration=deceleration)
    near, far = sorted((near, far))
    assert braking_speed(near, rules) <= braking_speed(far, rules)


@given(gap=numbers(0, 3), deceleration=numbers(0.05, 3), delay=numbers(0, 1))
@repeatable
def test_who_drives_as_fast_as_allowed_can_stand_in_time(
    settings: AvoidanceSettings, gap: float, deceleration: float, delay: float
) -> None:
    at_once = replace(settings, deceleration=deceleration, delay=0.0)
    speed = braking_speed(gap, at_once)
    assert braking_distance(speed, at_once) == pytest.approx(gap, abs=1e-9)
    assert braking_distance(speed, replace(at_once, delay=delay)) == pytest.approx(gap + speed * delay, abs=1e-9)
