"""Regions that may be things: connected components of "how yellow" and "how red" at every level at once.

No threshold fits every light, so all of them are tried: what stands out from its surroundings is a component at some
level, between the level where it melts into them and the one where it falls apart (a component tree, Najman and
Couprie 2006; maximally stable regions, Matas et al. 2002).
"""

import math
from dataclasses import dataclass
from typing import List, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.detection.robust.view import View
from obst_avoid.core.types import Array

YELLOW_LEVELS = np.exp(np.linspace(math.log(0.4), math.log(300.0), 20))
"""Red and green light less blue, asphalt's being 1: from a duckie in the dark to one in a lamp's light."""
GREEN_LEVELS = np.array([0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1])
"""Green against red: falls from asphalt's 1 to 0.07 on cones."""
BLUE_LEVELS = np.array([0.75, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05])
"""Blue against red and green, whatever the brightness: what stands half in the shadow stays whole."""
SMALLEST, WIDEST, SLIMMEST, FLATTEST = 14, 160, 4.0, 3.5
"""[px] area, [px] width, height to width, width to height, of a region in the working picture."""
BRIGHT_LEVELS = np.exp(np.linspace(math.log(1.2), math.log(60.0), 14))
"""Green light, asphalt's being 1: in blue and green light yellow things are the bright ones."""
DARK_LEVELS = np.exp(np.linspace(math.log(1.2), math.log(12.0), 10))
"""Asphalt's green light, against the pixel's: a fallen cone may show nothing but the black underside of its base."""
YELLOW, RED, BLUELESS, WIDE, JOINED, BRIGHT, DARK = range(7)
"""Channels: three colours, yellow without what is as narrow as paint, red across a cone's white band, light, dark."""


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Layer:
    """One level of one channel. labels: (view.height - view.top, view.width) int32. stats: (K, 5) int32 of OpenCV."""

    channel: int
    level: int
    labels: Array
    stats: Array


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Regions:
    """N regions. channel, level, layer, label: (N,) int. box: (N, 4) left, top, width, height in the working picture.

    area: (N,) [px]. middle: (N, 2) u, v of its centroid. layers: all, a channel's from its widest level to its
    narrowest. yellow, wide, wider: (view.height - view.top, view.width) uint8, yellow levels reached, by what is wider
    than paint, by what is wider still.
    """

    channel: Array
    level: Array
    layer: Array
    label: Array
    box: Array
    area: Array
    middle: Array
    layers: List[Layer]
    yellow: Array
    wide: Array
    wider: Array

    def __len__(self) -> int:
        return len(self.channel)


def find_regions(light: Array, view: View) -> Regions:
    """All regions of one picture. light: (view.height, view.width, 3) float32, relative to the asphalt's."""
    blue, green, red = cv2.split(light[view.top :])
    both = (green + red) / 2
    yellow = _reached(both - blue, YELLOW_LEVELS)
    wide, wider = (opened(yellow, bands) for bands in view.openings)
    fewer = _fallen(green / red, GREEN_LEVELS), _fallen(blue / both, BLUE_LEVELS)
    layers: List[Layer] = []
    found: List[Array] = []
    heights = {
        YELLOW: yellow,
        RED: fewer[0],
        BLUELESS: fewer[1],
        WIDE: wide,
        JOINED: joined(fewer[0], view.closing),
        BRIGHT: _reached(green, BRIGHT_LEVELS),
        DARK: _reached(1 / green, DARK_LEVELS),
    }
    for channel, height in heights.items():
        for level in range(int(height.max())):
            mask = (height > level).view(np.uint8)
            _, labels, stats, middles = cv2.connectedComponentsWithStats(mask, connectivity=4)
            w, h = stats[:, 2], stats[:, 3]
            good = (stats[:, 4] >= SMALLEST) & (w < FLATTEST * h) & (h < SLIMMEST * w) & (w < WIDEST)
            good &= stats[:, 1] + h + view.top > view.foot
            good[0] = False  # what is outside the mask
            ids = np.flatnonzero(good)
            here = np.full(len(ids), len(layers))
            found.append(np.column_stack([here, ids, stats[ids], middles[ids]]))
            layers.append(Layer(channel, level, labels, stats))
    table = np.concatenate(found) if found else np.zeros((0, 9))
    layer = table[:, 0].astype(int)
    box = table[:, 2:6] + (0, view.top, 0, 0)
    of_layer = np.array([(item.channel, item.level) for item in layers]).reshape(-1, 2)
    return Regions(
        of_layer[layer, 0],
        of_layer[layer, 1],
        layer,
        table[:, 1].astype(int),
        box,
        table[:, 6],
        table[:, 7:9] + (0, view.top),
        layers,
        yellow,
        wide,
        wider,
    )


def opened(height: Array, bands: Sequence[Tuple[int, int, int]]) -> Array:
    """Grey opening by a square of each band's pixels: what is narrower in any direction sinks to its surroundings."""
    result = np.empty_like(height)
    for first, past, pixels in bands:
        begin, end = max(first - pixels, 0), min(past + pixels, len(height))
        part = height[begin:end]
        if pixels > 1:
            part = cv2.morphologyEx(part, cv2.MORPH_OPEN, np.ones((pixels, pixels), np.uint8))
        result[first:past] = part[first - begin : past - begin]
    return result


def joined(height: Array, bands: Sequence[Tuple[int, int, int]]) -> Array:
    """Grey closing by a column of each band's pixels: what lies between two parts, one above the other, joins them."""
    result = np.empty_like(height)
    most = 2 * max(pixels for _, _, pixels in bands) + 2
    padded = cv2.copyMakeBorder(height, most, most, 0, 0, cv2.BORDER_CONSTANT)  # or things grow to a near edge
    for first, past, pixels in bands:
        column = np.ones((pixels | 1, 1), np.uint8)  # an even one moves things by half a pixel
        part = padded[most + first - 2 * pixels : most + past + 2 * pixels]
        if pixels > 1:
            part = cv2.morphologyEx(part, cv2.MORPH_CLOSE, column)
        result[first:past] = part[2 * pixels : 2 * pixels + past - first]
    return result


def _reached(values: Array, levels: Array) -> Array:
    """How many of the levels, evenly spaced in their logarithm, each value is above. Any shape, to uint8."""
    step = math.log(levels[1] / levels[0])
    logs = cv2.log(np.maximum(values, np.float32(1e-6)))
    steps: Array = np.clip((logs - np.float32(math.log(levels[0]))) * np.float32(1 / step) + 1, 0, len(levels))
    return steps.astype(np.uint8)


def _fallen(ratios: Array, levels: Array) -> Array:
    """How many of the levels, falling multiples of 0.05, each ratio is below. Any shape, to uint8."""
    table = (np.arange(256)[:, None] < np.rint(levels * 20)).sum(axis=1).astype(np.uint8)
    fallen: Array = cv2.LUT(np.minimum(ratios * np.float32(20), np.float32(255)).astype(np.uint8), table)
    return fallen
