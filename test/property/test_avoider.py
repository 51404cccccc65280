"""core.avoidance: the safety rules as sentences, for any obstacles, poses and histories."""

import math
from dataclasses import replace
from typing import Any, List, Optional, Sequence, Tuple

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.known import Known
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import Command, Decision, LanePose, Obstacle, Stamped, State
from property.strategies import lane_poses, numbers, obstacle_lists

START = 1_700_000_000_000_000_000
MS = 1_000_000
SURE = (1e-6, 0.0, 0.0, 1e-6)
stages = st.sampled_from(['stop_only', 'avoid_single', 'avoid_all'])
commands = st.none() | st.builds(Command, v=numbers(0.0, 0.25), omega=numbers(-2.0, 2.0))
pictures = st.lists(
    st.tuples(st.integers(10, 1500), obstacle_lists, lane_poses, st.booleans(), commands), min_size=1, max_size=6
)
"""Sequences: milliseconds since the one before, what is seen, where the robot is, whether our own lines say so too, and
what the wheels were told last.
"""


def inputs_of(
    now: int, obstacles: Any, pose: LanePose, own: bool, told: Tuple[Stamped[Command], ...], turn: Optional[str] = None
) -> Inputs:
    """Fresh inputs."""
    own_pose = Stamped(now, replace(pose, covariance=SURE)) if own else None
    heard = None if turn is None else Stamped(now, turn)
    return Inputs(Stamped(now, tuple(obstacles)), Stamped(now, pose), own_pose, told, heard)


def run(sequence: Sequence[Any], rules: AvoidanceSettings, turn: Optional[str] = None) -> List[Decision]:
    """The decisions of a sequence with fresh inputs."""
    now, memory, told, out = START, Memory(), (), []
    for wait, obstacles, pose, own, command in sequence:
        now += wait * MS
        told = told if command is None else (*told, Stamped(now, command))
        decision, memory = decide(inputs_of(now, obstacles, pose, own, told, turn), memory, now, rules)
        out.append(decision)
    return out


def at(ahead: float, left: float, radius: float, in_lane: Optional[bool]) -> Obstacle:
    """An obstacle with the middle of its footprint at (ahead, left), robot frame. [m]"""
    nearer = 1 - radius / math.hypot(ahead, left)
    return Obstacle(None, ahead * nearer, left * nearer, radius, in_lane)


def alone(obstacles: Sequence[Obstacle], d: float, v: float, rules: AvoidanceSettings) -> Decision:
    """The decision on one picture of a robot that drives along a straight lane, d m left of its middle."""
    told = (Stamped(START - 300 * MS, Command(v, 0.0)), Stamped(START, Command(v, 0.0)))
    return decide(inputs_of(START, obstacles, LanePose(d, 0.0), True, told), Memory(), START, rules)[0]


@given(
    ahead=numbers(0.07, 0.6), left=numbers(-0.2, 0.2), radius=numbers(0.005, 0.05),
    in_lane=st.sampled_from([True, False, None]), d=numbers(-0.03, 0.03), v=numbers(0.0, 0.2), stage=stages,
)  # fmt: skip
@example(ahead=0.094, left=0.0, radius=0.016, in_lane=True, d=0.0, v=0.125, stage='stop_only')
@example(ahead=0.115, left=0.0, radius=0.03, in_lane=None, d=0.0, v=0.2, stage='avoid_all')
@example(ahead=0.1, left=0.06, radius=0.03, in_lane=True, d=0.0, v=0.2, stage='avoid_all')
def test_while_it_moves_the_way_is_clear_over_the_braking_distance(
    avoidance_settings: AvoidanceSettings,
    ahead: float,
    left: float,
    radius: float,
    in_lane: Optional[bool],
    d: float,
    v: float,
    stage: str,
) -> None:
    rules = replace(avoidance_settings, stage=stage)
    assume(ahead - radius > rules.robot_ahead)
    decision = alone([at(ahead, left, radius, in_lane)], d, v, rules)
    moved = v * rules.lane_estimate.command_delay
    speed = decision.v_ref
    brakes = speed * rules.delay + speed**2 / (2 * rules.deceleration)
    # between where the robot is and where it shall be; while it moves over, it is somewhere between
    left = left + d
    low, high = sorted((d, decision.d_ref))
    everywhere = left - radius < low + rules.robot_width / 2 and left + radius > high - rules.robot_width / 2
    if speed > 0 and everywhere:
        assert ahead - radius - moved - rules.robot_ahead >= brakes - 1e-6


