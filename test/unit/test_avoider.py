"""core.avoidance.avoider: every state, every reason, and what outlives a picture. Closed loops: test_drives.py."""

from dataclasses import replace
from typing import Any, List, Optional, Sequence, Tuple

import pytest

from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide, restamped
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import Command, Decision, LanePose, Obstacle, Stamped, State

NOW = 1_700_000_000_000_000_000
MS = 1_000_000
STRAIGHT = LanePose(0.0, 0.0)
SURE = (1e-6, 0.0, 0.0, 1e-6)
"""Covariance of a pose of our own that is taken at its word."""
CLEAR, SLOW, AVOID, STOP, FAULT = State.CLEAR, State.SLOWING, State.AVOIDING, State.STOPPED, State.FAULT


@pytest.fixture
def settings(avoidance_settings: AvoidanceSettings) -> AvoidanceSettings:
    """Half a robot 0.075 m, with the margin 0.095; the lane leaves 0.035 to each side."""
    return replace(
        avoidance_settings,
        stage='avoid_all',
        lane_width=0.22,
        robot_width=0.15,
        robot_ahead=0.066,
        robot_behind=0.114,
        look_ahead=1.0,
        confirmation=0.4,
        margin=0.02,
        wanted_margin=0.03,
        least_margin=0.008,
        stop_distance=0.34,
        start_distance=0.37,
        near_distance=0.45,
        dead_end=0.6,
        switch_distance=0.5,
        cruise_speed=0.2,
        avoid_speed=0.12,
        slow_speed=0.1,
        deceleration=0.4,
        stop_hold=1.0,
        obstacles_age_limit=0.3,
        lane_pose_age_limit=0.4,
        clock_age_limit=0.5,
        future_limit=0.1,
    )


def obstacle(x: float, y: float, radius: float = 0.02, in_lane: Optional[bool] = True) -> Obstacle:
    """What stands with its nearest point at (x, y), robot frame. [m]"""
    return Obstacle(None, x, y, radius, in_lane)


def seen(*obstacles: Obstacle, at: int = NOW, pose: LanePose = STRAIGHT, bend: float = 0.0) -> Inputs:
    """Fresh inputs of a robot that stands: the filter's pose, and our own."""
    own = replace(pose, curvature=bend, covariance=SURE)
    standing = (Stamped(at - 200 * MS, Command(0.0, 0.0)), Stamped(at, Command(0.0, 0.0)))
    return Inputs(Stamped(at, obstacles), Stamped(at, replace(pose, curvature=bend)), Stamped(at, own), standing)


def run(pictures: Sequence[Tuple[int, Inputs]], settings: AvoidanceSettings) -> List[Decision]:
    """The decisions of a sequence; times in milliseconds, inputs made fresh."""
    memory, decisions = Memory(), []
    for milliseconds, inputs in pictures:
        now = NOW + milliseconds * MS
        again: Any = {
            name: value and replace(value, stamp=now)
            for name, value in (
                ('obstacles', inputs.obstacles),
                ('lane_pose', inputs.lane_pose),
                ('own_lane_pose', inputs.own_lane_pose),
            )
        }
        decision, memory = decide(replace(inputs, **again), memory, now, settings)
        decisions.append(decision)
    return decisions


def settled(settings: AvoidanceSettings, inputs: Inputs) -> Decision:
    """The decision when the same has been seen for half a second."""
    return run([(0, inputs), (250, inputs), (500, inputs)], settings)[-1]


RIGHT, LEFT = obstacle(0.7, -0.1), obstacle(0.7, 0.1)
"""Each leaves room on its other side."""
SOON = obstacle(0.45, -0.105)
"""To be passed on the left, and so near that it counts at once."""
MIDDLE = obstacle(0.3, 0.0)
OUTSIDE = obstacle(0.3, -0.1, in_lane=False)
FAR = obstacle(1.5, 0.0)


