"""What to show of a decision on the picture that it rests on: the robot has driven on since that was taken."""

from dataclasses import replace
from typing import Optional, Sequence

import numpy as np

from obst_avoid.core.age import NANOSECONDS
from obst_avoid.core.avoidance.corridor import View, view_of
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.lane_estimate import motion_of, pulled
from obst_avoid.core.motion import Motion, carried, inverse
from obst_avoid.core.types import Array, Command, Decision, LanePose, Stamped


def view_in_picture(
    decision: Decision, commands: Sequence[Stamped[Command]], decided: int, taken: int, settings: AvoidanceSettings
) -> Optional[View]:
    """The view of a decision from where the robot was when a picture was taken; None: the decision knows no lane.

    commands: the robot's motion, oldest first. decided, taken: [ns] of the decision and of the picture. A decision
    speaks of the moment at which the wheels will obey; what the robot was told takes that back.
    """
    numbers = decision.numbers
    if 'd [m]' not in numbers:
        return None
    pose = LanePose(numbers['d [m]'], numbers['phi [rad]'], numbers['curvature [1/m]'])
    view = view_of(decision, pose, settings)
    then = decided + round(settings.lane_estimate.command_delay * NANOSECONDS)
    told = motion_of(commands, taken, then, settings.lane_estimate)
    return view if told is None else _seen_after(inverse(pulled(told, numbers['pull [rad/m]'])), view)


def _seen_after(motion: Motion, view: View) -> View:
    deciding = view.deciding
    if deciding is not None:
        deciding = (*carried(motion, *deciding[:2]), deciding[2])
    return replace(view, region=_carried(motion, view.region), way=_carried(motion, view.way), deciding=deciding)


def _carried(motion: Motion, points: Array) -> Array:
    return np.array([carried(motion, x, y) for x, y in points.tolist()]).reshape(-1, 2)
