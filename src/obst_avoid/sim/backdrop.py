"""The road and the room as the lens sees them, without the things on it: looked up pixel by pixel with OpenCV.

A software graphics driver takes four times as long for the same. Values are square roots of the signal, see sensor.py.
"""

import functools
import math
from dataclasses import dataclass
from typing import Tuple

import cv2
import numpy as np

from obst_avoid.core.types import Array
from obst_avoid.sim.lens import Lens
from obst_avoid.sim.light import HEADLIGHT_COLOR, Light, ground_light, headlight, mirrored
from obst_avoid.sim.paint import ASPHALT, PIXELS, RED, WHITE, YELLOW, ground_picture
from obst_avoid.sim.room import room_picture
from obst_avoid.sim.town import Town, WorldPose

CELL = 8
"""[px] of the picture: light and glare on the ground are worked out on a grid this coarse."""
LIGHT_CELL, MARGIN = 0.06, 1.0
"""[m] of the ground's brightness map: its cells, and how far it reaches beyond the map."""
WEAKEST_GLARE = 2.0
"""Grey levels below which glare is left out."""
BARE_GLOSS = 40
"""Of asphalt and floor; tape has 255."""

RGB = Tuple[float, float, float]


@dataclass(frozen=True)
class Surfaces:
    """Colours of the ground, linear RGB albedo, and how glossy the tape is."""

    asphalt: RGB = (0.052, 0.052, 0.055)
    white: RGB = (0.74, 0.74, 0.71)
    yellow: RGB = (0.80, 0.50, 0.035)
    red: RGB = (0.50, 0.024, 0.022)
    floor: RGB = (0.20, 0.16, 0.12)


@dataclass(frozen=True, eq=False)
class Backdrop:
    """What stays the same while lens, town and light do.

    samples: (N, W, 2) float32, the road points of every sampled row, band by band, tap by tap, robot frame.
    grid: (rows, columns, 2) float32, the road point of every cell. to_camera: (rows * columns, 3) unit vectors there.
    vignette: (rows, columns, 3) BGR, share of the light that the lens lets through.
    paint: (H, W, 4) uint8 BGR and gloss, first row south. floor: the same beyond the map. brightness: of the ground,
    see ground_light.
    room: panorama, see room.py. mask: (rows, W) uint8 of the rows that show some room, 255 where it is road all the
    same. scale: [px/m] of paint.
    """

    lens: Lens
    light: Light
    samples: Array
    grid: Array
    to_camera: Array
    vignette: Array
    paint: Array
    floor: Tuple[float, float, float, float]
    brightness: Array
    room: Array
    mask: Array
    scale: float


def make_backdrop(lens: Lens, town: Town, surfaces: Surfaces, light: Light, shading: RGB, seed: int) -> Backdrop:
    """Lay out everything that does not move. shading: see renderer.Scene. seed: of texture and room."""
    samples, grid, to_camera, radius = _layout(lens)
    vignette = 1 - radius[..., None] * np.array(shading[::-1], dtype=np.float32)
    size = (
        int((town.size[1] + 2 * MARGIN) / LIGHT_CELL),
        int((town.size[0] + 2 * MARGIN) / LIGHT_CELL),
    )
    red, green, blue = (255 * math.sqrt(value) for value in surfaces.floor)
    paint = _painted(town, surfaces, seed)
    rows = int(np.flatnonzero(~lens.on_ground.all(axis=1)).max(initial=-1)) + 1
    mask = np.where(lens.on_ground[:rows], 255, 0).astype(np.uint8)
    return Backdrop(
        lens, light, samples, grid, to_camera, vignette, paint, (blue, green, red, float(BARE_GLOSS)),
        ground_light(light, size), room_picture(seed), mask, PIXELS / town.tile_size,
    )  # fmt: skip


def brightness_at(backdrop: Backdrop, x: float, y: float) -> float:
    """Brightness of the ground at a point of the world, 1 on the average."""
    rows, columns = backdrop.brightness.shape
    row, column = int((y + MARGIN) / LIGHT_CELL), int((x + MARGIN) / LIGHT_CELL)
    return float(backdrop.brightness[min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)])


