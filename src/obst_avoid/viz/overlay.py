"""Obstacles, and what the avoider makes of them, on the camera picture and on the bird view."""

import math
from typing import Callable, List, Optional, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.bird_view import BirdView, bird_from_ground, image_from_bird
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from obst_avoid.core.matrices import inverted
from obst_avoid.core.types import Array, Box, Obstacle, State

INSIDE, OUTSIDE, UNKNOWN = (40, 40, 230), (60, 190, 60), (0, 165, 255)
"""BGR: red what counts, green what does not, as in rviz."""
TEXT, SHADE = (255, 255, 255), (30, 30, 30)
BRIGHT = 130
"""[0 to 255] Luminance from which a ground is written on in SHADE instead of TEXT."""
FONT = cv2.FONT_HERSHEY_SIMPLEX
LETTERS, SMALLEST = 0.5, 0.4
"""OpenCV's size of letters in a picture 640 pixels wide, and the smallest that can be read."""
GAP = 2
"""[px] between letters and the edge of their ground, and between two labels."""
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


def draw_on_picture(picture: Array, obstacles: Sequence[Obstacle], view: BirdView, free: int = 0) -> Array:
    """A copy of the camera picture, (H, W, 3) uint8, with a box and a label on each obstacle.

    free: so many rows at the top are left free of labels.
    """
    drawn = picture.copy()
    seen = [(obstacle, _picture_box(obstacle, view)) for obstacle in obstacles]
    named = [(obstacle, box) for obstacle, box in seen if box is not None]
    for obstacle, box in named:
        corners = ((round(box.left), round(box.top)), (round(box.right) - 1, round(box.bottom) - 1))
        cv2.rectangle(drawn, corners[0], corners[1], _color(obstacle), max(1, round(2 * _unit(picture))))
    _label_all(drawn, named, LETTERS * _unit(picture), free)
    return drawn


