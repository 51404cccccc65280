"""core.avoidance.avoider: every state, every reason, and what outlives a picture."""

from dataclasses import replace
from typing import List, Optional, Sequence, Tuple

import pytest

from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide, passing_offset, restamped
from obst_avoid.core.avoidance.region import footprint_centre
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import Decision, LanePose, Obstacle, Stamped, State

NOW = 1_700_000_000_000_000_000
MS = 1_000_000
STRAIGHT = LanePose(0.0, 0.0)


@pytest.fixture
def settings(avoidance_settings: AvoidanceSettings) -> AvoidanceSettings:
    """Round numbers: half a robot 0.075, room beside it 0.035, half a robot and margin 0.095 m."""
    return replace(
        avoidance_settings,
        stage='avoid_single',
        box_length=0.5,
        box_width=0.25,
        lane_width=0.22,
        robot_width=0.15,
        margin=0.02,
        cruise_speed=0.2,
        avoid_speed=0.12,
        stop_hold=1.0,
        avoid_hold=3.0,
        obstacles_age_limit=0.3,
        lane_pose_age_limit=0.4,
        clock_age_limit=0.5,
        future_limit=0.1,
    )


def obstacle(x: float, y: float, radius: float = 0.02, in_lane: Optional[bool] = True) -> Obstacle:
    """What stands with its nearest point at (x, y), robot frame. [m]"""
    return Obstacle(None, x, y, radius, in_lane)


def seen(*obstacles: Obstacle, at: int = NOW, pose: LanePose = STRAIGHT) -> Inputs:
    """Fresh inputs."""
    return Inputs(Stamped(at, obstacles), Stamped(at, pose))


def run(pictures: Sequence[Tuple[int, Inputs]], settings: AvoidanceSettings) -> List[Decision]:
    """The decisions of a sequence; times in milliseconds, inputs made fresh."""
    memory, decisions = Memory(), []
    for milliseconds, inputs in pictures:
        now = NOW + milliseconds * MS
        fresh = Inputs(
            inputs.obstacles and replace(inputs.obstacles, stamp=now),
            inputs.lane_pose and replace(inputs.lane_pose, stamp=now),
        )
        decision, memory = decide(fresh, memory, now, settings)
        decisions.append(decision)
    return decisions


RIGHT, LEFT = obstacle(0.3, -0.1), obstacle(0.3, 0.1)
"""Each leaves room on its other side: their middles are 0.1063 m beside the robot's axis."""
MIDDLE = obstacle(0.3, 0.0)
OUTSIDE = obstacle(0.3, -0.1, in_lane=False)
FAR = obstacle(0.6, 0.0)


# passing_offset


@pytest.mark.parametrize(
    'x, y, radius, pose, offset',
    [
        pytest.param(0.3, -0.4, 0.0, STRAIGHT, 0.0, id='far to the right: none needed'),
        pytest.param(0.3, 0.4, 0.0, STRAIGHT, 0.0, id='far to the left: none needed'),
        pytest.param(0.3, -0.08, 0.0, STRAIGHT, 0.015, id='right: pass on the left'),
        pytest.param(0.3, 0.08, 0.0, STRAIGHT, -0.015, id='left: pass on the right'),
        pytest.param(0.0, -0.08, 0.02, STRAIGHT, 0.015, id='right: its middle is one radius farther'),
        pytest.param(0.0, 0.08, 0.02, STRAIGHT, -0.015, id='left: its middle is one radius farther'),
        pytest.param(0.3, -0.08, 0.0, LanePose(-0.01, 0), 0.005, id='right of a robot that is right itself'),
        pytest.param(
            0.3, -0.06, 0.0, LanePose(0.01, 0), None, id='right of a robot that is left: more than the lane has'
        ),
        pytest.param(0.3, -0.061, 0.0, STRAIGHT, 0.034, id='just enough room'),
        pytest.param(0.3, -0.059, 0.0, STRAIGHT, None, id='just too little room'),
        pytest.param(0.3, 0.059, 0.0, STRAIGHT, None, id='just too little room on the other side'),
        pytest.param(0.3, 0.0, 0.02, STRAIGHT, None, id='in the middle'),
        pytest.param(0.3, 0.0, 0.0, LanePose(0.08, 0), -0.015, id='ahead of a robot far left: stands left in the lane'),
        pytest.param(0.3, 0.0, 0.0, LanePose(0, -0.25), 0.02078, id='ahead of a robot turned right: stands right'),
        pytest.param(0.3, 0.0, 0.0, LanePose(0, 0.25), -0.02078, id='ahead of a robot turned left: stands left'),
    ],
)
def test_the_offset_that_passes(
    settings: AvoidanceSettings, x: float, y: float, radius: float, pose: LanePose, offset: Optional[float]
) -> None:
    assert passing_offset(obstacle(x, y, radius), pose, settings) == (
        None if offset is None else pytest.approx(offset, abs=1e-5)
    )


