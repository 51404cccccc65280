"""core.avoidance.corridor: which obstacles reach into the way that the robot needs, and what is shown of it."""

from dataclasses import replace
from typing import Any, List, Optional, Sequence

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from property.strategies import lane_poses, numbers

from obst_avoid.core.avoidance.corridor import HALF_WIDTH, TURNS, Placed, Reach, half_width, place, view_of
from obst_avoid.core.avoidance.known import Known
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.geometry import lane_from_robot, robot_from_lane
from obst_avoid.core.lane_estimate import Belief, LaneEstimate
from obst_avoid.core.types import Decision, LanePose, Obstacle, State

NOW = 1_700_000_000_000_000_000
PERIOD = 1 / 15
INSIDE, UNSURE, OUTSIDE = Reach.INSIDE, Reach.UNSURE, Reach.OUTSIDE
RANK = {INSIDE: 0, UNSURE: 1, OUTSIDE: 2}
repeatable = hypothesis.settings(deadline=None, derandomize=True)


@pytest.fixture(scope='module')
def settings(avoidance_settings: AvoidanceSettings) -> AvoidanceSettings:
    """A corridor of 0.1 m to each side, more in a turn; one standard deviation is 5 mm, twice that is unsure."""
    known = replace(
        avoidance_settings.known,
        position_error=0.005,
        position_growth=0.0,
        watch=1.0,
        moving=0.04,
        fastest=0.4,
        moving_certainty=3.0,
        foresight=3.0,
    )
    return replace(
        avoidance_settings,
        lane_width=0.22,
        robot_width=0.15,
        robot_behind=0.1,
        margin=0.025,
        yaw_margin=0.01,
        unsure=2.0,
        cruise_speed=0.2,
        look_ahead=1.0,
        convergence_length=0.15,
        known=known,
    )


def lane_of(pose: LanePose, d: float = 0.0, phi: float = 0.0, curvature: float = 0.0) -> LaneEstimate:
    """A pose that is known but for these standard deviations."""
    covariance = np.diag(np.square([d, phi, curvature, 0.1]))
    return LaneEstimate(NOW, Belief(np.array([pose.d, pose.phi, pose.curvature, 0.0]), covariance))


STRAIGHT = lane_of(LanePose(0.0, 0.0))


def known_at(x: float, y: float, radius: float = 0.03, speed: float = 0.0, **rest: Any) -> Known:
    """One that moves so fast to the left, as it was watched for a second."""
    lefts = tuple((NOW + round(index * PERIOD * 1e9), speed * index * PERIOD) for index in range(15))
    return Known(x, y, radius, **{'in_lane': None, 'seen': NOW, 'begun': NOW, 'lefts': lefts if speed else (), **rest})


def placed(item: Known, settings: AvoidanceSettings, lane: LaneEstimate = STRAIGHT, **rest: Any) -> Placed:
    """Where it is, by default in the lane's own bend, for a robot that does not turn and has passed nothing."""
    others = {'bends': [lane.pose.curvature], 'omega': 0.0, 'slack': 0.0, **rest}
    return place(item, lane, settings=settings, **others)


@pytest.mark.parametrize(
    'omega, half',
    [
        pytest.param(0.0, 0.1, id='straight on'),
        pytest.param(2.0, 0.12, id='turning left'),
        pytest.param(-2.0, 0.12, id='turning right'),
    ],
)
def test_the_corridor_is_wider_for_a_robot_that_turns(settings: AvoidanceSettings, omega: float, half: float) -> None:
    assert half_width(omega, settings) == pytest.approx(half)


@pytest.mark.parametrize(
    'left, reach',
    [
        pytest.param(0.0, INSIDE, id='in the middle'),
        pytest.param(0.129, INSIDE, id='its edge is in the corridor'),
        pytest.param(0.131, UNSURE, id='beside it by less than it may err'),
        pytest.param(0.139, UNSURE, id='just still unsure'),
        pytest.param(0.141, OUTSIDE, id='surely beside it'),
        pytest.param(-0.129, INSIDE, id='its edge is in the corridor from the right'),
        pytest.param(-0.139, UNSURE, id='just still unsure at the right'),
        pytest.param(-0.141, OUTSIDE, id='surely beside it at the right'),
    ],
)
@pytest.mark.parametrize('in_lane', [True, None])
@pytest.mark.parametrize('d, phi', [(0.0, 0.0), (0.05, -0.2)])
def test_what_reaches_into_the_corridor(
    settings: AvoidanceSettings, left: float, reach: Reach, in_lane: Optional[bool], d: float, phi: float
) -> None:
    lane = lane_of(LanePose(d, phi))
    found = placed(known_at(*robot_from_lane(0.5, left, lane.pose), in_lane=in_lane), settings, lane)
    assert found.reach is reach
    assert found.left == pytest.approx(left)


