"""The region ahead of the robot in which obstacles count: the report's bounding box."""

import math
from typing import Tuple

import numpy as np

from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import Array, Obstacle


def footprint_centre(obstacle: Obstacle) -> Tuple[float, float]:
    """Middle of an obstacle's footprint, (x, y) in m: one radius behind its nearest point, on the same ray."""
    distance = math.hypot(obstacle.x, obstacle.y)
    if distance < 1e-9:  # no direction: straight ahead
        return obstacle.radius, 0.0
    factor = 1 + obstacle.radius / distance
    return obstacle.x * factor, obstacle.y * factor


def in_region(obstacle: Obstacle, settings: AvoidanceSettings) -> bool:
    """True when any part of the footprint lies in the box and the obstacle may stand in our lane."""
    if obstacle.in_lane is False:
        return False
    x, y = footprint_centre(obstacle)
    half = settings.box_width / 2
    nearest_x, nearest_y = min(max(x, 0.0), settings.box_length), min(max(y, -half), half)
    return math.hypot(x - nearest_x, y - nearest_y) <= obstacle.radius


def region_outline(settings: AvoidanceSettings) -> Array:
    """(4, 2) corners of the box, columns x, y in m, robot frame, in order around it."""
    half = settings.box_width / 2
    return np.array([[0, half], [settings.box_length, half], [settings.box_length, -half], [0, -half]])