def test_the_offset_leaves_the_margin_beside_the_footprint(settings: AvoidanceSettings) -> None:
    for margin in (0.01, 0.02, 0.03):
        found = passing_offset(obstacle(0.0, -0.08, 0.02), STRAIGHT, replace(settings, margin=margin))
        assert found == pytest.approx(-0.1 + 0.02 + 0.075 + margin)


def test_a_robot_wider_than_its_lane_passes_nothing(settings: AvoidanceSettings) -> None:
    assert passing_offset(obstacle(0.3, -0.4), STRAIGHT, replace(settings, robot_width=0.23)) is None


# decide: one picture


@pytest.mark.parametrize(
    'obstacles, state, d_ref, v_ref, reason',
    [
        pytest.param([], State.CLEAR, 0.0, 0.2, 'clear: no obstacle in the lane', id='nothing'),
        pytest.param([FAR], State.CLEAR, 0.0, 0.2, 'clear: no obstacle in the lane', id='too far'),
        pytest.param([OUTSIDE], State.CLEAR, 0.0, 0.2, 'clear: no obstacle in the lane', id='outside the lane'),
        pytest.param(
            [obstacle(0.3, 0.3)], State.CLEAR, 0.0, 0.2, 'clear: no obstacle in the lane', id='beside the box'
        ),
        pytest.param(
            [RIGHT],
            State.AVOIDING,
            0.00868,
            0.12,
            'avoiding: 1 obstacle in the lane at 0.30 m, passing at +0.009 m',
            id='right',
        ),
        pytest.param(
            [LEFT],
            State.AVOIDING,
            -0.00868,
            0.12,
            'avoiding: 1 obstacle in the lane at 0.30 m, passing at -0.009 m',
            id='left',
        ),
        pytest.param(
            [replace(RIGHT, in_lane=None)], State.AVOIDING, 0.00868, 0.12, 'avoiding: 1 obstacle', id='lane unknown'
        ),
        pytest.param(
            [RIGHT, OUTSIDE, FAR], State.AVOIDING, 0.00868, 0.12, 'avoiding: 1 obstacle', id='one of three counts'
        ),
        pytest.param(
            [MIDDLE],
            State.STOPPED,
            0.0,
            0.0,
            'stopping: 1 obstacle in the lane, nearest 0.30 m, no room to pass in a lane of 0.22 m',
            id='in the middle',
        ),
        pytest.param(
            [obstacle(0.42, 0.0), RIGHT],
            State.STOPPED,
            0.0,
            0.0,
            'stopping: 2 obstacles in the lane, nearest 0.30 m',
            id='two',
        ),
        pytest.param(
            [RIGHT, RIGHT], State.STOPPED, 0.0, 0.0, 'stopping: 2 obstacles in the lane', id='two at one place'
        ),
        pytest.param([RIGHT, LEFT, MIDDLE], State.STOPPED, 0.0, 0.0, 'stopping: 3 obstacles in the lane', id='three'),
    ],
)
def test_one_picture(
    settings: AvoidanceSettings, obstacles: List[Obstacle], state: State, d_ref: float, v_ref: float, reason: str
) -> None:
    decision, _ = decide(seen(*obstacles), Memory(), NOW, settings)
    assert (decision.state, decision.v_ref) == (state, v_ref)
    assert decision.d_ref == pytest.approx(d_ref, abs=1e-5)
    assert decision.reason.startswith(reason)
    assert decision.active is (state is not State.CLEAR)


