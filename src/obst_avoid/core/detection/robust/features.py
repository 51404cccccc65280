"""What is measured on a region before anybody judges it: form, edges, size on the road, colour in and around it.

Nothing here is a threshold. Colours are logarithms of ratios to the asphalt, sizes are in metres on the road by the
calibration, or ratios. Trees (trees.py) weigh them. What costs nothing is measured on all regions; the rest only on
those that the first trees leave.
"""

from typing import Dict, List, Sequence, Tuple

import numpy as np

from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.robust.channels import COLORS, DIRECTIONS, UNIT, WIDE, YELLOW, Channels
from obst_avoid.core.detection.robust.lines import Line
from obst_avoid.core.detection.robust.regions import AT, Regions
from obst_avoid.core.detection.robust.view import View
from obst_avoid.core.types import Array

OWN_CELLS, OWN_GROWN = 10, 0.3
"""Where a region is, is asked at so many by so many points, over its box grown by this share on each side."""
INSIDE = slice(2, 8)
"""Those in the box itself, about."""
CELLS, GROWN = 6, 0.25
"""Its colours and edges: means of so many by so many cells over its box grown by this share on each side."""
AROUND, AROUND_CELLS = 3.4, 7
"""Its surroundings: so many box sizes across, in so many by so many cells."""
DIFFERENCE = 4.0
"""[octaves] Colours that differ by more than this are simply different."""
EVEN = 0.4
"""[octaves over 8 pixels] What is flatter than this has no edges to speak of."""
NO_LINE = 2.0
"""[m] and other measures of the nearest line where none is seen."""
NOTHING = 30.0
"""Levels, and ratios of sizes, for what a region would be part of where there is nothing."""


def measure_all(regions: Regions, channels: Channels, view: View) -> Array:
    """(N, len(QUICK)) float32, one row a region: what its box, its sums and its place on the road tell."""
    road = view.top, view.nearness, view.bearing
    found = native.quick(regions.table, channels.sums, *road, len(QUICK))
    if found is not None:
        return found
    column = {name: regions.table[:, index].astype(np.float64) for name, index in AT.items()}
    x, y, w, h, area = (column[name] for name in ('left', 'top', 'width', 'height', 'area'))
    values: Dict[str, Array] = {name: column[name] for name in ('channel', 'level')}
    values.update(
        alive=column['level'] - column['since'],
        aspect=w / h,
        fill=area / (w * h),
        pixels_across=w,
        pixels_up=h,
        off_middle=np.abs((column['sum_u'] / area - x) / w - 0.5),
        low_middle=(column['sum_v'] / area - y) / h,
    )
    values.update(_on_road(regions.table, view))
    values['aside'] = np.abs(values['aside'])
    for name in COLORS:
        values[name] = column[name] / area / UNIT
    values.update(_ring(regions.table, channels.sums, values))
    values['part'] = column['part'] / area
    for who in ('parent_', 'double_'):
        there = column[who + 'level'] > 0
        larger = {name: column[who + name] for name in ('left', 'top', 'width', 'height', 'area')}
        compared = {
            'levels': column['level'] - column[who + 'level'],
            'area': larger['area'] / area,
            'width': larger['width'] / w,
            'height': larger['height'] / h,
            'foot': (larger['top'] + larger['height'] - y - h) / h,
            'top': (y - larger['top']) / h,
        }
        values.update({who + name: np.where(there, ratio, NOTHING) for name, ratio in compared.items()})
    values['cut_side'] = (x <= 0) | (x + w >= view.width)
    values['cut_low'] = y + h + view.top >= view.height
    values['cut_top'] = y <= 0
    assert list(values) == QUICK
    return np.column_stack([values[name] for name in QUICK]).astype(np.float32)


def measure(
    regions: Regions, chosen: Array, quick: Array, channels: Channels, view: View, lines: Sequence[Line]
) -> Array:
    """(M, len(NAMES)) float32 of the chosen regions, (M,) int: everything. quick: (N, len(QUICK)) of measure_all."""
    table, values = regions.table[chosen], quick[chosen]
    near = _lines_as_array(lines)
    found = native.full(
        table,
        values,
        regions.place,
        channels.heights,
        channels.sums,
        view.top,
        view.nearness,
        view.bearing,
        near,
        (OWN_GROWN, GROWN, AROUND, DIFFERENCE, EVEN, NO_LINE),
        len(NAMES),
    )
    if found is not None:
        return found
    columns: Dict[str, Array] = {name: values[:, index] for index, name in enumerate(QUICK)}
    columns.update(_own(regions.place, table, channels.heights))
    road = _on_road(table, view)
    columns.update(_beside_lines(road['ahead'], road['aside'], near))
    inside = [columns[name].astype(np.float64) for name in COLORS]
    cells = _means(channels.sums, *_grid_over(table, channels.sums, CELLS, 1 + 2 * GROWN, square=False)) / UNIT
    for index, name in enumerate(COLORS):
        difference = cells[..., index] - inside[index][:, None, None]
        columns.update(_grid(name, np.clip(difference, -DIFFERENCE, DIFFERENCE)))
    edges = cells[..., len(COLORS) : len(COLORS) + DIRECTIONS]
    steepness = edges.sum(axis=3).mean(axis=(1, 2))
    columns['steepness'] = steepness
    for direction in range(DIRECTIONS):
        shares = edges[..., direction] / (steepness + EVEN)[:, None, None]
        columns.update(_grid('edge%d_' % direction, shares))
    around = _means(channels.sums, *_grid_over(table, channels.sums, AROUND_CELLS, AROUND, square=True)) / UNIT
    for name in ('brightness', 'blue'):
        index = COLORS.index(name)
        difference = around[..., index] - inside[index][:, None, None]
        columns.update(_grid('around_' + name, np.clip(difference, -DIFFERENCE, DIFFERENCE)))
    assert list(columns) == NAMES
    return np.column_stack([columns[name] for name in NAMES]).astype(np.float32)


