"""Lines of tape on the road in one picture: where scans of the road cross tape, and the curves that crossings share.

A scan is a row across the robot's view at one distance ahead, or a ray away from the camera. Tape is brighter than the
asphalt on both its sides, whatever the light, so the search looks at brightness alone; colour is kept for whoever asks
which line is which.
"""

import math
from dataclasses import dataclass
from typing import List, Optional, Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration, horizon_row
from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.robust.light import LINEAR
from obst_avoid.core.geometry import ground_from_pixel, image_from_rectified, pixel_from_ground
from obst_avoid.core.matrices import inverted
from obst_avoid.core.types import Array

WHITE_WIDTH, YELLOW_WIDTH = 0.048, 0.0245
"""[m] of the tapes; Duckietown's specification: 48, and 24 to 25 mm."""
ROWS, FARTHEST, ASIDE = 44, 1.3, 0.7
"""Rows across the road; [m] to the last one, and to either side."""
RAYS, RAY_BEGIN, RAY_STEP = 17, 0.2, 0.8
"""Rays; [m] ahead where they begin, and [px] of a picture 480 high between their samples."""
STEP = 0.004
"""[m] between samples along a row: a sixth of the narrow tape, a camera pixel at 1 m."""
MARGIN = 0.02
"""Fraction of the picture's height below the horizon that is left out: there a pixel is metres long."""
LOBE = 3
"""[samples] averaged on each side of an edge: half of the narrow tape."""
CONTRAST, LEAST_CONTRAST = 0.14, 3.0
"""An edge's least step, as a ratio of the road's grey value, and in grey levels."""
LOCAL_CONTRAST = 0.25
"""The same as a ratio of the grey value beside the tape: a lamp makes asphalt's grain as strong as tape elsewhere."""
NOISE_FACTOR = 6.5
"""Steps above so many times the typical one are edges: asphalt's grain, the sensor's noise."""
EVENNESS = 0.3
"""Least ratio of the steps on the two sides of tape: asphalt lies on both."""
NARROWEST, WIDEST = 0.012, 0.105
"""[m] of tape along a scan: blurred, slanting by up to 60 degrees, by a wrong calibration."""
REDNESS = 0.42
"""Green against red, relative to the road's: below, tape is red; measured 0.03 to 0.25, yellow 0.45 to 1."""
TOLERANCE, TOLERANCE_GROWTH = 0.004, 0.008
"""[m] that a crossing may lie beside its curve at the bumper, and more [m per m] ahead."""
ERROR, ERROR_GROWTH = 0.002, 0.012
"""[m] and [m per m ahead] standard deviation of a crossing, so that what is near decides where the robot is."""
LEAST_CROSSINGS = 5
"""Of a curve."""
LEAST_LENGTH = 0.07
"""[m] of a curve: about a dash and its gap."""
TRIALS = 500
"""Curves that are tried: a line with a tenth of the crossings has half of those in WINDOW, and 1 - (1 - 1/40)^250 of a
chance. With 400 instead, 2 to 3 of 75 pictures of real roads lost their lane."""
DENSITY = 0.35
"""Crossings for each row that a curve spans that it has to have before they count; dashes have 0.67."""
WINDOW = 0.2
"""Share of all crossings, the like ones, among which the others of a trial are chosen."""
GAP, GAP_GROWTH, FEW = 0.05, 0.12, 4
"""[m] and [m per m ahead] between crossings of one line, unless so many follow beyond."""
MOST_LINES = 7
"""Curves in one picture."""
MOST_CROSSINGS = 140
"""That are looked at, the nearest: where there are more, the far ones are walls and furniture, and time is short."""
STEEPEST = 8.0
"""Slope of a curve against straight ahead, where it is seen: 83 degrees, the end of a turn."""
LEAST_APART = 0.025
"""[m] between crossings through which a curve is tried."""
SHARPEST = 5.0
"""[1/m] the tightest lines that can be followed, yellow ones in a turn, have 3.4; tighter ones are corners."""
CURVATURE_PRIOR = 6.0
"""[1/m] standard deviation of lines' curvature; keeps short lines from bending at will."""
LEAST_ERROR = 0.5
"""Of crossings, as a ratio of ERROR: what they have in common does not show in the residual."""
PRIOR = (1e-9, 1e-9, CURVATURE_PRIOR**-2)
"""Information that a curve's a, b, c begin with."""
LONGEST = 80
"""[samples] between the edges of tape."""
CORE = np.arange(-1, 2)
"""[samples] of a crossing whose colour is taken."""
SEED = 1
"""Of the trials."""


