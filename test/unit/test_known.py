"""core.avoidance.known: which obstacles are remembered, where in the lane they stand, and whether they move."""

import math
from dataclasses import replace
from typing import Any, Callable, List, Optional, Sequence, Tuple

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property.strategies import lane_poses, numbers

from obst_avoid.core.avoidance.known import (
    CORRELATED,
    Known,
    footprint_centre,
    left_speed,
    moved,
    remaining,
    reported,
)
from obst_avoid.core.avoidance.settings import AvoidanceSettings, KnownSettings
from obst_avoid.core.geometry import robot_from_lane
from obst_avoid.core.motion import Motion
from obst_avoid.core.types import Kind, LanePose, Obstacle, Stamped

NOW = 1_700_000_000_000_000_000
MS = 1_000_000
BEFORE = NOW - 100 * MS
PERIOD = 1 / 15
"""[s] between two pictures."""
AHEAD = LanePose(0.0, 0.0)
"""The robot in the middle of a straight lane."""
Place = Tuple[float, float]
repeatable = hypothesis.settings(deadline=None, derandomize=True)


@pytest.fixture(scope='module')
def settings(avoidance_settings: AvoidanceSettings) -> AvoidanceSettings:
    """Round numbers; a report's place is believed at once, and a single look errs by 5 mm."""
    known = replace(
        avoidance_settings.known,
        gate=0.06,
        gate_growth=0.1,
        gain=1.0,
        near=0.2,
        view=0.6,
        out_of_sight=3.0,
        out_of_sight_moving=30.0,
        position_error=0.003,
        position_growth=0.0,
        shape_error=0.004,
        shape_direction=0.0,
        shape_bend=0.0,
        error_time=0.0,
        walking=0.0,
        watch=1.0,
        watch_bend=0.5,
        moving=0.04,
        fastest=0.4,
        moving_certainty=3.0,
    )
    return replace(avoidance_settings, robot_behind=0.1, stop_hold=1.0, known=known)


@pytest.fixture(scope='module')
def rules(settings: AvoidanceSettings) -> KnownSettings:
    """Of what is known alone."""
    return settings.known


def known_at(x: float, y: float, radius: float = 0.03, **rest: Any) -> Known:
    """One that was seen a picture ago, for the first time."""
    return Known(x, y, radius, **{'in_lane': True, 'seen': BEFORE, 'begun': BEFORE, **rest})


def standing(x: float, y: float, radius: float = 0.03, in_lane: Optional[bool] = True) -> Obstacle:
    """A reported obstacle whose footprint is a circle around (x, y)."""
    distance = math.hypot(x, y)
    return Obstacle(None, x * (1 - radius / distance), y * (1 - radius / distance), radius, in_lane)


def report_of(places: Sequence[Place], stamp: int = NOW) -> Stamped[Sequence[Obstacle]]:
    """A picture that shows a thing at each place."""
    return Stamped(stamp, [standing(x, y) for x, y in places])


def watched(lefts: Sequence[float], period: float = PERIOD) -> Known:
    """One that was so far left of the lane's centre in one look after another."""
    stamps = [NOW + round(index * period * 1e9) for index in range(len(lefts))]
    return known_at(0.6, 0.0, lefts=tuple(zip(stamps, lefts)))


@pytest.mark.parametrize(
    'x, y, radius, centre',
    [
        pytest.param(0.4, 0.0, 0.03, (0.43, 0.0), id='ahead'),
        pytest.param(0.0, -0.2, 0.05, (0.0, -0.25), id='to the right'),
        pytest.param(0.3, 0.4, 0.05, (0.33, 0.44), id='on its ray'),
        pytest.param(0.0, 0.0, 0.03, (0.03, 0.0), id='at the axle'),
        pytest.param(1e-310, 0.0, 0.03, (0.03, 0.0), id='at the axle but for rounding'),
    ],
)
def test_the_footprint_is_one_radius_behind_its_nearest_point(x: float, y: float, radius: float, centre: Place) -> None:
    assert footprint_centre(Obstacle(None, x, y, radius, True)) == pytest.approx(centre, abs=1e-12)


