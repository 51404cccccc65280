"""Colours as logarithms, and heights: how far each pixel stands out in each of the ways in which things stand out.

All integers, from tables: the compiled path (native.c) and this one give the same numbers. The correction for the
light is in the tables.
"""

import math
from dataclasses import dataclass
from typing import Tuple

import cv2
import numpy as np

from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.robust.light import LINEAR, Light
from obst_avoid.core.detection.robust.view import View
from obst_avoid.core.types import Array

UNIT = 64
"""Steps of an octave in which logarithms are counted."""
RANGE = 1024
"""[steps] that logarithms and their differences stay below."""
FAINT = 0.02
"""[ratio to asphalt] added to light before logarithms of it, so that the dark is not all noise."""
YELLOW_LEVELS = np.exp(np.linspace(math.log(0.55), math.log(300.0), 19))
"""Red and green light less blue, asphalt's being 1: from a duckie in the dark to one in a lamp's light."""
GREEN_LEVELS = np.array([0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1])
"""Green against red: falls from asphalt's 1 to 0.07 on cones."""
BLUE_LEVELS = np.array([0.75, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05])
"""Blue against red and green, whatever the brightness: what stands half in the shadow stays whole."""
BRIGHT_LEVELS = np.exp(np.linspace(math.log(3.0), math.log(60.0), 11))
"""Green light, asphalt's being 1: in blue and green light yellow things are the bright ones."""
DARK_LEVELS = np.exp(np.linspace(math.log(1.5), math.log(12.0), 9))
"""Asphalt's green light, against the pixel's: a fallen cone may show nothing but the black underside of its base."""
YELLOW, RED, BLUELESS, WIDE, JOINED, BRIGHT, DARK = range(7)
"""Channels: three colours, yellow without what is as narrow as paint, red across a cone's white band, light, dark."""
CHANNELS = 7
COLORS = ('brightness', 'green', 'blue')
"""Logarithms to the base 2 of: red and green light; green against red; blue against both."""
DIRECTIONS = 4
"""Of edges, across a half turn."""
SUMS = len(COLORS) + DIRECTIONS + 1
"""Numbers a pixel in Channels.sums, the last one 0: processors add them four at a time."""


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Channels:
    """One picture from view.top down: R rows of W pixels.

    heights: (7, R, W) uint8, levels reached in each channel. sums: (R + 1, W + 1, SUMS) int32, integral
    image of COLORS and of the strength of edges in each direction, in 1 / UNIT octaves (a pixel).
    """

    heights: Array
    sums: Array


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Tables:
    """What turns pixel values into logarithms, (3, 256) int16, and these into levels.

    less: (2 RANGE,) int16, from the logarithm of blue against the rest to that of what the rest is more, against the
    rest. steps: (3, 2 RANGE) uint8, levels of yellow, green, blue, by logarithm + RANGE. light: (2, 256) uint8, levels
    of bright and dark by the pixel's green.
    """

    logarithms: Array
    less: Array
    steps: Array
    light: Array


def channels_of(small: Array, light: Light, view: View) -> Channels:
    """Of a working picture, (view.height, view.width, 3) uint8, in that light."""
    rows = small[view.top :]
    tables = tables_of(light)
    found = native.channels(rows, tables.logarithms, tables.less, tables.steps, tables.light)
    heights, sums = found or _by_numpy(rows, tables)
    opened(heights[YELLOW], view.opening, heights[WIDE])
    joined(heights[RED], view.closing, heights[JOINED])
    return Channels(heights, sums)