def draw_on_bird_view(bird: Array, obstacles: Sequence[Obstacle]) -> Array:
    """A copy of the bird view, (H, W, 3) uint8, with each obstacle's box, its foot, and a label."""
    drawn = bird.copy()
    named = [(obstacle, obstacle.bird_box) for obstacle in obstacles if obstacle.bird_box is not None]
    for obstacle, box in named:
        color = _color(obstacle)
        left, top, right, bottom = (int(round(value)) for value in (box.left, box.top, box.right - 1, box.bottom - 1))
        cv2.rectangle(drawn, (left, top), (right, bottom), color, 1)
        cv2.circle(drawn, ((left + right) // 2, bottom), 3, color, -1)
    _label_all(drawn, named, LETTERS * _unit(bird), 0)
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
    width, height = _ground_of(words, size)
    left = min(max(at[0], 0), max(picture.shape[1] - width, 0))
    top = min(max(at[1] - height, 0), max(picture.shape[0] - height, 0))
    _write(picture, words, (int(left), int(top)), color, size)


def banner(picture: Array, words: str, color: Tuple[int, int, int] = SHADE) -> Array:
    """A copy with words along the lower edge, in as many lines as they need."""
    drawn = picture.copy()
    lines, size, height = _lines_of(picture, words)
    _strip(drawn, lines, drawn.shape[0] - height * len(lines), color, size)
    return drawn


def headline(picture: Array, words: str, color: Tuple[int, int, int] = SHADE) -> Tuple[Array, int]:
    """A copy with words along the upper edge, above the horizon where they hide least, and how many rows they take."""
    drawn = picture.copy()
    lines, size, height = _lines_of(picture, words)
    _strip(drawn, lines, 0, color, size)
    return drawn, min(height * len(lines), picture.shape[0])


def placed(
    sizes: Sequence[Tuple[int, int]], boxes: Sequence[Box], frame: Tuple[int, int], free: int = 0
) -> List[Tuple[int, int]]:
    """Left and top of each label, [px]: near what it names, inside the frame, and apart from all others while there is
    room; rather not on another's box. The lowest box, which is the nearest thing, chooses first.

    sizes: width and height of each label. boxes: what they name. frame: width and height of the picture. free: rows at
    its top that are left free.
    """
    found = [(0, 0)] * len(sizes)
    taken = np.empty((0, 4))
    others = np.array([(box.left, box.top, box.right, box.bottom) for box in boxes]).reshape(-1, 4)
    for index in sorted(range(len(sizes)), key=lambda i: -boxes[i].bottom):
        (width, height), box = sizes[index], boxes[index]
        limit = np.array([max(frame[0] - width, 0), max(frame[1] - height, free)])
        rows = np.arange(0, max(frame[1], 1), height + GAP)
        lefts = np.concatenate([box.left + np.arange(-2, 2.5, 0.5) * (width + GAP), [box.right - width]])
        tops = np.concatenate([box.top - height - rows, box.bottom + rows])
        near = np.array(np.meshgrid(lefts, tops)).reshape(2, -1).T
        spread = np.arange(0, limit[0] + 1, max(width // 4, 1)), np.arange(free, limit[1] + 1, height + GAP)
        anywhere = np.array(np.meshgrid(*spread)).reshape(2, -1).T
        places = np.round(np.clip(np.concatenate([near, anywhere]), (0, free), limit))
        areas = np.column_stack([places, places + (width, height)])
        far = np.abs(places - (box.left, box.top - height)).sum(axis=1)
        hidden = _common(areas, np.delete(others, index, axis=0)).sum(axis=1) / height
        clash = (_common(areas, taken + (-GAP, -GAP, GAP, GAP)) > 0).any(axis=1)
        best = int(np.argmin(far + hidden + 1e6 * clash))
        found[index] = (int(places[best, 0]), int(places[best, 1]))
        taken = np.vstack([taken, areas[best]])
    return found


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
    u, v, w = inverted(view.calibration.homography)
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


def _label_all(drawn: Array, named: Sequence[Tuple[Obstacle, Box]], size: float, free: int) -> None:
    """A label on each obstacle, in place, last of all, so that no box crosses them; one that had to move away from its
    box is tied to it by a line.
    """
    size = max(size, SMALLEST)
    sizes = [_ground_of(_words(obstacle), size) for obstacle, _ in named]
    places = placed(sizes, [box for _, box in named], (drawn.shape[1], drawn.shape[0]), free)
    for (obstacle, box), (left, top), (width, height) in zip(named, places, sizes):
        middle = (left + width // 2, top + height // 2)
        end = (
            round(min(max(middle[0], box.left), box.right - 1)),
            round(min(max(middle[1], box.top), box.bottom - 1)),
        )
        if max(abs(end[0] - middle[0]) - width / 2, abs(end[1] - middle[1]) - height / 2) > height / 2:
            cv2.line(drawn, middle, end, _color(obstacle), max(1, round(2 * size)), cv2.LINE_AA)
    for (obstacle, _), at in zip(named, places):
        _write(drawn, _words(obstacle), at, _color(obstacle), size)


def _common(areas: Array, others: Array) -> Array:
    """(N, M) [px²] that areas (N, 4) and others (M, 4) share; both left, top, right, bottom."""
    low = np.maximum(areas[:, np.newaxis, :2], others[np.newaxis, :, :2])
    high = np.minimum(areas[:, np.newaxis, 2:], others[np.newaxis, :, 2:])
    shared: Array = np.prod(np.maximum(high - low, 0), axis=2)
    return shared


def _ground_of(words: str, size: float) -> Tuple[int, int]:
    """Width and height [px] of the ground on which words are written."""
    (width, height), base = cv2.getTextSize(_in_letters(words), FONT, size, _thickness(size))
    return width + 2 * GAP, height + base + GAP


def _write(picture: Array, words: str, at: Tuple[int, int], color: Tuple[int, int, int], size: float) -> None:
    """Words on a filled ground, in place. at: left and top of the ground."""
    words, (width, height) = _in_letters(words), _ground_of(words, size)
    base = cv2.getTextSize(words, FONT, size, _thickness(size))[1]
    cv2.rectangle(picture, at, (at[0] + width - 1, at[1] + height - 1), color, -1)
    foot = (at[0] + GAP, at[1] + height - base)
    cv2.putText(picture, words, foot, FONT, size, _ink(color), _thickness(size), cv2.LINE_AA)


def _lines_of(picture: Array, words: str) -> Tuple[List[str], float, int]:
    """Words in lines that fit the picture's width, the size of the letters, and the height of a line [px]."""
    size = max(LETTERS * _unit(picture), SMALLEST)
    lines = ['']
    for word in _in_letters(words).split():
        longer = (lines[-1] + ' ' + word).strip()
        if lines[-1] and _ground_of(longer, size)[0] + 2 * GAP > picture.shape[1]:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines, size, _ground_of('Ag', size)[1] + GAP


def _strip(picture: Array, lines: Sequence[str], top: int, color: Tuple[int, int, int], size: float) -> None:
    """Lines of words over the whole width, in place."""
    height = _ground_of('Ag', size)[1] + GAP
    cv2.rectangle(picture, (0, top), (picture.shape[1], top + height * len(lines) - 1), color, -1)
    for index, line in enumerate(lines):
        _write(picture, line, (GAP, top + height * index + GAP // 2), color, size)


def _thickness(size: float) -> int:
    """[px] of the letters' strokes."""
    return max(1, round(1.6 * size))


def _ink(ground: Tuple[int, int, int]) -> Tuple[int, int, int]:
    """What can be read on a ground of a colour, BGR."""
    blue, green, red = ground
    return SHADE if 0.114 * blue + 0.587 * green + 0.299 * red > BRIGHT else TEXT


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
