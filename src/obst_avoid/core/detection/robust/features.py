"""What is measured on a region before anybody judges it: form, edges, size on the road, colour in and around it.

Nothing here is a threshold. Colours are logarithms of ratios to the asphalt, sizes are in metres on the road by the
calibration, or ratios. Trees (trees.py) weigh them.
"""

import math
from typing import Dict, List, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.detection.robust.lines import Line
from obst_avoid.core.detection.robust.regions import WIDE, YELLOW, Regions
from obst_avoid.core.detection.robust.view import View
from obst_avoid.core.types import Array

CELLS, GROWN = 10, 0.3
"""A region is looked at through so many by so many cells, over its box grown by this share on each side."""
INSIDE = slice(2, 8)
"""Cells of the box itself, about."""
AROUND, AROUND_CELLS = 3.4, 7
"""Its surroundings: so many box sizes across, in so many by so many cells."""
EDGE_CELLS, EDGE_GROWN = 6, 0.25
"""Its edges: so many by so many cells over its box grown by this share on each side."""
DIRECTIONS = 4
"""Of edges, across a half turn."""
EVEN = 0.05
"""[octaves a pixel] What is flatter than this has no edges to speak of."""
FAINT = 0.02
"""[ratio to asphalt] added to light before logarithms of it, so that the dark is not all noise."""
NO_LINE = 2.0
"""[m] and other measures of the nearest line where none is seen."""
NO_NEIGHBOR = 6.0
"""Logarithm of area for the level beyond a channel's first one: everything."""


def measure(regions: Regions, light: Array, view: View, lines: Sequence[Line]) -> Array:
    """(N, len(NAMES)) float32, one row a region. light: (view.height, view.width, 3), relative to the asphalt's."""
    count = len(regions)
    if not count:
        return np.zeros((0, len(NAMES)), dtype=np.float32)
    x, y, w, h = regions.box.T
    u, v = _cells(regions.box, view)
    smooth = cv2.blur(light, (3, 3))
    seen = _colors(smooth[v, u])
    own = _own(regions, u, v - view.top)
    size = np.maximum(own.sum(axis=(1, 2)), 1)
    inside = [(color * own).sum(axis=(1, 2)) / size for color in seen]
    columns: Dict[str, Array] = {}
    columns.update(_form(regions, own))
    columns.update(_on_road(regions, view))
    columns.update(_levels(regions, own, u, v - view.top))
    columns.update(_beside_lines(columns['ahead'], columns['aside'], lines))
    columns['aside'] = np.abs(columns['aside'])
    columns['cut_side'] = (x <= 0) | (x + w >= view.width)
    columns['cut_low'] = y + h >= view.height
    columns['cut_top'] = y <= view.top
    for name, color, mean in zip(COLORS, seen, inside):
        difference = color - mean[:, None, None]
        columns[name] = mean
        columns[name + '_spread'] = np.sqrt((difference**2 * own).sum(axis=(1, 2)) / size)
        columns[name + '_left'] = difference[:, INSIDE, 0].mean(axis=1)
        columns[name + '_right'] = difference[:, INSIDE, -1].mean(axis=1)
        columns[name + '_above'] = difference[:, 0, INSIDE].mean(axis=1)
        columns[name + '_below'] = difference[:, -1, INSIDE].mean(axis=1)
        columns.update(_grid(name, np.clip(difference, -4, 4).reshape(count, 5, 2, 5, 2).mean(axis=(2, 4))))
    columns.update(_grid('own', own.reshape(count, 5, 2, 5, 2).mean(axis=(2, 4))))
    quarter = cv2.blur(cv2.resize(light, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), (3, 3))
    far = _colors(_surroundings(regions.box, quarter))
    steepness, edges = _edges(regions.box, smooth, view)
    columns['steepness'] = steepness
    for direction in range(DIRECTIONS):
        columns.update(_grid('edge%d_' % direction, edges[..., direction]))
    columns.update(_grid('around_brightness', np.clip(far[0] - inside[0][:, None, None], -4, 4)))
    columns.update(_grid('around_blue', np.clip(far[2] - inside[2][:, None, None], -4, 4)))
    assert list(columns) == NAMES
    return np.column_stack([columns[name] for name in NAMES]).astype(np.float32)