@given(distance=numbers(0.05, 2), bearing=numbers(-3, 3), radius=numbers(0.001, 0.04))
@repeatable
def test_what_is_known_can_be_reported_again(distance: float, bearing: float, radius: float) -> None:
    place = distance * math.cos(bearing), distance * math.sin(bearing)
    item = known_at(*place, radius, in_lane=None, kind=Kind.CONE)
    assert footprint_centre(item.obstacle) == pytest.approx(place, abs=1e-12)
    assert (item.obstacle.radius, item.obstacle.in_lane, item.obstacle.kind) == (radius, None, Kind.CONE)


@pytest.mark.parametrize(
    'motion, place',
    [
        pytest.param(None, (0.5, 0.1), id='nobody knows'),
        pytest.param(Motion(), (0.5, 0.1), id='stood'),
        pytest.param(Motion(0.2, 0.0, 0.0), (0.3, 0.1), id='drove on'),
        pytest.param(Motion(0.0, 0.0, math.pi / 2), (0.1, -0.5), id='turned left on the spot'),
        pytest.param(Motion(0.5, 0.0, -math.pi / 2), (-0.1, 0.0), id='drove there and turned right'),
    ],
)
def test_what_is_known_is_carried_with_the_robot(motion: Optional[Motion], place: Place) -> None:
    assert moved((), motion) == ()
    item = known_at(0.5, 0.1, left=0.1, left_error=0.01)
    (after,) = moved([item], motion)
    assert (after.x, after.y) == pytest.approx(place, abs=1e-12)
    assert replace(after, x=item.x, y=item.y) == item, 'nothing else changes'


@pytest.mark.parametrize(
    'before, report, after',
    [
        pytest.param([], [], [], id='nothing'),
        pytest.param([], [(0.5, 0.0)], [(0.5, 0.0, 'new')], id='the first one'),
        pytest.param([(0.5, 0.0)], [], [(0.5, 0.0, 'kept')], id='not reported'),
        pytest.param([(0.5, 0.0)], [(0.55, 0.01)], [(0.55, 0.01, 'seen')], id='a little farther'),
        pytest.param([(0.3, 0.0)], [(0.38, 0.0)], [(0.38, 0.0, 'seen')], id='near, 8 cm off, gate 9.8 cm'),
        pytest.param(
            [(0.3, 0.0)], [(0.3, 0.1)], [(0.3, 0.0, 'kept'), (0.3, 0.1, 'new')], id='near, 10 cm off, gate 9.2 cm'
        ),
        pytest.param([(1.0, 0.0)], [(1.0, 0.1)], [(1.0, 0.1, 'seen')], id='far, 10 cm off, gate 16 cm'),
        pytest.param([(1.0, 0.0)], [(1.0, 0.2)], [(1.0, 0.0, 'kept'), (1.0, 0.2, 'new')], id='far, 20 cm off'),
        pytest.param(
            [(0.5, 0.03), (0.5, -0.03)],
            [(0.5, -0.02), (0.5, 0.04)],
            [(0.5, 0.04, 'seen'), (0.5, -0.02, 'seen')],
            id='two side by side: each the nearest',
        ),
        pytest.param(
            [(0.5, 0.03), (0.5, -0.03)],
            [(0.5, -0.01)],
            [(0.5, 0.03, 'kept'), (0.5, -0.01, 'seen')],
            id='two side by side, one hidden',
        ),
        pytest.param(
            [(0.5, 0.0)],
            [(0.5, 0.05), (0.5, 0.01)],
            [(0.5, 0.01, 'seen'), (0.5, 0.05, 'new')],
            id='a second one beside a known one',
        ),
        pytest.param(
            [(0.5, 0.0), (0.5, 0.06)],
            [(0.5, 0.05), (0.5, 0.13)],
            [(0.5, 0.0, 'kept'), (0.5, 0.05, 'seen'), (0.5, 0.13, 'new')],
            id='the nearest pair first',
        ),
    ],
)
def test_each_known_one_takes_the_nearest_reported_one(
    rules: KnownSettings, before: List[Place], report: List[Place], after: List[Tuple[float, float, str]]
) -> None:
    found = reported([known_at(x, y) for x, y in before], report_of(report), None, rules)
    names = {(BEFORE, BEFORE): 'kept', (BEFORE, NOW): 'seen', (NOW, NOW): 'new'}
    assert [(round(item.x, 9), round(item.y, 9), names[item.begun, item.seen]) for item in found] == after


