"""Shapes, blobs and drawn pictures for the tests of the detector."""

import functools
import math
from typing import Any, List, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.paper.shape import Blob
from obst_avoid.core.types import Box, Kind
from unit import drawn

SCALE = 140.0
"""[px/m] the reference scale of the shipped settings, so that sizes in the tests read as those in the YAML."""
OVERSAMPLING = 8


def mask_of(outline: Any, degrees: float = 0.0, pixels_per_metre: float = SCALE) -> np.ndarray:
    """A shape on the road as a mask of the bird view, turned about its middle. outline: (N, 2) in m. 0 or 255."""
    outline = np.asarray(outline, dtype=np.float64)
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turned = (outline - outline.mean(axis=0)) @ np.array([[cos, sin], [-sin, cos]])
    size = int(2 * np.linalg.norm(turned, axis=1).max() * pixels_per_metre) + 8
    fine = np.zeros((size * OVERSAMPLING,) * 2, dtype=np.uint8)
    corners = (turned * pixels_per_metre + size / 2) * OVERSAMPLING
    cv2.fillPoly(fine, [np.rint(corners).astype(np.int32)], 255)
    coarse = cv2.resize(fine, (size, size), interpolation=cv2.INTER_AREA)
    return np.where(coarse > 127, 255, 0).astype(np.uint8)


def rectangle(length: float, width: float) -> List[Tuple[float, float]]:
    """Paint. [m]"""
    return [(0, 0), (length, 0), (length, width), (0, width)]


def smear(foot: float, top: float, length: float) -> List[Tuple[float, float]]:
    """What stands upright, seen in the bird view: its foot is as wide as it is, its top is drawn far away. [m]"""
    return [(0, -foot / 2), (length, -top / 2), (length, top / 2), (0, foot / 2)]


def blob(
    left: float,
    bottom: float,
    width: float = 10.0,
    height: float = 20.0,
    area: float = 150.0,
    major: float = 150.0,
    **other: Any,
) -> Blob:
    """A blob of a given box, an accepted duckie unless said otherwise. [px]"""
    values = {'kind': Kind.DUCKIE, 'pixels': np.empty((0, 2), dtype=int), 'minor': 10.0, 'refused': ''}
    values.update(other)
    return Blob(box=Box(left, bottom - height, left + width, bottom), area=area, major=major, **values)


@functools.lru_cache(maxsize=64)
def picture_of(calibration: Calibration, things: Sequence[drawn.Thing] = ()) -> np.ndarray:
    """What a robot in the middle of its lane sees, drawn once for all tests. Not to be written to."""
    picture = drawn.draw(drawn.Scene(tuple(things)), calibration, drawn.RobotPose())
    picture.setflags(write=False)
    return picture


def duckie(x: float, y: float, height: float = 0.05) -> drawn.Thing:
    """A duckie on the drawn road. [m]"""
    return drawn.Thing(Kind.DUCKIE, x, y, height)


def cone(x: float, y: float, height: float = 0.05) -> drawn.Thing:
    """A cone on the drawn road. [m]"""
    return drawn.Thing(Kind.CONE, x, y, height)
