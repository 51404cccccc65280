"""A calibration laid out for rendering: what each pixel of the picture looks at."""

import math
from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.geometry import image_from_rectified
from obst_avoid.core.matrices import inverted, solved
from obst_avoid.core.types import Array

FARTHEST = 30.0
"""[m] at which the road is taken to be below the horizon still."""
STEEPEST = 0.74
"""[rad] of elevation up to which the room is looked at; room.py shows a little more."""
MOST_TAPS = 4
ITERATIONS = 20


@dataclass(frozen=True, eq=False)
class Lens:
    """What the lens does.

    ground: (H, W, 2) float32, x and y [m] in the robot frame of the road at each pixel, 0 where it shows the room.
    room: (H, W, 2) float32, azimuth and elevation [rad] in the robot frame. on_ground, blind: (H, W) bool; blind is
    what no ray reaches.
    bands: (first row, end row, taps): how often each row of the road is sampled from near to far, since a pixel shows
    a long and narrow piece of it. projection: (3, 4) from the robot frame (x, y, z, 1) to rays of the rectified
    camera. eye: (3,) [m] of the camera, robot frame. fold: squared radius beyond which the lens model is not used.
    """

    calibration: Calibration
    ground: Array
    room: Array
    on_ground: Array
    blind: Array
    bands: Tuple[Tuple[int, int, int], ...]
    projection: Array
    eye: Array
    fold: float

    def pixels_from_ground(self, ground: Array) -> Array:
        """(N, 2) of the robot frame, m, ahead of the camera, to (N, 2) of the picture."""
        points = np.column_stack([ground, np.ones(len(ground))]) @ inverted(self.calibration.homography).T
        return image_from_rectified(self.calibration, points[:, :2] / np.maximum(points[:, 2:], 1e-6))


def lay_out(calibration: Calibration) -> Lens:
    """Follow each pixel's ray. The ground is where the homography says, so that the road is seen exactly there."""
    width, height = calibration.width, calibration.height
    projection = _projection(calibration)
    eye = -solved(projection[:, :3], projection[:, 3])
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rectified = _rectified(calibration, pixels)
    seen = np.isfinite(rectified).all(axis=1)
    rectified = np.nan_to_num(rectified)
    seen &= np.abs(image_from_rectified(calibration, rectified) - pixels).max(axis=1) < 0.05
    homogeneous = np.column_stack([rectified, np.ones(len(rectified))])
    points = homogeneous @ calibration.homography.T
    on_ground = seen & (points[:, 2] > 1e-9)
    ground = points[:, :2] / np.where(on_ground, points[:, 2], 1.0)[:, None]
    on_ground &= np.hypot(ground[:, 0], ground[:, 1]) < FARTHEST
    ground[~on_ground] = 0
    rays = homogeneous @ inverted(calibration.projection).T @ inverted(projection[:, :3]).T
    room = np.column_stack(
        [
            np.arctan2(rays[:, 1], rays[:, 0]),
            np.clip(np.arctan2(rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])), -STEEPEST, STEEPEST),
        ]
    )
    shape = (height, width)
    ground = ground.reshape(height, width, 2)
    return Lens(
        calibration,
        ground.astype(np.float32),
        room.astype(np.float32).reshape(height, width, 2),
        on_ground.reshape(shape),
        ~seen.reshape(shape),
        tuple(_bands(ground, on_ground.reshape(shape))),
        projection,
        eye,
        _fold(calibration),
    )


def _rectified(calibration: Calibration, pixels: Array) -> Array:
    """Where pixels of the picture lie in the rectified one, (N, 2) to (N, 2); beyond the lens's fold: somewhere.

    Near the fold OpenCV's own iteration does not converge. Here the radial part is inverted by a table and only the
    small tangential part by iteration.
    """
    k1, k2, p1, p2, k3 = calibration.distortion
    radius = np.linspace(0, math.sqrt(_fold(calibration)), 20001)
    squared = radius**2
    bent = radius * (1 + squared * (k1 + squared * (k2 + squared * k3)))
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ inverted(calibration.camera_matrix).T
    goal, shift = rays[:, :2], np.zeros((len(pixels), 2))
    for _ in range(ITERATIONS):
        radial = goal - shift
        length = np.hypot(radial[:, 0], radial[:, 1])
        point = radial * (np.interp(length, bent, radius) / np.maximum(length, 1e-12))[:, None]
        x, y = point.T
        r2 = x * x + y * y
        shift = np.column_stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y])
    rectified = np.column_stack([point, np.ones(len(point))])
    rectified = rectified @ (calibration.projection @ calibration.rectification).T
    flat: Array = rectified[:, :2] / rectified[:, 2:]
    return flat


def _projection(calibration: Calibration) -> Array:
    """(3, 4). On the ground it is the homography's inverse, exactly; upwards it follows the cross product of its axes.

    A measured homography has axes that are not quite at right angles; camera_from_robot would mend that, and things
    would stand a little beside the paint.
    """
    columns = inverted(calibration.projection) @ inverted(calibration.homography)
    columns = columns / (0.5 * (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1])))
    ahead = calibration.homography @ (calibration.width / 2, calibration.height - 1, 1)
    if (columns @ (ahead / ahead[2]))[2] < 0:
        columns = -columns
    up = np.cross(columns[:, 0], columns[:, 1])
    return np.column_stack([columns[:, 0], columns[:, 1], up / np.linalg.norm(up), columns[:, 2]])


def _fold(calibration: Calibration) -> float:
    """Largest squared radius up to which the lens model is one to one and its picture grows, at most 9."""
    squared = np.linspace(0, 9, 3001)
    k1, k2, k3 = calibration.distortion[[0, 1, 4]]
    radius = np.sqrt(squared) * (1 + squared * (k1 + squared * (k2 + squared * k3)))
    falling = np.flatnonzero(np.diff(radius) <= 0)
    return float(squared[falling[0]]) if len(falling) else 9.0


def _bands(ground: Array, on_ground: Array) -> List[Tuple[int, int, int]]:
    """Rows of equal sampling: as many taps down a pixel as it is longer than wide on the road, a power of two."""
    step = np.linalg.norm(np.diff(ground, axis=0, append=ground[-1:]), axis=2)
    across = np.linalg.norm(np.diff(ground, axis=1, append=ground[:, -1:]), axis=2)
    whole = on_ground & np.roll(on_ground, -1, axis=0)
    taps = []
    for row in range(len(ground)):
        kept = whole[row] & (across[row] > 1e-6)
        ratio = np.median(step[row][kept] / across[row][kept]) if kept.any() else 1.0
        taps.append(min(MOST_TAPS, 2 ** max(0, math.ceil(math.log2(max(float(ratio), 1.0) / 2)))))
    rows = np.flatnonzero(on_ground.any(axis=1))
    if not len(rows):
        return []
    bands: List[Tuple[int, int, int]] = []
    for row in range(int(rows[0]), len(ground)):
        if bands and bands[-1][2] == taps[row]:
            bands[-1] = (bands[-1][0], row + 1, taps[row])
        else:
            bands.append((row, row + 1, taps[row]))
    return bands