@pytest.mark.parametrize(
    'gain, x, radius',
    [
        pytest.param(1.0, 0.54, 0.05, id='the report alone'),
        pytest.param(0.5, 0.52, 0.04, id='half'),
        pytest.param(0.25, 0.51, 0.035, id='a quarter'),
    ],
)
def test_a_report_counts_with_a_gain(rules: KnownSettings, gain: float, x: float, radius: float) -> None:
    before = [known_at(0.5, 0.0, 0.03)]
    report = Stamped(NOW, [replace(standing(0.54, 0.0, 0.05, in_lane=False), kind=Kind.DUCKIE)])
    (found,) = reported(before, report, None, replace(rules, gain=gain))
    assert (found.x, found.y, found.radius) == pytest.approx((x, 0.0, radius), abs=1e-12)
    assert (found.in_lane, found.kind) == (False, Kind.DUCKIE), 'as last reported'
    (new,) = reported([], report, None, rules)
    assert (new.in_lane, new.kind) == (False, Kind.DUCKIE)


@pytest.mark.parametrize('way, count', [(0.0, 2), (0.01, 2), (0.03, 1)])
def test_the_gate_is_wider_where_nobody_says_how_far_the_robot_came(
    rules: KnownSettings, way: float, count: int
) -> None:
    found = reported([known_at(0.5, 0.0)], report_of([(0.38, 0.0)]), None, rules, unknown_way=way)
    assert len(found) == count, '12 cm off, gate 9.8 cm'


@given(data=st.data(), places=st.lists(st.tuples(numbers(0.2, 1.2), numbers(-0.2, 0.2)), max_size=5))
@repeatable
def test_the_order_of_the_report_is_irrelevant(rules: KnownSettings, data: Any, places: List[Place]) -> None:
    before = [known_at(0.4, 0.01), known_at(0.42, -0.08), known_at(0.9, 0.0)]
    apart = [math.hypot(item.x - x, item.y - y) for item in before for x, y in places]
    hypothesis.assume(len({round(distance, 6) for distance in apart}) == len(apart))
    other = data.draw(st.permutations(places))
    found, again = (reported(before, report_of(order), AHEAD, rules) for order in (places, other))
    assert found[:3] == again[:3]
    assert set(found) == set(again)


@pytest.mark.parametrize(
    'x, y, pose, left',
    [
        pytest.param(0.5, 0.05, AHEAD, 0.05, id='straight ahead of a robot in the middle'),
        pytest.param(0.5, 0.05, LanePose(-0.02, 0.0), 0.03, id='the robot is at the right'),
        pytest.param(0.5, 0.0, LanePose(0.0, 0.1), 0.5 * math.sin(0.1), id='the robot is turned left'),
        pytest.param(0.5, 0.5, LanePose(0.0, 0.0, 2.0), 0.0, id='on the centre of a bend'),
    ],
)
def test_the_first_look_says_where_in_the_lane_it_stands(
    rules: KnownSettings, x: float, y: float, pose: LanePose, left: float
) -> None:
    (found,) = reported([], report_of([(x, y)]), pose, rules)
    assert found.left == pytest.approx(left, abs=1e-9)
    assert (found.left_error, found.placed) == (pytest.approx(0.005), NOW)


@pytest.mark.parametrize(
    'changed, error',
    [
        pytest.param({}, 0.005, id='3 mm of its place, 4 mm of the lane'),
        pytest.param({'position_growth': 0.01}, math.hypot(0.008, 0.004), id='its place, farther away'),
        pytest.param({'shape_direction': 0.02}, math.hypot(0.003, 0.014), id='direction of the lane'),
        pytest.param({'shape_bend': 0.04}, math.sqrt(0.003**2 + 0.004**2 + 0.005**2), id='bend of the lane'),
    ],
)
def test_a_look_errs_by_all_that_it_rests_on(rules: KnownSettings, changed: Any, error: float) -> None:
    (found,) = reported([], report_of([(0.5, 0.0)]), AHEAD, replace(rules, **changed))
    assert found.left_error == pytest.approx(error)