def test_the_nearest_one_decides(settings: AvoidanceSettings) -> None:
    near, far = obstacle(0.3, -0.05), obstacle(0.31, 0.0)
    assert decide(seen(far, near), Memory(), NOW, settings)[0].obstacle is near
    assert decide(seen(), Memory(), NOW, settings)[0].obstacle is None


@pytest.mark.parametrize(
    'obstacles, stops', [([], False), ([FAR], False), ([RIGHT], True), ([MIDDLE], True), ([RIGHT, LEFT], True)]
)
def test_stage_stop_only_stops_for_all_that_counts(
    settings: AvoidanceSettings, obstacles: List[Obstacle], stops: bool
) -> None:
    decision, _ = decide(seen(*obstacles), Memory(), NOW, replace(settings, stage='stop_only'))
    assert decision.state is (State.STOPPED if stops else State.CLEAR)
    if len(obstacles) == 1 and stops:
        assert decision.reason == 'stopping: 1 obstacle in the lane, nearest 0.30 m, stage stop_only'


def test_the_lane_pose_says_where_in_the_lane_it_stands(settings: AvoidanceSettings) -> None:
    # dead ahead of a robot that drives at the left edge: in the lane it stands left, and is passed on the right
    decision, _ = decide(seen(MIDDLE, pose=LanePose(0.09, 0.0)), Memory(), NOW, settings)
    assert decision.state is State.AVOIDING and decision.d_ref == pytest.approx(0.09 - 0.115)


# decide: faults


def inputs_at(obstacles: Optional[int], lane_pose: Optional[int], clock_stood: float = 0.0) -> Inputs:
    """Inputs of a clear road whose stamps lie so many milliseconds back; None: they never came."""
    return Inputs(
        None if obstacles is None else Stamped(NOW - obstacles * MS, ()),
        None if lane_pose is None else Stamped(NOW - lane_pose * MS, LanePose(0.0, 0.0)),
        clock_stood,
    )


@pytest.mark.parametrize(
    'inputs, reason',
    [
        pytest.param(Inputs(), 'no obstacle list yet', id='nothing came'),
        pytest.param(inputs_at(None, 0), 'no obstacle list yet', id='no obstacle list'),
        pytest.param(inputs_at(0, None), 'no lane pose yet', id='no lane pose'),
        pytest.param(inputs_at(301, 0), 'obstacle list is 0.30 s old, limit 0.30 s', id='old obstacles'),
        pytest.param(inputs_at(0, 401), 'lane pose is 0.40 s old, limit 0.40 s', id='old lane pose'),
        pytest.param(
            inputs_at(-101, 0), 'obstacle list is stamped 0.10 s in the future, limit 0.10 s', id='obstacles ahead'
        ),
        pytest.param(
            inputs_at(0, -101), 'lane pose is stamped 0.10 s in the future, limit 0.10 s', id='lane pose ahead'
        ),
        pytest.param(inputs_at(0, 0, 0.6), 'the clock has stood still for 0.6 s, limit 0.5 s', id='the clock stands'),
        pytest.param(inputs_at(None, None, 9.0), 'the clock has stood still for 9.0 s, limit 0.5 s', id='all at once'),
    ],
)
def test_doubt_is_a_fault_and_stops(settings: AvoidanceSettings, inputs: Inputs, reason: str) -> None:
    decision, _ = decide(inputs, Memory(), NOW, settings)
    assert (decision.state, decision.d_ref, decision.v_ref, decision.active) == (State.FAULT, 0.0, 0.0, True)
    assert decision.reason.startswith('stopping: ') and decision.reason.endswith(reason)


@pytest.mark.parametrize('inputs', [inputs_at(300, 400), inputs_at(-100, -100), inputs_at(0, 0, 0.5)])
def test_inputs_at_their_limits_are_fresh(settings: AvoidanceSettings, inputs: Inputs) -> None:
    assert decide(inputs, Memory(), NOW, settings)[0].state is State.CLEAR


def test_a_fault_does_not_forget_what_is_being_passed(settings: AvoidanceSettings) -> None:
    _, memory = decide(seen(RIGHT), Memory(), NOW, settings)
    assert decide(Inputs(), memory, NOW, settings)[1].avoided == memory.avoided


# decide: what outlives a picture

CLEAR, AVOID, STOP = State.CLEAR, State.AVOIDING, State.STOPPED


