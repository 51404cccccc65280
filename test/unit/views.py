"""What a camera must see, worked out by OpenCV's lens model and the pose, to compare rendered pictures with."""

from dataclasses import dataclass
from typing import Any, Callable, Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration
from obst_avoid.sim.meshes import mesh_of
from obst_avoid.sim.things import Thing
from obst_avoid.sim.town import WorldPose
from unit.cameras import Camera, calibration_of

FINE = 8
"""Points a pixel's side is divided into where a shape is filled."""


@dataclass(frozen=True)
class Eye:
    """A calibration, and rays to (N, 3) points of the robot frame by the camera's pose: (N, 3) in the lens's frame."""

    calibration: Calibration
    rays: Callable[[Any], Any]

    @property
    def size(self) -> Tuple[int, int]:
        """(width, height) of the picture."""
        return self.calibration.width, self.calibration.height

    def project(self, points: Any) -> Any:
        """Where OpenCV sees (N, 3) points of the robot frame: (N, 2) columns u, v."""
        camera = self.calibration
        rays = self.rays(points).reshape(-1, 1, 3)
        return cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.camera_matrix, camera.distortion)[0][:, 0]

    def sees(self, points: Any) -> Any:
        """(N,) bool: in the picture, and not where the lens model folds the outside back into it."""
        rays, pixels = self.rays(points), self.project(points)
        radius = np.linspace(0, 3, 3000)
        k1, k2, _, _, k3 = self.calibration.distortion
        bent = radius * (1 + k1 * radius**2 + k2 * radius**4 + k3 * radius**6)
        fold = radius[np.argmax(np.diff(bent) < 0)] if (np.diff(bent) < 0).any() else 3.0
        ahead = (rays[:, 2] > 0.02) & (np.hypot(rays[:, 0], rays[:, 1]) < 0.9 * fold * rays[:, 2])
        return ahead & (pixels > 8).all(axis=1) & (pixels < np.array(self.size) - 9).all(axis=1)


def eye_of_camera(camera: Camera) -> Eye:
    """A made-up camera's."""
    turn = camera.rectification.T @ camera.rotation
    return Eye(calibration_of(camera), lambda points: (np.asarray(points) - camera.position) @ turn.T)


def eye_of_calibration(calibration: Calibration) -> Eye:
    """A calibration's from files: on the ground exactly by its homography, above it by the pose nearest to that."""
    ground = np.array([[x, y, 0.0] for x in np.linspace(0.2, 1.0, 9) for y in np.linspace(-0.4, 0.4, 9)])
    onto = np.linalg.inv(calibration.homography)
    onto = onto * np.sign((onto @ (0.5, 0, 1))[2])
    points = np.column_stack([ground[:, :2], np.ones(len(ground))]) @ onto.T
    _, turn, shift = cv2.solvePnP(ground, points[:, :2] / points[:, 2:], calibration.projection, None)

    def rays(points: Any) -> Any:
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        flat = np.column_stack([points[:, :2], np.ones(len(points))]) @ (np.linalg.inv(calibration.projection) @ onto).T
        solid = points @ cv2.Rodrigues(turn)[0].T + shift.ravel()
        return np.where(points[:, 2:] == 0, flat, solid) @ calibration.rectification

    return Eye(calibration, rays)


def robot_points(points: Any, pose: WorldPose) -> Any:
    """(N, 3) points of the world in the robot frame."""
    offset = np.asarray(points, dtype=np.float64) - (pose.x, pose.y, 0)
    ahead = np.array([np.cos(pose.heading), np.sin(pose.heading), 0])
    left = np.array([-ahead[1], ahead[0], 0])
    return np.column_stack([offset @ ahead, offset @ left, offset[:, 2]])


def corners_of(thing: Thing) -> Any:
    """(N, 3) vertices of a thing in the world, m."""
    points = thing.height * mesh_of(thing.sort, thing.lying).vertices.astype(np.float64)
    cos, sin = np.cos(thing.yaw), np.sin(thing.yaw)
    x, y = cos * points[:, 0] - sin * points[:, 1], sin * points[:, 0] + cos * points[:, 1]
    return np.column_stack([thing.x + x, thing.y + y, points[:, 2]])


def silhouette(eye: Eye, thing: Thing, pose: WorldPose) -> Any:
    """(H, W) bool: pixels whose middle lies within one of the thing's triangles."""
    pixels = eye.project(robot_points(corners_of(thing), pose))
    width, height = eye.size
    mask = np.zeros((height, width), dtype=bool)
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 2, (width, height))
    if (low >= high).any():
        return mask
    fine = np.zeros((high - low)[::-1] * FINE, dtype=np.uint8)
    corners = np.rint(((pixels - low) * FINE + FINE // 2) * 16).astype(np.int32)
    for triangle in mesh_of(thing.sort, thing.lying).triangles:
        cv2.fillConvexPoly(fine, corners[triangle], 1, shift=4)
    mask[low[1] : high[1], low[0] : high[0]] = fine[FINE // 2 :: FINE, FINE // 2 :: FINE] > 0
    return mask


def sampled(picture: Any, pixels: Any) -> Any:
    """(N,) or (N, C) float64 values of a picture at (N, 2) pixels, interpolated."""
    maps = np.asarray(pixels, dtype=np.float32)[None]
    return cv2.remap(picture.astype(np.float32), maps, None, cv2.INTER_LINEAR)[0].astype(np.float64)


def overlap(one: Any, other: Any) -> float:
    """Intersection over union."""
    return float((one & other).sum() / max((one | other).sum(), 1))
