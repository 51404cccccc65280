"""A small lane follower that tracks d_ref and v_ref, for stacks whose own controller does not."""

import math
from dataclasses import dataclass
from typing import Optional, Tuple

from obst_avoid.core.age import why_stale, why_stopped
from obst_avoid.core.lane_estimate import LaneEstimateSettings
from obst_avoid.core.settings import group, number
from obst_avoid.core.types import Command, Decision, LanePose, Stamped, State


@dataclass(frozen=True)
class LaneControlSettings:
    """config/lane_controller_node.yaml and config/lane_estimate.yaml have values, units and reasons."""

    cruise_speed: float = number('m/s', above=0)
    largest_speed: float = number('m/s', above=0)
    convergence_length: float = number('m', above=0)
    learning_length: float = number('m', above=0)
    learning_offset: float = number('m', at_least=0)
    largest_learned: float = number('1/m', at_least=0)
    damping: float = number('ratio', above=0)
    largest_omega: float = number('rad/s', above=0)
    lane_pose_age_limit: float = number('s', above=0)
    reference_age_limit: float = number('s', above=0)
    clock_age_limit: float = number('s', above=0)
    future_limit: float = number('s', at_least=0)
    lane_estimate: LaneEstimateSettings = group(LaneEstimateSettings)


@dataclass(frozen=True)
class Reference:
    """What the avoider asks for. d_ref: [m]. v_ref: [m/s]. Both count only when active."""

    active: bool
    d_ref: float
    v_ref: float


def reference_from_decision(decision: Decision) -> Reference:
    """What of a decision the controller tracks; in STOPPED and FAULT it stands, whatever v_ref says."""
    stands = decision.state in (State.STOPPED, State.FAULT)
    return Reference(decision.active, decision.d_ref, 0.0 if stands else decision.v_ref)


def control(
    lane_pose: Optional[Stamped[LanePose]],
    reference: Optional[Stamped[Reference]],
    clock_stood: float,
    now: int,
    settings: LaneControlSettings,
    learned: float = 0.0,
) -> Tuple[Command, str]:
    """One command, and why if it is a stop.

    lane_pose: where the robot will be when the wheels obey, see lane_estimate.believed.
    learned: [1/m] the bend that keeps the robot where it shall be, see learning.
    reference: stamped with its time of arrival. clock_stood: [s] of wall time since ROS time last moved.
    now: ROS time in ns.
    The offset from d_ref shrinks like a damped oscillator over the metres driven, whatever the speed:
    e'' = -e / L^2 - 2 damping e' / L with L = convergence_length, from which omega follows by e' = sin(phi).
    A missing or stale input stops the robot.
    """
    stale = why_stopped(clock_stood, settings.clock_age_limit)
    stale = stale or why_stale('lane pose', lane_pose, now, settings.lane_pose_age_limit, settings.future_limit)
    stale = stale or why_stale('lane control', reference, now, settings.reference_age_limit, settings.future_limit)
    if stale is not None or lane_pose is None or reference is None:
        return Command(0.0, 0.0), 'stopping: %s' % stale
    pose, wanted = lane_pose.value, reference.value
    d_ref, speed = (wanted.d_ref, wanted.v_ref) if wanted.active else (0.0, settings.cruise_speed)
    speed = min(speed, settings.largest_speed)
    if speed <= 0:
        return Command(0.0, 0.0), 'stopping: asked to by the avoider'
    length = settings.convergence_length
    bend = pose.curvature + learned - (pose.d - d_ref) / length**2 - 2 * settings.damping * math.sin(pose.phi) / length
    omega = max(-settings.largest_omega, min(settings.largest_omega, speed * bend))
    return Command(speed, omega), 'tracking d_ref %+.3f m at %.2f m/s' % (d_ref, speed)


def learning(
    learned: float,
    lane_pose: Optional[Stamped[LanePose]],
    reference: Optional[Stamped[Reference]],
    metres: float,
    settings: LaneControlSettings,
) -> float:
    """[1/m] the bend that the robot needs beyond the lane's, after so many metres more: the integral of its offset.

    It makes up for wheels that pull, and for a heading that is wrong all the time, by a camera that looks aside for
    example. Only small offsets teach: a greater one is a new d_ref, or a curve that begins.
    """
    if lane_pose is None or reference is None:
        return 0.0
    offset = lane_pose.value.d - (reference.value.d_ref if reference.value.active else 0.0)
    if abs(offset) > settings.learning_offset:
        return learned
    more = -offset / settings.convergence_length**2 * metres / settings.learning_length
    return max(-settings.largest_learned, min(settings.largest_learned, learned + more))
