"""What to do about the obstacles: drive on, pass inside the lane, or stop, and why (report, section Avoidance)."""

import math
from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple

from obst_avoid.core.age import age, why_stale, why_stopped
from obst_avoid.core.avoidance.region import footprint_centre, in_region
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.geometry import lane_from_robot
from obst_avoid.core.types import Decision, LanePose, Obstacle, Stamped, State

ROUNDING = 1e-9
"""[m] by which a computed gap may miss the margin that it was computed from."""


@dataclass(frozen=True)
class Inputs:
    """The latest of everything that a decision rests on; None: nothing came yet.

    clock_stood: [s] of wall time since ROS time last moved.
    """

    obstacles: Optional[Stamped[Sequence[Obstacle]]] = None
    lane_pose: Optional[Stamped[LanePose]] = None
    clock_stood: float = 0.0


@dataclass(frozen=True)
class Memory:
    """What outlives a picture: when we last had to stop and when we last passed something, each with its decision.

    A stop or a pass is held for a while after its reason was last seen, since near obstacles drop out of the view.
    """

    stopped: Optional[Stamped[Decision]] = None
    avoided: Optional[Stamped[Decision]] = None


def decide(inputs: Inputs, memory: Memory, now: int, settings: AvoidanceSettings) -> Tuple[Decision, Memory]:
    """Decide once. now: ROS time in ns, not earlier than the memory's stamps.

    Whatever is missing, stale or unclear ends in v_ref = 0 with the reason.
    Source: report, figure "Logic of one of the First Stages in Commissioning".
    """
    stopped = _within(memory.stopped, now, settings.stop_hold)
    held = _within(memory.avoided, now, settings.avoid_hold)
    memory = Memory(memory.stopped if stopped else None, memory.avoided if held else None)
    standing = memory if held is None else replace(memory, avoided=Stamped(now, held))  # what is beside us stays there
    fault = _why_blind(inputs, now, settings)
    if fault is not None or inputs.obstacles is None or inputs.lane_pose is None:
        decision = Decision(State.FAULT, 0.0, 0.0, 'stopping: %s' % fault)
        return decision, replace(standing, stopped=Stamped(now, decision))  # a detector that starts anew sees late
    counted = sorted(
        (obstacle for obstacle in inputs.obstacles.value if in_region(obstacle, settings)),
        key=lambda obstacle: math.hypot(obstacle.x, obstacle.y),
    )
    reaction = _react(counted, inputs.lane_pose.value, settings) if counted else None
    if reaction is not None and held is not None:
        reaction = _beside(reaction, held, counted, inputs.lane_pose.value, settings)
    if reaction is not None and reaction.state is State.STOPPED:
        return reaction, replace(standing, stopped=Stamped(now, reaction))
    if stopped is not None and memory.stopped is not None:
        since = age(memory.stopped.stamp, now)
        reason = 'waiting: no reason to stop for %.1f s of %.1f s' % (since, settings.stop_hold)
        return replace(stopped, reason=reason), standing
    if reaction is not None:
        return reaction, replace(memory, avoided=Stamped(now, reaction))
    if held is not None:
        return replace(held, reason='passing: the obstacle is out of sight, keeping %+.3f m' % held.d_ref), memory
    return Decision(State.CLEAR, 0.0, settings.cruise_speed, 'clear: no obstacle in the lane'), memory


def restamped(memory: Memory, now: int) -> Memory:
    """The memory after the clock jumped back: what was held is held from now on. now: ROS time in ns."""

    def again(event: Optional[Stamped[Decision]]) -> Optional[Stamped[Decision]]:
        return None if event is None else Stamped(now, event.value)

    return Memory(again(memory.stopped), again(memory.avoided))


def passing_offset(obstacle: Obstacle, pose: LanePose, settings: AvoidanceSettings) -> Optional[float]:
    """d_ref [m] that passes an obstacle inside the lane, or None when there is not enough room.

    The smaller of the two offsets that leave half a robot and the margin beside the footprint, zero when none is
    needed; the robot's side may reach the lane's edge but not cross it.
    Source: report, figure "Geometry of described Scene", case 1.
    """
    x, y = footprint_centre(obstacle)
    _, centre = lane_from_robot(x, y, pose)
    beside = obstacle.radius + settings.margin + settings.robot_width / 2
    offset = min(max(0.0, centre + beside), -min(0.0, centre - beside))
    if offset > (settings.lane_width - settings.robot_width) / 2:
        return None
    return offset if centre < 0 else -offset


def _react(counted: Sequence[Obstacle], pose: LanePose, settings: AvoidanceSettings) -> Decision:
    if len(counted) > 1:
        return _stop(counted, '')
    if settings.stage == 'stop_only':
        return _stop(counted, 'stage stop_only')
    nearest = counted[0]
    offset = passing_offset(nearest, pose, settings)
    if offset is None:
        return _stop(counted, 'no room to pass in a lane of %.2f m' % settings.lane_width)
    return _avoid(nearest, offset, settings)


def _avoid(obstacle: Obstacle, offset: float, settings: AvoidanceSettings) -> Decision:
    reason = 'avoiding: 1 obstacle in the lane at %.2f m, passing at %+.3f m' % (obstacle.x, offset)
    return Decision(State.AVOIDING, offset, settings.avoid_speed, reason, obstacle)


def _stop(counted: Sequence[Obstacle], why: str) -> Decision:
    count = '1 obstacle' if len(counted) == 1 else '%d obstacles' % len(counted)
    reason = 'stopping: %s in the lane, nearest %.2f m%s' % (count, counted[0].x, why and ', ' + why)
    return Decision(State.STOPPED, 0.0, 0.0, reason, counted[0])


def _why_blind(inputs: Inputs, now: int, settings: AvoidanceSettings) -> Optional[str]:
    doubts: List[Optional[str]] = [
        why_stopped(inputs.clock_stood, settings.clock_age_limit),
        why_stale('obstacle list', inputs.obstacles, now, settings.obstacles_age_limit, settings.future_limit),
        why_stale('lane pose', inputs.lane_pose, now, settings.lane_pose_age_limit, settings.future_limit),
    ]
    return next((reason for reason in doubts if reason is not None), None)


def _beside(
    reaction: Decision,
    held: Decision,
    counted: Sequence[Obstacle],
    pose: LanePose,
    settings: AvoidanceSettings,
) -> Decision:
    """What to do about an obstacle while one is being passed, which may stand beside the robot, out of sight.

    While the robot drives, an obstacle only comes nearer; one that is clearly farther is a second one. That stops the
    robot, and so does one that asks for the other side. Otherwise the larger offset is kept until the hold is over:
    steering back for what is measured now would hit what was measured before.
    """
    if reaction.obstacle is None or held.obstacle is None or reaction.state is State.STOPPED:
        return reaction
    offset = max(reaction.d_ref, held.d_ref, key=abs)
    x, y = footprint_centre(reaction.obstacle)
    room = abs(lane_from_robot(x, y, pose)[1] - offset) - reaction.obstacle.radius - settings.robot_width / 2
    another = reaction.obstacle.x > held.obstacle.x + settings.same_obstacle
    if another or reaction.d_ref * held.d_ref < 0 or room < settings.margin - ROUNDING:
        return _stop(counted, 'while another one is being passed')
    return _avoid(reaction.obstacle, offset, settings)


def _within(event: Optional[Stamped[Decision]], now: int, hold: float) -> Optional[Decision]:
    if event is None or age(event.stamp, now) > hold:
        return None
    return event.value