@dataclass(frozen=True, eq=False)
class LineSampling:
    """How a camera's picture is sampled: M samples, scan after scan, rows before rays.

    map_pixel, map_part: (1, M, 2) and (1, M) maps for cv2.remap. ground: (M, 2) [m] x, y of the samples, robot frame.
    scan: (M,) int32 number of the row or ray. whole: (1, M) float32, 0 at the ends of scans, where an edge has only one
    side, else 1. ahead: (ROWS,) [m] x of the rows. trials: (3, TRIALS) from 0 to 1, the choices of random sample
    consensus, drawn once so that the same picture gives the same answer.
    """

    map_pixel: Array
    map_part: Array
    ground: Array
    scan: Array
    whole: Array
    ahead: Array
    trials: Array


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where scans cross tape, from near to far; all of shape (N,), robot frame.

    row: number of the row at about the same distance. x, y: [m] of its middle. across: (N, 2) [m] from edge to edge
    along the scan. color: (N, 3) B, G, R in linear light relative to the road's.
    """

    row: Array
    x: Array
    y: Array
    across: Array
    color: Array


@dataclass(frozen=True, eq=False)
class Line:
    """One curve of tape: the points where a + b x + c (x² + y²) / 2 = y, robot frame.

    That is y = a + b x + c x² / 2 as far as it goes, and a circle beyond. a: [m], b: slope at x = 0, c: about the
    curvature [1/m], positive to the left. covariance: (3, 3) of a, b, c. begin, end: [m] x of the first and the last
    crossing. count: crossings on it. residual: [m] standard deviation of them beside it. width: [m] of the tape,
    square to it. blueness: blue against the rest, relative to the road's, white about 1, yellow less.
    brightness: relative to the road's. x, y: (N,) [m] its crossings.
    """

    a: float
    b: float
    c: float
    covariance: Array
    begin: float
    end: float
    count: int
    residual: float
    width: float
    blueness: float
    brightness: float
    x: Array
    y: Array


def make_sampling(calibration: Calibration) -> LineSampling:
    """Lay out the scans of one camera: rows across the road, each the same ratio farther than the last, and rays.

    Rows cross what runs ahead, rays away from the camera what runs across, as lines do in a bend.
    """
    width, height = calibration.width, calibration.height
    homography = calibration.homography
    bottom = ground_from_pixel(homography, np.array([[width / 2, height - 1.0]]))[0, 0]
    top = max(horizon_row(homography, u) for u in (0, width - 1)) + MARGIN * height
    limit = inverted(homography) @ (FARTHEST, 0, 1)
    last = min(max(top, limit[1] / limit[2]) if limit[2] > 0 else top, height - 2.0)
    farthest = ground_from_pixel(homography, np.array([[width / 2, last]]))[0, 0]
    ahead = np.geomspace(max(bottom, 0.03), max(farthest, 0.1), ROWS)
    aside = np.arange(ASIDE, -ASIDE - STEP / 2, -STEP)
    scans = [np.column_stack([np.full(len(aside), x), aside]) for x in ahead]
    v = np.arange(height - 1.0, last, -RAY_STEP * height / 480)
    for u in np.linspace(0, width - 1, RAYS):
        ray = ground_from_pixel(homography, np.column_stack([np.full(len(v), u), v]))
        scans.append(ray[(ray[:, 0] > RAY_BEGIN) & (ray[:, 0] < FARTHEST)])
    ground = np.concatenate(scans)
    scan = np.repeat(np.arange(len(scans)), [len(points) for points in scans])
    before = np.column_stack([ground, np.ones(len(ground))]) @ inverted(homography)[2] > 0
    ground, scan = ground[before], scan[before]  # what lies behind a turned camera has no pixel
    pixels = pixel_from_ground(homography, ground)
    shown = (pixels > -0.5).all(axis=1) & (pixels < (width - 0.5, height - 0.5)).all(axis=1)
    maps = np.full((len(ground), 2), -10.0)  # beyond the rectified picture the lens model folds back
    if shown.any():
        maps[shown] = image_from_rectified(calibration, pixels[shown])
    shown &= (maps >= 0).all(axis=1) & (maps <= (width - 1, height - 1)).all(axis=1)
    maps, ground, scan = maps[shown].astype(np.float32), ground[shown], scan[shown]
    fixed = cv2.convertMaps(maps[None], None, cv2.CV_16SC2)
    whole = np.ones((1, len(scan)), dtype=np.float32)
    for shift in range(1, LOBE + 2):
        whole[0, shift:][scan[shift:] != scan[:-shift]] = 0
        whole[0, :-shift][scan[shift:] != scan[:-shift]] = 0
    whole[0, : LOBE + 1] = whole[0, len(scan) - LOBE - 1 :] = 0
    trials = np.random.RandomState(SEED).uniform(size=(3, TRIALS))
    return LineSampling(fixed[0], fixed[1], ground, scan.astype(np.int32), whole, ahead, trials)


def find_lines(picture: Array, sampling: LineSampling, road: Array) -> List[Line]:
    """The curves of tape in a camera picture, those with the most crossings first; none of red tape.

    picture: (H, W, 3) uint8 BGR. road: (3,) linear light ((v + 1) / 256)^2.2 of the asphalt, B, G, R.
    """
    return curves(find_crossings(picture, sampling, road), sampling.trials)


def find_crossings(picture: Array, sampling: LineSampling, road: Array) -> Crossings:
    """Where scans cross tape: a step up and a step down of brightness, a tape's width apart. Arguments as above."""
    road = np.maximum(np.asarray(road, dtype=np.float64).ravel(), 1e-5)
    if not len(sampling.scan) or not np.isfinite(road).all():  # no road in sight, or no light
        return Crossings(np.zeros(0, dtype=int), np.zeros(0), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 3)))
    _, green, red = 256 * road ** (1 / 2.2)
    share = int(round(256 * green / (green + red)))  # the strong channel is the clear one; old numpy rounds to a float
    least = max(CONTRAST * (share * green + (256 - share) * red) / 256, LEAST_CONTRAST)
    found = native.tapes(
        picture, sampling, (share, 256 - share), (least, NOISE_FACTOR, EVENNESS, LOCAL_CONTRAST, LONGEST), LINEAR
    )
    left, right, color = found or _tapes(picture, sampling, share, least)
    first, last = _ground(sampling.ground, left), _ground(sampling.ground, right)
    across = last - first
    width = np.sqrt(across[:, 0] ** 2 + across[:, 1] ** 2)
    color = color / (len(CORE) * road)
    middle = (first + last) / 2
    row = np.searchsorted(sampling.ahead, middle[:, 0])
    keep = np.flatnonzero((width > NARROWEST) & (width < WIDEST) & (color[:, 1] > REDNESS * color[:, 2]))
    keep = keep[np.argsort(row[keep], kind='stable')][:MOST_CROSSINGS]
    return Crossings(row[keep], middle[keep, 0], middle[keep, 1], across[keep], color[keep])