def _quick_names() -> List[str]:
    names = ['channel', 'level', 'alive', 'aspect', 'fill', 'pixels_across', 'pixels_up', 'off_middle', 'low_middle']
    names += ['ahead', 'aside', 'width', 'rise', 'rise_to_width', 'length']
    names += list(COLORS) + ['ring_' + name for name in COLORS] + ['part']
    for who in ('parent_', 'double_'):
        names += [who + name for name in ('levels', 'area', 'width', 'height', 'foot', 'top')]
    return names + ['cut_side', 'cut_low', 'cut_top']


def _names() -> List[str]:
    names = QUICK + ['row%d' % i for i in range(6)] + ['lean', 'yellow', 'narrowness', 'wide']
    names += ['own%d%d' % (i, j) for i in range(5) for j in range(5)]
    names += ['line_distance', 'line_beyond', 'line_width', 'line_blue']
    for name in COLORS:
        names += ['%s%d%d' % (name, i, j) for i in range(CELLS) for j in range(CELLS)]
    names.append('steepness')
    for direction in range(DIRECTIONS):
        names += ['edge%d_%d%d' % (direction, i, j) for i in range(CELLS) for j in range(CELLS)]
    for name in ('around_brightness', 'around_blue'):
        names += ['%s%d%d' % (name, i, j) for i in range(AROUND_CELLS) for j in range(AROUND_CELLS)]
    return names


QUICK = _quick_names()
NAMES = _names()


