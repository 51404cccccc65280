"""What the detector would make of a moment, without a picture: the truth with the errors that were measured on it.

For drives by the thousand, and for tests of the avoider alone. It is no proof of anything that has to do with seeing.
"""

import math
from dataclasses import replace
from typing import Callable, List, Optional

import numpy as np

from obst_avoid.core.types import LanePose, Obstacle, Scene
from obst_avoid.sim.town import Route, WorldPose, crossing_at, pose_at, robot_from_world
from obst_avoid.sim.world import Place, World, truth

FARTHEST = 1.2
"""[m] at which things are seen."""
ALONG_ERROR, ACROSS_ERROR, RADIUS_ERROR = 0.015, 0.008, 0.08
"""Ratio of the distance, and of the radius: standard deviations of drawn drives (docs/detector.md)."""
LINES = (0.25, 0.6)
"""[m] ahead of the axle between which the lines are seen that a lane pose rests on."""
D_ERROR, PHI_ERROR = 0.003, 0.006
"""[m], [rad] of such a lane pose, beyond that it takes what it sees for a circle."""
SIDE_UNKNOWN = 0.25
"""Share of the pictures in which nothing is said about the side, farther than half a metre away."""


def perceive(world: World, place: Place, in_view: Callable[[float, float], bool]) -> Scene:
    """The obstacles in view, each in its place in truth about, and the lane pose; inside an intersection none."""
    random = place.random
    obstacles: List[Obstacle] = []
    for item in truth(world, place):
        distance = math.hypot(item.x, item.y)
        if item.x <= 0 or distance > FARTHEST or not in_view(item.x, item.y):
            continue
        along, across, wide, known = random.standard_normal(4)
        longer, turned = 1 + ALONG_ERROR * along, ACROSS_ERROR * across
        unsure = item.in_lane and distance > 0.5 and abs(known) < SIDE_UNKNOWN
        obstacles.append(
            replace(
                item,
                x=longer * (item.x - turned * item.y),
                y=longer * (item.y + turned * item.x),
                radius=item.radius * max(0.5, 1 + RADIUS_ERROR * wide),
                in_lane=None if unsure else item.in_lane,
            )
        )
    return Scene(obstacles, _lane_pose(world, place))


def _lane_pose(world: World, place: Place) -> Optional[LanePose]:
    """Where the robot would be if the lane were the circle that fits it best where the lines are seen."""
    route: Route = place.scenario.route
    begin, end = LINES
    places = [pose_at(route, world.along + ahead) for ahead in np.linspace(begin, end, 8)]
    if any(crossing_at(place.scenario.town, spot.x, spot.y) for spot in places[:5]):
        return None
    pose: WorldPose = world.vehicle.pose
    points = robot_from_world(np.array([[spot.x, spot.y] for spot in places]), pose)
    x, y = points.T
    a, b, c = np.linalg.lstsq(np.column_stack([np.ones_like(x), x, (x * x + y * y) / 2]), y, rcond=None)[0].tolist()
    d_noise, phi_noise = place.random.standard_normal(2)
    slope = math.sqrt(max(b * b + 1 - 2 * a * c, 1e-6))
    d = -2 * a / (slope + math.sqrt(slope * slope + 2 * a * c))  # of the circle through the robot's axle
    lane = LanePose(d + D_ERROR * d_noise, -math.atan(b) + PHI_ERROR * phi_noise, c / slope, (1e-4, 0.0, 0.0, 0.01))
    return lane if abs(lane.d) < 0.22 and abs(lane.phi) < 1.0 else None