def _tapes(picture: Array, sampling: LineSampling, share: int, least: float) -> Tuple[Array, Array, Array]:
    """Positions of tape's edges, (N,), as _pairs, and (N, 3) sums of linear light over its core.

    share: of green in grey, of 256, the rest is red's. least: [grey levels] an edge.
    """
    sampled = cv2.remap(picture, sampling.map_pixel, sampling.map_part, cv2.INTER_LINEAR)[0].astype(np.int32)
    grey = (share * sampled[:, 1] + (256 - share) * sampled[:, 2] + 128) >> 8
    sums = np.concatenate([[0], grey.cumsum()])
    change = np.zeros(len(grey))
    behind, ahead = sums[LOBE : -LOBE - 1] - sums[: -2 * LOBE - 1], sums[2 * LOBE + 1 :] - sums[LOBE + 1 : -LOBE]
    change[LOBE:-LOBE] = (ahead - behind) * (sampling.whole[0, LOBE:-LOBE] > 0)
    some = np.sort(np.abs(change[::29]))
    threshold = max(LOBE * least, NOISE_FACTOR * float(some[len(some) // 2])) if len(some) else least
    left, right = _pairs(change, grey, threshold, sampling.scan)
    core = ((left + right) / 2 + 0.5).astype(int)
    return left, right, LINEAR[sampled[core[:, None] + CORE]].sum(axis=1)


def _pairs(change: Array, grey: Array, threshold: float, scan: Array) -> Tuple[Array, Array]:
    """Positions, to fractions of a sample, of tape's first and second edge. change: (M,) LOBE times the steps."""
    back = -change
    rises, falls = _peaks(change, threshold), _peaks(back, threshold)
    after = np.searchsorted(rises, falls)  # the step up that comes last before each step down
    falls, rises = falls[after > 0], rises[after[after > 0] - 1]
    up, down = change[rises], back[falls]
    good = (scan[rises] == scan[falls]) & (falls - rises < LONGEST)
    good &= (up > EVENNESS * down) & (down > EVENNESS * up)
    good &= (up > LOBE * LOCAL_CONTRAST * grey[rises - LOBE]) & (down > LOBE * LOCAL_CONTRAST * grey[falls + LOBE])
    rises, falls = rises[good], falls[good]
    return rises + _vertex(change, rises), falls + _vertex(back, falls)


def _peaks(values: Array, threshold: float) -> Array:
    """Positions of local maxima above a threshold."""
    at = np.flatnonzero(values > threshold)
    here = values[at]
    peaks: Array = at[(here >= values[at - 1]) & (here > values[at + 1])]
    return peaks


def _ground(ground: Array, at: Array) -> Array:
    """(N, 2) [m] of positions between samples."""
    index = at.astype(int)
    here = ground[index]
    point: Array = here + (at - index)[:, None] * (ground[index + 1] - here)
    return point


def _vertex(values: Array, at: Array) -> Array:
    """Offset, -0.5 to 0.5, of the parabola's vertex through a local maximum and its neighbours."""
    before, here, after = values[at - 1], values[at], values[at + 1]
    offset: Array = (before - after) / (2 * (before + after) - 4 * here - LOBE * 1e-3)
    return offset


def curves(crossings: Crossings, trials: Array) -> List[Line]:
    """The curves that many crossings share, one after the other; trials as in LineSampling.

    Random sample consensus (Fischler and Bolles 1981); all curves are tried on all crossings once.
    """
    if len(crossings.x) < LEAST_CROSSINGS:
        return []
    x, y = crossings.x, crossings.y
    design = np.ones((3, len(x)))
    design[1] = x
    design[2] = (x * x + y * y) / 2
    tolerance = TOLERANCE + TOLERANCE_GROWTH * x
    kindred = _kindred(crossings, trials)
    limits = LEAST_APART, SHARPEST, STEEPEST, DENSITY, LEAST_CROSSINGS
    chosen = native.curves(x, y, crossings.row, tolerance, kindred, limits, MOST_LINES)
    if chosen is None:
        chosen = _chosen(design, crossings, tolerance, kindred)
    bounds = ERROR, ERROR_GROWTH, LEAST_ERROR, LEAST_CROSSINGS, LEAST_LENGTH, GAP, GAP_GROWTH, FEW, PRIOR[0], PRIOR[2]
    fitted = native.fitted(x, y, crossings.across, crossings.color, tolerance, chosen, bounds)
    if fitted is None:
        return _fitted(chosen, design, tolerance, crossings) if len(chosen) else []
    return [_from_numbers(values, numbers, crossings) for values, numbers in zip(*fitted)]


def _from_numbers(values: Array, numbers: Array, crossings: Crossings) -> Line:
    x, y = crossings.x[numbers], crossings.y[numbers]
    a, b, c = values[:3].tolist()
    residual, width, blueness, brightness = values[12:].tolist()
    begin, end, covariance = float(x[0]), float(x[-1]), values[3:12].reshape(3, 3)
    return Line(a, b, c, covariance, begin, end, len(x), residual, width, blueness, brightness, x, y)


def _chosen(design: Array, crossings: Crossings, tolerance: Array, trials: Array) -> Array:
    """(L, N) bool: crossings on each of the curves that most lie on. trials: (3, T) numbers of crossings."""
    x, y = crossings.x, crossings.y
    chosen: List[Array] = []
    tried = _tried(design, y, trials)
    if not len(tried):
        return np.zeros((0, len(x)), dtype=bool)
    beside = np.abs((tried[:, :3] @ design - y) / tried[:, 3:])
    close = beside < tolerance
    first, last = close.argmax(axis=1), len(x) - 1 - close[:, ::-1].argmax(axis=1)
    gaps = DENSITY * (crossings.row[last] - crossings.row[first])
    near = close.astype(np.float32)
    free = np.ones(len(x), dtype=np.float32)
    for _ in range(MOST_LINES):
        counts = near @ free
        best = int(np.argmax(counts - gaps))
        if counts[best] < LEAST_CROSSINGS:
            break
        chosen.append(near[best] * free > 0)
        free[beside[best] < 2 * tolerance] = 0
    return np.array(chosen, dtype=bool).reshape(-1, len(x))


def _kindred(crossings: Crossings, trials: Array) -> Array:
    """(3, TRIALS) numbers of crossings; trials as in LineSampling.

    The second and third of half of the trials are near the first on the road, of the others near it in colour.
    """
    count = len(crossings.x)
    first = trials[0] * count
    chosen: Array = np.concatenate([first[None], first + (trials[1:] - 0.5) * (WINDOW * count)]).astype(int)
    np.minimum(np.maximum(chosen, 0, out=chosen), count - 1, out=chosen)  # np.clip takes four times as long
    blue, green, red = np.maximum(crossings.color.T, 1e-3)
    order = (blue / (green + red)).argsort()
    half = chosen.shape[1] // 2
    chosen[:, :half] = order[chosen[:, :half]]
    return chosen


def _tried(design: Array, y: Array, trials: Array) -> Array:
    """(T, 4): a, b, c through three crossings each, (3, T), and the length of the gradient on the curve."""
    i, j, k = trials
    x, q = design[1], design[2]
    xj, xk, qj, qk, yj, yk = x[j] - x[i], x[k] - x[i], q[j] - q[i], q[k] - q[i], y[j] - y[i], y[k] - y[i]
    divisor = xj * qk - xk * qj
    apart = np.minimum(xj * xj + yj * yj, xk * xk + yk * yk) > LEAST_APART**2
    apart &= ((xj - xk) ** 2 + (yj - yk) ** 2 > LEAST_APART**2) & (np.abs(divisor) > 1e-6)
    divisor[~apart] = 1.0
    b, c = (yj * qk - yk * qj) / divisor, (xj * yk - xk * yj) / divisor
    a = y[i] - b * x[i] - c * q[i]
    length = np.sqrt(np.maximum(b * b + 1 - 2 * a * c, 0.01))
    good = apart & (np.abs(c) < SHARPEST * length)
    for end in (i, j, k):
        good &= np.abs(b + c * x[end]) < STEEPEST * (1 - c * y[end])
    tried = np.empty((int(good.sum()), 4))
    for column, values in enumerate((a, b, c, length)):
        tried[:, column] = values[good]
    return tried


def _fitted(chosen: Array, design: Array, tolerance: Array, crossings: Crossings) -> List[Line]:
    """Curves by least squares through the crossings of each; chosen: (L, N) bool."""
    y = crossings.y
    products = np.empty((12, len(y)))
    for index, factor in enumerate((design[0], design[1], design[2], y)):
        np.multiply(design, factor, out=products[3 * index : 3 * index + 3])
    error = ERROR + ERROR_GROWTH * crossings.x
    scale = np.ones((len(chosen), 1))
    number = np.arange(len(chosen))[:, None]
    for _ in range(2):
        sums = (chosen / (error * scale) ** 2) @ products.T
        inverse = np.stack([inverted(one) for one in sums[:, :9].reshape(-1, 3, 3) + np.diag(PRIOR)])
        values = (inverse @ sums[:, 9:, None])[:, :, 0]
        scale = np.sqrt(np.maximum(values[:, 1:2] ** 2 + 1 - 2 * values[:, :1] * values[:, 2:], 0.1))
        beside = (values @ design - y) / scale
        distance = np.abs(beside)
        chosen = (distance < tolerance) & (distance.argmin(axis=0) == number)
    lines = []
    for index in range(len(chosen)):
        line = _line(chosen[index], values[index], inverse[index], beside[index], float(scale[index, 0]), crossings)
        if line is not None:
            lines.append(line)
    return lines


def _line(
    chosen: Array, values: Array, inverse: Array, beside: Array, scale: float, crossings: Crossings
) -> Optional[Line]:
    """One fitted curve with what its crossings, (N,) bool, say of the tape; None when they are too few or too close."""
    numbers = np.flatnonzero(chosen)
    if len(numbers) < LEAST_CROSSINGS:
        return None
    numbers = _in_line(numbers, crossings.x[numbers], crossings.y[numbers])
    count = len(numbers)
    x, y, beside = crossings.x[numbers], crossings.y[numbers], beside[numbers]
    if count < LEAST_CROSSINGS or math.hypot(x[-1] - x[0], y[-1] - y[0]) < LEAST_LENGTH:
        return None
    a, b, c = values.tolist()
    near = numbers[: count // 2 + 1]  # the far half is blurred
    across = crossings.across[near]
    square = across[:, 1] * (1 - c * crossings.y[near]) - across[:, 0] * (b + c * crossings.x[near])
    width = float(np.sort(np.abs(square))[count // 4]) / scale
    blue, green, red = crossings.color[numbers].sum(axis=0).tolist()
    residual = math.sqrt(float(beside @ beside) / max(count - 3, 1))
    error = ERROR + ERROR_GROWTH * float(x[count // 2])
    return Line(
        a, b, c, inverse * max(residual / error, LEAST_ERROR) ** 2, float(x[0]), float(x[-1]), count, residual, width,
        2 * blue / max(green + red, 1e-6), (green + red) / (2 * count), x, y,
    )  # fmt: skip


def _in_line(numbers: Array, x: Array, y: Array) -> Array:
    """The numbers of crossings in their order along the line, from the robot on.

    Without the few at either end that a gap separates from the rest: those are another line's.
    """
    squared = x * x + y * y
    near, far = int(squared.argmin()), int(squared.argmax())
    along = (x - x[near]) * (x[far] - x[near]) + (y - y[near]) * (y[far] - y[near])
    order = along.argsort()
    numbers, x, y = numbers[order], x[order], y[order]
    gaps = np.flatnonzero((x[1:] - x[:-1]) ** 2 + (y[1:] - y[:-1]) ** 2 > (GAP + GAP_GROWTH * x[1:]) ** 2) + 1
    if len(gaps) and gaps[0] < FEW:
        numbers, gaps = numbers[gaps[0] :], gaps[1:] - gaps[0]
    if len(gaps) and len(numbers) - gaps[-1] < FEW:
        numbers = numbers[: gaps[-1]]
    return numbers
