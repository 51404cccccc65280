"""core.avoidance: the safety rules as sentences, for any obstacles, poses and histories."""

import math
from dataclasses import replace
from typing import Any, List, Optional, Sequence, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import Decision, LanePose, Obstacle, Stamped, State
from property.strategies import lane_poses, numbers, obstacle_lists

START = 1_700_000_000_000_000_000
MS = 1_000_000
stages = st.sampled_from(['stop_only', 'avoid_single'])
pictures = st.lists(st.tuples(st.integers(10, 1500), obstacle_lists, lane_poses), min_size=1, max_size=6)
"""Sequences: milliseconds since the one before, what is seen, where the robot is."""


def run(sequence: Sequence[Any], rules: AvoidanceSettings) -> List[Tuple[Decision, Sequence[Obstacle], LanePose]]:
    """The decisions of a sequence with fresh inputs, each with what it rests on."""
    now, memory, out = START, Memory(), []
    for wait, obstacles, pose in sequence:
        now += wait * MS
        decision, memory = decide(Inputs(Stamped(now, tuple(obstacles)), Stamped(now, pose)), memory, now, rules)
        out.append((decision, obstacles, pose))
    return out


def footprint(obstacle: Obstacle, pose: LanePose) -> Tuple[float, float, float]:
    """Middle of a footprint in the robot frame, x and y, and its distance left of the lane's centre."""
    bearing = math.atan2(obstacle.y, obstacle.x)
    distance = math.hypot(obstacle.x, obstacle.y) + obstacle.radius
    x, y = distance * math.cos(bearing), distance * math.sin(bearing)
    return x, y, pose.d + distance * math.sin(bearing + pose.phi)


def counts(obstacle: Obstacle, rules: AvoidanceSettings) -> bool:
    """True when its circle surely reaches into the box ahead."""
    x, y, _ = footprint(obstacle, LanePose(0.0, 0.0))
    beside = max(abs(y) - rules.box_width / 2, 0.0)
    before = max(-x, x - rules.box_length, 0.0)
    return obstacle.in_lane is not False and math.hypot(beside, before) <= obstacle.radius - 1e-9


@given(sequence=pictures, stage=stages)
def test_a_moving_robot_keeps_clear(avoidance_settings: AvoidanceSettings, sequence: Any, stage: str) -> None:
    rules = replace(avoidance_settings, stage=stage)
    for decision, obstacles, pose in run(sequence, rules):
        for obstacle in obstacles:
            if decision.v_ref > 0 and counts(obstacle, rules):
                _, _, left = footprint(obstacle, pose)
                assert abs(left - decision.d_ref) >= obstacle.radius + rules.robot_width / 2 - 1e-9


@given(sequence=pictures, lane_width=numbers(0.15, 0.3), margin=numbers(0.0, 0.05))
def test_the_robots_side_stays_in_the_lane(
    avoidance_settings: AvoidanceSettings, sequence: Any, lane_width: float, margin: float
) -> None:
    rules = replace(avoidance_settings, stage='avoid_single', lane_width=lane_width, margin=margin)
    for decision, _, _ in run(sequence, rules):
        assert abs(decision.d_ref) + rules.robot_width / 2 <= lane_width / 2 + 1e-9


@given(sequence=pictures, stage=stages)
def test_every_decision_is_well_formed(avoidance_settings: AvoidanceSettings, sequence: Any, stage: str) -> None:
    rules = replace(avoidance_settings, stage=stage)
    for decision, obstacles, _ in run(sequence, rules):
        assert math.isfinite(decision.d_ref) and math.isfinite(decision.v_ref) and decision.reason
        assert 0 <= decision.v_ref <= rules.cruise_speed
        assert (decision.v_ref == 0) is (decision.state in (State.STOPPED, State.FAULT))
        assert decision.active is (decision.state is not State.CLEAR)
        if decision.state is State.CLEAR:
            assert decision.d_ref == 0 and not any(counts(obstacle, rules) for obstacle in obstacles)


