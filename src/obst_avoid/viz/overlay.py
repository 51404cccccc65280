"""Obstacles, and what the avoider makes of them, on the camera picture and on the bird view."""

import math
from typing import Callable, Optional, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.bird_view import BirdView, bird_from_ground, image_from_bird
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from obst_avoid.core.types import Array, Box, Obstacle, State

INSIDE, OUTSIDE, UNKNOWN = (40, 40, 230), (60, 190, 60), (0, 165, 255)
"""BGR: red what counts, green what does not, as in rviz."""
TEXT, SHADE = (255, 255, 255), (30, 30, 30)
FONT = cv2.FONT_HERSHEY_SIMPLEX
STATE_COLORS = {
    State.CLEAR: (80, 160, 60), State.SLOWING: (0, 165, 255), State.AVOIDING: (200, 130, 30),
    State.STOPPED: (40, 40, 220), State.FAULT: (130, 50, 150),
}  # fmt: skip
WAY = (255, 255, 120)
"""BGR of the path chosen."""
CORRIDOR_SHARE, FOOT_SHARE = 0.2, 0.5
"""Of the colour in the corridor's ground and in the foot of the obstacle that decides."""
STEP = 0.02
"""[m] between two points of a line on the road: the lens bends what is straight."""
FARTHEST = 100.0
"""[m] beyond which no point is drawn."""
SHIFT = 3
"""Bits of a pixel's fraction that OpenCV draws with."""


def draw_on_picture(picture: Array, obstacles: Sequence[Obstacle], view: BirdView) -> Array:
    """A copy of the camera picture, (H, W, 3) uint8, with a box and a label on each obstacle."""
    drawn = picture.copy()
    unit = _unit(picture)
    for obstacle in obstacles:
        box = _picture_box(obstacle, view)
        if box is None:
            continue
        color = _color(obstacle)
        corners = ((round(box.left), round(box.top)), (round(box.right) - 1, round(box.bottom) - 1))
        cv2.rectangle(drawn, corners[0], corners[1], color, max(1, round(2 * unit)))
    for obstacle in obstacles:  # labels last, so that no box crosses them
        box = _picture_box(obstacle, view)
        if box is not None:
            label(drawn, _words(obstacle), (box.left, box.top), _color(obstacle), 0.45 * unit)
    return drawn


