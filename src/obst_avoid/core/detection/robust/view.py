"""What is fixed for one camera: where each pixel of the working picture lies on the road."""

from dataclasses import dataclass
from typing import Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration, camera_position
from obst_avoid.core.detection.robust.lines import LineSampling, make_sampling
from obst_avoid.core.detection.robust.tracking import CameraPlace
from obst_avoid.core.geometry import image_from_rectified, rectified_from_image
from obst_avoid.core.types import Array

WIDTH = 320
"""[px] of the working picture, whatever the camera's: a duckie 16 px high in 640x480 still has 8 rows."""
FARTHEST = 3.0
"""[m] straight ahead of the farthest road that is looked at; above it there is room for things that stand there."""
FARTHEST_FOOT = 1.5
"""[m] straight ahead: what stands farther away is judged when the robot is nearer."""
ROOM = 0.06
"""Of the picture's height above that row."""
TAPE = (0.032, 0.045)
"""[m] Paint is narrower than the one, things are wider: tape is 25 mm and, white and red, 48 mm wide, and that lies
along the road or across it, where it looks flat. The other tells how much wider."""
BAND = 0.03
"""[m] A cone's white band is lower: what it cuts in two is joined again."""
FOLD = 0.01
"""Of the picture's height: what the lens model does not map back to this near is not in the picture."""
GROWTH = 1.2
"""Rows share a width in pixels as long as it differs by less than this factor."""


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class View:
    """The working picture of one camera: WIDTH pixels wide, rows from top on.

    scale: pixels of the camera picture to one of the working picture. width, height: of the whole working picture.
    foot: first row in which something may stand that is looked at. nearness: (height, width) [1/m] of the road at each
    pixel, ahead of the robot; 0 at the horizon, negative above. bearing: (height, width) y / x of the road there.
    openings: for each width of TAPE the bands of rows (first, last, pixels), counted from top. closing: the same for
    BAND.
    """

    scale: float
    width: int
    height: int
    top: int
    foot: int
    nearness: Array
    bearing: Array
    openings: Tuple[Tuple[Tuple[int, int, int], ...], ...]
    closing: Tuple[Tuple[int, int, int], ...]
    sampling: LineSampling
    camera: CameraPlace


def make_view(calibration: Calibration) -> View:
    """Lay out the working picture of one camera."""
    scale = calibration.width / WIDTH
    width, height = WIDTH, round(calibration.height / scale)
    u, v = np.meshgrid((np.arange(width) + 0.5) * scale - 0.5, (np.arange(height) + 0.5) * scale - 0.5)
    rectified = rectified_from_image(calibration, np.column_stack([u.ravel(), v.ravel()]))
    x, y, w = (np.column_stack([rectified, np.ones(len(rectified))]) @ calibration.homography.T).T
    x = np.where(np.abs(x) < 1e-9, 1e-9, x)
    nearness = np.where(x > 0, w / x, 9.0).reshape(u.shape).astype(np.float32)
    bearing = (y / x).reshape(u.shape).astype(np.float32)
    column = nearness[:, width // 2]
    top, foot = (int(np.argmax(column > 1 / distance)) for distance in (FARTHEST, FARTHEST_FOOT))  # 0: all are farther
    top = max(top - int(ROOM * height), 0)
    across = np.abs(bearing[:, width // 2 + 8] - bearing[:, width // 2 - 8]) / np.maximum(column, 1e-3)
    density = np.where(column > 0.3, 16 / np.maximum(across, 1e-6), 0)[top:]
    place = camera_position(calibration)
    return View(
        scale,
        width,
        height,
        top,
        foot,
        nearness,
        bearing,
        tuple(_bands(np.clip(np.rint(tape * density), 1, 61).astype(int)) for tape in TAPE),
        _bands(np.clip(np.rint(BAND * density), 1, 61).astype(int)),
        make_sampling(calibration),
        CameraPlace(float(place[0]), float(place[2])),
    )


def working_picture(picture: Array, view: View) -> Array:
    """(H, W, 3) uint8 to (view.height, view.width, 3) uint8, averaged."""
    small: Array = cv2.resize(picture, (view.width, view.height), interpolation=cv2.INTER_AREA)
    return small


def in_view(calibration: Calibration, x: float, y: float) -> bool:
    """Whether a point of the road, [m] in the robot frame, lies in the camera's picture."""
    u, v, w = np.linalg.solve(calibration.homography, (x, y, 1.0))
    if w <= 0:
        return False
    rectified = np.array([[u / w, v / w]])
    image = image_from_rectified(calibration, rectified)
    if not ((image >= 0) & (image < (calibration.width, calibration.height))).all():
        return False
    back = rectified_from_image(calibration, image)  # beyond the lens's field of view its model folds back
    return bool(np.abs(back - rectified).max() < FOLD * calibration.height)


def _bands(pixels: Array) -> Tuple[Tuple[int, int, int], ...]:
    """Neighbouring rows of about the same width, (first, one past the last, width)."""
    bands, first = [], 0
    while first < len(pixels):
        past = first
        while past < len(pixels) and pixels[past] <= max(pixels[first] * GROWTH, pixels[first] + 1):
            past += 1
        bands.append((first, past, int(np.median(pixels[first:past]))))
        first = past
    return tuple(bands)