@pytest.mark.parametrize(
    'x, y, radius, begin, end, away',
    [
        pytest.param(0.5, 0.0, 0.03, 0.47, 0.53, 0.47, id='ahead'),
        pytest.param(0.4, 0.3, 0.05, 0.35, 0.45, 0.45, id='to the left'),
        pytest.param(0.4, -0.3, 0.05, 0.35, 0.45, 0.45, id='to the right'),
        pytest.param(-0.1, 0.0, 0.03, -0.13, -0.07, 0.07, id='behind the axle'),
    ],
)
def test_a_footprint_is_measured_along_the_lane_and_straight(
    settings: AvoidanceSettings, x: float, y: float, radius: float, begin: float, end: float, away: float
) -> None:
    found = placed(known_at(x, y, radius), settings)
    assert (found.begin, found.end, found.away) == pytest.approx((begin, end, away))
    assert (found.left, found.radius, found.speed) == pytest.approx((y, radius, 0.0))


@pytest.mark.parametrize(
    'errors, growth, error',
    [
        pytest.param({}, 0.0, 0.005, id='of its place alone'),
        pytest.param({}, 0.014, 0.012, id='of its place, farther away'),
        pytest.param({'d': 0.012}, 0.0, 0.013, id='of the offset'),
        pytest.param({'phi': 0.024}, 0.0, 0.013, id='of the heading, so far ahead'),
        pytest.param({'curvature': 0.096}, 0.0, 0.013, id='of the bend, so far ahead'),
    ],
)
def test_the_place_errs_by_all_that_it_rests_on(
    settings: AvoidanceSettings, errors: Any, growth: float, error: float
) -> None:
    rules = replace(settings, known=replace(settings.known, position_growth=growth))
    assert placed(known_at(0.5, 0.0), rules, lane_of(LanePose(0.0, 0.0), **errors)).error == pytest.approx(error)


@pytest.mark.parametrize(
    'x, y, bend, reach',
    [
        pytest.param(0.35, 0.0, 0.0, INSIDE, id='straight ahead on a straight'),
        pytest.param(0.6, 0.0, 2.4, OUTSIDE, id='straight ahead, beyond a bend to the left'),
        pytest.param(0.6, 0.0, -5.9, OUTSIDE, id='straight ahead, beyond a bend to the right'),
        pytest.param(*robot_from_lane(0.5, 0.0, LanePose(0, 0, 2.4)), 2.4, INSIDE, id='round a bend to the left'),
        pytest.param(*robot_from_lane(0.25, 0.0, LanePose(0, 0, -5.9)), -5.9, INSIDE, id='round a bend to the right'),
        pytest.param(*robot_from_lane(0.5, 0.0, LanePose(0, 0, 2.4)), 0.0, OUTSIDE, id='beside a straight'),
    ],
)
def test_the_corridor_bends_with_the_lane(
    settings: AvoidanceSettings, x: float, y: float, bend: float, reach: Reach
) -> None:
    assert placed(known_at(x, y), settings, lane_of(LanePose(0.0, 0.0, bend))).reach is reach


