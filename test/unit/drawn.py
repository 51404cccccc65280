"""Drawn scenes: a straight road with flat-coloured duckies and cones, for tests that need no simulator.

World frame: x along the lane, y left, origin on the lane's centre line, z up.
"""

import functools
import math
from dataclasses import dataclass
from typing import Any, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration, camera_from_robot
from obst_avoid.core.geometry import ground_from_pixel, rectified_from_image
from obst_avoid.core.types import Array, Kind, LanePose

ASPHALT, WHITE, YELLOW, RED = (62, 60, 60), (228, 230, 232), (50, 205, 238), (45, 40, 200)
WALL, DUCK, BEAK, CONE, CONE_BASE = (150, 142, 135), (30, 205, 245), (20, 110, 240), (25, 95, 245), (40, 40, 45)
LANE_WIDTH = 0.22
"""[m] between the inner edges of the lines; line widths and dashes by Duckietown's specification."""
WHITE_WIDTH, YELLOW_WIDTH, RED_WIDTH, DASH, GAP = 0.048, 0.025, 0.048, 0.05, 0.025
OVERSAMPLING = 2
NOISE = 3.0
"""[grey levels] standard deviation."""


@dataclass(frozen=True)
class Thing:
    """A duckie or a cone. x, y: [m] middle of its footprint, world frame. height: [m]."""

    kind: Kind
    x: float
    y: float
    height: float = 0.05

    @property
    def radius(self) -> float:
        """[m] of its footprint."""
        return (0.4 if self.kind is Kind.DUCKIE else 0.35) * self.height


@dataclass(frozen=True)
class Scene:
    """What stands on the road. stop_line: [m] x of its near edge, inf for none."""

    things: Tuple[Thing, ...] = ()
    stop_line: float = math.inf


@dataclass(frozen=True)
class RobotPose:
    """The robot in the world. x, y: [m]. heading: [rad] turned left of the lane."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0

    @property
    def lane_pose(self) -> LanePose:
        """The same as the lane filter would say it."""
        return LanePose(self.y, self.heading)


def robot_from_world(x: Any, y: Any, pose: RobotPose) -> Tuple[Any, Any]:
    """Points of the world, x and y in m (numbers or arrays), in the robot frame."""
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    return cos * (x - pose.x) + sin * (y - pose.y), -sin * (x - pose.x) + cos * (y - pose.y)


def draw(scene: Scene, calibration: Calibration, pose: RobotPose, seed: int = 0) -> Array:
    """The picture that the robot's camera takes: (height, width, 3) uint8, BGR, lens distortion included."""
    picture = _road(scene, calibration, pose)
    near_last = sorted(scene.things, key=lambda thing: -float(robot_from_world(thing.x, thing.y, pose)[0]))
    for thing in near_last:
        for color, points in _parts(thing):
            _draw_part(picture, calibration, pose, color, points)
    picture = cv2.resize(picture, (calibration.width, calibration.height), interpolation=cv2.INTER_AREA)
    noise = np.empty(picture.shape, dtype=np.int16)
    cv2.setRNGSeed(seed)
    cv2.randn(noise, (0, 0, 0), (NOISE, NOISE, NOISE))
    noisy: Array = cv2.add(picture, noise, dtype=cv2.CV_8U)
    return noisy