def draw_on_bird_view(bird: Array, obstacles: Sequence[Obstacle]) -> Array:
    """A copy of the bird view, (H, W, 3) uint8, with each obstacle's box, its foot, and a label."""
    drawn = bird.copy()
    for obstacle in obstacles:
        box = obstacle.bird_box
        if box is None:
            continue
        color = _color(obstacle)
        left, top, right, bottom = (int(round(value)) for value in (box.left, box.top, box.right - 1, box.bottom - 1))
        cv2.rectangle(drawn, (left, top), (right, bottom), color, 1)
        cv2.circle(drawn, ((left + right) // 2, bottom), 3, color, -1)
        label(drawn, _words(obstacle), (left, top), color, 0.4)
    return drawn


def draw_plan_on_picture(picture: Array, plan: View, state: State, view: BirdView) -> Array:
    """A copy of the camera picture, (H, W, 3) uint8, with the corridor in the state's colour, the path, and the foot of
    the obstacle that decides; as far as they lie in what the bird view is made of.
    """

    def pixels(ground: Array) -> Array:
        return image_from_rectified(view.calibration, pixel_from_ground(view.calibration.homography, ground))

    return _with_plan(picture, plan, state, pixels, _seen_ground(view))


def draw_plan_on_bird_view(bird: Array, plan: View, state: State, view: BirdView) -> Array:
    """A copy of the bird view, (H, W, 3) uint8, with the same."""

    def pixels(ground: Array) -> Array:
        return bird_from_ground(view, ground)

    return _with_plan(bird, plan, state, pixels, _seen_ground(view))


def label(picture: Array, words: str, at: Tuple[float, float], color: Tuple[int, int, int], size: float) -> None:
    """Write words above a point, in place, on a filled ground so that they stay legible, inside the picture."""
    words = _in_letters(words)
    (width, height), base = cv2.getTextSize(words, FONT, size, 1)
    left = int(min(max(at[0], 0), max(picture.shape[1] - width - 4, 0)))
    bottom = int(min(max(at[1] - 2, height + base + 2), picture.shape[0] - 2))
    cv2.rectangle(picture, (left, bottom - height - base - 2), (left + width + 4, bottom), color, -1)
    cv2.putText(picture, words, (left + 2, bottom - base), FONT, size, TEXT, 1, cv2.LINE_AA)


def banner(picture: Array, words: str, color: Tuple[int, int, int] = SHADE) -> Array:
    """A copy with one line of words along the lower edge."""
    drawn = picture.copy()
    size = 0.5 * _unit(picture)
    (_, height), base = cv2.getTextSize(words, FONT, size, 1)
    cv2.rectangle(drawn, (0, drawn.shape[0] - height - base - 6), (drawn.shape[1], drawn.shape[0]), color, -1)
    cv2.putText(drawn, words, (4, drawn.shape[0] - base - 3), FONT, size, TEXT, 1, cv2.LINE_AA)
    return drawn


def contact_sheet(panels: Sequence[Tuple[str, Array]], columns: int = 4, width: int = 320) -> Array:
    """Pictures side by side, each scaled to width [px] and titled. panels: (title, (H, W) or (H, W, 3) uint8).

    Raises ValueError without panels.
    """
    if not panels:
        raise ValueError('no picture for a contact sheet, expected at least one')
    cells = []
    for title, picture in panels:
        color = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) if picture.ndim == 2 else picture
        height = max(1, round(color.shape[0] * width / color.shape[1]))
        shrinks = width < color.shape[1]
        cell = cv2.resize(color, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        cell = cv2.copyMakeBorder(cell, 20, 4, 2, 2, cv2.BORDER_CONSTANT, value=SHADE)
        cv2.putText(cell, _in_letters(title), (4, 14), FONT, 0.42, TEXT, 1, cv2.LINE_AA)
        cells.append(cell)
    columns = min(columns, len(cells))
    rows = []
    for first in range(0, len(cells), columns):
        row = cells[first : first + columns]
        height = max(cell.shape[0] for cell in row)
        row += [np.full((1, width + 4, 3), SHADE, dtype=np.uint8)] * (columns - len(row))
        padded = [
            cv2.copyMakeBorder(cell, 0, height - cell.shape[0], 0, 0, cv2.BORDER_CONSTANT, value=SHADE) for cell in row
        ]
        rows.append(np.hstack(padded))
    sheet: Array = np.vstack(rows)
    return sheet


def _with_plan(picture: Array, plan: View, state: State, pixels: Callable[[Array], Array], sides: Array) -> Array:
    """pixels: of ground points in the picture. sides: of the ground that is drawn on, as of _cut."""
    drawn = picture.copy()
    color, thin = STATE_COLORS[state], max(1, round(_unit(picture)))
    region, way, foot = _dense(plan.region), _dense(plan.way), _outline(plan.deciding)
    parts = [_dense(_cut(region, sides)), _dense(_cut(foot, sides))]  # a side is straight on the road only
    parts += [_pieces(line, sides) for line in (region, foot, way)]
    ground = np.concatenate(parts)
    if len(ground):  # OpenCV projects no empty array
        ends = np.cumsum([len(part) for part in parts])[:-1]
        corridor, stand, edge, rim, chosen = np.split(pixels(ground), ends)
        _blend(drawn, corridor, color, CORRIDOR_SHARE)
        _blend(drawn, stand, color, FOOT_SHARE)
        _lines(drawn, edge, color, thin)
        _lines(drawn, rim, color, thin)
        _lines(drawn, chosen, SHADE, 3 * thin)
        _lines(drawn, chosen, WAY, thin)
    return drawn


def _outline(foot: Optional[Tuple[float, float, float]]) -> Array:
    """(N, 2) [m] points around a footprint x, y, radius; (0, 2) around none."""
    if foot is None:
        return np.empty((0, 2))
    x, y, radius = np.clip(foot, -FARTHEST, FARTHEST)
    angles = np.linspace(0, 2 * math.pi, 33)
    return np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])


def _seen_ground(view: BirdView) -> Array:
    """The sides, as of _cut, of the ground that the bird view shows: inside the cropped picture, and so before the
    camera, since 0 <= u <= right w only where w >= 0.
    """
    u, v, w = np.linalg.inv(view.calibration.homography)
    right, low = view.calibration.width - 1, view.calibration.height - 1
    sides: Array = np.array([u, right * w - u, v - view.crop_row * w, low * w - v])
    return sides


def _dense(points: Array) -> Array:
    """A line's points and more between them. (N, 2) to (M, 2), both in m."""
    points = np.clip(np.asarray(points, dtype=np.float64).reshape(-1, 2), -FARTHEST, FARTHEST)
    if len(points) < 2:
        return points[:0]
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    steps = np.linspace(0, ends[-1], min(int(ends[-1] / STEP) + 2, 1000))
    at = np.union1d(ends, steps)
    dense: Array = np.column_stack([np.interp(at, ends, points[:, 0]), np.interp(at, ends, points[:, 1])])
    return dense


