"""The town's ground as one picture of materials, drawn from its tiles once."""

import functools
import math
from typing import List, Tuple

import cv2
import numpy as np

from obst_avoid.core.types import Array
from obst_avoid.sim.town import DASH, RED_WIDTH, ROADS, WHITE_WIDTH, YELLOW_WIDTH, Town

PIXELS = 512
"""[px] of a tile's side, 1.1 mm each; the ground one camera pixel shows is larger from 0.15 m on."""
OVERSAMPLING = 4
WHITE, YELLOW, RED, ASPHALT = 0, 1, 2, 3
"""Channels: share of each pixel that is this paint, 0 to 255; last the asphalt's brightness, 128 is its mean."""

_Line = Tuple[int, Array]


@functools.lru_cache(maxsize=2)
def ground_picture(town: Town, seed: int) -> Array:
    """(rows * PIXELS, columns * PIXELS, 4) uint8, first row north. seed: of texture and wear."""
    rows, columns = len(town.tiles), len(town.tiles[0])
    picture = np.zeros((rows * PIXELS, columns * PIXELS, 4), dtype=np.uint8)
    for row, tiles in enumerate(town.tiles):
        for column, tile in enumerate(tiles):
            cell = picture[row * PIXELS : (row + 1) * PIXELS, column * PIXELS : (column + 1) * PIXELS]
            cell[...] = _tile(tile, town.tile_size, town.lane_width, DASH if town.dashed else 1.0)
    random = np.random.RandomState(seed)
    wear = _cloud(random, picture.shape[:2], (3, 24, 150))
    scratches = np.clip(2.3 + 1.0 * wear, 0.25, 1)  # of the paint, a tenth is worn
    for channel in (WHITE, YELLOW, RED):
        picture[..., channel] = (picture[..., channel] * scratches).astype(np.uint8)
    texture = 34 * _cloud(random, picture.shape[:2], (1, 2, 5, 60, 400)) + 128.0
    picture[..., ASPHALT] = np.clip(texture, 0, 255).astype(np.uint8)
    for edge in list(range(0, rows * PIXELS, PIXELS)):
        picture[max(edge - 1, 0) : edge + 1, :, ASPHALT] = 60
    for edge in list(range(0, columns * PIXELS, PIXELS)):
        picture[:, max(edge - 1, 0) : edge + 1, ASPHALT] = 60
    picture.setflags(write=False)
    return picture


def on_road(town: Town) -> Array:
    """(rows, columns) bool, first row north: which tiles have a road."""
    return np.array([[bool(ROADS[tile]) for tile in row] for row in town.tiles])


@functools.lru_cache(maxsize=32)
def _tile(tile: str, size: float, lane_width: float, dash: float) -> Array:
    """(PIXELS, PIXELS, 4) uint8: one tile's paint."""
    fine = PIXELS * OVERSAMPLING
    cell = np.zeros((PIXELS, PIXELS, 4), dtype=np.uint8)
    for channel in (WHITE, YELLOW, RED):
        mask = np.zeros((fine, fine), dtype=np.uint8)
        for kind, outline in _lines(tile, size, lane_width, dash):
            if kind == channel:
                points = np.column_stack([outline[:, 0] / size, 1 - outline[:, 1] / size]) * fine - 0.5
                cv2.fillPoly(mask, [np.rint(points * 16).astype(np.int32)], 255, shift=4)
        thin = cv2.erode(mask, np.ones((3, 3), dtype=np.uint8))  # cv2 fills what the outline touches too
        even = cv2.addWeighted(mask, 0.5, thin, 0.5, 0)
        cell[..., channel] = cv2.resize(even, (PIXELS, PIXELS), interpolation=cv2.INTER_AREA)
    return cell


def _lines(tile: str, size: float, lane: float, dash: float) -> List[_Line]:
    """Outlines of a tile's paint, (N, 2) in m from its south-west corner. dash: share of the yellow line's period."""
    roads = ROADS[tile]
    inner = YELLOW_WIDTH / 2 + lane
    half = size / 2
    lines: List[_Line] = []

    def add(kind: int, outline: Array, quarters: int) -> None:
        turned = _turn(np.asarray(outline, dtype=np.float64) - half, quarters) + half
        lines.append((kind, turned))

    quarters_of = {'E': 0, 'N': 1, 'W': 2, 'S': 3}
    if len(roads) == 2 and roads in ('EW', 'NS'):
        turn = quarters_of[roads[0]]
        for y in (half + inner, half - inner - WHITE_WIDTH):
            add(WHITE, _box(0, y, size, y + WHITE_WIDTH), turn)
        period = size / round(size / 0.075)
        for index in range(int(round(size / period))):
            begin = (index + (1 - dash) / 2) * period
            add(YELLOW, _box(begin, half - YELLOW_WIDTH / 2, begin + dash * period, half + YELLOW_WIDTH / 2), turn)
    elif len(roads) == 2:  # about the corner between the two roads; drawn for east and north
        turn = {'EN': 0, 'NW': 1, 'SW': 2, 'ES': 3}[roads]
        corner = np.array([size, size])
        for radius in (half - inner - WHITE_WIDTH, half + inner):
            add(WHITE, corner + _ring(radius, radius + WHITE_WIDTH, math.pi, 1.5 * math.pi), turn)
        count = round(half * math.pi / 2 / 0.075)
        for index in range(count):
            begin = math.pi + math.pi / 2 * (index + (1 - dash) / 2) / count
            ring = _ring(half - YELLOW_WIDTH / 2, half + YELLOW_WIDTH / 2, begin, begin + math.pi / 2 * dash / count)
            add(YELLOW, corner + ring, turn)
    elif len(roads) > 2:
        reach = half - inner - WHITE_WIDTH
        for side in 'ENWS':
            turn = quarters_of[side]
            if side not in roads:
                add(WHITE, _box(half + inner, 0, half + inner + WHITE_WIDTH, size), turn)
                continue
            # who enters over the east side keeps to the north of the road's middle
            add(RED, _box(size - RED_WIDTH, half + YELLOW_WIDTH / 2, size, half + inner), turn)
            for y in (half + inner, half - inner - WHITE_WIDTH):
                add(WHITE, _box(size - reach - WHITE_WIDTH, y, size, y + WHITE_WIDTH), turn)
    return lines


def _box(x0: float, y0: float, x1: float, y1: float) -> Array:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _ring(inner: float, outer: float, begin: float, end: float) -> Array:
    angles = np.linspace(begin, end, 33)
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    return np.concatenate([inner * around, outer * around[::-1]])


def _turn(points: Array, quarters: int) -> Array:
    for _ in range(quarters):
        points = np.column_stack([-points[:, 1], points[:, 0]])
    return points


def _cloud(random: 'np.random.RandomState', shape: Tuple[int, ...], scales: Tuple[int, ...]) -> Array:
    """(H, W) float32 noise with features of the given sizes in pixels, mean 0 and about 1 high."""
    cloud = np.zeros(shape, dtype=np.float32)
    for scale in scales:
        small = random.standard_normal((shape[0] // scale + 2, shape[1] // scale + 2)).astype(np.float32)
        cloud += cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    cloud /= math.sqrt(len(scales))
    return cloud