def see(backdrop: Backdrop, pose: WorldPose, factors: RGB) -> Array:
    """Road and room from a pose of the robot: (H, W, 3) uint8 BGR. factors: as in Renderer.render."""
    lens, light = backdrop.lens, backdrop.light
    height, width = lens.on_ground.shape
    first = lens.bands[0][0] if lens.bands else height
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    turn = np.array([[cos, -sin, pose.x], [sin, cos, pose.y]])
    matt = np.empty((height, width, 3), dtype=np.uint8)
    last_room = len(backdrop.mask)
    if last_room:
        matt[:last_room] = _room(backdrop, pose.heading)
    if first < height:
        glossy = _road(backdrop, turn)
        road = cv2.cvtColor(glossy, cv2.COLOR_BGRA2BGR)
        if last_room > first:
            cv2.copyTo(road[: last_room - first], backdrop.mask[first:], matt[first:last_room])
        matt[max(first, last_room) :] = road[max(last_room - first, 0) :]
    at = cv2.transform(
        backdrop.grid, (turn + [[0, 0, MARGIN], [0, 0, MARGIN]]) / LIGHT_CELL - [[0, 0, 0.5], [0, 0, 0.5]]
    )
    here = cv2.remap(backdrop.brightness, at, None, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    strength = np.array([light.strength * c * f for c, f in zip(light.color, factors)], dtype=np.float32)[::-1]
    lit = here[..., None] * strength
    if light.headlight:
        own = headlight(light, backdrop.grid[..., 0], backdrop.grid[..., 1])
        lit += own[..., None] * np.array([c * f for c, f in zip(HEADLIGHT_COLOR, factors)], dtype=np.float32)[::-1]
    field = cv2.resize(np.sqrt(lit * backdrop.vignette), (width, height))
    color = cv2.multiply(matt, field, dtype=cv2.CV_32F)
    if first < height:
        glare = mirrored(light, backdrop.to_camera, pose.heading).reshape(here.shape)
        bright = np.flatnonzero(255 * np.sqrt(glare.max(axis=1) * strength.max()) > WEAKEST_GLARE)
        begin, end = (max(bright[0] * CELL - CELL, first), bright[-1] * CELL + 2 * CELL) if len(bright) else (0, 0)
        if end > begin:
            gloss = cv2.cvtColor(cv2.extractChannel(glossy[begin - first : end - first], 3), cv2.COLOR_GRAY2BGR)
            spread = cv2.resize(np.sqrt(glare[..., None] * backdrop.vignette * strength), (width, height))[begin:end]
            color[begin:end] = cv2.magnitude(color[begin:end], cv2.multiply(gloss, spread, dtype=cv2.CV_32F))
    picture: Array = cv2.convertScaleAbs(color)
    return picture


def _room(backdrop: Backdrop, heading: float) -> Array:
    lens = backdrop.lens
    rows = len(backdrop.mask)
    size = backdrop.room.shape
    scale = size[1] / (2 * math.pi)
    at = cv2.transform(
        lens.room[:rows], np.array([[scale, 0, (heading % (2 * math.pi)) * scale], [0, scale, size[0] / 2]])
    )
    room: Array = cv2.remap(backdrop.room, at, None, cv2.INTER_LINEAR, None, cv2.BORDER_WRAP)
    return room


def _road(backdrop: Backdrop, turn: Array) -> Array:
    """The ground's paint and gloss from the first row of road on: (H', W, 4) uint8."""
    pixels = cv2.transform(backdrop.samples, turn * backdrop.scale - [[0, 0, 0.5], [0, 0, 0.5]])
    sampled = cv2.remap(backdrop.paint, pixels, None, cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, backdrop.floor)
    parts, row = [], 0
    for begin, end, taps in backdrop.lens.bands:
        rows = end - begin
        band = [sampled[row + tap * rows : row + (tap + 1) * rows] for tap in range(taps)]
        while len(band) > 1:
            band = [cv2.addWeighted(one, 0.5, other, 0.5, 0) for one, other in zip(band[::2], band[1::2])]
        parts.append(band[0])
        row += rows * taps
    road: Array = np.concatenate(parts)
    return road


@functools.lru_cache(maxsize=4)
def _layout(lens: Lens) -> Tuple[Array, Array, Array, Array]:
    """samples, grid and to_camera of a Backdrop, and (rows, columns) squared distances of its cells from the middle."""
    height, width = lens.on_ground.shape
    rows = []
    for begin, end, taps in lens.bands:
        for tap in range(taps):  # spread over a pixel's height, which reaches half way to its neighbours
            share = (tap + 0.5) / taps - 0.5
            for row in range(begin, end):
                below = lens.ground[min(row + 1, height - 1)]
                above = lens.ground[max(row - 1, 0)]
                other = below if share > 0 else above
                usable = (other != 0).any(axis=1, keepdims=True)
                rows.append(
                    np.where(usable, lens.ground[row] + abs(share) * (other - lens.ground[row]), lens.ground[row])
                )
    samples = np.array(rows, dtype=np.float32) if rows else np.zeros((0, width, 2), dtype=np.float32)
    v = np.minimum((np.arange(math.ceil(height / CELL)) + 0.5) * CELL, height - 1).astype(int)
    u = np.minimum((np.arange(math.ceil(width / CELL)) + 0.5) * CELL, width - 1).astype(int)
    grid = np.ascontiguousarray(lens.ground[v][:, u])
    to_camera = lens.eye - np.concatenate([grid, np.zeros_like(grid[..., :1])], axis=2).reshape(-1, 3)
    to_camera /= np.linalg.norm(to_camera, axis=1)[:, None]
    radius = ((u[None, :] + 0.5) / width - 0.5) ** 2 + ((v[:, None] + 0.5) / height - 0.5) ** 2
    return samples, grid, to_camera, radius.astype(np.float32)


@functools.lru_cache(maxsize=2)
def _painted(town: Town, surfaces: Surfaces, seed: int) -> Array:
    """The paint of a Backdrop, as square roots."""
    ground = ground_picture(town, seed)[::-1]
    shares = [np.ascontiguousarray(ground[..., channel]) for channel in (WHITE, YELLOW, RED)]
    texture = np.ascontiguousarray(ground[..., ASPHALT])
    levels = np.arange(256) / 128.0
    channels = []
    for channel in (2, 1, 0):
        shade = np.sqrt(np.clip(surfaces.asphalt[channel] * levels, 0, 1))
        value = cv2.LUT(texture, np.rint(255 * shade).astype(np.uint8))
        for share, albedo in zip(shares, (surfaces.white, surfaces.yellow, surfaces.red)):
            bare = cv2.multiply(value, 255 - share, scale=1 / 255)
            value = cv2.add(bare, cv2.convertScaleAbs(share, alpha=math.sqrt(albedo[channel])))
        channels.append(value)
    channels.append(np.maximum.reduce([*shares, np.full_like(texture, BARE_GLOSS)]))
    painted: Array = cv2.merge(channels)
    return painted
