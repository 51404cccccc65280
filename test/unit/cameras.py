"""Made-up cameras. Their homographies and projections are derived here from the pose, not by the code under test."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Dict, Optional, Tuple

import cv2
import numpy as np
import yaml

from obst_avoid.core.calibration import Calibration, load_calibration

ROBOT = 'duck1'


@dataclass(frozen=True)
class Camera:
    """A camera on a robot; the default is close to the package's own.

    ahead, left, height: [m] place of the camera in the robot frame. pitch: [deg] looks down. roll: [deg] turns the
    horizon clockwise as the camera sees it. yaw: [deg] looks left. focal: [px] of the picture. projection: [px]
    fx and fy of the rectified picture. twist: [deg] by which the rectification turns the picture clockwise.
    """

    width: int = 640
    picture_height: int = 480
    focal: float = 320.0
    distortion: Tuple[float, ...] = (-0.26, 0.045, 0.0, 0.0, 0.0)
    projection: Tuple[float, float] = (212.9, 259.1)
    ahead: float = 0.066
    left: float = 0.0
    height: float = 0.108
    pitch: float = 21.0
    roll: float = 0.0
    yaw: float = 0.0
    twist: float = 0.0

    def resized(self, width: int, picture_height: int) -> 'Camera':
        """The same camera with a picture of another size."""
        factor = width / self.width
        fx, fy = self.projection
        return replace(
            self,
            width=width,
            picture_height=picture_height,
            focal=self.focal * factor,
            projection=(fx * factor, fy * picture_height / self.picture_height),
        )

    @property
    def middle(self) -> Tuple[float, float]:
        """[px] of the picture; pixel centres are whole numbers."""
        return (self.width - 1) / 2, (self.picture_height - 1) / 2

    @property
    def k(self) -> np.ndarray:
        """(3, 3) camera matrix of the picture as it comes."""
        return np.array([[self.focal, 0, self.middle[0]], [0, self.focal, self.middle[1]], [0, 0, 1]])

    @property
    def p(self) -> np.ndarray:
        """(3, 3) camera matrix of the rectified picture."""
        fx, fy = self.projection
        return np.array([[fx, 0, self.middle[0]], [0, fy, self.middle[1]], [0, 0, 1]])

    @property
    def rectification(self) -> np.ndarray:
        """(3, 3) from the lens's frame to the rectified camera's."""
        return _turned_clockwise(self.twist)

    @property
    def position(self) -> np.ndarray:
        """(3,) [m] in the robot frame."""
        return np.array([self.ahead, self.left, self.height])

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) from the robot frame to the rectified camera's: z forward, x right, y down."""
        pitch, yaw = math.radians(self.pitch), math.radians(self.yaw)
        forward = np.array([math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch)])
        right = np.array([math.sin(yaw), -math.cos(yaw), 0])
        return _turned_clockwise(self.roll) @ np.stack([right, np.cross(forward, right), forward])

    @property
    def homography(self) -> np.ndarray:
        """(3, 3) from a rectified pixel (u, v, 1) to the road in m, robot frame, with 1 in its corner."""
        rotation = self.rotation
        onto = self.p @ np.column_stack([rotation[:, 0], rotation[:, 1], -rotation @ self.position])
        homography = np.linalg.inv(onto)
        return homography / homography[2, 2]

    def image_from_robot(self, points: Any) -> np.ndarray:
        """Where points of the robot frame, (N, 3) in m, lie in the picture as it comes. (N, 2) columns u, v."""
        rotation = self.rectification.T @ self.rotation
        turn, _ = cv2.Rodrigues(rotation)
        pixels, _ = cv2.projectPoints(
            np.asarray(points, dtype=np.float64).reshape(-1, 1, 3),
            turn,
            -rotation @ self.position,
            self.k,
            np.array(self.distortion),
        )
        return pixels.reshape(-1, 2)

    def rectified_from_robot(self, points: Any) -> np.ndarray:
        """Where points of the robot frame, (N, 3) in m, lie in the rectified picture. (N, 2) columns u, v."""
        rays = (np.asarray(points, dtype=np.float64) - self.position) @ self.rotation.T
        pixels = rays @ self.p.T
        return pixels[:, :2] / pixels[:, 2:]


def intrinsic_file(camera: Camera) -> Dict[str, Any]:
    """The content of a camera's intrinsic file."""
    return {
        'image_width': camera.width,
        'image_height': camera.picture_height,
        'camera_name': ROBOT,
        'camera_matrix': _matrix(camera.k),
        'distortion_model': 'plumb_bob',
        'distortion_coefficients': _matrix(np.array([camera.distortion])),
        'rectification_matrix': _matrix(camera.rectification),
        'projection_matrix': _matrix(np.column_stack([camera.p, np.zeros(3)])),
    }


def extrinsic_file(camera: Camera, form: str = 'flat') -> Dict[str, Any]:
    """The content of a camera's extrinsic file: flat or nested pixels of 640x480, or resolution-independent."""
    if form == 'resolution-independent':
        return {'format': form, 'homography': (camera.homography @ camera.p).ravel().tolist()}
    of_640 = camera.resized(640, 480).homography
    return {'homography': of_640.ravel().tolist() if form == 'flat' else of_640.tolist()}


def write_files(folder: Path, intrinsic: Any, extrinsic: Any, name: str = ROBOT) -> None:
    """Lay the two files as Duckietown does. Text is written as it is, anything else as YAML."""
    for kind, content in (('camera_intrinsic', intrinsic), ('camera_extrinsic', extrinsic)):
        path = folder / kind / (name + '.yaml')
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))


def load_camera(
    folder: Path,
    camera: Camera,
    form: str = 'flat',
    intrinsic: Optional[Dict[str, Any]] = None,
    extrinsic: Optional[Dict[str, Any]] = None,
) -> Calibration:
    """Write a camera's files, with some fields changed, and load them by the code under test."""
    write_files(
        folder,
        dict(intrinsic_file(camera), **(intrinsic or {})),
        dict(extrinsic_file(camera, form), **(extrinsic or {})),
    )
    return load_calibration(str(folder), ROBOT)


def calibration_of(camera: Camera) -> Calibration:
    """A camera's calibration without files, for tests of the later stages."""
    homography = camera.homography
    sign = np.sign((homography @ (camera.middle[0], camera.picture_height - 1, 1))[2])
    return Calibration(
        vehicle=ROBOT,
        width=camera.width,
        height=camera.picture_height,
        camera_matrix=camera.k,
        distortion=np.array(camera.distortion),
        rectification=camera.rectification,
        projection=camera.p,
        homography=homography * sign,
        source='camera_extrinsic/%s.yaml' % ROBOT,
    )


def _turned_clockwise(degrees: float) -> np.ndarray:
    """(3, 3) that turns what a camera sees, x right and y down, clockwise about its axis."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def _matrix(matrix: np.ndarray) -> Dict[str, Any]:
    return {'rows': matrix.shape[0], 'cols': matrix.shape[1], 'data': matrix.ravel().tolist()}
