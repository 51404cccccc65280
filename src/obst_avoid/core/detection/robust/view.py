"""What is fixed for one camera: where each pixel of the working picture lies on the road."""

from dataclasses import dataclass

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration, camera_position
from obst_avoid.core.detection.robust.lines import LineSampling, make_sampling
from obst_avoid.core.detection.robust.tracking import CameraPlace
from obst_avoid.core.geometry import image_from_rectified, rectified_from_image
from obst_avoid.core.matrices import inverted
from obst_avoid.core.types import Array

WIDTH = 240
"""[px] of the working picture, whatever the camera's: a duckie 16 px high in 640x480 still has 8 rows."""
FARTHEST = 3.0
"""[m] straight ahead of the farthest road that is looked at; above it there is room for things that stand there."""
FARTHEST_FOOT = 1.5
"""[m] straight ahead: what stands farther away is judged when the robot is nearer."""
ROOM = 0.06
"""Of the picture's height above that row."""
TAPE = 0.032
"""[m] Paint is narrower, things are wider: tape is 25 mm and, white and red, 48 mm wide, and that lies
along the road or across it, where it looks flat."""
BAND = 0.03
"""[m] A cone's white band is lower: what it cuts in two is joined again."""
FOLD = 0.01
"""Of the picture's height: what the lens model does not map back to this near is not in the picture."""
GROWTH = 1.2
"""Rows share a width in pixels as long as it differs by less than this factor."""


NEAREST, WIDEST_BEARING = 20.0, 4.0
"""[1/m] and slope of the road that is looked up, and in how many steps."""
ROAD_STEPS = (150, 200)


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class View:
    """The working picture of one camera: WIDTH pixels wide, rows from top on.

    scale: pixels of the camera picture to one of the working picture. width, height: of the whole working picture.
    foot: first row in which something may stand that is looked at. nearness: (height, width) [1/m] of the road at each
    pixel, ahead of the robot; 0 at the horizon, negative above. bearing: (height, width) y / x of the road there.
    opening: (B, 3) int32, bands of rows (first, one past the last, pixels of TAPE), counted from top. closing: the same
    for BAND. road: ROAD_STEPS bool, over nearness and bearing, whether the road there is in the picture.
    """

    scale: float
    width: int
    height: int
    top: int
    foot: int
    nearness: Array
    bearing: Array
    opening: Array
    closing: Array
    sampling: LineSampling
    camera: CameraPlace
    road: Array


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
        _bands(np.clip(np.rint(TAPE * density), 1, 61).astype(int)),
        _bands(np.clip(np.rint(BAND * density), 1, 61).astype(int)),
        make_sampling(calibration),
        CameraPlace(float(place[0]), float(place[2])),
        _road(calibration),
    )


def working_picture(picture: Array, view: View) -> Array:
    """(H, W, 3) uint8 to (view.height, view.width, 3) uint8, averaged.

    First whole pixels together, which takes a tenth of the time, then the rest of the way.
    """
    height, width = picture.shape[:2]
    together = next((n for n in range(width // view.width, 1, -1) if width % n == 0 and height % n == 0), 1)
    if together > 1:
        picture = cv2.resize(picture, (width // together, height // together), interpolation=cv2.INTER_AREA)
    small: Array = cv2.resize(picture, (view.width, view.height), interpolation=cv2.INTER_LINEAR)
    return small


def in_view(calibration: Calibration, x: float, y: float) -> bool:
    """Whether a point of the road, [m] in the robot frame, lies in the camera's picture."""
    return bool(_in_view(calibration, np.array([[x, y]]))[0])


def _in_view(calibration: Calibration, ground: Array) -> Array:
    """The same of (N, 2) points, (N,) bool."""
    u, v, w = inverted(calibration.homography) @ np.column_stack([ground, np.ones(len(ground))]).T
    before = w > 1e-9
    rectified = np.column_stack([u, v]) / np.where(before, w, 1.0)[:, None]
    image = image_from_rectified(calibration, rectified)
    inside = before & ((image >= 0) & (image < (calibration.width, calibration.height))).all(axis=1)
    if not inside.any():
        return np.zeros(len(ground), dtype=bool)
    back = rectified_from_image(calibration, image[inside])  # beyond its field of view the lens model folds back
    inside[inside] = np.abs(back - rectified[inside]).max(axis=1) < FOLD * calibration.height
    result: Array = inside
    return result


def shown(view: View, x: float, y: float) -> bool:
    """in_view of the view's camera, to about a hundredth of the picture's size and in no time."""
    if x <= 1 / NEAREST or abs(y) >= WIDEST_BEARING * x:
        return False
    row, column = int(ROAD_STEPS[0] / (NEAREST * x)), int((y / (WIDEST_BEARING * x) + 1) / 2 * ROAD_STEPS[1])
    return bool(view.road[min(row, ROAD_STEPS[0] - 1), min(column, ROAD_STEPS[1] - 1)])  # rounding may go past the end


def _road(calibration: Calibration) -> Array:
    """View.road."""
    nearness = (np.arange(ROAD_STEPS[0]) + 0.5) / ROAD_STEPS[0] * NEAREST
    bearing = ((np.arange(ROAD_STEPS[1]) + 0.5) / ROAD_STEPS[1] * 2 - 1) * WIDEST_BEARING
    x, slope = (values.ravel() for values in np.meshgrid(1 / nearness, bearing, indexing='ij'))
    return _in_view(calibration, np.column_stack([x, slope * x])).reshape(ROAD_STEPS)


def _bands(pixels: Array) -> Array:
    """Neighbouring rows of about the same width, (first, one past the last, width); odd: an even one moves things."""
    bands, first = [], 0
    while first < len(pixels):
        past = first
        while past < len(pixels) and pixels[past] <= max(pixels[first] * GROWTH, pixels[first] + 1):
            past += 1
        bands.append((first, past, int(np.median(pixels[first:past])) | 1))
        first = past
    return np.array(bands, dtype=np.int32).reshape(-1, 3)
