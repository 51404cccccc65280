"""The report's linear colour correction ("anti-instagram") and its colour filters."""

from dataclasses import dataclass
from typing import Optional

import cv2
import numpy as np

from obst_avoid.core.detection.paper.settings import ColorRange
from obst_avoid.core.types import Array

PERCENTILES = (1.0, 99.0)
"""Of each channel, taken as its black and its white: a hundredth may be a lamp or noise."""
SMALLEST_SPAN = 32
"""[grey levels] between the two below which a picture says nothing about its light (a lens cap, a wall)."""
SAMPLES = 4
"""Every so manyth row and column is looked at: percentiles do not need all pixels."""


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class ColorCorrection:
    """corrected = gain * value + offset, channel by channel (B, G, R); the table holds it for all 256 values.

    table: (1, 256, 3) uint8, as cv2.LUT wants it.
    """

    table: Array


def estimate_correction(picture: Array, largest_gain: float) -> Optional[ColorCorrection]:
    """The linear correction that stretches each channel from black to white.

    picture: (H, W, 3) uint8, BGR. Returns None where the picture has too little contrast to tell.
    Source: report, section "Evaluation of the Interface" (a linear transformation a channel); percentiles instead
    of the 2017 node's clusters, as today's stack does.
    """
    sample = picture[::SAMPLES, ::SAMPLES].reshape(-1, 3)
    low, high = np.percentile(sample, PERCENTILES, axis=0)
    if (high - low).max() < SMALLEST_SPAN:
        return None
    gain = np.minimum(255 / np.maximum(high - low, 1), largest_gain)
    values = np.arange(256)[:, None]
    table = np.clip(np.round((values - low) * gain), 0, 255).astype(np.uint8)
    return ColorCorrection(table.reshape(1, 256, 3))


def correct(picture: Array, correction: Optional[ColorCorrection]) -> Array:
    """Apply a correction to every pixel, as deployed in 2018. None: the picture itself."""
    if correction is None:
        return picture
    corrected: Array = cv2.LUT(picture, correction.table)
    return corrected


def in_color(hsv: Array, color: ColorRange) -> Array:
    """Pixels within a colour range (report, step 3). (H, W, 3) uint8, OpenCV's HSV, to (H, W) uint8, 0 or 255."""
    mask: Array = cv2.inRange(hsv, np.array(color.low, dtype=np.uint8), np.array(color.high, dtype=np.uint8))
    return mask
