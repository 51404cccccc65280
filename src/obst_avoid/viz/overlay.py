"""Obstacles on the camera picture and on the bird view."""

from typing import Optional, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.bird_view import BirdView, image_from_bird
from obst_avoid.core.types import Array, Box, Obstacle

INSIDE, OUTSIDE, UNKNOWN = (40, 40, 230), (60, 190, 60), (0, 165, 255)
"""BGR: red what counts, green what does not, as in rviz."""
TEXT, SHADE = (255, 255, 255), (30, 30, 30)
FONT = cv2.FONT_HERSHEY_SIMPLEX


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