@pytest.mark.parametrize(
    'left, speed, reach',
    [
        pytest.param(0.0, 0.0, OUTSIDE, id='where the lane was mistaken'),
        pytest.param(0.12, 0.0, OUTSIDE, id='reaches over the line, says who sees the line'),
        pytest.param(0.2, 0.1, OUTSIDE, id='moves away'),
        pytest.param(0.2, -0.1, INSIDE, id='moves to the lane'),
        pytest.param(-0.2, 0.1, INSIDE, id='moves to the lane from the right'),
        pytest.param(-0.2, -0.1, OUTSIDE, id='moves away at the right'),
        pytest.param(0.27, -0.05, INSIDE, id='will just be in the lane'),
        pytest.param(0.295, -0.05, OUTSIDE, id='will not be in the lane yet'),
    ],
)
def test_what_is_outside_the_lane_counts_only_when_it_comes(
    settings: AvoidanceSettings, left: float, speed: float, reach: Reach
) -> None:
    unsure = lane_of(LanePose(0.0, 0.0), d=0.012)
    found = placed(known_at(0.6, left, speed=speed, in_lane=False), settings, unsure)
    assert found.reach is reach
    assert found.speed == pytest.approx(speed)


@pytest.mark.parametrize(
    'along, left, speed, foresight, reach',
    [
        pytest.param(0.5, 0.3, 0.0, 3.0, OUTSIDE, id='stands'),
        pytest.param(0.5, 0.3, -0.1, 3.0, INSIDE, id='will be in the way in 3 s'),
        pytest.param(0.5, 0.3, 0.1, 3.0, OUTSIDE, id='moves away'),
        pytest.param(0.5, 0.3, -0.1, 1.0, OUTSIDE, id='nobody looks ahead so far'),
        pytest.param(0.1, 0.3, -0.1, 3.0, OUTSIDE, id='the robot has passed it after 1 s'),
        pytest.param(-0.2, 0.15, -0.2, 3.0, OUTSIDE, id='the robot has passed it'),
        pytest.param(0.5, 0.05, -0.2, 3.0, INSIDE, id='crosses the way'),
        pytest.param(0.5, 0.1, 0.1, 3.0, INSIDE, id='leaves the way, but is in it still'),
        pytest.param(0.5, 0.3, -0.3, 3.0, INSIDE, id='comes across the whole lane'),
        pytest.param(0.5, -0.3, 0.1, 3.0, INSIDE, id='will be in the way from the right'),
        pytest.param(0.5, 0.235, -0.04, 2.5, UNSURE, id='will be beside the corridor by less than it may err'),
    ],
)
def test_what_moves_counts_until_the_robot_has_passed(
    settings: AvoidanceSettings, along: float, left: float, speed: float, foresight: float, reach: Reach
) -> None:
    rules = replace(settings, known=replace(settings.known, foresight=foresight, moving=0.03))
    found = placed(known_at(along, left, speed=speed), rules)
    assert found.reach is reach
    assert found.left == pytest.approx(left), 'where it is now'


@pytest.mark.parametrize(
    'x, y, bends, reach, left',
    [
        pytest.param(0.6, 0.0, [2.4], OUTSIDE, -0.314, id='one way, to the left'),
        pytest.param(0.6, 0.0, sorted(TURNS.values()), INSIDE, 0.0, id='straight on is one of them'),
        pytest.param(0.4, 0.3, [0.0, 2.4], INSIDE, 0.0, id='left is one of them'),
        pytest.param(0.6, 0.135, [0.0, -1.0], UNSURE, 0.135, id='unsure counts more than outside'),
        pytest.param(0.3, 0.1, [0.0, 2.4], INSIDE, None, id='in the way on both: the one that it is nearer to'),
    ],
)
def test_of_several_ways_the_worst_counts(
    settings: AvoidanceSettings, x: float, y: float, bends: List[float], reach: Reach, left: Optional[float]
) -> None:
    found, again = (placed(known_at(x, y), settings, bends=order) for order in (bends, bends[::-1]))
    assert found == again
    assert found.reach is reach
    nearest = min((placed(known_at(x, y), settings, bends=[bend]).left for bend in bends), key=abs)
    assert found.left == pytest.approx(nearest if left is None else left, abs=0.02)


def test_a_way_on_which_it_may_be_counts_more_than_a_nearer_one(settings: AvoidanceSettings) -> None:
    lane, item = lane_of(LanePose(0.0, 0.0), curvature=0.082), known_at(0.6, 0.16)
    straight, bent = (placed(item, settings, lane, bends=[bend]) for bend in (0.0, 1.763))
    assert (straight.reach, bent.reach) == (UNSURE, OUTSIDE)
    assert abs(straight.left) > abs(bent.left)
    assert placed(item, settings, lane, bends=[0.0, 1.763]) == straight


