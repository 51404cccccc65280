"""Where tape lies in a picture: its two edges, row by row of the rectified picture, and the lines that they form.

Tape is brighter than asphalt, has one of two known widths, and is either as grey as the asphalt or much yellower,
whatever the light: both comparisons are with the asphalt beside it. The calibration under test only sets the scale
of the search, with room for a wrong one.
"""

import enum
from dataclasses import dataclass
from typing import List, Optional, Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration, horizon_row
from obst_avoid.core.geometry import ground_from_pixel, image_from_rectified
from obst_avoid.core.types import Array

WHITE_WIDTH, YELLOW_WIDTH = 0.048, 0.0245
"""[m] of the tapes; Duckietown's specification: 48, and 24 to 25 mm."""
NEAREST, FARTHEST, ASIDE = 0.05, 1.2, 0.65
"""[m] of the road that is searched, by the calibration under test."""
MARGIN = 0.03
"""Fraction of the picture's height below the horizon that is left out: there a pixel is metres long."""
ROW_STEP = 2.0
"""[px] of a picture 480 high between rows; nearer ones share camera pixels and are no independent evidence."""
STEP = 0.001
"""[m] between samples along a row."""
SCALE_ROOM = 1.6
"""Factor by which tape may seem wider or narrower: the calibration may be wrong, and tape may cross at an angle."""
CONTRAST = 0.12
"""Of the brightness range in the rows: weaker edges are asphalt's grain and reflections."""
YELLOWNESS = 0.72
"""Blue against red and green, relative to the asphalt's: below, tape is yellow; measured 0.2 to 0.6 and 0.85 to 1.1."""
REDNESS = 0.3
"""Green against red, relative to the asphalt's: below, tape is red; measured 0.03 to 0.25, orange dashes 0.35."""
LINE_TOLERANCE = 0.008
"""[m] that a crossing may lie beside the curve of its line."""
LEAST_CROSSINGS = 12
"""Of a line."""
LEAST_LENGTH = 0.12
"""[m] of a line."""
TRIALS = 400
"""Curves that are tried for a line: with a third of the crossings on it, 1 - (1 - 1/27)^400 find it."""
SHARPEST_CURVE = 6.0
"""[1/m] the tightest lines in Duckietown, the inner ones of a right turn, have about 5."""


class Tape(enum.Enum):
    """The two sorts of tape that bound lanes."""

    WHITE = 'white'
    YELLOW = 'yellow'


@dataclass(frozen=True, eq=False)
class Line:
    """One line of tape in one picture. left, right: (N, 2) rectified pixels u, v of its edges, one row each."""

    tape: Tape
    left: Array
    right: Array


@dataclass(frozen=True, eq=False)
class Rows:
    """How a camera's picture is sampled.

    map_u, map_v: (R, S) float32 for cv2.remap, outside the picture where the camera does not look. u, v: (R, S) of the
    samples in the rectified picture.
    """

    map_u: Array
    map_v: Array
    u: Array
    v: Array


def rows_of(calibration: Calibration) -> Rows:
    """Rows of the rectified picture from the bumper to the distance limit, sampled every STEP of road across."""
    width, height = calibration.width, calibration.height
    top = max(horizon_row(calibration.homography, u) for u in (0, width - 1)) + MARGIN * height
    v = np.arange(height - 1.0, max(top, 0.0), -ROW_STEP * height / 480)
    homography = calibration.homography
    middle = -(homography[1, 1] * v + homography[1, 2]) / homography[1, 0]  # column of y = 0 in each row
    ahead = ground_from_pixel(homography, np.column_stack([middle, v]))[:, 0]
    aside = ground_from_pixel(homography, np.column_stack([middle - 1, v]))[:, 1]
    seen = (ahead > NEAREST) & (ahead < FARTHEST) & (aside > 0)
    v, middle, aside = v[seen], middle[seen], aside[seen]
    y = np.arange(ASIDE, -ASIDE - STEP / 2, -STEP)
    u = middle[:, None] - y[None, :] / aside[:, None]
    v = np.repeat(v[:, None], len(y), axis=1)
    pixels = image_from_rectified(calibration, np.column_stack([u.ravel(), v.ravel()])).reshape(*u.shape, 2)
    shown = (u > -0.5) & (u < width - 0.5)  # beyond, the lens model folds back
    pixels[~shown] = -10.0
    return Rows(pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32), u, v)