@given(
    ahead=numbers(0.1, 1.2), farther=numbers(0.0, 0.5), left=numbers(-0.2, 0.2), radius=numbers(0.005, 0.06),
    in_lane=st.sampled_from([True, None]), v=numbers(0.0, 0.2), stage=stages,
)  # fmt: skip
def test_the_same_obstacle_farther_away_never_brakes_harder(
    avoidance_settings: AvoidanceSettings,
    ahead: float,
    farther: float,
    left: float,
    radius: float,
    in_lane: Optional[bool],
    v: float,
    stage: str,
) -> None:
    rules = replace(avoidance_settings, stage=stage)
    assume(ahead - radius > rules.robot_ahead + 0.02)
    near = alone([at(ahead, left, radius, in_lane)], 0.0, v, rules)
    far = alone([at(ahead + farther, left, radius, in_lane)], 0.0, v, rules)
    assert far.v_ref >= near.v_ref - 1e-9


@given(
    ahead=numbers(0.25, 0.8), farther=numbers(0.0, 0.5), left=numbers(-0.2, 0.2), error=numbers(0.001, 0.03),
    radius=numbers(0.005, 0.06), in_lane=st.sampled_from([True, False, None]), stage=stages,
)  # fmt: skip
@example(ahead=0.3, farther=0.1, left=0.14, error=0.02, radius=0.02, in_lane=True, stage='avoid_all')
def test_nor_does_one_that_is_known_for_a_while_and_as_surely(
    avoidance_settings: AvoidanceSettings,
    ahead: float,
    farther: float,
    left: float,
    error: float,
    radius: float,
    in_lane: Optional[bool],
    stage: str,
) -> None:
    # what is farther is less sure, and may slow the robot down where it did not; here both are as sure
    rules, decisions = replace(avoidance_settings, stage=stage), []
    before = START - 1000 * MS
    for x in (ahead, ahead + farther):
        seen = at(x, left, radius, in_lane)
        known = Known(
            x, left, radius, in_lane, START - 50 * MS, before, left=left, left_error=error, placed=START - 50 * MS
        )
        first = inputs_of(before, [seen], LanePose(0.0, 0.0), True, ())
        _, memory = decide(first, Memory(), before, rules)
        inputs = replace(inputs_of(START, [seen], LanePose(0.0, 0.0), False, ()), own_lane_pose=None)
        memory = replace(memory, known=(known,), known_stamp=START - 50 * MS, stopped=None)
        decisions.append(decide(inputs, memory, START, rules)[0])
    assert decisions[1].v_ref >= decisions[0].v_ref - 1e-9


@given(sequence=pictures, lane_width=numbers(0.15, 0.3), margin=numbers(0.0, 0.05), stage=stages)
def test_the_robots_side_stays_in_the_lane(
    avoidance_settings: AvoidanceSettings, sequence: Any, lane_width: float, margin: float, stage: str
) -> None:
    rules = replace(avoidance_settings, stage=stage, lane_width=lane_width, margin=margin)
    for decision in run(sequence, rules):
        assert abs(decision.d_ref) + rules.robot_width / 2 <= lane_width / 2 + 1e-9


@given(sequence=pictures, stage=stages)
def test_every_decision_is_well_formed(avoidance_settings: AvoidanceSettings, sequence: Any, stage: str) -> None:
    rules = replace(avoidance_settings, stage=stage)
    for decision in run(sequence, rules):
        assert math.isfinite(decision.d_ref) and math.isfinite(decision.v_ref) and decision.reason
        assert 0 <= decision.v_ref <= rules.cruise_speed
        assert (decision.v_ref == 0) is (decision.state in (State.STOPPED, State.FAULT))
        assert decision.active is (decision.state is not State.CLEAR)
        assert all(math.isfinite(number) for number in decision.numbers.values())
        if decision.state is State.CLEAR:
            assert decision.d_ref == 0 and decision.v_ref == rules.cruise_speed