@given(sequence=pictures)
def test_stage_stop_only_never_leaves_the_middle(avoidance_settings: AvoidanceSettings, sequence: Any) -> None:
    rules = replace(avoidance_settings, stage='stop_only')
    for decision, obstacles, _ in run(sequence, rules):
        assert decision.d_ref == 0 and decision.state in (State.CLEAR, State.STOPPED)
        assert decision.v_ref == 0 or not any(counts(obstacle, rules) for obstacle in obstacles)


@given(sequence=pictures)
def test_more_than_one_obstacle_stops(avoidance_settings: AvoidanceSettings, sequence: Any) -> None:
    for decision, obstacles, _ in run(sequence, avoidance_settings):
        if sum(counts(obstacle, avoidance_settings) for obstacle in obstacles) > 1:
            assert decision.state is State.STOPPED


@given(sequence=pictures)
def test_a_mirrored_scene_gives_the_mirrored_answer(avoidance_settings: AvoidanceSettings, sequence: Any) -> None:
    mirrored = [
        (wait, [replace(one, y=-one.y) for one in obstacles], LanePose(-pose.d, -pose.phi, -pose.curvature))
        for wait, obstacles, pose in sequence
    ]
    for (here, _, _), (there, _, _) in zip(run(sequence, avoidance_settings), run(mirrored, avoidance_settings)):
        assert (there.state, there.v_ref) == (here.state, here.v_ref)
        assert there.d_ref == pytest.approx(-here.d_ref, abs=1e-12)


@given(sequence=pictures, data=st.data())
def test_the_order_of_obstacles_is_irrelevant(avoidance_settings: AvoidanceSettings, sequence: Any, data: Any) -> None:
    shuffled = [(wait, data.draw(st.permutations(obstacles)), pose) for wait, obstacles, pose in sequence]
    for (here, _, _), (there, _, _) in zip(run(sequence, avoidance_settings), run(shuffled, avoidance_settings)):
        assert (there.state, there.d_ref, there.v_ref) == (here.state, here.d_ref, here.v_ref)


@given(sequence=pictures)
def test_a_stop_outlives_its_reason(avoidance_settings: AvoidanceSettings, sequence: Any) -> None:
    since: Optional[float] = None
    for (wait, _, _), (decision, _, _) in zip(sequence, run(sequence, avoidance_settings)):
        since = None if since is None else since + wait * 1e-3
        if since is not None and since < avoidance_settings.stop_hold - 1e-6:
            assert decision.v_ref == 0
        if decision.state is State.STOPPED and not decision.reason.startswith('waiting'):
            since = 0.0


ages = st.integers(-2000, 2000)


@given(
    sequence=pictures,
    obstacles=st.none() | ages,
    lane_pose=st.none() | ages,
    stood=numbers(0.0, 2.0),
    seen=obstacle_lists,
)
def test_doubt_stops_whatever_was_before(
    avoidance_settings: AvoidanceSettings,
    sequence: Any,
    obstacles: Optional[int],
    lane_pose: Optional[int],
    stood: float,
    seen: Any,
) -> None:
    rules, memory, now = avoidance_settings, Memory(), START
    for wait, some, pose in sequence:
        now += wait * MS
        _, memory = decide(Inputs(Stamped(now, tuple(some)), Stamped(now, pose)), memory, now, rules)
    now += 10 * MS
    inputs = Inputs(
        None if obstacles is None else Stamped(now - obstacles * MS, tuple(seen)),
        None if lane_pose is None else Stamped(now - lane_pose * MS, LanePose(0.0, 0.0)),
        stood,
    )
    ahead = rules.future_limit * 1e3
    doubtful = (
        obstacles is None
        or not -ahead <= obstacles <= rules.obstacles_age_limit * 1e3
        or lane_pose is None
        or not -ahead <= lane_pose <= rules.lane_pose_age_limit * 1e3
        or stood > rules.clock_age_limit
    )
    decision, _ = decide(inputs, memory, now, rules)
    assert (decision.state is State.FAULT) is doubtful
    assert decision.v_ref == 0 or not doubtful