@pytest.mark.parametrize(
    'changed, milliseconds, gain, variance',
    [
        pytest.param({}, 100, 1 / 2, 1 / 2, id='two independent looks'),
        pytest.param({'error_time': 0.15}, 100, 1 / 4, 3 / 4, id='looks that err alike'),
        pytest.param({'error_time': 0.15}, 600, 1 / 2, 1 / 2, id='looks so far apart that they do not'),
        pytest.param({'walking': math.sqrt(0.00025)}, 100, 2 / 3, 2 / 3, id='it may have walked'),
    ],
)
def test_the_place_in_the_lane_is_filtered(
    rules: KnownSettings, changed: Any, milliseconds: int, gain: float, variance: float
) -> None:
    before = known_at(0.5, 0.0, left=0.0, left_error=0.005, placed=NOW - milliseconds * MS)
    (found,) = reported([before], report_of([(0.5, 0.02)]), AHEAD, replace(rules, **changed))
    assert found.left == pytest.approx(gain * 0.02)
    assert found.left_error == pytest.approx(0.005 * math.sqrt(variance))
    assert found.placed == NOW


@given(lefts=st.lists(numbers(-0.005, 0.005), min_size=1, max_size=12))
@repeatable
def test_independent_looks_make_their_mean(rules: KnownSettings, lefts: List[float]) -> None:
    known: Sequence[Known] = ()
    for index, left in enumerate(lefts):
        known = reported(known, report_of([(0.6, left)], NOW + index * 100 * MS), AHEAD, rules)
    assert known[0].left == pytest.approx(float(np.mean(lefts)), abs=1e-9)
    assert known[0].left_error == pytest.approx(0.005 / math.sqrt(len(lefts)))


@given(along=numbers(0.4, 0.9), left=numbers(-0.15, 0.15), poses=st.lists(lane_poses, min_size=1, max_size=6))
@repeatable
def test_what_stands_keeps_its_place_whatever_the_robot_does(
    rules: KnownSettings, along: float, left: float, poses: List[LanePose]
) -> None:
    found = known_at(0.0, 0.0)
    for index, pose in enumerate(poses):
        x, y = robot_from_lane(along, left, pose)
        hypothesis.assume(x > rules.near)
        (found,) = reported([replace(found, x=x, y=y)], report_of([(x, y)], NOW + index * 100 * MS), pose, rules)
    assert found.left == pytest.approx(left, abs=1e-9)


@pytest.mark.parametrize(
    'x, report, lane',
    [
        pytest.param(0.5, [(0.5, 0.05)], None, id='no lines are seen'),
        pytest.param(0.5, [], AHEAD, id='it is not reported'),
        pytest.param(0.19, [(0.19, 0.05)], AHEAD, id='too near to be seen'),
    ],
)
def test_the_place_in_the_lane_is_kept(
    rules: KnownSettings, x: float, report: List[Place], lane: Optional[LanePose]
) -> None:
    before = known_at(x, 0.0, left=0.0, left_error=0.005, placed=BEFORE, lefts=((BEFORE, 0.0),))
    (found,) = reported([before], report_of(report), lane, rules)
    assert (found.left, found.left_error, found.placed) == (0.0, 0.005, BEFORE)
    assert (NOW, 0.05) not in found.lefts


@pytest.mark.parametrize(
    'x, y, pose, stamps',
    [
        pytest.param(0.5, 0.0, AHEAD, (BEFORE, NOW), id='one more'),
        pytest.param(0.5, 0.0, LanePose(0.0, 0.0, 0.4), (BEFORE, NOW), id='in a slight bend'),
        pytest.param(0.5, 0.0, LanePose(0.0, 0.0, -0.6), (NOW,), id='a bend begins anew'),
        pytest.param(0.19, 0.0, AHEAD, (), id='too near to be seen'),
    ],
)
def test_single_looks_are_kept_as_long_as_they_tell_a_speed(
    rules: KnownSettings, x: float, y: float, pose: LanePose, stamps: Tuple[int, ...]
) -> None:
    long_ago = NOW - 1001 * MS
    before = known_at(x, y, lefts=((long_ago, 0.0), (BEFORE, 0.0)))
    (found,) = reported([before], report_of([(x, y)]), pose, rules)
    assert tuple(stamp for stamp, _ in found.lefts) == stamps


