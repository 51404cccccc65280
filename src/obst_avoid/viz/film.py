"""One picture of a film: what the camera saw, the bird view, the map, and what was decided."""

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.bird_view import BirdView, crop, warp
from obst_avoid.core.types import Array, Decision, Obstacle
from obst_avoid.viz.overlay import (
    FONT,
    INSIDE,
    OUTSIDE,
    SHADE,
    STATE_COLORS,
    TEXT,
    draw_on_bird_view,
    draw_on_picture,
    draw_plan_on_bird_view,
    draw_plan_on_picture,
    label,
)

SIZE = (1120, 640)
"""[px] width, height of the film."""
ROBOT, PATH = (230, 120, 40), (80, 220, 255)
AHEAD, BEHIND, HALF = 0.066, 0.114, 0.075
"""[m] of the robot that is drawn."""


@dataclass(frozen=True, eq=False)
class Map:
    """The town from above. picture: (H, W, 3) uint8 BGR, north up. pixels_per_metre: [px/m]. Origin: lower left."""

    picture: Array
    pixels_per_metre: float

    def pixel(self, x: float, y: float) -> Tuple[int, int]:
        """Where a point of the world, m, is drawn."""
        return int(round(x * self.pixels_per_metre)), int(round(self.picture.shape[0] - y * self.pixels_per_metre))


@dataclass(frozen=True, eq=False)
class Shot:
    """What one picture of the film shows. time: [s]. picture: (H, W, 3) uint8 BGR. speed: [m/s] as commanded.

    pose: x, y [m], heading [rad] in the world, where it is known. standing: the obstacles that are there, in truth:
    x and y [m] in the world, and whether it stands in the lane. plan: the decision's, from where the robot was when the
    picture was taken; None: nobody knows it.
    """

    time: float
    picture: Array
    obstacles: Sequence[Obstacle]
    decision: Decision
    speed: float
    pose: Optional[Tuple[float, float, float]] = None
    standing: Sequence[Tuple[float, float, Optional[bool]]] = ()
    plan: Optional[View] = None


def compose(shot: Shot, view: BirdView, town: Optional[Map], path: Sequence[Tuple[float, float]], title: str) -> Array:
    """(640, 1120, 3) uint8. path: where the robot has been, x and y in the world, m."""
    canvas = np.full((SIZE[1], SIZE[0], 3), SHADE, dtype=np.uint8)
    left, right = 640, SIZE[0] - 640
    picture, bird = shot.picture, warp(crop(shot.picture, view), view)
    if shot.plan is not None:
        picture = draw_plan_on_picture(picture, shot.plan, shot.decision.state, view)
        bird = draw_plan_on_bird_view(bird, shot.plan, shot.decision.state, view)
    _paste(canvas, draw_on_picture(picture, shot.obstacles, view), (0, 0, left, 480))
    bird = draw_on_bird_view(bird, shot.obstacles)
    height = min(round(bird.shape[0] * right / bird.shape[1]), 300)
    _paste(canvas, bird, (left, 0, right, height))
    label(canvas, 'from above, as the robot works it out', (left, 0), SHADE, 0.45)
    if town is not None:
        _paste(canvas, _drawn_map(town, shot, path), (left, height + 6, right, SIZE[1] - height - 6))
    color = STATE_COLORS[shot.decision.state]
    cv2.rectangle(canvas, (0, 480), (left, 516), color, -1)
    _words(canvas, shot.decision.state.name, (10, 506), 0.8)
    _words(canvas, '%.1f s   %.2f m/s' % (shot.time, shot.speed), (left - 210, 504), 0.6)
    for index, line in enumerate(_wrapped(shot.decision.reason, 66)[:2]):
        _words(canvas, line, (10, 544 + 24 * index), 0.55)
    inside = sum(obstacle.in_lane is not False for obstacle in shot.obstacles)
    count = '%d in the lane (red), %d outside (green)' % (inside, len(shot.obstacles) - inside)
    _words(canvas, 'sees %s' % count, (10, 598), 0.5)
    _words(canvas, title, (10, 626), 0.5)
    return canvas


def shrunk_map(picture: Array, pixels_per_metre: float, longest: int = 900) -> Map:
    """A map for films from one of any size."""
    scale = min(1.0, longest / max(picture.shape[:2]))
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return Map(small, pixels_per_metre * scale)


def _drawn_map(town: Map, shot: Shot, path: Sequence[Tuple[float, float]]) -> Array:
    drawn = town.picture.copy()
    unit = max(1, round(town.pixels_per_metre / 90))
    if len(path) > 1:
        points = np.array([town.pixel(x, y) for x, y in path], dtype=np.int32)
        cv2.polylines(drawn, [points.reshape(-1, 1, 2)], False, PATH, 2 * unit, cv2.LINE_AA)
    for x, y, inside in shot.standing:
        cv2.circle(drawn, town.pixel(x, y), 5 * unit, OUTSIDE if inside is False else INSIDE, -1, cv2.LINE_AA)
    if shot.pose is not None:
        x, y, heading = shot.pose
        corners = [(AHEAD, HALF), (AHEAD, -HALF), (-BEHIND, -HALF), (-BEHIND, HALF)]
        cos, sin = math.cos(heading), math.sin(heading)
        body = [town.pixel(x + cos * a - sin * b, y + sin * a + cos * b) for a, b in corners]
        cv2.fillPoly(drawn, [np.array(body, dtype=np.int32)], ROBOT, cv2.LINE_AA)
        nose = town.pixel(x + cos * 0.16, y + sin * 0.16)
        cv2.line(drawn, town.pixel(x, y), nose, TEXT, unit, cv2.LINE_AA)
    return drawn


def _paste(canvas: Array, picture: Array, where: Tuple[int, int, int, int]) -> None:
    """Fit a picture into a box (left, top, width, height) without stretching it."""
    left, top, width, height = where
    scale = min(width / picture.shape[1], height / picture.shape[0])
    size = (max(1, int(picture.shape[1] * scale)), max(1, int(picture.shape[0] * scale)))
    if size != (picture.shape[1], picture.shape[0]):
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
    x, y = left + (width - size[0]) // 2, top + (height - size[1]) // 2
    canvas[y : y + size[1], x : x + size[0]] = picture


def _words(canvas: Array, words: str, at: Tuple[int, int], size: float) -> None:
    cv2.putText(canvas, words, at, FONT, size, TEXT, 1, cv2.LINE_AA)


def _wrapped(words: str, width: int) -> List[str]:
    lines = ['']
    for word in words.split():
        if len(lines[-1]) + len(word) >= width:
            lines.append('')
        lines[-1] = (lines[-1] + ' ' + word).strip()
    return lines
