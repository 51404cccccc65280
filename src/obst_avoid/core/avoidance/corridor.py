"""The corridor that the robot needs: as wide as it is with a margin, bent with the lane. Which obstacles reach into it.

It takes the place of the report's bounding box (report, section "Obstacle Avoidance"), which is a rectangle ahead of
the robot and therefore looks beside the lane in a corner.
"""

import enum
import math
from dataclasses import dataclass, replace
from typing import Optional, Sequence, Tuple

import numpy as np

from obst_avoid.core.avoidance.known import Known, error_of, footprint_centre, left_speed
from obst_avoid.core.avoidance.path import path
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.geometry import lane_from_robot, robot_from_lane
from obst_avoid.core.lane_estimate import LaneEstimate
from obst_avoid.core.types import Array, Decision, LanePose

TURNS = {'left': 2.4, 'straight': 0.0, 'right': -5.9}
"""[1/m] curvature of our lane through an intersection: 0.585 m tiles, lane 0.22 m (Duckietown's specification)."""
CONTRADICTION = 3.0
"""Standard deviations between where an obstacle was seen in the lane and where it lies from the robot now, beyond which
the robot has left that lane, at an intersection for example, and the latter counts."""
HALF_WIDTH = 'corridor half width [m]'
"""Its name among a decision's numbers."""
OUTLINE_STEP = 0.03
"""[m] between two points of a drawn corridor."""


class Reach(enum.Enum):
    """Whether an obstacle reaches into the corridor."""

    INSIDE = 'inside'
    UNSURE = 'unsure'
    OUTSIDE = 'outside'


@dataclass(frozen=True)
class Placed:
    """An obstacle in the lane frame, x along the lane from the axle.

    begin, end: [m] along the lane, of its footprint. away: [m] from the axle to the footprint, straight. left: [m] of
    the lane's centre, of its middle. error: [m] standard deviation of left. speed: [m/s] to the left; 0: it stands.
    """

    known: Known
    begin: float
    end: float
    away: float
    left: float
    error: float
    speed: float
    reach: Reach

    @property
    def radius(self) -> float:
        """[m] of the footprint."""
        return self.known.radius


def half_width(omega: float, settings: AvoidanceSettings) -> float:
    """[m] from the corridor's middle to its edge. omega: [rad/s] at which the robot turns; its corners swing out."""
    return settings.robot_width / 2 + settings.margin + settings.yaw_margin * abs(omega)


def place(
    item: Known, lane: LaneEstimate, bends: Sequence[float], omega: float, slack: float, settings: AvoidanceSettings
) -> Placed:
    """An obstacle in the lane, by the bend for which it reaches farthest into the corridor.

    bends: [1/m] the lane's curvature, or those of the ways that the robot may take. slack: [m] by which the corridor is
    wider while something is passed, or the robot stands: hysteresis in place.
    """
    half = half_width(omega, settings) + slack
    found = [_placed(item, lane, replace(lane.pose, curvature=bend), half, len(bends) > 1, settings) for bend in bends]
    worst: Placed = min(found, key=lambda one: (_RANK[one.reach], abs(one.left), one.left))
    return worst


_RANK = {Reach.INSIDE: 0, Reach.UNSURE: 1, Reach.OUTSIDE: 2}


def _placed(
    item: Known, lane: LaneEstimate, pose: LanePose, half: float, forked: bool, settings: AvoidanceSettings
) -> Placed:
    along, left = lane_from_robot(item.x, item.y, pose)
    error = math.hypot(_lane_error(lane, along), error_of(item, settings.known))
    if (
        item.left is not None
        and not forked
        and abs(left - item.left) < CONTRADICTION * math.hypot(error, item.left_error)
    ):
        left, error = item.left, item.left_error
    speed = 0.0 if forked else left_speed(item, settings.known)
    ahead = left + speed * min(
        settings.known.foresight, max(along + settings.robot_behind, 0.0) / settings.cruise_speed
    )
    nearest = 0.0 if left * ahead <= 0 else min(abs(left), abs(ahead))
    beside = nearest - item.radius - half
    within = settings.lane_width / 2 - (nearest - item.radius)
    seen = item.left is not None and within > CONTRADICTION * error  # by the lines of the same pictures
    if item.in_lane is False and not seen and not (speed * left < 0 < within):
        reach = Reach.OUTSIDE
    elif beside < 0:
        reach = Reach.INSIDE
    else:
        reach = Reach.UNSURE if beside < settings.unsure * error else Reach.OUTSIDE
    return Placed(
        item, along - item.radius, along + item.radius, math.hypot(item.x, item.y) - item.radius, left, error, speed,
        reach,
    )  # fmt: skip


def _lane_error(lane: LaneEstimate, along: float) -> float:
    """[m] standard deviation of where the lane's centre is so far ahead."""
    step = np.array([1.0, along, along**2 / 2])
    return math.sqrt(max(float(step @ lane.belief.covariance[:3, :3] @ step), 0.0))


@dataclass(frozen=True, eq=False)
class View:
    """What to show of a decision. region: (N, 2) points around the corridor, closed. way: (N, 2) points of the path
    chosen. Columns x, y in m, robot frame. deciding: (x, y, radius) [m] of the footprint that decides, None without.
    """

    region: Array
    way: Array
    deciding: Optional[Tuple[float, float, float]]


def view_of(decision: Decision, pose: LanePose, settings: AvoidanceSettings) -> View:
    """The corridor as far as obstacles count, and the path in it. pose: of the robot in its lane now."""
    half = decision.numbers.get(HALF_WIDTH, half_width(0.0, settings))
    alongs = np.linspace(0.0, settings.look_ahead, int(settings.look_ahead / OUTLINE_STEP) + 2)
    edges = [(along, half) for along in alongs] + [(along, -half) for along in alongs[::-1]]
    lefts, _ = path(alongs, pose, decision.d_ref, settings.convergence_length)
    deciding = None
    if decision.obstacle is not None:
        x, y = footprint_centre(decision.obstacle)
        deciding = (x, y, decision.obstacle.radius)
    return View(_from_lane([*edges, edges[0]], pose), _from_lane(list(zip(alongs, lefts)), pose), deciding)


def _from_lane(points: Sequence[Tuple[float, float]], pose: LanePose) -> Array:
    return np.array([robot_from_lane(float(along), float(left), pose) for along, left in points])