# decide: one picture


@pytest.mark.parametrize(
    'obstacles, state, d_ref, v_ref, reason',
    [
        pytest.param([obstacle(0.45, -0.11)], AVOID, 0.03, 0.12, 'avoiding', id='right and near: slowly'),
        pytest.param([], CLEAR, 0.0, 0.2, 'clear: no obstacle in the lane', id='nothing'),
        pytest.param([FAR], CLEAR, 0.0, 0.2, 'clear: no obstacle in the lane', id='too far'),
        pytest.param([obstacle(0.6, 0.0)], CLEAR, 0.0, 0.2, 'clear', id='in the way, but nothing to do yet'),
        pytest.param([OUTSIDE], CLEAR, 0.0, 0.2, 'clear: no obstacle in the lane', id='outside the lane'),
        pytest.param([obstacle(0.3, 0.3)], CLEAR, 0.0, 0.2, 'clear', id='beside the corridor'),
        pytest.param([RIGHT], AVOID, 0.03, 0.2, 'avoiding: 1 obstacle in the lane at 0.70 m, passing at', id='right'),
        pytest.param([LEFT], AVOID, -0.03, 0.2, 'avoiding: 1 obstacle in the lane at 0.70 m', id='left'),
        pytest.param([replace(RIGHT, in_lane=None)], AVOID, 0.03, 0.2, 'avoiding: 1 obstacle', id='lane unknown'),
        pytest.param([RIGHT, OUTSIDE, FAR], AVOID, 0.03, 0.2, 'avoiding: 1 obstacle', id='one of three counts'),
        pytest.param([RIGHT, obstacle(0.75, -0.11)], AVOID, 0.03, 0.2, 'avoiding: 2 obstacles', id='two on one side'),
        pytest.param(
            [MIDDLE], STOP, 0.0, 0.0,
            'stopping: 1 obstacle in the lane, nearest 0.30 m, no room to pass in a lane of 0.22 m', id='in the middle',
        ),
        pytest.param([obstacle(0.40, 0.0)], STOP, 0.0, 0.0, 'stopping', id='where a robot stops'),
        pytest.param([obstacle(0.43, 0.0)], SLOW, 0.0, 0.12, 'slowing: 1 obstacle in the lane', id='before that'),
        pytest.param(
            [obstacle(0.35, 0.0), obstacle(0.32, -0.1)], STOP, 0.0, 0.0,
            'stopping: 2 obstacles in the lane, nearest 0.32 m', id='two with no room between',
        ),
        pytest.param([obstacle(0.3, -0.08), obstacle(0.3, 0.08), MIDDLE], STOP, 0.0, 0.0, 'stopping: 3', id='three'),
        pytest.param([obstacle(0.12, 0.0, in_lane=False)], STOP, 0.0, 0.0, 'stopping: 1 obstacle in the path',
                     id='outside by its flag, but before the bumper'),
    ],
)  # fmt: skip
def test_one_picture(
    settings: AvoidanceSettings, obstacles: List[Obstacle], state: State, d_ref: float, v_ref: float, reason: str
) -> None:
    decision = settled(settings, seen(*obstacles))
    assert (decision.state, decision.v_ref) == (state, pytest.approx(v_ref, abs=5e-3))
    assert decision.d_ref == pytest.approx(d_ref, abs=0.008)
    assert decision.reason.startswith(reason)
    assert decision.active is (state is not CLEAR)


def test_the_one_that_decides_is_named(settings: AvoidanceSettings) -> None:
    near, far = obstacle(0.3, -0.05), obstacle(0.33, 0.0)
    found = decide(seen(far, near), Memory(), NOW, settings)[0].obstacle
    assert found is not None and (found.x, found.y) == (pytest.approx(near.x), pytest.approx(near.y))
    assert decide(seen(), Memory(), NOW, settings)[0].obstacle is None


