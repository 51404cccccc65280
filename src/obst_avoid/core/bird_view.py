"""The report's bird view: the road seen from above, in metres, 640 pixels wide.

Boxes on the wire are in its pixels, in every profile, so detector and visualizer build it from the same settings.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration, CalibrationError, horizon_row
from obst_avoid.core.geometry import ground_from_pixel, image_from_rectified
from obst_avoid.core.matrices import inverted
from obst_avoid.core.settings import number
from obst_avoid.core.types import Array, Box

WIDTH = 640
"""[px] of the bird view, whatever the picture's size; part of the PoseArray's contract."""


@dataclass(frozen=True)
class BirdViewSettings:
    """config/bird_view.yaml has units and reasons."""

    crop_distance: float = number('m', above=0.3, at_most=10)
    horizon_margin: float = number('fraction of the picture height', above=0, below=0.5)


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class BirdView:
    """What is fixed while camera, picture size and settings stay the same.

    crop_row: first row of the rectified picture that is used. map_u, map_v: for cv2.remap, from the camera picture
    to the cropped rectified one. from_crop: (3, 3) from a pixel of the cropped picture to one of the bird view.
    width, height: [px]. pixels_per_metre: [px/m]. x_top, y_left: [m] ground point of the bird view's pixel (0, 0).
    """

    calibration: Calibration
    crop_row: int
    map_u: Array
    map_v: Array
    from_crop: Array
    width: int
    height: int
    pixels_per_metre: float
    x_top: float
    y_left: float


def make_bird_view(calibration: Calibration, settings: BirdViewSettings) -> BirdView:
    """Lay out the bird view of one camera.

    The picture is cropped at the row of settings.crop_distance straight ahead (report, detection step 1). A rolled
    camera has the horizon below that row at one side, and the ground points of that corner run to infinity: the
    crop then moves down to horizon_margin below the horizon's lower end.
    Raises CalibrationError when nothing of the road is left.
    """
    width, height = calibration.width, calibration.height
    limit = inverted(calibration.homography) @ (settings.crop_distance, 0, 1)
    horizon = max(horizon_row(calibration.homography, u) for u in (0, width - 1))
    crop_row = max(0, math.ceil(horizon + settings.horizon_margin * height))
    if limit[2] > 0:
        crop_row = max(crop_row, math.ceil(limit[1] / limit[2]))
    if limit[2] <= 0 or crop_row > 0.8 * height:
        raise CalibrationError(
            '%s: homography has the horizon at row %.0f of %d, expected it well above the row of %g m ahead'
            % (calibration.source, horizon, height, settings.crop_distance)
        )
    corners = np.array(
        [[0, crop_row], [width - 1, crop_row], [0, height - 1], [width - 1, height - 1]], dtype=np.float64
    )
    ground = ground_from_pixel(calibration.homography, corners)
    (x_top, y_left), (x_low, y_right) = ground.max(axis=0), ground.min(axis=0)
    scale = (WIDTH - 1) / (y_left - y_right)
    bird = np.column_stack([y_left - ground[:, 1], x_top - ground[:, 0]]) * scale
    from_crop = cv2.getPerspectiveTransform((corners - (0, crop_row)).astype(np.float32), bird.astype(np.float32))
    cut = np.array([[1, 0, 0], [0, 1, -crop_row], [0, 0, 1]], dtype=np.float64)
    map_u, map_v = cv2.initUndistortRectifyMap(
        calibration.camera_matrix,
        calibration.distortion,
        calibration.rectification,
        cut @ calibration.projection,
        (width, height - crop_row),
        cv2.CV_32FC1,
    )
    bird_height = int(math.ceil((x_top - x_low) * scale)) + 1
    return BirdView(
        calibration, crop_row, map_u, map_v, from_crop, WIDTH, bird_height, float(scale), float(x_top), float(y_left)
    )


def crop(picture: Array, view: BirdView) -> Array:
    """Rectify a camera picture and cut it off at the distance limit. (H, W, 3) to (H - crop_row, W, 3) uint8."""
    cropped: Array = cv2.remap(picture, view.map_u, view.map_v, cv2.INTER_LINEAR)
    return cropped


def warp(cropped: Array, view: BirdView) -> Array:
    """The bird view of a cropped picture: (view.height, view.width, 3) uint8, far up, left left (report, step 2)."""
    warped: Array = cv2.warpPerspective(cropped, view.from_crop, (view.width, view.height), flags=cv2.INTER_LINEAR)
    return warped


def ground_from_bird(view: BirdView, pixels: Array) -> Array:
    """(N, 2) columns u, v of the bird view to (N, 2) columns x, y in m, robot frame."""
    pixels = np.asarray(pixels, dtype=np.float64)
    ground: Array = np.array([view.x_top, view.y_left]) - pixels[:, ::-1] / view.pixels_per_metre
    return ground


def bird_from_ground(view: BirdView, ground: Array) -> Array:
    """(N, 2) columns x, y in m, robot frame, to (N, 2) columns u, v of the bird view."""
    offset: Array = np.array([view.x_top, view.y_left]) - np.asarray(ground, dtype=np.float64)
    bird: Array = offset[:, ::-1] * view.pixels_per_metre
    return bird


def footprint_box(view: BirdView, x: float, y: float, radius: float) -> Box:
    """Box in the bird view of something that is not seen now, by its footprint.

    x, y: [m] the point of it nearest the robot. The box's sides stay inside the bird view; it may lie below it.
    """
    corners = bird_from_ground(view, np.array([[x + 2 * radius, y + radius], [x, y - radius]])) + 0.5
    (left, top), (right, bottom) = corners.tolist()
    left = min(max(left, 0.0), view.width - 1.0)
    return Box(left, max(top, 0.0), max(min(right, float(view.width)), left + 1.0), max(bottom, 1.0))


def image_from_bird(view: BirdView, pixels: Array) -> Array:
    """(N, 2) columns u, v of the bird view to (N, 2) columns u, v of the camera picture as it came."""
    points = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
    cropped = cv2.perspectiveTransform(points, inverted(view.from_crop)).reshape(-1, 2)
    return image_from_rectified(view.calibration, cropped + (0, view.crop_row))


def image_box_from_bird(view: BirdView, pixels: Array) -> Box:
    """Box in the camera picture around the given bird view pixels, (N, 2) columns u, v, clipped to the picture."""
    hull = cv2.convexHull(np.asarray(pixels, dtype=np.float32).reshape(-1, 1, 2)).reshape(-1, 2)
    corners = np.concatenate([hull + shift for shift in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5))])
    points = image_from_bird(view, corners) + 0.5  # from pixel centres to the edges that a box counts
    limit = (view.calibration.width, view.calibration.height)
    left, top = np.clip(points.min(axis=0), 0, limit)
    right, bottom = np.clip(points.max(axis=0), 0, limit)
    return Box(float(left), float(top), float(right), float(bottom))