COLORS = ('brightness', 'green', 'blue')
"""Logarithms to the base 2 of: the light; green against red; blue against both."""


def _names() -> List[str]:
    names = ['channel', 'level', 'aspect', 'fill', 'log_width', 'log_height', 'off_middle', 'low_middle']
    names += ['row%d' % i for i in range(6)] + ['lean']
    names += ['ahead', 'aside', 'width', 'rise', 'rise_to_width', 'length']
    names += ['yellow', 'narrowness', 'narrowness_more', 'wide', 'parent', 'child']
    names += ['parent_width', 'parent_height', 'parent_foot', 'parent_top']
    names += ['line_distance', 'line_beyond', 'line_width', 'line_blue']
    names += ['cut_side', 'cut_low', 'cut_top']
    for name in COLORS:
        names += [name] + [name + end for end in ('_spread', '_left', '_right', '_above', '_below')]
        names += ['%s%d%d' % (name, i, j) for i in range(5) for j in range(5)]
    names += ['own%d%d' % (i, j) for i in range(5) for j in range(5)]
    names.append('steepness')
    for direction in range(DIRECTIONS):
        names += ['edge%d_%d%d' % (direction, i, j) for i in range(EDGE_CELLS) for j in range(EDGE_CELLS)]
    for name in ('around_brightness', 'around_blue'):
        names += ['%s%d%d' % (name, i, j) for i in range(AROUND_CELLS) for j in range(AROUND_CELLS)]
    return names


NAMES = _names()


def _cells(box: Array, view: View) -> List[Array]:
    """Pixels of the cells' middles: columns u and rows v, each (N, CELLS, CELLS) int, rows first."""
    x, y, w, h = (values[:, None] for values in box.T)
    steps = (np.arange(CELLS) + 0.5) / CELLS * (1 + 2 * GROWN) - GROWN
    u = np.clip(np.floor(x + w * steps), 0, view.width - 1).astype(int)
    v = np.clip(np.floor(y + h * steps), 0, view.height - 1).astype(int)
    shape = (len(box), CELLS, CELLS)
    return [np.broadcast_to(u[:, None, :], shape), np.broadcast_to(v[:, :, None], shape)]


def _colors(light: Array) -> List[Array]:
    """(..., 3) light to the logarithms named in COLORS."""
    blue, green, red = (light[..., i] + np.float32(FAINT) for i in range(3))
    both = green + red
    return [np.log2((both + blue) / 3), np.log2(green / red), np.log2(2 * blue / both)]


def _own(regions: Regions, u: Array, v: Array) -> Array:
    """(N, CELLS, CELLS) float32: 1 where a cell's middle belongs to the region."""
    own = np.zeros(u.shape, dtype=np.float32)
    for layer in np.unique(regions.layer):
        chosen = np.flatnonzero(regions.layer == layer)
        rows = v[chosen]
        labels = regions.layers[layer].labels[np.maximum(rows, 0), u[chosen]]
        own[chosen] = (labels == regions.label[chosen, None, None]) & (rows >= 0)
    return own


def _form(regions: Regions, own: Array) -> Dict[str, Array]:
    """The silhouette."""
    x, y, w, h = regions.box.T
    rows = own[:, INSIDE]
    widths = rows.mean(axis=2)
    steps = (np.arange(CELLS) + 0.5) / CELLS
    middles = (rows * steps).sum(axis=2) / np.maximum(rows.sum(axis=2), 1)
    columns = {
        'channel': regions.channel,
        'level': regions.level,
        'aspect': np.log2(w / h),
        'fill': regions.area / (w * h),
        'log_width': np.log2(w),
        'log_height': np.log2(h),
        'off_middle': np.abs((regions.middle[:, 0] - x) / w - 0.5),
        'low_middle': (regions.middle[:, 1] - y) / h,
    }
    columns.update({'row%d' % i: widths[:, i] for i in range(6)})
    columns['lean'] = np.abs(middles[:, 0] - middles[:, 5])
    return columns