def _cut(points: Array, sides: Array) -> Array:
    """What of an area lies inside all sides (Sutherland and Hodgman 1974).

    points: (N, 2) around it, in m. sides: (S, 3), a x + b y + c >= 0 inside. Returns (M, 2), closed; (0, 2) when
    nothing is left.
    """
    for side in sides:
        inside = points @ side[:2] + side[2]
        if (inside >= 0).all():
            continue
        after = np.roll(inside, -1)
        crosses = (inside >= 0) != (after >= 0)
        share = inside / np.where(crosses, inside - after, 1.0)
        crossings = points + share[:, np.newaxis] * (np.roll(points, -1, axis=0) - points)
        both = np.stack([points, crossings], axis=1).reshape(-1, 2)
        points = both[np.stack([inside >= 0, crosses], axis=1).ravel()]
    return np.concatenate([points, points[:1]])


def _pieces(points: Array, sides: Array) -> Array:
    """What of a line lies inside all sides, as of _cut: the ends of its pieces, (2 M, 2), a piece two points."""
    first, inside = points[:-1], points @ sides[:, :2].T + sides[:, 2]
    here, there = inside[:-1], inside[1:]
    crossing = here / np.where((here >= 0) != (there >= 0), here - there, 1.0)
    begin = np.where(here >= 0, 0.0, np.where(there >= 0, crossing, 2.0)).max(axis=1)
    end = np.where(there >= 0, 1.0, crossing).min(axis=1)
    shares = np.stack([begin, end], axis=1)[begin < end]
    steps = np.diff(points, axis=0)[begin < end]
    pieces: Array = first[begin < end][:, np.newaxis] + shares[:, :, np.newaxis] * steps[:, np.newaxis]
    return pieces.reshape(-1, 2)


def _blend(drawn: Array, pixels: Array, color: Tuple[int, int, int], share: float) -> None:
    """Lay a colour over an area, in place, so that the picture shines through. pixels: (N, 2) around it."""
    if len(pixels) < 3:
        return
    limit = (drawn.shape[1], drawn.shape[0])
    left, top = np.clip(np.floor(pixels.min(axis=0)), 0, limit).astype(int)
    right, bottom = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, limit).astype(int)
    part = drawn[top:bottom, left:right]
    if part.size:
        painted = part.copy()
        cv2.fillPoly(painted, [_fractions(pixels - (left, top))], color, cv2.LINE_8, SHIFT)
        cv2.addWeighted(painted, share, part, 1 - share, 0, part)


def _lines(drawn: Array, pixels: Array, color: Tuple[int, int, int], width: int) -> None:
    """Draw pieces of a line, in place. pixels: (2 M, 2), a piece two points."""
    if len(pixels):
        cv2.polylines(drawn, list(_fractions(pixels).reshape(-1, 2, 2)), False, color, width, cv2.LINE_AA, SHIFT)


def _fractions(pixels: Array) -> Array:
    """(N, 2) int32 as OpenCV draws with fractions of pixels; what is far outside stays outside."""
    rounded: Array = np.round(np.clip(pixels, -8000, 8000) * 2**SHIFT).astype(np.int32)
    return rounded


def _in_letters(words: str) -> str:
    """With a ? for what the font does not have; a file name that is not UTF-8 would end the process."""
    return words.encode('ascii', 'replace').decode()


def _unit(picture: Array) -> float:
    """Of lengths and letters: 1 in a picture 640 pixels wide."""
    return float(max(picture.shape[1] / 640, 0.5))


def _color(obstacle: Obstacle) -> Tuple[int, int, int]:
    return UNKNOWN if obstacle.in_lane is None else INSIDE if obstacle.in_lane else OUTSIDE


def _words(obstacle: Obstacle) -> str:
    kind = '' if obstacle.kind is None else obstacle.kind.value + ' '
    return '%s%.2f m' % (kind, float(np.hypot(obstacle.x, obstacle.y)))


def _picture_box(obstacle: Obstacle, view: BirdView) -> Optional[Box]:
    """The obstacle's own box, or what its bird view box says of it in the picture when only that is known.

    An upright thing's sides are columns of the picture and rays of the bird view. Its box there touches each ray at
    one end only; at the other end the box is wider than the thing. So of a side's two corners the inner one counts.
    """
    if obstacle.image_box is not None or obstacle.bird_box is None:
        return obstacle.image_box
    box = obstacle.bird_box
    if box.top >= view.height:  # remembered, out of sight before the bumper
        return None
    bottom = min(box.bottom, view.height)
    corners = np.array([[u, v] for u in (box.left, box.right - 1) for v in (box.top, bottom - 1)])
    points = np.clip(image_from_bird(view, corners), 0, (view.calibration.width, view.calibration.height))
    left, right = points[:2, 0].max(), points[2:, 0].min()
    if left >= right:  # paint, not a thing: take all of it
        left, right = points[:, 0].min(), points[:, 0].max()
    return Box(float(left), float(points[:, 1].min()), float(right), float(points[:, 1].max()))