@pytest.mark.parametrize(
    'item, speed',
    [
        pytest.param(watched([]), 0.0, id='never seen'),
        pytest.param(watched([0.1]), 0.0, id='seen once'),
        pytest.param(watched([0.1] * 15), 0.0, id='stands'),
        pytest.param(watched([0.08 * PERIOD * i for i in range(15)]), 0.08, id='to the left'),
        pytest.param(watched([-0.08 * PERIOD * i for i in range(15)]), -0.08, id='to the right'),
        pytest.param(watched([0.03 * PERIOD * i for i in range(15)]), 0.0, id='so slowly that it may stand'),
        pytest.param(watched([0.45 * PERIOD * i for i in range(15)]), 0.0, id='absurdly fast: the lane was mistaken'),
        pytest.param(watched([0.08 * 0.2 * i for i in range(4)], 0.2), 0.0, id='too few looks'),
        pytest.param(watched([0.08 * 0.2 * i for i in range(5)], 0.2), 0.08, id='just enough looks'),
        pytest.param(watched([0.08 * 0.03 * i for i in range(14)], 0.03), 0.0, id='watched for 0.39 s'),
        pytest.param(watched([0.08 * 0.03 * i for i in range(15)], 0.03), 0.08, id='watched for 0.42 s'),
        pytest.param(
            watched([0.08 * PERIOD * i + 0.05 * (-1) ** i for i in range(15)]), 0.0, id='scatters more than it moves'
        ),
    ],
)
def test_a_speed_is_a_slope_that_is_sure(rules: KnownSettings, item: Known, speed: float) -> None:
    assert left_speed(item, rules) == pytest.approx(speed, abs=1e-9)


@pytest.mark.parametrize('looks', [6, 15])
def test_a_speed_is_sure_when_the_looks_scatter_little_about_it(rules: KnownSettings, looks: int) -> None:
    times, lefts = [i / 10 for i in range(looks)], [0.008 * i + 0.005 * (-1) ** i for i in range(looks)]
    (slope, _), covariance = np.polyfit(times, lefts, 1, cov=True)
    certainty = slope / math.sqrt(covariance[0, 0]) / CORRELATED
    item = watched(lefts, 0.1)
    assert left_speed(item, replace(rules, moving_certainty=certainty * 0.99)) == pytest.approx(slope)
    assert left_speed(item, replace(rules, moving_certainty=certainty * 1.01)) == 0.0


@given(seed=st.integers(0, 2**32 - 1), speed=st.sampled_from([0.0, 0.08, -0.08]), gain=st.sampled_from([0.6, 1.0]))
@repeatable
def test_walking_is_told_from_standing_in_a_second(rules: KnownSettings, seed: int, speed: float, gain: float) -> None:
    noise = np.random.default_rng(seed).normal(0.0, 0.003, (16, 2))
    settings, known = replace(rules, gain=gain), ()
    for index, (ahead, left) in enumerate(noise):
        place = 0.6 + ahead, speed * index * PERIOD + left
        known = reported(known, report_of([place], NOW + round(index * PERIOD * 1e9)), AHEAD, settings)
    (item,) = known
    assert left_speed(item, settings) == pytest.approx(speed, rel=0.25)


@pytest.mark.parametrize(
    'pose, looks, speed',
    [
        pytest.param(AHEAD, 16, 0.08, id='on a straight'),
        pytest.param(AHEAD, 4, 0.0, id='not for long'),
        pytest.param(LanePose(0.0, 0.0, 2.4), 16, 0.0, id='in a bend'),
    ],
)
def test_a_speed_is_measured_in_the_lane(rules: KnownSettings, pose: LanePose, looks: int, speed: float) -> None:
    known: Sequence[Known] = ()
    for index in range(looks):
        place = robot_from_lane(0.5, 0.08 * index * PERIOD, pose)
        known = reported(known, report_of([place], NOW + round(index * PERIOD * 1e9)), pose, rules)
    assert left_speed(known[0], rules) == pytest.approx(speed, abs=1e-9)


