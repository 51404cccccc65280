"""Where in the lane the robot can pass, and how fast it may drive towards what it cannot pass. Pure geometry."""

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence

import numpy as np

from obst_avoid.core.avoidance.corridor import Placed
from obst_avoid.core.avoidance.path import path
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import LanePose

OFFSETS = 41
"""Lateral offsets that are tried, over the room that the lane has: less than 2 mm apart."""
PATH_STEP = 0.02
"""[m] between two places on a path that are looked at."""
YELLOW_WIDTH = 0.025
"""[m] of the line between the lanes (Duckietown's specification)."""


@dataclass(frozen=True)
class Pass:
    """A way past obstacles. d_ref: [m]. clearance: [m] that is left beside the footprints, at least."""

    d_ref: float
    clearance: float


def groups_of(stations: Sequence[Placed], settings: AvoidanceSettings) -> List[List[Placed]]:
    """Obstacles in the order of the lane, in groups between which the robot has the room to change its offset."""
    groups: List[List[Placed]] = []
    end = -math.inf
    for item in sorted(stations, key=lambda one: one.begin):
        if item.begin - end > settings.switch_distance:
            groups.append([])
        groups[-1].append(item)
        end = max(end, item.end)
    return groups


def passing(
    group: Sequence[Placed], held: Optional[float], pose: LanePose, settings: AvoidanceSettings
) -> Optional[Pass]:
    """The offset that passes all obstacles of a group inside the lane; None when there is none, or the robot cannot
    get there in time.

    The smallest offset with the wanted margin, and the error of each place beside it, else the one with the greatest;
    the robot's side may reach the lane's edge but not cross it. held: [m] the offset that was chosen before; its side
    is kept, and it does not shrink, since what is beside the robot is not seen any more. pose: of the robot when the
    wheels obey.
    Source: report, figure "Geometry of described Scene", case 1; the free intervals take the place of its formula.
    """
    room = (settings.lane_width - settings.robot_width) / 2
    if room < 0:
        return None
    offsets = np.linspace(-room, room, OFFSETS)
    beside = np.array([np.abs(item.left - offsets) - item.radius - settings.robot_width / 2 for item in group])
    clearances, sure = beside.min(axis=0), (beside - np.array([[item.error] for item in group])).min(axis=0)
    least = settings.margin
    if held is not None:
        least = settings.least_margin
        clearances[(offsets * held < 0) | (np.abs(offsets) < abs(held) - (offsets[1] - offsets[0]) / 2)] = -math.inf
    wide = np.flatnonzero((sure >= settings.wanted_margin) & np.isfinite(clearances))
    if len(wide):
        best = int(wide[np.abs(offsets[wide]).argmin()])
    else:
        best = max(range(OFFSETS), key=lambda index: (clearances[index], -abs(offsets[index])))
    found = Pass(float(offsets[best]), float(clearances[best]))
    return found if found.clearance >= least and reached(group, pose, found.d_ref, settings) else None


def passing_beyond(everything: Sequence[Placed], pose: LanePose, settings: AvoidanceSettings) -> Optional[Pass]:
    """The way through the opposite lane, along its middle; None when anything known stands there.

    everything: also what stands outside our lane.
    """
    d_ref = settings.lane_width + YELLOW_WIDTH
    clearances = [abs(item.left - d_ref) - item.radius - settings.robot_width / 2 for item in everything]
    if any(item.speed for item in everything) or min(clearances) < settings.wanted_margin:
        return None
    return Pass(d_ref, min(clearances)) if reached(everything, pose, d_ref, settings) else None


def clearance_on_path(
    item: Placed, pose: LanePose, d_ref: float, farthest: float, settings: AvoidanceSettings
) -> float:
    """[m] least distance between the robot's side and a footprint on the way from pose to d_ref, negative when it is
    touched; inf when the way ends, `farthest` m ahead of where the robot is, before it comes beside the obstacle.
    """
    begin, end = max(item.begin - settings.robot_ahead, 0.0), min(item.end + settings.robot_behind, farthest)
    if end < begin:
        return math.inf
    alongs = np.linspace(begin, end, max(2, int((end - begin) / PATH_STEP)))
    lefts, slopes = path(alongs, pose, d_ref, settings.convergence_length)
    half = settings.robot_width / 2 + np.abs(slopes) * max(settings.robot_ahead, settings.robot_behind) / 2
    return float((np.abs(item.left - lefts) - half).min()) - item.radius


def reached(group: Sequence[Placed], pose: LanePose, d_ref: float, settings: AvoidanceSettings) -> bool:
    """Whether the way to an offset keeps clear of all that it passes."""
    return all(clearance_on_path(item, pose, d_ref, math.inf, settings) >= settings.least_margin for item in group)


def braking_speed(gap: float, settings: AvoidanceSettings) -> float:
    """[m/s] at most, with so many m left until where the robot shall stand."""
    return math.sqrt(2 * settings.deceleration * max(gap, 0.0))


def braking_distance(speed: float, settings: AvoidanceSettings) -> float:
    """[m] that the robot still drives when it decides to stop: v delay + v^2 / 2a."""
    return speed * settings.delay + speed**2 / (2 * settings.deceleration)