def test_it_says_the_numbers(settings: AvoidanceSettings) -> None:
    numbers = decide(seen(obstacle(0.43, 0.0)), Memory(), NOW, settings)[0].numbers
    assert numbers['gap [m]'] == pytest.approx(0.43 - 0.066)
    assert numbers['time to collision [s]'] == pytest.approx((0.43 - 0.066) / 0.12, rel=0.05)
    assert numbers['d [m]'] == pytest.approx(0.0, abs=1e-3) and numbers['corridor half width [m]'] >= 0.095
    assert 'to spare [m]' in settled(settings, seen(RIGHT)).numbers


@pytest.mark.parametrize(
    'stage, obstacles, state',
    [
        pytest.param('stop_only', [], CLEAR, id='nothing'),
        pytest.param('stop_only', [FAR], CLEAR, id='too far'),
        pytest.param('stop_only', [obstacle(0.36, -0.1)], STOP, id='stop_only stops where there is room'),
        pytest.param('stop_only', [MIDDLE], STOP, id='and where there is none'),
        pytest.param('avoid_single', [RIGHT], AVOID, id='avoid_single passes one'),
        pytest.param('avoid_single', [obstacle(0.36, -0.1), obstacle(0.36, -0.09)], STOP, id='and stops before two'),
        pytest.param('avoid_all', [RIGHT, replace(RIGHT, y=-0.12)], AVOID, id='avoid_all passes two'),
        pytest.param('avoid_all_opposite_lane', [MIDDLE], STOP, id='over the line only from standing'),
    ],
)
def test_the_stages(settings: AvoidanceSettings, stage: str, obstacles: List[Obstacle], state: State) -> None:
    decision = settled(replace(settings, stage=stage), seen(*obstacles))
    assert decision.state is state
    if stage == 'stop_only':
        assert decision.d_ref == 0 and ('stage stop_only' in decision.reason or decision.state is CLEAR)


@pytest.mark.parametrize('there', [[], [obstacle(0.6, 0.25, 0.03, in_lane=False)]], ids=['free', 'something is there'])
def test_the_opposite_lane(settings: AvoidanceSettings, there: List[Obstacle]) -> None:
    rules = replace(settings, stage='avoid_all_opposite_lane')
    first, *_, decision = run([(ms, seen(obstacle(0.4, 0.0), *there)) for ms in (0, 500, 1000, 1500)], rules)
    assert first.state is STOP
    if there:
        assert decision.v_ref == 0
    else:
        assert (decision.state, decision.d_ref) == (AVOID, pytest.approx(0.245))


def test_the_lane_pose_says_where_in_the_lane_it_stands(settings: AvoidanceSettings) -> None:
    # straight ahead of a robot that drives at the left edge: in the lane it stands left, and is passed on the right
    decision = settled(settings, seen(obstacle(0.8, 0.0), pose=LanePose(0.1, 0.0)))
    assert decision.state is AVOID and decision.d_ref < -0.02


@pytest.mark.parametrize(
    'inputs, state, reason',
    [
        pytest.param(seen(obstacle(0.34, 0.14), bend=2.4), STOP, 'in a bend', id='on a left bend'),
        pytest.param(seen(obstacle(0.34, -0.14), bend=-2.4), STOP, 'in a bend', id='on a right bend'),
        pytest.param(seen(obstacle(0.34, -0.14), bend=2.4), CLEAR, '', id='beyond a left bend'),
        pytest.param(seen(obstacle(0.60, 0.05), bend=-2.4), CLEAR, '', id='straight ahead of a right bend'),
    ],
)
def test_the_corridor_bends(settings: AvoidanceSettings, inputs: Inputs, state: State, reason: str) -> None:
    decision, _ = decide(inputs, Memory(), NOW, settings)
    assert decision.state is state and reason in decision.reason