def find_lines(picture: Array, rows: Rows, homography: Array) -> List[Line]:
    """All lines of tape in a camera picture, (H, W, 3) uint8 BGR: at most two white ones and one yellow one.

    homography: as in Calibration, of the camera whose rows these are; lines are sought on the road by it.
    """
    found = _crossings(picture, rows)
    lines = []
    for tape, most in ((Tape.YELLOW, 1), (Tape.WHITE, 2)):
        row, left, right = (values[found[3] == (tape is Tape.WHITE)] for values in found[:3])
        for _ in range(most):
            middle = _pixels(rows, row, (left + right) / 2)
            chosen = _longest_curve(ground_from_pixel(homography, middle)) if len(row) else None
            if chosen is None:
                break
            lines.append(
                Line(tape, _pixels(rows, row[chosen], left[chosen]), _pixels(rows, row[chosen], right[chosen]))
            )
            row, left, right = row[~chosen], left[~chosen], right[~chosen]
    return lines


def _crossings(picture: Array, rows: Rows) -> Tuple[Array, Array, Array, Array]:
    """Where tape crosses rows: row number, position of left and right edge in samples, and whether it is white."""
    sampled = cv2.remap(picture, rows.map_u, rows.map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    inside = (rows.map_u >= 0) & (rows.map_v >= 0)
    inside &= (rows.map_u <= picture.shape[1] - 1) & (rows.map_v <= picture.shape[0] - 1)
    light = (sampled / np.float32(255)) ** np.float32(2.2)  # ratios of colours mean something in linear light
    road = np.median(light[inside], axis=0) + 1e-4 if inside.any() else np.ones(3)
    light = light / road.astype(np.float32)
    bright = np.where(inside, light[..., 1:].mean(axis=2), np.float32(np.nan))
    low, high = np.nanpercentile(bright, (20, 99)) if inside.any() else (0.0, 0.0)
    threshold = CONTRAST * (high - low)
    found: List[Tuple[int, float, float, bool]] = []
    for index in range(len(bright)):
        for left, right in _bright_spans(bright[index], threshold):
            width = (right - left) * STEP
            tapes = [tape for tape in (WHITE_WIDTH, YELLOW_WIDTH) if tape / SCALE_ROOM < width < tape * SCALE_ROOM]
            white = _is_white(light[index], left, right) if tapes else None
            if white is not None and (WHITE_WIDTH if white else YELLOW_WIDTH) in tapes:
                found.append((index, left, right, white))
    values = np.array(found, dtype=np.float64).reshape(-1, 4)
    return values[:, 0].astype(int), values[:, 1], values[:, 2], values[:, 3] > 0.5


def _bright_spans(bright: Array, threshold: float) -> List[Tuple[float, float]]:
    """Left and right edge, in samples, of what is brighter than both its sides; each half way up its own flank."""
    reach = int(round(0.5 * YELLOW_WIDTH / STEP))
    smooth = cv2.blur(bright.reshape(1, -1), (5, 1), borderType=cv2.BORDER_REPLICATE).ravel()
    change = np.zeros_like(smooth)
    change[reach // 2 : -(reach // 2)] = smooth[2 * (reach // 2) :] - smooth[: -2 * (reach // 2)]
    rises, falls = _peaks(change, threshold), _peaks(-change, threshold)
    spans = []
    widest = SCALE_ROOM * WHITE_WIDTH / STEP
    for rise in rises:
        later = falls[(falls > rise) & (falls < rise + widest)]
        if not len(later) or (rises[(rises > rise) & (rises < later[0])]).size:
            continue
        edges = _half_way(bright, int(rise), int(later[0]), reach)
        if edges is not None:
            spans.append(edges)
    return spans


def _peaks(change: Array, threshold: float) -> Array:
    """Positions of local maxima above the threshold; NaN is none."""
    middle = change[1:-1]
    with np.errstate(invalid='ignore'):
        return 1 + np.flatnonzero((middle > threshold) & (middle >= change[:-2]) & (middle > change[2:]))


def _half_way(bright: Array, rise: int, fall: int, reach: int) -> Optional[Tuple[float, float]]:
    """Positions, in samples, where the brightness is half way between the tape's and each side's."""
    inner = bright[rise + max((fall - rise) // 4, 1) : fall - max((fall - rise) // 4, 1) + 1]
    sides = bright[max(rise - 2 * reach, 0) : max(rise - reach // 2, 1)], bright[fall + reach // 2 : fall + 2 * reach]
    if not all(len(side) >= reach and np.isfinite(side).all() for side in sides):
        return None  # at the picture's border
    if not len(inner) or not np.isfinite(inner).all():
        return None
    plateau = float(np.median(inner))
    left = _crossing(bright, rise, reach, (plateau + float(np.median(sides[0]))) / 2)
    right = _crossing(bright[::-1], len(bright) - 1 - fall, reach, (plateau + float(np.median(sides[1]))) / 2)
    return None if left is None or right is None else (left, len(bright) - 1 - right)


def _crossing(bright: Array, near: int, reach: int, level: float) -> Optional[float]:
    """Where the brightness rises through a level, closest to a sample."""
    begin = max(near - reach, 0)
    part = bright[begin : near + reach + 1]
    ups = np.flatnonzero((part[:-1] < level) & (part[1:] >= level))
    if not len(ups):
        return None
    up = ups[np.argmin(np.abs(ups + begin - near))]
    return float(begin + up + (level - part[up]) / (part[up + 1] - part[up]))


def _is_white(light: Array, left: float, right: float) -> Optional[bool]:
    """White, yellow, or None for neither; (S, 3) linear light relative to the asphalt."""
    quarter = 0.25 * (right - left)
    blue, green, red = np.median(light[int(left + quarter) : int(right - quarter) + 1], axis=0)
    ratio = 2 * blue / max(green + red, 1e-6)
    if ratio < YELLOWNESS:
        return None if green < REDNESS * red else False  # a red stop line
    return True if green > REDNESS * red else None


def _pixels(rows: Rows, row: Array, sample: Array) -> Array:
    """(N, 2) rectified pixels of positions between samples; u grows evenly along a row."""
    step = rows.u[row, 1] - rows.u[row, 0]
    return np.column_stack([rows.u[row, 0] + sample * step, rows.v[row, 0]])


def _longest_curve(points: Array) -> Optional[Array]:
    """Which of (N, 2) road points lie on the gentle curve that most of them share; None if too few do.

    Random sample consensus (Fischler and Bolles 1981) over y = a + b x + c x² / 2.
    """
    if len(points) < LEAST_CROSSINGS:
        return None
    random = np.random.RandomState(1)  # the same pictures give the same answer
    x, y = points[:, 0], points[:, 1]
    trials = random.randint(0, len(points), (TRIALS, 3))
    at = x[trials]
    spread = np.min([np.abs(at[:, 0] - at[:, 1]), np.abs(at[:, 1] - at[:, 2]), np.abs(at[:, 0] - at[:, 2])], axis=0)
    trials = trials[spread > 0.03]
    if not len(trials):
        return None
    basis = np.stack([np.ones((len(trials), 3)), x[trials], x[trials] ** 2 / 2], axis=2)
    curves = np.linalg.solve(basis, y[trials][..., None])[..., 0]
    curves = curves[(np.abs(curves[:, 1]) < 1.5) & (np.abs(curves[:, 2]) < SHARPEST_CURVE)]
    if not len(curves):
        return None
    design = np.stack([np.ones_like(x), x, x**2 / 2])
    near = np.abs(curves @ design - y) < LINE_TOLERANCE
    chosen = near[np.argmax(near.sum(axis=1))]
    for _ in range(3):
        if chosen.sum() < LEAST_CROSSINGS:
            return None
        curve, *_ = np.linalg.lstsq(design[:, chosen].T, y[chosen], rcond=None)
        chosen = np.abs(curve @ design - y) < LINE_TOLERANCE
    if chosen.sum() < LEAST_CROSSINGS or np.ptp(x[chosen]) < LEAST_LENGTH:
        return None
    return chosen