def _on_road(table: Array, view: View) -> Dict[str, Array]:
    """Its size on the road, if its lowest row is its foot."""
    x, y, w, h = table[:, AT['left'] : AT['height'] + 1].astype(np.int64).T
    y = y + view.top
    foot, column = y + h - 1, np.clip(x + w // 2, 1, view.width - 2)
    nearness = view.nearness[foot, column].astype(np.float64)
    ahead = 1 / np.clip(nearness, 0.2, 20)
    left = view.bearing[foot, x].astype(np.float64)
    right = view.bearing[foot, np.minimum(x + w, view.width - 1)].astype(np.float64)
    width = np.abs(left - right) * ahead
    above = view.nearness[y, column].astype(np.float64)
    rise = 1 - np.clip(above / np.maximum(nearness, 1e-3), -2, 1)  # its height in heights of the camera, if upright
    aside = view.bearing[foot, column] * ahead
    return {
        'ahead': ahead,
        'aside': aside,
        'width': width,
        'rise': rise,
        'rise_to_width': np.maximum(rise, 1e-2) / np.maximum(width, 1e-3),
        'length': np.clip(1 / np.clip(above, 0.2, 20) - ahead, 1e-3, 5),  # on the road, if it lies flat
    }


def _ring(table: Array, sums: Array, values: Dict[str, Array]) -> Dict[str, Array]:
    """How its colours differ from those just around it, half its size to each side."""
    x, y, w, h = table[:, AT['left'] : AT['height'] + 1].astype(np.int64).T
    rows, width = sums.shape[0] - 1, sums.shape[1] - 1
    u = np.maximum(x - (w + 1) // 2, 0), np.minimum(x + w + (w + 1) // 2, width)
    v = np.maximum(y - (h + 1) // 2, 0), np.minimum(y + h + (h + 1) // 2, rows)
    total = sums[v[1], u[1]] - sums[v[1], u[0]] - sums[v[0], u[1]] + sums[v[0], u[0]]
    size = np.maximum((u[1] - u[0]) * (v[1] - v[0]) - table[:, AT['area']], 1)
    ring = (total[:, :3] - table[:, AT['brightness'] : AT['blue'] + 1]) / size[:, None] / UNIT
    return {'ring_' + name: ring[:, index] - values[name] for index, name in enumerate(COLORS)}


def _own(place: Array, table: Array, heights: Array) -> Dict[str, Array]:
    """The silhouette, and how yellow it gets, with and without what is as narrow as paint."""
    x, y, w, h = (values[:, None] for values in table[:, AT['left'] : AT['height'] + 1].astype(np.float64).T)
    steps = (np.arange(OWN_CELLS) + 0.5) / OWN_CELLS * (1 + 2 * OWN_GROWN) - OWN_GROWN
    u, v = np.floor(x + w * steps).astype(int), np.floor(y + h * steps).astype(int)
    shown = ((u >= 0) & (u < place.shape[2]))[:, None, :] & ((v >= 0) & (v < place.shape[1]))[:, :, None]
    u = np.broadcast_to(np.clip(u, 0, place.shape[2] - 1)[:, None, :], shown.shape)
    v = np.broadcast_to(np.clip(v, 0, place.shape[1] - 1)[:, :, None], shown.shape)
    channel, first, past = (table[:, AT[name], None, None] for name in ('channel', 'first', 'past'))
    at = place[channel, v, u]
    own = shown & (heights[channel, v, u] > 0) & (at >= first) & (at < past)
    rows = own[:, INSIDE, INSIDE].astype(np.float64)
    widths = own[:, INSIDE].mean(axis=2)
    middles = (rows * np.arange(6)).sum(axis=2) / np.maximum(rows.sum(axis=2), 1)
    peaks = [(heights[which][v, u] * own).max(axis=(1, 2)).astype(np.float64) for which in (YELLOW, WIDE)]
    in_yellow = (table[:, AT['channel']] == YELLOW) | (table[:, AT['channel']] == WIDE)
    columns = {'row%d' % i: widths[:, i] for i in range(6)}
    columns['lean'] = np.abs(middles[:, 0] - middles[:, 5])
    columns['yellow'] = peaks[0]
    columns['narrowness'] = peaks[0] - peaks[1]
    columns['wide'] = peaks[1] - np.where(in_yellow, table[:, AT['level']], 0)
    columns.update(_grid('own', own.reshape(len(own), 5, 2, 5, 2).mean(axis=(2, 4))))
    return columns


def _lines_as_array(lines: Sequence[Line]) -> Array:
    """(L, 7) a, b, c, first and last x, width, blueness."""
    rows = [[line.a, line.b, line.c, *sorted((line.begin, line.end)), line.width, line.blueness] for line in lines]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def _beside_lines(x: Array, y: Array, lines: Array) -> Dict[str, Array]:
    """How far its foot is from the nearest line of tape, how far beyond its seen part, and what tape that is."""
    best = np.full((4, len(x)), NO_LINE)
    for a, b, c, near, far, width, blueness in lines:  # a line across the road begins anywhere
        f = a + b * x + c * (x**2 + y**2) / 2 - y
        distance = np.abs(f) / np.sqrt((b + c * x) ** 2 + (1 - c * y) ** 2)
        beyond = np.maximum(np.maximum(near - x, x - far), 0)
        nearer = distance**2 + beyond**2 < best[0] ** 2 + best[1] ** 2
        best = np.where(nearer, [distance, beyond, np.full(len(x), width), np.full(len(x), blueness)], best)
    return dict(zip(('line_distance', 'line_beyond', 'line_width', 'line_blue'), best))


def _grid_over(table: Array, sums: Array, cells: int, across: float, square: bool) -> Tuple[Array, Array, Array, Array]:
    """First and past columns, first and past rows of cells, (N, cells) each, at least a pixel and in the picture.

    across: of the grid, in box sizes; square: in those of the longer side.
    """
    x, y, w, h = (values[:, None] for values in table[:, AT['left'] : AT['height'] + 1].astype(np.float64).T)
    size = (np.maximum(w, h), np.maximum(w, h)) if square else (w, h)
    steps = (np.arange(cells + 1) / cells - 0.5) * across
    bounds = []
    for low, own, grid, most in ((x, w, size[0], sums.shape[1] - 1), (y, h, size[1], sums.shape[0] - 1)):
        at = np.floor(low + own / 2 + grid * steps + 0.5).astype(int)
        first = np.clip(at[:, :-1], 0, most - 1)
        bounds += [first, np.maximum(np.clip(at[:, 1:], 0, most), first + 1)]
    return bounds[0], bounds[1], bounds[2], bounds[3]


def _means(sums: Array, left: Array, right: Array, top: Array, bottom: Array) -> Array:
    """(N, C, C, SUMS) float64: means over cells, rows first."""
    (left, right), (top, bottom) = (left[:, None], right[:, None]), (top[:, :, None], bottom[:, :, None])
    total = sums[bottom, right] - sums[bottom, left] - sums[top, right] + sums[top, left]
    means: Array = total / ((right - left) * (bottom - top))[..., None]
    return means


def _grid(name: str, values: Array) -> Dict[str, Array]:
    """(N, R, C) to a column a cell."""
    return {'%s%d%d' % (name, i, j): values[:, i, j] for i in range(values.shape[1]) for j in range(values.shape[2])}
