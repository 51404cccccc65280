"""What stands in the town: obstacles, and what only looks a little like them."""

import functools
import math
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np
from shapely.geometry import Polygon

from obst_avoid.core.types import Array, Kind
from obst_avoid.sim.meshes import footprint_of
from obst_avoid.sim.town import WorldPose, robot_from_world

KINDS = {'duckie': Kind.DUCKIE, 'cone': Kind.CONE, 'banded_cone': Kind.CONE}
"""What the detector shall find; everything else only confuses it."""


@dataclass(frozen=True)
class Thing:
    """One object. sort: one of meshes.SORTS. x, y: [m] middle of its footprint, world frame. yaw: [rad] it faces.

    height: [m] when it stands upright. lying: tipped over. tint: factors of its colour, linear RGB.
    """

    sort: str
    x: float
    y: float
    yaw: float = 0.0
    height: float = 0.05
    lying: bool = False
    tint: Tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def kind(self) -> Optional[Kind]:
        """None for what is no obstacle to us."""
        return KINDS.get(self.sort)


@dataclass(frozen=True)
class Foot:
    """Where a thing stands, as PoseArray means it: nearest point (x, y) [m] in the robot frame, radius [m]."""

    x: float
    y: float
    radius: float


def outline(thing: Thing) -> Array:
    """(K, 2) convex outline of the thing's vertical projection on the ground, world frame, m."""
    cos, sin = math.cos(thing.yaw), math.sin(thing.yaw)
    points: Array = thing.height * footprint_of(thing.sort, thing.lying) @ np.array([[cos, sin], [-sin, cos]])
    return points + (thing.x, thing.y)


@functools.lru_cache(maxsize=1024)
def footprint(thing: Thing) -> Polygon:
    """The same as a polygon."""
    return Polygon(outline(thing))


def foot(thing: Thing, pose: WorldPose) -> Foot:
    """Where a robot sees the thing stand.

    The point lies on the ray to the footprint's middle, as near as the footprint reaches along it; the radius is half
    the footprint's width across that ray. For a round thing the middle is one radius farther, for others about so.
    """
    points = robot_from_world(outline(thing), pose)
    middle = robot_from_world(np.array([[thing.x, thing.y]]), pose)[0]
    distance = float(np.hypot(*middle))
    ray = middle / max(distance, 1e-9)
    across = points @ np.array([-ray[1], ray[0]])
    radius = float(across.max() - across.min()) / 2
    nearest = float((points @ ray).min())
    return Foot(float(ray[0] * nearest), float(ray[1] * nearest), radius)
