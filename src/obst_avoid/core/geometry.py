"""Points between camera picture, rectified picture, road and lane. A function names its result first."""

import math
from typing import Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.matrices import inverted
from obst_avoid.core.types import Array, LanePose

STRAIGHT = 1e-6
"""[1/m] of curvature below which a lane is straight."""


def ground_from_pixel(homography: Array, pixels: Array) -> Array:
    """Project rectified pixels onto the road plane (inverse perspective mapping).

    homography: (3, 3) as in Calibration. pixels: (N, 2) float64, columns u, v.
    Returns (N, 2) float64, columns x, y in m, robot frame. Raises ValueError for a pixel on or above the horizon.
    Source: report, section "Inverse Perspective Mapping".
    """
    points = np.column_stack([pixels, np.ones(len(pixels))]) @ homography.T
    if (points[:, 2] <= 0).any():
        raise ValueError('%d of %d pixels lie on or above the horizon' % ((points[:, 2] <= 0).sum(), len(points)))
    ground: Array = points[:, :2] / points[:, 2:]
    return ground


def pixel_from_ground(homography: Array, ground: Array) -> Array:
    """Where points of the road appear in the rectified picture.

    homography: (3, 3) as in Calibration. ground: (N, 2) float64, columns x, y in m, robot frame.
    Returns (N, 2) float64, columns u, v. Raises ValueError for a point that lies behind the camera.
    """
    points = np.column_stack([ground, np.ones(len(ground))]) @ inverted(homography).T
    if (points[:, 2] <= 0).any():
        raise ValueError('%d of %d points lie behind the camera' % ((points[:, 2] <= 0).sum(), len(points)))
    pixels: Array = points[:, :2] / points[:, 2:]
    return pixels


def image_from_rectified(calibration: Calibration, pixels: Array) -> Array:
    """Where rectified pixels lie in the camera picture as it came, lens distortion included.

    pixels: (N, 2) float64, columns u, v. Returns (N, 2) float64, columns u, v; possibly outside the picture.
    """
    rays = np.column_stack([pixels, np.ones(len(pixels))])
    rays = rays @ inverted(calibration.projection @ calibration.rectification).T
    image, _ = cv2.projectPoints(
        rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), calibration.camera_matrix, calibration.distortion
    )
    points: Array = image.reshape(-1, 2)
    return points


def rectified_from_image(calibration: Calibration, pixels: Array) -> Array:
    """Where pixels of the camera picture lie in the rectified picture. (N, 2) float64 to (N, 2) float64."""
    points = cv2.undistortPointsIter(  # its sibling without Iter stops after 5 steps, 11 px off in the corners
        np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2),
        calibration.camera_matrix,
        calibration.distortion,
        calibration.rectification,
        calibration.projection,
        (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-6),
    )
    rectified: Array = points.reshape(-1, 2)
    return rectified


def lane_from_robot(x: float, y: float, pose: LanePose) -> Tuple[float, float]:
    """A point of the robot frame in the lane frame: (along the lane, left of its centre) in m.

    The lane bends with pose.curvature everywhere: its centre is a circle, or a straight.
    """
    cos, sin = math.cos(pose.phi), math.sin(pose.phi)
    ahead, left = cos * x - sin * y, sin * x + cos * y + pose.d
    if abs(pose.curvature) < STRAIGHT:
        return ahead, left
    radius = 1 / pose.curvature
    side = math.copysign(1.0, radius)
    along = abs(radius) * math.atan2(ahead, side * (radius - left))
    return along, radius - side * math.hypot(ahead, radius - left)


def robot_from_lane(along: float, left: float, pose: LanePose) -> Tuple[float, float]:
    """The inverse of lane_from_robot, for points nearer to the lane's centre than the middle of its bend."""
    if abs(pose.curvature) >= STRAIGHT:
        radius = 1 / pose.curvature
        turned = along * pose.curvature
        along, left = (radius - left) * math.sin(turned), radius - (radius - left) * math.cos(turned)
    cos, sin = math.cos(pose.phi), math.sin(pose.phi)
    return cos * along + sin * (left - pose.d), -sin * along + cos * (left - pose.d)