def test_a_turn_that_was_heard_long_ago_says_nothing(settings: AvoidanceSettings) -> None:
    _, memory = decide(seen(), Memory(), NOW, settings)
    later = NOW + 1000 * MS
    _, memory = decide(replace(seen(at=later), own_lane_pose=None), memory, later, settings)
    now = later + 50 * MS
    heard = Stamped(now - round(settings.turn_age_limit * 1e9) - MS, 'straight')
    scene = seen(obstacle(0.22, -0.22), at=now)
    assert decide(replace(scene, own_lane_pose=None, turn=heard), memory, now, settings)[0].state is STOP


@pytest.mark.parametrize(
    'turn, place, state',
    [
        pytest.param(None, obstacle(0.22, -0.22), STOP, id='nobody says: on the right turn'),
        pytest.param(None, obstacle(0.34, 0.14), STOP, id='nobody says: on the left turn'),
        pytest.param('straight', obstacle(0.22, -0.22), CLEAR, id='straight on: on the right turn'),
        pytest.param('right', obstacle(0.22, -0.22), STOP, id='right: on the right turn'),
        pytest.param('right', obstacle(0.34, 0.14), CLEAR, id='right: on the left turn'),
        pytest.param('left', obstacle(0.34, 0.14), STOP, id='left: on the left turn'),
        pytest.param('left', obstacle(0.35, 0.0), STOP, id='left: straight ahead, the turn may begin later'),
    ],
)
def test_an_intersection(settings: AvoidanceSettings, turn: Optional[str], place: Obstacle, state: State) -> None:
    _, memory = decide(seen(), Memory(), NOW, settings)
    later = NOW + 1000 * MS
    _, memory = decide(replace(seen(at=later), own_lane_pose=None), memory, later, settings)  # the lines have ended
    now = later + 50 * MS
    decision, _ = decide(
        replace(seen(place, at=now), own_lane_pose=None, turn=turn and Stamped(now, turn)), memory, now, settings
    )
    assert decision.state is state


# decide: faults


def inputs_at(obstacles: Optional[int], lane_pose: Optional[int], own: Optional[int] = None, **rest: Any) -> Inputs:
    """Inputs of a clear road whose stamps lie so many milliseconds back; None: they never came."""
    stamps = [None if ms is None else NOW - ms * MS for ms in (obstacles, lane_pose, own)]
    return Inputs(
        None if stamps[0] is None else Stamped(stamps[0], ()),
        None if stamps[1] is None else Stamped(stamps[1], STRAIGHT),
        None if stamps[2] is None else Stamped(stamps[2], STRAIGHT),
        **rest,
    )


@pytest.mark.parametrize(
    'inputs, reason',
    [
        pytest.param(Inputs(), 'no obstacle list yet', id='nothing came'),
        pytest.param(inputs_at(None, 0), 'no obstacle list yet', id='no obstacle list'),
        pytest.param(inputs_at(0, None), 'no lane pose yet', id='no lane pose'),
        pytest.param(inputs_at(301, 0), 'obstacle list is 0.30 s old, limit 0.30 s', id='old obstacles'),
        pytest.param(inputs_at(0, 401), 'lane pose is 0.40 s old, limit 0.40 s', id='old lane pose'),
        pytest.param(inputs_at(0, 401, 401), 'lane pose is 0.40 s old, limit 0.40 s', id='both lane poses are old'),
        pytest.param(inputs_at(-101, 0), 'obstacle list is stamped 0.10 s in the future, limit 0.10 s', id='ahead'),
        pytest.param(inputs_at(0, -101), 'lane pose is stamped 0.10 s in the future, limit 0.10 s', id='pose ahead'),
        pytest.param(inputs_at(0, 0, clock_stood=0.6), 'the clock has stood still for 0.6 s, limit 0.5 s', id='clock'),
        pytest.param(inputs_at(None, None, clock_stood=9.0), 'stood still for 9.0 s, limit 0.5 s', id='all at once'),
    ],
)
def test_doubt_is_a_fault_and_stops(settings: AvoidanceSettings, inputs: Inputs, reason: str) -> None:
    decision, _ = decide(inputs, Memory(), NOW, settings)
    assert (decision.state, decision.d_ref, decision.v_ref, decision.active) == (FAULT, 0.0, 0.0, True)
    assert decision.reason.startswith('stopping: ') and decision.reason.endswith(reason)