@pytest.mark.parametrize(
    'stored, bends, left, error',
    [
        pytest.param({}, [0.0], 0.10, 0.005, id='never placed: where it lies from the robot'),
        pytest.param({'left': 0.11, 'left_error': 0.002}, [0.0], 0.11, 0.002, id='as it was seen over time'),
        pytest.param({'left': 0.1161, 'left_error': 0.002}, [0.0], 0.1161, 0.002, id='almost a contradiction'),
        pytest.param({'left': 0.1163, 'left_error': 0.002}, [0.0], 0.10, 0.005, id='a contradiction'),
        pytest.param({'left': 0.1163, 'left_error': 0.012}, [0.0], 0.1163, 0.012, id='none, unsure as it is'),
        pytest.param({'left': 0.11, 'left_error': 0.002}, [0.0, -5.0], 0.10, 0.005, id='on an intersection'),
    ],
)
def test_the_place_over_time_counts_unless_the_robot_has_left_that_lane(
    settings: AvoidanceSettings, stored: Any, bends: List[float], left: float, error: float
) -> None:
    found = placed(known_at(0.05, 0.10, **stored), settings, bends=bends)
    assert (found.left, found.error) == pytest.approx((left, error), abs=1e-9)


def test_on_an_intersection_nothing_moves(settings: AvoidanceSettings) -> None:
    item = known_at(0.6, 0.3, speed=-0.1)
    assert placed(item, settings).reach is INSIDE
    found = placed(item, settings, bends=[0.0, -1.0])
    assert (found.speed, found.reach) == (0.0, OUTSIDE)


@pytest.mark.parametrize(
    'left, omega, slack, reach',
    [
        pytest.param(0.135, 0.0, 0.0, OUTSIDE, id='beside the corridor'),
        pytest.param(0.135, 0.0, 0.01, INSIDE, id='counted before'),
        pytest.param(0.141, 0.0, 0.01, OUTSIDE, id='counted before, but is farther aside now'),
        pytest.param(0.135, 1.0, 0.0, INSIDE, id='the robot turns left'),
        pytest.param(0.135, -1.0, 0.0, INSIDE, id='the robot turns right'),
        pytest.param(0.145, -1.0, 0.01, INSIDE, id='the robot turns and it counted before'),
    ],
)
def test_the_corridor_is_wider_for_what_counted_before(
    settings: AvoidanceSettings, left: float, omega: float, slack: float, reach: Reach
) -> None:
    sure = replace(settings, unsure=0.0)
    assert placed(known_at(0.5, left), sure, omega=omega, slack=slack).reach is reach


items = st.builds(
    known_at,
    x=numbers(-0.2, 1.0),
    y=numbers(-0.4, 0.4),
    radius=numbers(0.01, 0.1),
    speed=st.sampled_from([0.0, 0.08, -0.15]),
    in_lane=st.sampled_from([True, False, None]),
    left=st.one_of(st.none(), numbers(-0.3, 0.3)),
    left_error=numbers(0.001, 0.05),
)
ways = st.sampled_from([[0.0], [1.3], [-2.4], [0.0, 0.7], sorted(TURNS.values())])
errors = st.tuples(numbers(0, 0.03), numbers(0, 0.1), numbers(0, 1))


def mirrored(item: Known) -> Known:
    """The same thing at the other side."""
    lefts = tuple((stamp, -left) for stamp, left in item.lefts)
    return replace(item, y=-item.y, left=None if item.left is None else -item.left, lefts=lefts)


@given(item=items, pose=lane_poses, bends=ways, unsure=errors, omega=numbers(-4, 4), slack=numbers(0, 0.02))
@repeatable
def test_a_mirrored_scene_is_placed_mirrored(
    settings: AvoidanceSettings,
    item: Known,
    pose: LanePose,
    bends: Sequence[float],
    unsure: Sequence[float],
    omega: float,
    slack: float,
) -> None:
    sides = [abs(placed(item, settings, lane_of(pose), bends=[bend]).left) for bend in bends]
    hypothesis.assume(len({round(side, 9) for side in sides}) == len(sides))
    here = place(item, lane_of(pose, *unsure), bends, omega, slack, settings)
    other_lane = lane_of(LanePose(-pose.d, -pose.phi, -pose.curvature), *unsure)
    there = place(mirrored(item), other_lane, [-bend for bend in bends], -omega, slack, settings)
    assert there.reach is here.reach
    assert (there.begin, there.end, there.away, there.error) == pytest.approx(
        (here.begin, here.end, here.away, here.error), abs=1e-9
    )
    assert (there.left, there.speed) == pytest.approx((-here.left, -here.speed), abs=1e-9)