def _on_road(regions: Regions, view: View) -> Dict[str, Array]:
    """Its size on the road, if its lowest row is its foot."""
    x, y, w, h = regions.box.T
    foot = np.clip((y + h - 1).astype(int), 0, view.height - 1)
    head = np.clip(y.astype(int), 0, view.height - 1)
    column = np.clip((x + w / 2).astype(int), 1, view.width - 2)
    nearness = view.nearness[foot, column]
    ahead = 1 / np.clip(nearness, 0.2, 20)
    left = view.bearing[foot, np.clip(x.astype(int), 0, view.width - 1)]
    right = view.bearing[foot, np.clip((x + w).astype(int), 0, view.width - 1)]
    width = np.abs(left - right) * ahead
    above = view.nearness[head, column]
    rise = 1 - np.clip(above / np.maximum(nearness, 1e-3), -2, 1)  # its height in heights of the camera, if upright
    return {
        'ahead': ahead,
        'aside': view.bearing[foot, column] * ahead,
        'width': np.log2(np.maximum(width, 1e-3)),
        'rise': rise,
        'rise_to_width': np.log2(np.maximum(rise, 1e-2) / np.maximum(width, 1e-3)),
        'length': np.log2(np.clip(1 / np.clip(above, 0.2, 20) - ahead, 1e-3, 5)),  # on the road, if it lies flat
    }


def _levels(regions: Regions, own: Array, u: Array, v: Array) -> Dict[str, Array]:
    """How it compares with what it is part of a level before, with its part a level later, and with paint."""
    count = len(regions)
    rows = np.maximum(v, 0)

    def peak(height: Array) -> Array:
        highest: Array = (height[rows, u] * own).reshape(count, -1).max(axis=1)
        return highest

    yellow, wide, wider = peak(regions.yellow), peak(regions.wide), peak(regions.wider)
    in_yellow = (regions.channel == YELLOW) | (regions.channel == WIDE)
    steps = (np.arange(CELLS) + 0.5) / CELLS
    centred = 1 - 0.5 * np.hypot(*np.meshgrid(steps - 0.5, steps - 0.55))
    best = (own * centred).reshape(count, -1).argmax(axis=1)
    every = np.arange(count)
    at_u, at_v = u.reshape(count, -1)[every, best], rows.reshape(count, -1)[every, best]
    parent, child = np.full(count, NO_NEIGHBOR), np.full(count, -NO_NEIGHBOR)
    outgrown = np.zeros((count, 4))
    w, h = regions.box[:, 2], regions.box[:, 3]
    for layer in np.unique(regions.layer):
        chosen = np.flatnonzero(regions.layer == layer)
        here = regions.layers[layer]
        for step in (-1, 1):
            other = layer + step
            if not 0 <= other < len(regions.layers) or regions.layers[other].channel != here.channel:
                continue
            neighbor = regions.layers[other]
            label = neighbor.labels[at_v[chosen], at_u[chosen]]
            stats = neighbor.stats[label]
            area = np.where(label > 0, stats[:, 4], 0)
            ratio = np.log2((area + 1) / regions.area[chosen])
            if step == 1:
                child[chosen] = ratio
                continue
            parent[chosen] = ratio
            own_stats = here.stats[regions.label[chosen]]
            own_top = own_stats[:, 1]
            outgrown[chosen] = np.column_stack(
                [
                    np.log2(stats[:, 2] / w[chosen]),
                    np.log2(stats[:, 3] / h[chosen]),
                    (stats[:, 1] + stats[:, 3] - own_top - h[chosen]) / h[chosen],
                    (stats[:, 1] - own_top) / h[chosen],
                ]
            )
    return {
        'yellow': yellow,
        'narrowness': yellow - wide,
        'narrowness_more': yellow - wider,
        'wide': wide - np.where(in_yellow, regions.level, 0),
        'parent': parent,
        'child': child,
        'parent_width': outgrown[:, 0],
        'parent_height': outgrown[:, 1],
        'parent_foot': outgrown[:, 2],
        'parent_top': outgrown[:, 3],
    }