@pytest.mark.parametrize(
    'inputs',
    [
        pytest.param(inputs_at(300, 400), id='as old as may be'),
        pytest.param(inputs_at(-100, -100), id='as far ahead as may be'),
        pytest.param(inputs_at(0, 0, clock_stood=0.5), id='the clock stood as long as it may'),
        pytest.param(inputs_at(0, 401, 0), id='the filter is silent, our own lines are there'),
        pytest.param(inputs_at(0, None, 0), id='there is no filter'),
        pytest.param(inputs_at(0, 0, 401), id='our own lines are not'),
    ],
)
def test_inputs_at_their_limits_are_fresh(settings: AvoidanceSettings, inputs: Inputs) -> None:
    assert decide(inputs, Memory(), NOW, settings)[0].state is CLEAR


def test_a_fault_forgets_nothing(settings: AvoidanceSettings) -> None:
    _, memory = decide(seen(SOON), Memory(), NOW, settings)
    after = decide(Inputs(), memory, NOW, settings)[1]
    assert (after.passing, after.known) == (memory.passing, memory.known) and memory.passing is not None


# decide: what outlives a picture

NEAR = obstacle(0.1, -0.1)
"""Beside the bumper, where nothing can be seen."""


@pytest.mark.parametrize(
    'pictures, states',
    [
        pytest.param([], [], id='nothing happened'),
        pytest.param([(0, seen(MIDDLE)), (999, seen())], [STOP, STOP], id='a stop is held'),
        pytest.param([(0, seen(MIDDLE)), (1000, seen())], [STOP, STOP], id='for a second'),
        pytest.param([(0, seen(MIDDLE)), (1001, seen())], [STOP, CLEAR], id='and no longer'),
        pytest.param([(0, seen(MIDDLE)), (900, seen(MIDDLE)), (1800, seen())], [STOP] * 3, id='since the last one'),
        pytest.param(
            [(0, seen(MIDDLE)), (500, seen(SOON)), (900, seen(SOON)), (1001, seen(SOON))],
            [STOP, STOP, STOP, AVOID], id='also before a pass',
        ),
        pytest.param([(0, seen(SOON)), (900, seen())], [AVOID, AVOID], id='a pass is held'),
        pytest.param([(0, seen(SOON)), (1001, seen())], [AVOID, CLEAR], id='but not when it should be seen'),
        pytest.param(
            [(0, seen(MIDDLE)), (100, Inputs()), (200, seen())], [STOP, FAULT, STOP], id='a fault in between'
        ),
        pytest.param([(0, Inputs()), (1000, seen())], [FAULT, FAULT], id='a fault is held like a stop'),
        pytest.param([(0, Inputs()), (1001, seen())], [FAULT, CLEAR], id='and no longer than one'),
        pytest.param([(0, seen(SOON)), (100, seen(SOON, obstacle(0.45, 0.105)))], [AVOID, SLOW], id='one beside it'),
        pytest.param(
            [(0, seen(MIDDLE)), (100, seen(obstacle(0.41, 0.0)))], [STOP, STOP], id='a little room does not start it'
        ),
        pytest.param(
            [(0, seen(MIDDLE)), (100, seen(obstacle(0.30, -0.20))), (1200, seen(obstacle(0.30, -0.20)))],
            [STOP, STOP, CLEAR], id='it went to the side',
        ),
    ],
)  # fmt: skip
def test_sequences(settings: AvoidanceSettings, pictures: List[Tuple[int, Inputs]], states: List[State]) -> None:
    assert [decision.state for decision in run(pictures, settings)] == states


