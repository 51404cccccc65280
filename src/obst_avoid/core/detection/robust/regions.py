"""Regions that may be things: connected components of every channel at every level at once.

No threshold fits every light, so all of them are tried: what stands out from its surroundings is a component at some
level, between the level where it melts into them and the one where it falls apart (a component tree, Najman and
Couprie 2006; maximally stable regions, Matas et al. 2002). A component that stays the same over several levels is one
region.
"""

from dataclasses import dataclass
from typing import Dict, List

import cv2
import numpy as np

from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.robust.channels import CHANNELS, Channels
from obst_avoid.core.detection.robust.view import View
from obst_avoid.core.types import Array

SMALLEST, WIDEST, SLIMMEST, FLATTEST = 8, 120, 4.0, 3.5
"""[px] area, [px] width, height to width, width to height, of a region in the working picture."""
COLUMNS = (
    ['channel', 'level', 'since', 'left', 'top', 'width', 'height', 'area', 'sum_u', 'sum_v']
    + ['brightness', 'green', 'blue', 'first', 'past', 'part']
    + [who + what for who in ('parent_', 'double_') for what in ('level', 'left', 'top', 'width', 'height', 'area')]
)
"""Of Regions.table."""
AT = {name: index for index, name in enumerate(COLUMNS)}


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Regions:
    """N regions of one picture.

    table: (N, len(COLUMNS)) int32. channel; level: the highest at which it is this region; since: the highest below
    at which it is part of a larger one; left, top, width, height, sum_u, sum_v: [px] from view.top down; brightness,
    green, blue: sums of channels.COLORS; first, past: its pixels' numbers in place; part: area of the largest region
    in it; parent: of the next larger region; double: of the smallest one at least twice as large; -1 where there is
    none. place: (7, R, W) int32, for each channel numbers in which all pixels of a region follow each other; only
    where heights are above 0.
    """

    table: Array
    place: Array
    top: int

    def __len__(self) -> int:
        return len(self.table)

    @property
    def box(self) -> Array:
        """(N, 4) float64 left, top, width, height in the working picture."""
        box: Array = self.table[:, AT['left'] : AT['height'] + 1].astype(np.float64)
        box[:, 1] += self.top
        return box


def find_regions(channels: Channels, view: View) -> Regions:
    """All regions of one picture that may be looked at."""
    lowest = view.foot - view.top
    limits = SMALLEST, WIDEST, round(2 * SLIMMEST), round(2 * FLATTEST), lowest
    found = native.regions(channels.heights, channels.sums, CHANNELS, limits, len(COLUMNS))
    if found is not None:
        return Regions(found[0], found[1], view.top)
    place = np.full((CHANNELS,) + channels.heights.shape[1:], -1, dtype=np.int32)
    table = np.concatenate([_tree(channels, channel, place[channel]) for channel in range(CHANNELS)])
    return Regions(table[_good(table, lowest)], place, view.top)


def _good(table: Array, lowest: int) -> Array:
    """Which rows have a thing's form and a foot that is near enough."""
    w, h = table[:, AT['width']], table[:, AT['height']]
    good: Array = (w < FLATTEST * h) & (h < SLIMMEST * w) & (w < WIDEST) & (table[:, AT['top']] + h > lowest)
    return good


def _tree(channels: Channels, channel: int, place: Array) -> Array:
    """All rows of one channel, larger regions before their parts; fills place, (R, W)."""
    height = channels.heights[channel]
    node_of = np.full(height.shape, -1)
    nodes: List[Dict[str, int]] = []
    parents: List[int] = []
    for level in range(1, int(height.max()) + 1):
        _, labels, stats, _ = cv2.connectedComponentsWithStats((height >= level).view(np.uint8), connectivity=4)
        above = np.empty(len(stats), dtype=int)
        above[labels.ravel()] = node_of.ravel()
        ids = np.full(len(stats), -1)
        for label in np.flatnonzero(stats[:, 4] >= SMALLEST):
            if not label:
                continue  # what is outside
            parent, area = int(above[label]), int(stats[label, 4])
            if parent >= 0 and nodes[parent]['area'] == area:
                ids[label] = parent
                nodes[parent]['level'] = level
                continue
            ids[label] = len(nodes)
            names = 'left', 'top', 'width', 'height', 'area'
            nodes.append(dict(zip(names, map(int, stats[label])), level=level))
            parents.append(parent)
        here = ids[labels]
        node_of = np.where(here >= 0, here, node_of)
    return _table(channels, channel, nodes, parents, node_of, place)


def _table(
    channels: Channels, channel: int, nodes: List[Dict[str, int]], parents: List[int], node_of: Array, place: Array
) -> Array:
    count = len(nodes)
    table = np.full((count, len(COLUMNS)), -1, dtype=np.int32)
    inside = node_of >= 0
    v, u = np.nonzero(inside)
    numbers = np.zeros((count, 5), dtype=np.int64)
    planes = np.diff(np.diff(channels.sums[..., :3].astype(np.int64), axis=0), axis=1)
    np.add.at(numbers, node_of[inside], np.column_stack([u, v, planes[inside]]))
    sizes, parts = np.ones(count, dtype=int), np.zeros(count, dtype=int)
    for index in range(count - 1, -1, -1):
        if parents[index] >= 0:
            numbers[parents[index]] += numbers[index]
            sizes[parents[index]] += sizes[index]
            parts[parents[index]] = max(parts[parents[index]], nodes[index]['area'])
    firsts = np.zeros(count, dtype=int)
    free, roots = np.zeros(count, dtype=int), 0
    for index, (node, parent) in enumerate(zip(nodes, parents)):
        firsts[index] = roots if parent < 0 else free[parent]
        free[index] = firsts[index] + 1
        if parent < 0:
            roots += sizes[index]
        else:
            free[parent] += sizes[index]
        double = parent
        while double >= 0 and nodes[double]['area'] < 2 * node['area']:
            double = parents[double]
        row = dict(node, channel=channel, since=0 if parent < 0 else nodes[parent]['level'])
        row.update(zip(('sum_u', 'sum_v', 'brightness', 'green', 'blue'), numbers[index].tolist()))
        row.update(first=int(firsts[index]), past=int(firsts[index] + sizes[index]), part=int(parts[index]))
        for who, other in (('parent_', parent), ('double_', double)):
            if other >= 0:
                row.update({who + name: value for name, value in nodes[other].items()})
        for name, value in row.items():
            table[index, AT[name]] = value
    place[inside] = firsts[node_of[inside]]
    return table