@given(sequence=pictures)
def test_stage_stop_only_never_leaves_the_middle(avoidance_settings: AvoidanceSettings, sequence: Any) -> None:
    for decision in run(sequence, replace(avoidance_settings, stage='stop_only')):
        assert decision.d_ref == 0 and decision.state is not State.AVOIDING


@given(sequence=pictures, stage=stages)
def test_a_mirrored_scene_gives_the_mirrored_answer(
    avoidance_settings: AvoidanceSettings, sequence: Any, stage: str
) -> None:
    rules = replace(avoidance_settings, stage=stage)
    mirrored = [
        (
            wait,
            [replace(one, y=-one.y) for one in obstacles],
            LanePose(-pose.d, -pose.phi, -pose.curvature),
            own,
            None if command is None else Command(command.v, -command.omega),
        )
        for wait, obstacles, pose, own, command in sequence
    ]
    # the turns at an intersection are no mirror images of each other: traffic keeps to the right
    for here, there in zip(run(sequence, rules, 'straight'), run(mirrored, rules, 'straight')):
        assert there.state is here.state
        assert there.v_ref == pytest.approx(here.v_ref, abs=1e-9)
        assert there.d_ref == pytest.approx(-here.d_ref, abs=1e-9)


@given(sequence=pictures, data=st.data())
def test_the_order_of_obstacles_is_irrelevant(avoidance_settings: AvoidanceSettings, sequence: Any, data: Any) -> None:
    shuffled = [(wait, data.draw(st.permutations(obstacles)), *rest) for wait, obstacles, *rest in sequence]
    for here, there in zip(run(sequence, avoidance_settings), run(shuffled, avoidance_settings)):
        assert (there.state, there.d_ref, there.v_ref) == (here.state, here.d_ref, here.v_ref)


@given(sequence=pictures)
def test_a_stop_outlives_its_reason(avoidance_settings: AvoidanceSettings, sequence: Any) -> None:
    since: Optional[float] = None
    for (wait, *_), decision in zip(sequence, run(sequence, avoidance_settings)):
        since = None if since is None else since + wait * 1e-3
        if since is not None and since < avoidance_settings.stop_hold - 1e-6:
            assert decision.v_ref == 0
        if decision.state is State.STOPPED and not decision.reason.startswith('waiting'):
            since = 0.0


ages = st.integers(-2000, 2000)


@given(
    sequence=pictures, obstacles=st.none() | ages, lane_pose=st.none() | ages, own=st.none() | ages,
    stood=numbers(0.0, 2.0), seen=obstacle_lists,
)  # fmt: skip
def test_doubt_stops_whatever_was_before(
    avoidance_settings: AvoidanceSettings,
    sequence: Any,
    obstacles: Optional[int],
    lane_pose: Optional[int],
    own: Optional[int],
    stood: float,
    seen: Any,
) -> None:
    rules, memory, now = avoidance_settings, Memory(), START
    for wait, some, pose, lines, _ in sequence:
        now += wait * MS
        _, memory = decide(inputs_of(now, some, pose, lines, ()), memory, now, rules)
    now += 10 * MS
    inputs = Inputs(
        None if obstacles is None else Stamped(now - obstacles * MS, tuple(seen)),
        None if lane_pose is None else Stamped(now - lane_pose * MS, LanePose(0.0, 0.0)),
        None if own is None else Stamped(now - own * MS, LanePose(0.0, 0.0)),
        clock_stood=stood,
    )
    ahead = rules.future_limit * 1e3

    def doubtful(milliseconds: Optional[int], limit: float) -> bool:
        return milliseconds is None or not -ahead <= milliseconds <= limit * 1e3

    blind = (
        doubtful(obstacles, rules.obstacles_age_limit)
        or (doubtful(lane_pose, rules.lane_pose_age_limit) and doubtful(own, rules.lane_pose_age_limit))
        or stood > rules.clock_age_limit
    )
    decision, _ = decide(inputs, memory, now, rules)
    assert (decision.state is State.FAULT) is blind
    assert decision.v_ref == 0 or not blind