def _beside_lines(x: Array, y: Array, lines: Sequence[Line]) -> Dict[str, Array]:
    """How far its foot is from the nearest line of tape, how far beyond its seen part, and what tape that is."""
    best = {
        'line_distance': np.full(len(x), NO_LINE),
        'line_beyond': np.full(len(x), NO_LINE),
        'line_width': np.full(len(x), NO_LINE),
        'line_blue': np.full(len(x), NO_LINE),
    }
    for line in lines:
        f = line.a + line.b * x + line.c * (x**2 + y**2) / 2 - y
        distance = np.abs(f) / np.hypot(line.b + line.c * x, 1 - line.c * y)
        near, far = sorted((line.begin, line.end))  # a line across the road begins anywhere
        beyond = np.maximum(np.maximum(near - x, x - far), 0)
        nearer = np.hypot(distance, beyond) < np.hypot(best['line_distance'], best['line_beyond'])
        seen = {'line_distance': distance, 'line_beyond': beyond, 'line_width': line.width, 'line_blue': line.blueness}
        for name, values in seen.items():
            best[name] = np.where(nearer, values, best[name])
    return best


def _edges(box: Array, light: Array, view: View) -> Tuple[Array, Array]:
    """How steep its brightness is, (N,), and in which of its cells edges of which direction are, as shares of that.

    (N, EDGE_CELLS, EDGE_CELLS, DIRECTIONS): histograms of oriented gradients (Dalal and Triggs 2005), by integral
    images (Dollar et al. 2009). In logarithms, so an edge in the dark weighs as much as one in the light.
    """
    bright = cv2.log(light[view.top :].sum(axis=2) / 3 + np.float32(FAINT)) * np.float32(1 / math.log(2))
    across = cv2.Sobel(bright, cv2.CV_32F, 1, 0, ksize=1) / 2
    down = cv2.Sobel(bright, cv2.CV_32F, 0, 1, ksize=1) / 2
    size, angle = cv2.cartToPolar(across, down)
    turn = angle * np.float32(DIRECTIONS / math.pi)
    sums = []
    for direction in range(DIRECTIONS):
        off = np.abs((turn - direction + DIRECTIONS / 2) % DIRECTIONS - DIRECTIONS / 2)
        sums.append(cv2.integral(size * np.maximum(1 - off, 0), sdepth=cv2.CV_32F))
    table = np.stack(sums, axis=2)
    x, y, w, h = box.T
    steps = np.arange(EDGE_CELLS + 1) / EDGE_CELLS * (1 + 2 * EDGE_GROWN) - EDGE_GROWN
    u = np.clip(np.rint(x[:, None] + w[:, None] * steps), 0, view.width).astype(int)
    v = np.clip(np.rint(y[:, None] + h[:, None] * steps) - view.top, 0, len(size)).astype(int)
    corner = table[v[:, :, None], u[:, None, :]]
    cell = corner[:, 1:, 1:] - corner[:, 1:, :-1] - corner[:, :-1, 1:] + corner[:, :-1, :-1]
    area = np.maximum(np.diff(v)[:, :, None] * np.diff(u)[:, None, :], 1)
    cell = cell / area[..., None]
    steepness = cell.sum(axis=3).mean(axis=(1, 2))
    return np.log2(steepness + EVEN), cell / (steepness + EVEN)[:, None, None, None]


def _surroundings(box: Array, quarter: Array) -> Array:
    """(N, AROUND_CELLS, AROUND_CELLS, 3) light around each box. quarter: the light at half the working size."""
    x, y, w, h = box.T
    size = np.maximum(w, h)[:, None] * (np.arange(AROUND_CELLS) - AROUND_CELLS // 2) / (AROUND_CELLS - 1) * AROUND
    u = np.clip(((x + w / 2)[:, None] + size) / 2, 0, quarter.shape[1] - 1).astype(int)
    v = np.clip(((y + h / 2)[:, None] + size) / 2, 0, quarter.shape[0] - 1).astype(int)
    around: Array = quarter[v[:, :, None], u[:, None, :]]
    return around


def _grid(name: str, values: Array) -> Dict[str, Array]:
    """(N, R, C) to a column a cell."""
    return {'%s%d%d' % (name, i, j): values[:, i, j] for i in range(values.shape[1]) for j in range(values.shape[2])}
