"""Colour without thresholds: every value is seen relative to the asphalt in the same light.

Asphalt is nearly grey and nearly everywhere, so the ratio of a pixel to it takes light's colour and exposure out. The
correction is folded into the table that turns pixel values into ratios; no pixel is corrected on its own.
"""

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from obst_avoid.core.types import Array

LINEAR = (((np.arange(256) + 1) / 256) ** 2.2).astype(np.float32)
"""Light of each pixel value: cameras encode about its root 2.2 (sRGB, IEC 61966-2-1). The 1 keeps ratios finite."""
DARKER, BRIGHTER = 15.0, 60.0
"""[percentiles] of brightness of the road's part of a picture between which asphalt lies: shadows, wheels and the
robot's own bumper are darker, paint and things are brighter."""
FIRST_ROW, LAST_ROW, ROWS = 0.5, 0.98, 60
"""The road's part, as fractions of the picture's height; so many rows of a whole picture are looked at."""
DARKEST, FASTEST, LONGEST = 1.5 / 256, 2.0, 10.0
"""Limits: asphalt is at least as bright as pixel value 1 or so, and changes by at most this factor a second; after so
many seconds [s] the light before says nothing."""


@dataclass(frozen=True)
class Light:
    """What asphalt looks like now. road: linear light in B, G, R, 0 to 1."""

    road: Tuple[float, float, float]

    def as_array(self) -> Array:
        """(3,) float64."""
        return np.array(self.road)


def estimate_light(picture: Array) -> Light:
    """The light of one picture, (H, W, 3) uint8 BGR. A picture without any asphalt gives its own grey."""
    height = picture.shape[0]
    every = max(height // ROWS, 1)
    sample = picture[int(FIRST_ROW * height) : int(LAST_ROW * height) + 1 : every, ::every].reshape(-1, 3)
    brightness = LINEAR[sample[:, 0]] + LINEAR[sample[:, 1]] + LINEAR[sample[:, 2]]
    ranks = int(DARKER / 100 * (len(sample) - 1)), int(BRIGHTER / 100 * (len(sample) - 1))
    low, high = np.partition(brightness, ranks)[list(ranks)]
    between = sample[(brightness >= low) & (brightness <= high)]
    middle = len(between) // 2
    blue, green, red = LINEAR[np.partition(between, middle, axis=0)[middle]].tolist()
    least = float(DARKEST**2.2)
    return Light((max(blue, least), max(green, least), max(red, least)))


def followed(before: Optional[Light], seen: Light, seconds: float) -> Light:
    """The light to use: what is seen, but no faster than FASTEST from the light before. None: nothing before."""
    if before is None or seconds > LONGEST:
        return seen
    limit = float(FASTEST ** max(seconds, 0.0))
    blue, green, red = (min(max(new, old / limit), old * limit) for old, new in zip(before.road, seen.road))
    return Light((blue, green, red))