def _road(scene: Scene, calibration: Calibration, pose: RobotPose) -> Array:
    ground, shown = _ground_of_pixels(calibration)
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    x = np.float32(pose.x) + np.float32(cos) * ground[:, 0] - np.float32(sin) * ground[:, 1]
    y = np.float32(pose.y) + np.float32(sin) * ground[:, 0] + np.float32(cos) * ground[:, 1]
    half = LANE_WIDTH / 2
    left_white = half + YELLOW_WIDTH + LANE_WIDTH
    surface = np.zeros(len(x), dtype=np.uint8)
    surface[((y < -half) & (y > -half - WHITE_WIDTH)) | ((y > left_white) & (y < left_white + WHITE_WIDTH))] = 1
    middle = np.flatnonzero((y > half) & (y < half + YELLOW_WIDTH))
    surface[middle[np.mod(x[middle], DASH + GAP) < DASH]] = 2
    if math.isfinite(scene.stop_line):
        surface[(np.abs(y) < half) & (x > scene.stop_line) & (x < scene.stop_line + RED_WIDTH)] = 3
    surfaces = np.full(shown.shape, 4, dtype=np.uint8)
    surfaces[shown] = surface
    picture: Array = np.array([ASPHALT, WHITE, YELLOW, RED, WALL], dtype=np.uint8)[surfaces]
    return picture


@functools.lru_cache(maxsize=1)
def _ground_of_pixels(calibration: Calibration) -> Tuple[Array, Array]:
    """Road points (N, 2) in m, robot frame, of the oversampled pixels that show the road, and which these are."""
    width, height = calibration.width * OVERSAMPLING, calibration.height * OVERSAMPLING
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    pixels = (np.column_stack([u.ravel(), v.ravel()]) + 0.5) / OVERSAMPLING - 0.5
    rectified = rectified_from_image(calibration, pixels)
    depth = np.column_stack([rectified, np.ones(len(rectified))]) @ calibration.homography[2]
    shown = depth > 0
    ground = ground_from_pixel(calibration.homography, rectified[shown]).astype(np.float32)
    return ground, shown.reshape(height, width)


def _parts(thing: Thing) -> Sequence[Tuple[Tuple[int, int, int], Array]]:
    """Convex bodies of a thing, back to front: colour and (N, 3) points in m, world frame."""
    h = thing.height
    at = np.array([thing.x, thing.y, 0])
    if thing.kind is Kind.CONE:
        base = _ellipsoid(at, (0.35 * h, 0.35 * h, 0.02 * h))
        body = np.concatenate([_ellipsoid(at + (0, 0, 0.04 * h), (0.28 * h, 0.28 * h, 0.001)), [at + (0, 0, h)]])
        return [(CONE_BASE, base), (CONE, body)]
    body = _ellipsoid(at + (0, 0, 0.33 * h), (0.4 * h, 0.4 * h, 0.33 * h))
    head = _ellipsoid(at + (0, 0, 0.73 * h), (0.27 * h, 0.27 * h, 0.27 * h))
    beak = _ellipsoid(at + (-0.28 * h, 0, 0.68 * h), (0.1 * h, 0.1 * h, 0.05 * h))
    return [(DUCK, body), (DUCK, head), (BEAK, beak)]


def _ellipsoid(centre: Array, semi_axes: Tuple[float, float, float]) -> Array:
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, 24, endpoint=False), np.linspace(-np.pi / 2, np.pi / 2, 13))
    unit = np.stack([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)], axis=-1).reshape(-1, 3)
    surface: Array = centre + unit * semi_axes
    return surface


def _draw_part(
    picture: Array, calibration: Calibration, pose: RobotPose, color: Tuple[int, int, int], points: Array
) -> None:
    x, y = robot_from_world(points[:, 0], points[:, 1], pose)
    rotation, translation = camera_from_robot(calibration)
    camera = np.column_stack([x, y, points[:, 2]]) @ rotation.T + translation
    if (camera[:, 2] < 0.03).any() or np.abs(camera[:, :2] / camera[:, 2:]).max() > 1.5:
        return  # behind the camera or so far outside the picture that the lens model folds back
    rays = camera @ calibration.rectification  # its inverse from the right
    image, _ = cv2.projectPoints(
        rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), calibration.camera_matrix, calibration.distortion
    )
    hull = cv2.convexHull(((image.reshape(-1, 2) + 0.5) * OVERSAMPLING - 0.5).astype(np.float32))
    cv2.fillConvexPoly(picture, np.rint(hull).astype(np.int32), color)