@pytest.mark.parametrize(
    'pictures, states',
    [
        pytest.param([], [], id='nothing happened'),
        pytest.param([(0, seen(MIDDLE)), (999, seen())], [STOP, STOP], id='a stop is held'),
        pytest.param([(0, seen(MIDDLE)), (1000, seen())], [STOP, STOP], id='for a second'),
        pytest.param([(0, seen(MIDDLE)), (1001, seen())], [STOP, CLEAR], id='and no longer'),
        pytest.param(
            [(0, seen(MIDDLE)), (900, seen(MIDDLE)), (1800, seen())], [STOP, STOP, STOP], id='since the last sighting'
        ),
        pytest.param(
            [(0, seen(MIDDLE)), (500, seen(RIGHT)), (1001, seen(RIGHT))], [STOP, STOP, AVOID], id='also before a pass'
        ),
        pytest.param([(0, seen(RIGHT)), (3000, seen())], [AVOID, AVOID], id='a pass is held'),
        pytest.param([(0, seen(RIGHT)), (3001, seen())], [AVOID, CLEAR], id='for three seconds'),
        pytest.param(
            [(0, seen(RIGHT)), (2000, seen(RIGHT)), (4000, seen())], [AVOID, AVOID, AVOID], id='since last seen'
        ),
        pytest.param(
            [(0, seen(RIGHT)), (100, seen(LEFT)), (1200, seen())], [AVOID, STOP, AVOID], id='one opposite: stops'
        ),
        pytest.param([(0, seen(RIGHT)), (3100, seen(LEFT))], [AVOID, AVOID], id='opposite, but the first is passed'),
        pytest.param([(0, seen(RIGHT)), (100, seen(RIGHT, LEFT))], [AVOID, STOP], id='a second one beside it'),
        pytest.param(
            [(0, seen(MIDDLE)), (100, Inputs()), (200, seen())],
            [STOP, State.FAULT, State.FAULT],
            id='a fault in between',
        ),
        pytest.param([(0, Inputs()), (1000, seen())], [State.FAULT, State.FAULT], id='a fault is held like a stop'),
        pytest.param([(0, Inputs()), (1001, seen())], [State.FAULT, CLEAR], id='and no longer than one'),
        pytest.param(
            [(0, seen(RIGHT)), (2000, seen(MIDDLE)), (4000, seen(MIDDLE)), (5001, seen())],
            [AVOID, STOP, STOP, AVOID],
            id='a pass does not run out while the robot stands',
        ),
        pytest.param(
            [(0, seen(RIGHT)), (2000, Inputs()), (4000, Inputs()), (5001, seen())],
            [AVOID, State.FAULT, State.FAULT, AVOID],
            id='nor while it is blind',
        ),
        pytest.param(
            [(0, seen(RIGHT)), (2000, seen(MIDDLE)), (2900, seen()), (5200, seen())],
            [AVOID, STOP, STOP, AVOID],
            id='nor while it waits',
        ),
        pytest.param(
            [(0, seen(RIGHT)), (100, seen(obstacle(0.45, -0.1)))], [AVOID, STOP], id='a second one on the same side'
        ),
        pytest.param(
            [(0, seen(RIGHT)), (100, seen(obstacle(0.35, -0.1)))], [AVOID, AVOID], id='the same one, measured anew'
        ),
    ],
)
def test_sequences(settings: AvoidanceSettings, pictures: List[Tuple[int, Inputs]], states: List[State]) -> None:
    assert [decision.state for decision in run(pictures, settings)] == states


def test_a_held_stop_says_so_and_stands_still(settings: AvoidanceSettings) -> None:
    first, held = run([(0, seen(MIDDLE)), (400, seen())], settings)
    assert (held.v_ref, held.obstacle) == (0.0, first.obstacle)
    assert held.reason.startswith('waiting: ') and held.reason.endswith('for 0.4 s of 1.0 s')


def test_a_held_pass_keeps_offset_and_speed(settings: AvoidanceSettings) -> None:
    first, held = run([(0, seen(RIGHT)), (400, seen())], settings)
    assert (held.d_ref, held.v_ref, held.obstacle) == (first.d_ref, 0.12, first.obstacle)
    assert held.reason == 'passing: the obstacle is out of sight, keeping +0.009 m'