@given(item=items, pose=lane_poses, bends=ways, unsure=errors, more=numbers(0, 0.05), omega=numbers(0, 4))
@repeatable
def test_a_wider_corridor_never_counts_less(
    settings: AvoidanceSettings,
    item: Known,
    pose: LanePose,
    bends: Sequence[float],
    unsure: Sequence[float],
    more: float,
    omega: float,
) -> None:
    lane = lane_of(pose, *unsure)
    narrow = RANK[placed(item, settings, lane, bends=bends).reach]
    assert RANK[placed(item, settings, lane, bends=bends, slack=more).reach] <= narrow
    assert RANK[placed(item, settings, lane, bends=bends, omega=omega).reach] <= narrow


CLEAR = Decision(State.CLEAR, 0.0, 0.2, 'clear')


@pytest.mark.parametrize(
    'pose',
    [
        pytest.param(LanePose(0.0, 0.0), id='in the middle of a straight'),
        pytest.param(LanePose(0.05, -0.3), id='at the left, turned right'),
        pytest.param(LanePose(-0.03, 0.2, 1.5), id='in a bend to the left'),
        pytest.param(LanePose(0.03, 0.1, -2.5), id='in a bend to the right'),
    ],
)
@pytest.mark.parametrize('said, half', [({}, 0.1), ({HALF_WIDTH: 0.13}, 0.13)])
def test_the_region_lies_along_the_lane(settings: AvoidanceSettings, pose: LanePose, said: Any, half: float) -> None:
    region = view_of(replace(CLEAR, numbers=said), pose, settings).region
    np.testing.assert_array_equal(region[0], region[-1], 'closed')
    alongs, lefts = np.array([lane_from_robot(x, y, pose) for x, y in region[:-1]]).T
    np.testing.assert_allclose(np.abs(lefts), half, atol=1e-9)
    count = len(lefts) // 2
    np.testing.assert_allclose(lefts[:count], half, atol=1e-9)
    np.testing.assert_allclose(lefts[count:], -half, atol=1e-9)
    np.testing.assert_allclose(alongs[:count], alongs[count:][::-1], atol=1e-9)
    assert (alongs.min(), alongs.max()) == pytest.approx((0.0, 1.0), abs=1e-9)
    assert np.diff(alongs[:count]).max() < 0.06, 'fine enough for a bend'


@pytest.mark.parametrize('d_ref', [0.0, 0.03, -0.03])
@pytest.mark.parametrize('pose', [LanePose(0.02, 0.1), LanePose(-0.02, -0.1, 1.5)])
def test_the_way_leads_from_the_robot_to_the_offset(settings: AvoidanceSettings, pose: LanePose, d_ref: float) -> None:
    way = view_of(Decision(State.AVOIDING, d_ref, 0.1, 'avoiding'), pose, settings).way
    assert way[0] == pytest.approx([0.0, 0.0], abs=1e-12)
    along, left = lane_from_robot(*way[-1], pose)
    assert (along, left) == pytest.approx((1.0, d_ref), abs=0.002)
    first = way[1] / np.hypot(*way[1])
    assert first == pytest.approx([1.0, 0.0], abs=0.2), 'it sets out in the direction of the robot'


def test_what_decides_is_shown_as_its_footprint(settings: AvoidanceSettings) -> None:
    pose = LanePose(0.0, 0.0)
    assert view_of(CLEAR, pose, settings).deciding is None
    stopping = Decision(State.STOPPED, 0.0, 0.0, 'stopping', Obstacle(None, 0.3, 0.4, 0.05, True))
    assert view_of(stopping, pose, settings).deciding == pytest.approx((0.33, 0.44, 0.05))