@pytest.mark.parametrize(
    'x, y, seconds, moving, remains',
    [
        pytest.param(0.5, 0.0, 0.0, True, True, id='just seen'),
        pytest.param(0.5, 0.0, 1.0, True, True, id='missing for as long as a stop is held'),
        pytest.param(0.5, 0.0, 1.01, True, False, id='gone'),
        pytest.param(0.5, 0.0, 1.01, False, False, id='gone, and nobody knows how the robot moves'),
        pytest.param(0.24, 0.0, 1.01, True, False, id='just far enough ahead to be seen'),
        pytest.param(0.22, 0.0, 1.01, True, True, id='its nearest point too near to be seen'),
        pytest.param(0.19, 0.0, 3600.0, True, True, id='before the bumper, for ever'),
        pytest.param(0.19, 0.0, 3600.0, False, True, id='the same, and nobody knows how the robot moves'),
        pytest.param(0.19, 0.12, 30.0, True, True, id='near and beside, for as long as that is remembered'),
        pytest.param(0.19, 0.12, 30.1, True, False, id='near and beside for ever'),
        pytest.param(0.19, 0.12, 3.0, False, True, id='near and beside, and nobody knows how the robot moves'),
        pytest.param(0.19, 0.12, 3.1, False, False, id='the same for longer'),
        pytest.param(0.3, 0.2, 1.01, True, False, id='at the side, in sight'),
        pytest.param(0.3, 0.21, 1.01, True, True, id='too far to the left to be seen'),
        pytest.param(0.3, -0.21, 1.01, True, True, id='too far to the right to be seen'),
        pytest.param(0.3, -0.21, 3.1, False, False, id='too far to the right for longer'),
        pytest.param(0.0, 0.2, 5.0, True, True, id='beside the axle'),
        pytest.param(-0.129, 0.1, 5.0, True, True, id='beside the tail'),
        pytest.param(-0.131, 0.1, 0.0, True, False, id='passed'),
        pytest.param(-0.131, 0.1, 0.0, False, False, id='passed, says who sees it'),
    ],
)
def test_what_can_be_seen_is_seen_or_gone_and_the_rest_is_passed(
    settings: AvoidanceSettings, x: float, y: float, seconds: float, moving: bool, remains: bool
) -> None:
    item = known_at(x, y, radius=0.03, seen=NOW - round(seconds * 1e9))
    assert remaining((), NOW, moving, settings) == ()
    assert remaining([item], NOW, moving, settings) == ((item,) if remains else ())


def test_each_one_remains_by_itself(settings: AvoidanceSettings) -> None:
    gone, there, near = known_at(0.5, 0.0, seen=NOW - 2000 * MS), known_at(0.6, 0.0), known_at(0.1, 0.0)
    assert remaining([gone, there, near], NOW, True, settings) == (there, near)


def walking(rate: int, seconds: float, path: Callable[[float], float], rules: KnownSettings) -> Known:
    """What is known of a thing 0.6 m ahead of a robot that stands, path(seconds) m left of the lane's middle."""
    known: Sequence[Known] = ()
    for index in range(round(seconds * rate) + 1):
        left = path(index / rate)
        known = reported(known, report_of([(0.6, left)], NOW + round(index / rate * 1e9)), AHEAD, rules)
    (item,) = known
    return item


def test_what_walked_into_the_lane_and_stopped_is_placed_where_it_stands(avoidance_settings: AvoidanceSettings) -> None:
    item = walking(15, 3.5, lambda time: max(0.3 - 0.08 * time, 0.1), avoidance_settings.known)
    assert item.left == pytest.approx(0.1, abs=3 * item.left_error)


def test_how_sure_it_is_does_not_depend_on_the_rate_of_reports(avoidance_settings: AvoidanceSettings) -> None:
    slow, fast = (walking(rate, 3.0, lambda time: 0.3 - 0.08 * time, avoidance_settings.known) for rate in (10, 30))
    assert fast.left == pytest.approx(slow.left, abs=0.015)