def test_a_held_stop_says_so_and_stands_still(settings: AvoidanceSettings) -> None:
    _, held = run([(0, seen(MIDDLE)), (400, seen())], settings)
    assert held.v_ref == 0.0 and held.obstacle is not None
    assert held.reason == 'waiting: 1 obstacle in the lane, nearest 0.30 m, not seen for 0.4 s of 1.0 s'


def test_the_offset_does_not_shrink(settings: AvoidanceSettings) -> None:
    first, kept = run([(0, seen(obstacle(0.45, -0.1))), (100, seen(obstacle(0.45, -0.11)))], settings)
    assert first.state is kept.state is AVOID and kept.d_ref >= first.d_ref - 1e-9 > 0.01


def driven(settings: AvoidanceSettings, first: Obstacle, seconds: float, v: float) -> List[Decision]:
    """A robot that drives straight at v past one obstacle, which a detector reports as long as it can be seen."""
    memory, decisions, dt = Memory(), [], 50
    commands = tuple(Stamped(NOW + ms * MS, Command(v, 0.0)) for ms in range(-500, int(1000 * seconds) + 1, dt))
    for ms in range(0, int(1000 * seconds), dt):
        now, x = NOW + ms * MS, first.x - v * ms / 1000
        inputs = seen(*([replace(first, x=x)] if x > 0.2 else []), at=now)
        told = tuple(item for item in commands if item.stamp <= now)
        decision, memory = decide(replace(inputs, commands=told), memory, now, settings)
        decisions.append(decision)
    return decisions


def test_a_pass_is_held_until_the_tail_has_passed(settings: AvoidanceSettings) -> None:
    decisions = driven(settings, obstacle(0.7, -0.1, 0.015), 9.0, 0.12)
    last = max(index for index, decision in enumerate(decisions) if decision.state is AVOID)
    begun = round(settings.confirmation / 0.05) + 1
    assert all(decision.state is AVOID and decision.d_ref > 0.01 for decision in decisions[begun : last + 1])
    passed = (0.7 + 2 * 0.015 + 0.114) / 0.12  # until its far end is behind the tail
    assert last * 0.05 == pytest.approx(passed, abs=0.25)
    assert all(decision.state is CLEAR for decision in decisions[last + 1 :])


# restamped


def test_an_empty_memory_stays_empty() -> None:
    assert restamped(Memory(), NOW) == Memory()


@pytest.mark.parametrize('what, state', [(MIDDLE, STOP), (SOON, AVOID)], ids=['a stop', 'a pass'])
def test_what_is_held_survives_a_clock_that_jumps_back(
    settings: AvoidanceSettings, what: Obstacle, state: State
) -> None:
    _, memory = decide(seen(what), Memory(), NOW, settings)
    early = NOW - 3_600_000 * MS
    memory = restamped(memory, early)
    for milliseconds, expected in ((10, state), (1000, state), (1001, CLEAR)):
        now = early + milliseconds * MS
        assert decide(seen(at=now), memory, now, settings)[0].state is expected


@pytest.mark.parametrize('what', [MIDDLE, SOON], ids=['a stop', 'a pass'])
def test_what_ran_out_does_not_come_back_when_the_clock_jumps(settings: AvoidanceSettings, what: Obstacle) -> None:
    _, memory = decide(seen(what), Memory(), NOW, settings)
    later = NOW + 60_000 * MS
    decision, memory = decide(seen(at=later), memory, later, settings)
    assert decision.state is CLEAR
    assert decide(seen(), restamped(memory, NOW - MS), NOW, settings)[0].state is CLEAR


def test_the_memory_given_is_left_alone(settings: AvoidanceSettings) -> None:
    memory = Memory()
    decide(seen(MIDDLE), memory, NOW, settings)
    assert memory == Memory()
