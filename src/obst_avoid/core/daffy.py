"""What today's Duckietown lane controller can be told of a d_ref and a v_ref that it does not know.

It can be asked to slow down to a share of its own speed, or to stop, as before a stop line; and it follows whatever
lane pose it hears, so one that is moved by d_ref makes it drive beside the middle. What it cannot do exactly it is told
to do more slowly.
"""

import enum
from dataclasses import dataclass
from typing import Optional, Tuple

from obst_avoid.core.age import why_stale, why_stopped
from obst_avoid.core.lane_control import Reference
from obst_avoid.core.settings import names, number
from obst_avoid.core.types import LanePose, Stamped


@dataclass(frozen=True)
class DaffySettings:
    """config/daffy_adapter_node.yaml has values, units and reasons."""

    full_speed: float = number('m/s', above=0)
    slow_share: float = number('ratio', above=0, below=1)
    speed_tolerance: float = number('m/s', at_least=0)
    offset_tolerance: float = number('m', at_least=0)
    modes: Tuple[str, ...] = names()
    lane_pose_age_limit: float = number('s', above=0)
    reference_age_limit: float = number('s', above=0)
    clock_age_limit: float = number('s', above=0)
    future_limit: float = number('s', at_least=0)


class Pace(enum.Enum):
    """What the controller is asked for: its own speed, a share of it, or to stand."""

    FULL = 'full'
    SLOW = 'slow'
    STAND = 'stand'


@dataclass(frozen=True)
class Asked:
    """pace: for the controller. d_ref: [m] by which the lane pose that it hears is moved. reason: for a person."""

    pace: Pace
    d_ref: float
    reason: str


def acts(switched_on: bool, mode: Optional[str], settings: DaffySettings) -> bool:
    """Whether the robot does now what the avoider is for. mode: of the state machine, None where there is none."""
    return switched_on and (mode is None or mode in settings.modes)


def asked(
    lane_pose: Optional[Stamped[LanePose]],
    reference: Optional[Stamped[Reference]],
    heard: bool,
    clock_stood: float,
    now: int,
    settings: DaffySettings,
) -> Asked:
    """What to ask for now.

    lane_pose: the filter's latest. reference: stamped with its time of arrival. heard: somebody follows the moved lane
    pose. clock_stood: [s] of wall time since ROS time last moved. now: ROS time [ns].
    """
    stale = why_stopped(clock_stood, settings.clock_age_limit)
    stale = stale or why_stale('lane pose', lane_pose, now, settings.lane_pose_age_limit, settings.future_limit)
    stale = stale or why_stale('lane control', reference, now, settings.reference_age_limit, settings.future_limit)
    if stale is not None or reference is None:
        return Asked(Pace.STAND, 0.0, 'stopping: %s' % stale)
    wanted = reference.value
    if not wanted.active:
        return Asked(Pace.FULL, 0.0, 'at its own speed')
    if abs(wanted.d_ref) > settings.offset_tolerance and not heard:
        return Asked(Pace.STAND, 0.0, 'stopping: nobody follows the moved lane pose, expected the lane controller')
    pace = pace_of(wanted.v_ref, settings)
    return Asked(pace, wanted.d_ref, '%s, d_ref %+.3f m for %.2f m/s' % (pace.value, wanted.d_ref, wanted.v_ref))


def pace_of(speed: float, settings: DaffySettings) -> Pace:
    """The fastest that is not faster than speed [m/s]."""
    if speed >= settings.full_speed - settings.speed_tolerance:
        return Pace.FULL
    slow = settings.full_speed * settings.slow_share
    return Pace.SLOW if speed >= slow - settings.speed_tolerance else Pace.STAND