def tables_of(light: Light) -> Tables:
    """For one light."""
    ratios = LINEAR[None].astype(np.float64) / light.as_array()[:, None]
    logarithms = np.minimum(np.rint(UNIT * np.log2(ratios + FAINT)), RANGE // 2 - 1).astype(np.int16)
    return Tables(logarithms, _LESS, _STEPS, _LIGHT[:, logarithms[1].astype(int) + RANGE])


def opened(height: Array, bands: Array, result: Array) -> None:
    """Grey opening by a square of each band's pixels: what is narrower in any direction sinks to its surroundings.

    height, result: (R, W) uint8. bands: (B, 3) int32 first row, one past the last, odd number of pixels.
    """
    if native.morphed(height, bands, False, result):
        return
    for first, past, pixels in bands.tolist():
        begin, end = max(first - pixels, 0), min(past + pixels, len(height))
        part = cv2.morphologyEx(height[begin:end], cv2.MORPH_OPEN, np.ones((pixels, pixels), np.uint8))
        result[first:past] = part[first - begin : past - begin]


def joined(height: Array, bands: Array, result: Array) -> None:
    """Grey closing by a column of each band's pixels: what lies between two parts, one above the other, joins them.

    Arguments as above.
    """
    if native.morphed(height, bands, True, result):
        return
    most = 2 * int(bands[:, 2].max())
    padded = cv2.copyMakeBorder(height, most, most, 0, 0, cv2.BORDER_CONSTANT)  # or things grow to a near edge
    for first, past, pixels in bands.tolist():
        part = padded[most + first - 2 * pixels : most + past + 2 * pixels]
        part = cv2.morphologyEx(part, cv2.MORPH_CLOSE, np.ones((pixels, 1), np.uint8))
        result[first:past] = part[2 * pixels : 2 * pixels + past - first]


def _by_numpy(rows: Array, tables: Tables) -> Tuple[Array, Array]:
    """heights, but for WIDE and JOINED, and sums."""
    blue, green, red = (tables.logarithms[i][rows[..., i]].astype(np.int32) for i in range(3))
    bright = (green + red) >> 1
    colors = bright, green - red, blue - bright
    yellow = bright + tables.less[colors[2] + RANGE]
    heights = np.empty((CHANNELS,) + bright.shape, dtype=np.uint8)
    for step, (channel, values) in zip(tables.steps, ((YELLOW, yellow), (RED, colors[1]), (BLUELESS, colors[2]))):
        heights[channel] = step[np.clip(values + RANGE, 0, 2 * RANGE - 1)]
    for step, channel in zip(tables.light, (BRIGHT, DARK)):
        heights[channel] = step[rows[..., 1]]
    padded = np.pad(bright, 1, mode='edge')
    smooth = padded[:-2] + 2 * padded[1:-1] + padded[2:]
    across = smooth[:, 2:] - smooth[:, :-2]
    smooth = padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]
    down = smooth[2:] - smooth[:-2]
    most, least = np.maximum(np.abs(across), np.abs(down)), np.minimum(np.abs(across), np.abs(down))
    flat = np.abs(across) >= np.abs(down)
    rising = (across > 0) == (down > 0)
    planes = np.zeros(bright.shape + (SUMS,), dtype=np.int32)
    planes[..., :3] = np.stack(colors, axis=-1)
    slanting = least + (least >> 2) + (least >> 3) + (least >> 5)  # the root of 2, about
    planes[..., 3] = np.where(flat, most - least, 0)
    planes[..., 4] = np.where(rising, slanting, 0)
    planes[..., 5] = np.where(flat, 0, most - least)
    planes[..., 6] = np.where(rising, 0, slanting)
    sums = np.zeros((len(planes) + 1, planes.shape[1] + 1, SUMS), dtype=np.int32)
    sums[1:, 1:] = planes.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32)
    return heights, sums


def _steps_of(values: Array, levels: Array) -> Array:
    """How many of the levels each value is above."""
    steps: Array = (values[:, None] > levels).sum(axis=1).astype(np.uint8)
    return steps


def _less() -> Array:
    """Logarithm of 1 less a ratio, by the ratio's logarithm."""
    part = 1 - np.exp2(np.arange(-RANGE, RANGE) / UNIT)
    return np.where(part > 0, np.rint(UNIT * np.log2(np.maximum(part, 1e-9))), -2 * RANGE).astype(np.int16)


def _steps() -> Array:
    value = np.arange(-RANGE, RANGE) / UNIT
    return np.stack(
        [
            _steps_of(value, np.log2(YELLOW_LEVELS)),
            _steps_of(-value, -np.log2(GREEN_LEVELS)),
            _steps_of(-value, -np.log2(BLUE_LEVELS)),
        ]
    )


def _light() -> Array:
    value = np.arange(-RANGE, RANGE) / UNIT
    return np.stack([_steps_of(value, np.log2(BRIGHT_LEVELS)), _steps_of(-value, -np.log2(1 / DARK_LEVELS + FAINT))])


_LESS, _STEPS, _LIGHT = _less(), _steps(), _light()