def test_the_reason_for_a_second_one(settings: AvoidanceSettings) -> None:
    _, stopped = run([(0, seen(RIGHT)), (400, seen(LEFT))], settings)
    assert (stopped.state, stopped.v_ref, stopped.d_ref) == (State.STOPPED, 0.0, 0.0)
    assert stopped.reason == 'stopping: 1 obstacle in the lane, nearest 0.30 m, while another one is being passed'


@pytest.mark.parametrize('side', [-1, 1], ids=['right', 'left'])
def test_the_offset_grows_with_what_is_measured_and_does_not_shrink(settings: AvoidanceSettings, side: int) -> None:
    small, large = obstacle(0.25, 0.1 * side), obstacle(0.24, 0.085 * side)
    first, grown, kept = run([(0, seen(small)), (100, seen(large)), (200, seen(small))], settings)
    assert grown.d_ref == pytest.approx(passing_offset(large, STRAIGHT, settings))
    assert first.d_ref * -side < grown.d_ref * -side == kept.d_ref * -side
    assert (kept.state, kept.v_ref) == (State.AVOIDING, 0.12)
    assert kept.reason.endswith('passing at %+.3f m' % kept.d_ref), 'the reason tells what is done'


@pytest.mark.parametrize('side', [-1, 1], ids=['right', 'left'])
def test_the_offset_kept_for_one_does_not_lead_into_another(settings: AvoidanceSettings, side: int) -> None:
    # The second stands at the other edge of the lane: by itself it needs no offset, but it leaves no room for that of
    # the first, which has dropped out of the view.
    first, second = obstacle(0.3, 0.061 * side, 0.0), obstacle(0.35, -0.115 * side, 0.01)
    assert passing_offset(second, STRAIGHT, settings) == 0
    _, both = run([(0, seen(first)), (100, seen(second))], settings)
    _, y = footprint_centre(second)
    assert both.v_ref == 0 or abs(y - both.d_ref) >= 0.01 + 0.075


def test_a_second_obstacle_on_the_same_side_does_not_lead_back_into_the_first(settings: AvoidanceSettings) -> None:
    # The first is passed at +0.03 m and has dropped out of the view beside the robot; the second, farther ahead at
    # the edge, needs no offset. Steering back for it would hit the first.
    first, second = obstacle(0.2, -0.065, 0.005), obstacle(0.45, -0.11, 0.01)
    needed, other = (passing_offset(one, STRAIGHT, settings) for one in (first, second))
    assert needed is not None and needed > 0.03 and other is not None and other < 0.005
    passing, both = run([(0, seen(first)), (300, seen(second))], settings)
    assert passing.d_ref == pytest.approx(needed)
    assert both.v_ref == 0 or both.d_ref >= needed - settings.margin


# restamped


def test_an_empty_memory_stays_empty() -> None:
    assert restamped(Memory(), NOW) == Memory()


@pytest.mark.parametrize('what, state, hold', [(MIDDLE, STOP, 1000), (RIGHT, AVOID, 3000)], ids=['a stop', 'a pass'])
def test_what_is_held_survives_a_clock_that_jumps_back(
    settings: AvoidanceSettings, what: Obstacle, state: State, hold: int
) -> None:
    _, memory = decide(seen(what), Memory(), NOW, settings)
    early = NOW - 3_600_000 * MS
    memory = restamped(memory, early)
    for milliseconds, expected in ((0, state), (hold, state), (hold + 1, CLEAR)):
        now = early + milliseconds * MS
        assert decide(seen(at=now), memory, now, settings)[0].state is expected


@pytest.mark.parametrize('what', [MIDDLE, RIGHT], ids=['a stop', 'a pass'])
def test_what_ran_out_does_not_come_back_when_the_clock_jumps(settings: AvoidanceSettings, what: Obstacle) -> None:
    _, memory = decide(seen(what), Memory(), NOW, settings)
    later = NOW + 60_000 * MS
    decision, memory = decide(seen(at=later), memory, later, settings)
    assert decision.state is CLEAR
    assert decide(seen(), restamped(memory, NOW), NOW, settings)[0].state is CLEAR


def test_the_memory_given_is_left_alone(settings: AvoidanceSettings) -> None:
    memory = Memory()
    decide(seen(MIDDLE), memory, NOW, settings)
    assert memory == Memory()
