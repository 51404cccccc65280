"""What a picture shows, known exactly: the other half of every picture that the simulation takes."""

import functools
import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np
from shapely.geometry import Polygon

from obst_avoid.core.types import Array, Box, Kind, LanePose, Obstacle
from obst_avoid.sim.renderer import Renderer, Scene
from obst_avoid.sim.things import Thing, foot, footprint
from obst_avoid.sim.town import Route, Town, WorldPose, crossing_at, lane_strip, locate

BEHIND, AHEAD, STRIP_STEP = 0.3, 3.0, 0.5
"""[m] along the lane for which an obstacle can be in it, at least, and in steps of which it is looked at."""


@dataclass(frozen=True, eq=False)
class SeenObstacle:
    """One obstacle in one picture.

    x, y, radius: [m] as in PoseArray, robot frame. in_lane: False when the whole footprint lies beyond the lines of our
    lane; None farther away than AHEAD, and inside an intersection beside our way, where no line says so.
    mask: (H, W) bool, its visible pixels. box: around them, None when none is seen.
    """

    kind: Kind
    x: float
    y: float
    radius: float
    in_lane: Optional[bool]
    mask: Array
    box: Optional[Box]


@dataclass(frozen=True)
class Truth:
    """What one picture shows. obstacles: all of the scene, in its order, seen or not. lane_pose: with curvature."""

    obstacles: Tuple[SeenObstacle, ...]
    lane_pose: LanePose


def obstacles_of(things: Sequence[Thing], town: Town, route: Route, along: float, pose: WorldPose) -> List[Obstacle]:
    """The obstacles among things, as a perfect detector would report them.

    along: [m] on the route where the robot is. pose: of the robot.
    """
    strip = _strip(route, int(along // STRIP_STEP))
    found = []
    for thing in things:
        if thing.kind is None:
            continue
        inside = footprint(thing).intersects(strip)
        at = foot(thing, pose)
        unknown = math.hypot(at.x, at.y) > AHEAD or crossing_at(town, thing.x, thing.y)
        in_lane = True if inside else None if unknown else False
        found.append(Obstacle(thing.kind, at.x, at.y, at.radius, in_lane))
    return found


@functools.lru_cache(maxsize=64)
def _strip(route: Route, index: int) -> Polygon:
    """Our lane about the index-th STRIP_STEP of the route."""
    return lane_strip(route, index * STRIP_STEP - BEHIND, (index + 1) * STRIP_STEP + AHEAD)


def truth_of(renderer: Renderer, scene: Scene, route: Route, near: float, pose: WorldPose) -> Truth:
    """What a sharp picture from a pose shows. near: [m] about where on the route the robot is."""
    along, lane_pose = locate(route, pose, near)
    names = renderer.names(scene, pose)
    indices = [index for index, thing in enumerate(scene.things) if thing.kind is not None]
    obstacles = obstacles_of(scene.things, scene.town, route, along, pose)
    seen = []
    for index, obstacle in zip(indices, obstacles):
        mask = names == index + 1
        assert obstacle.kind is not None
        seen.append(
            SeenObstacle(obstacle.kind, obstacle.x, obstacle.y, obstacle.radius, obstacle.in_lane, mask, box_of(mask))
        )
    return Truth(tuple(seen), lane_pose)


def box_of(mask: Array) -> Optional[Box]:
    """Box around the True pixels of a (H, W) mask; None without any."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    return Box(float(columns[0]), float(rows[0]), float(columns[-1] + 1), float(rows[-1] + 1))
