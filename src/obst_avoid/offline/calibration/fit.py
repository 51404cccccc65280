"""Which tilt and height of the camera the lane's lines ask for.

One camera and many pictures of lanes. In each picture the lines are concentric curves on the road at known widths;
the camera's tilt and height are the same in all. Both are found together by least squares over the tape's edges, in
pixels, as a bundle adjustment does it (Triggs et al. 2000), with the tape's known widths as further observations.
What one picture of a straight lane says: the lines' vanishing point, the pitch; the tape's widths left and right,
the roll; their size, the height. The yaw is not among them: it turns the lane as the robot's own heading does.
"""

import math
from dataclasses import dataclass, fields
from typing import Any, List, Optional, Sequence, Tuple

import cv2
import numpy as np
from scipy.optimize import least_squares

from obst_avoid.core.calibration import Calibration, camera_from_robot, camera_position
from obst_avoid.core.geometry import ground_from_pixel
from obst_avoid.core.matrices import inverted
from obst_avoid.core.types import Array
from obst_avoid.offline.calibration.paint import WHITE_WIDTH, YELLOW_WIDTH, Line, Tape

LANE_WIDTH = 0.225
"""[m] between the lines; 0.20 to 0.25 in Duckietowns."""
LIMITS = ((math.radians(12), 0.0, math.radians(5)), (math.radians(15), 0.0, math.radians(6)), (0.6, 0.0, 0.25))
"""Of roll [rad], pitch [rad] and the logarithm of the height's ratio: the largest that is tried, what is expected, and
its standard deviation. Files are off by that much when a mount was bent or another robot's file was copied."""
KNOWN = ((LANE_WIDTH, 0.02), (WHITE_WIDTH, 0.001), (YELLOW_WIDTH, 0.0007))
"""[m] what is known of lane and tape before a picture is seen, each with its standard deviation."""
BLOOM = (0.0, 0.5)
"""[px] by which bright tape spreads over its edge, and its standard deviation: blur, overexposure, tone curve."""
CURVATURE_SPREAD = 2.5
"""[1/m] standard deviation of a lane's curvature."""
LANE_LIMITS = (0.12, 0.40)
"""[m] between lines that the calibration under test may show for one lane."""
SOFT = 2.0
"""[px] residuals beyond it count less (soft L1 loss), until the outliers are known."""
OUTLIER = 4.0
"""Standard deviations beyond which an edge point is left out."""
LEAST_NOISE = 0.25
"""[px] of an edge point, however well the lines fit."""
PICTURE_SPREAD = (math.radians(0.7), math.radians(0.5), 0.03)
"""Standard deviation of roll, pitch and height from one picture beyond its noise: roads are not flat, lanes begin to
bend, lens models err. Answers of single real pictures of one robot scatter by 0.5 to 1.8 degrees, 0.7 to 0.9 degrees
and 4 to 6 per cent, with another robot's lens; half of that is counted for its own."""
COMMON = len(LIMITS) + len(KNOWN) + 1
"""Values that all pictures share; each picture adds heading, offset and curvature."""
STEPS = 40
"""Of the least squares; sound lines need 5 to 15."""
ANOTHER_VIEW = (math.radians(1.0), 0.01)
"""Heading [rad] or offset [m] by which two pictures differ at least, if they are to count as two: a robot that stands
shows the same again and again."""
FEW = 5
"""Pictures from which on their scatter tells more than the model does of how sure the answer is."""


@dataclass(frozen=True, eq=False)
class Correction:
    """What a calibration is changed by. roll: [rad] clockwise about the optical axis, as the camera sees it.

    pitch: [rad] further down. yaw: [rad] further left. height: ratio to the file's, about the point below the camera.
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    height: float = 1.0


@dataclass(frozen=True, eq=False)
class Edges:
    """Edge points of all pictures. pixels: (M, 2) rectified. picture: (M,) its number. widths: (M, 3), see _edges_of.

    outward: (M,) 1 for a tape's right edge, -1 for its left one.
    edge: (M,) number of the edge that a point belongs to; points of one edge follow each other down the picture.
    """

    pixels: Array
    picture: Array
    widths: Array
    outward: Array
    edge: Array

    def of(self, chosen: Array) -> 'Edges':
        """Those that a mask or an index names."""
        return Edges(*(values[chosen] for values in (self.pixels, self.picture, self.widths, self.outward, self.edge)))


@dataclass(frozen=True, eq=False)
class Fit:
    """What the lines say.

    correction: of the calibration under test, without yaw. spread: (3,) standard deviations of roll [rad], pitch [rad],
    height [ratio]; covariance: (3, 3) of the same. lane, white, yellow: (width [m], standard deviation).
    headings, offsets: (N,) of the pictures that had lines, [rad], [m] of the yellow line's middle to the left;
    heading_spread: (N,) [rad]. pictures: (N,) which ones.
    noise: [px] standard deviation of the edge points about the lines. edges: those that were used.
    views: how many of the pictures show the lane from another place.
    tapes: how many white and yellow lines were used. at_limit: the answer lies at the edge of what is tried.
    """

    correction: Correction
    covariance: Array
    lane: Tuple[float, float]
    white: Tuple[float, float]
    yellow: Tuple[float, float]
    pictures: Array
    headings: Array
    heading_spread: Array
    offsets: Array
    noise: float
    edges: Edges
    views: int
    tapes: Tuple[int, int]
    at_limit: bool

    @property
    def spread(self) -> Array:
        """(3,) standard deviations of roll, pitch, height."""
        deviations: Array = np.sqrt(np.diag(self.covariance))
        return deviations


def corrected_homography(calibration: Calibration, correction: Correction) -> Array:
    """(3, 3) the calibration's homography with the camera turned and raised where it stands.

    It keeps what a measured homography has beyond a rigid camera's: only the rays are turned before it, and the road
    is scaled about the point below the camera after it.
    """
    rotation, _ = camera_from_robot(calibration)
    foot = camera_position(calibration)[:2]
    return _corrected(calibration, rotation, foot, correction)


def _corrected(calibration: Calibration, rotation: Array, foot: Array, correction: Correction) -> Array:
    up, forward = rotation[:, 2], np.array([0.0, 0.0, 1.0])
    left = np.cross(up, forward) / np.linalg.norm(np.cross(up, forward))
    turn = np.eye(3)
    for axis, angle in ((up, correction.yaw), (left, correction.pitch), (forward, -correction.roll)):
        turn = turn @ cv2.Rodrigues(axis * angle)[0]
    scale = correction.height
    raised = np.array([[scale, 0, (1 - scale) * foot[0]], [0, scale, (1 - scale) * foot[1]], [0, 0, 1]])
    projection = calibration.projection
    homography: Array = raised @ calibration.homography @ projection @ turn @ inverted(projection)
    return homography


def fit(calibration: Calibration, pictures: Sequence[Sequence[Line]], begin: Correction) -> Optional[Fit]:
    """Fit tilt and height to the lines of pictures of one camera. None when no picture has a line of a lane.

    calibration: under test. pictures: the lines that find_lines gave for each. begin: where the search begins.
    """
    guessed = corrected_homography(calibration, begin)
    edges, numbers, tapes = _edges_of(guessed, pictures)
    if not len(numbers):
        return None
    rotation, _ = camera_from_robot(calibration)
    foot = camera_position(calibration)[:2]

    def residuals(values: Array, edges: Edges, noise: float) -> Array:
        correction = Correction(values[0], values[1], 0.0, math.exp(values[2]))
        homography = _corrected(calibration, rotation, foot, correction)
        lanes = values[COMMON:].reshape(-1, 3)
        apart = _pixels_apart(homography, edges, values[3:6], lanes) - values[6] * edges.outward
        expected = (values[:COMMON] - means) / deviations
        return np.concatenate([apart / noise, expected, lanes[:, 2] / CURVATURE_SPREAD])

    def jacobian(values: Array, edges: Edges, noise: float) -> Array:
        """By differences; a picture's own three values touch its own points only, so all pictures step at once."""
        base, size = residuals(values, edges, noise), len(edges.pixels)
        matrix = np.zeros((len(base), len(values)))
        for column in range(COMMON):
            stepped = values.copy()
            stepped[column] += 1e-6
            matrix[:, column] = (residuals(stepped, edges, noise) - base) / 1e-6
        for column in range(COMMON, COMMON + 3):
            stepped = values.copy()
            stepped[column::3] += 1e-6
            change = (residuals(stepped, edges, noise) - base) / 1e-6
            matrix[np.arange(size), column + 3 * edges.picture] = change[:size]
        matrix[np.arange(size + COMMON, len(base)), np.arange(COMMON + 2, len(values), 3)] = 1 / CURVATURE_SPREAD
        return matrix

    means, deviations = np.array([(mean, deviation) for *_, mean, deviation in (*LIMITS, *KNOWN, BLOOM)]).T
    camera = means.copy()
    camera[:3] = begin.roll, begin.pitch, math.log(begin.height)
    values = np.concatenate([camera, _first_guess(guessed, edges, len(numbers))])
    most = np.full(len(values), np.inf)
    most[:3] = [limit for limit, *_ in LIMITS]
    scale = np.concatenate([0.3 * deviations, np.tile([0.05, 0.02, 0.5], len(numbers))])
    options: Any = {'x_scale': scale, 'bounds': (-most, most), 'max_nfev': STEPS}
    first = least_squares(
        residuals, np.clip(values, -most, most), jacobian, loss='soft_l1', f_scale=SOFT, args=(edges, 1.0), **options
    )
    apart = first.fun[: len(edges.pixels)]
    noise = _noise(apart)
    kept = np.abs(apart) < OUTLIER * noise
    edges = edges.of(kept)
    final = least_squares(residuals, first.x, jacobian, args=(edges, noise), **options)
    size = len(edges.pixels)
    apart = final.fun[:size] * noise
    lanes = final.x[COMMON:].reshape(-1, 3)
    views = _views(lanes[:, 0], lanes[:, 1])
    alike = _points_for_one(apart, edges.edge) * len(lanes) / views
    covariance = _covariance(final.jac, final.fun, edges, alike, views)
    height = math.exp(final.x[2])
    covariance[2] *= height
    covariance[:, 2] *= height
    spread = np.sqrt(np.diag(covariance))
    lane_spread = spread[COMMON:].reshape(-1, 3)
    lane, white, yellow = zip(final.x[3:6], spread[3:6])
    return Fit(
        Correction(float(final.x[0]), float(final.x[1]), 0.0, height), covariance[:3, :3], lane, white, yellow,
        np.array(numbers), lanes[:, 0], lane_spread[:, 0], lanes[:, 1], _noise(apart), edges, views, tapes,
        bool((np.abs(final.x[:3]) > 0.98 * most[:3]).any()),
    )  # fmt: skip


def _views(headings: Array, offsets: Array) -> int:
    """How many of the pictures were taken from another place in the lane than those before."""
    kept: List[Tuple[float, float]] = []
    for heading, offset in zip(headings, offsets):
        far = [abs(heading - h) > ANOTHER_VIEW[0] or abs(offset - o) > ANOTHER_VIEW[1] for h, o in kept]
        if all(far):
            kept.append((heading, offset))
    return len(kept)


def _covariance(jacobian: Array, residual: Array, edges: Edges, points_for_one: float, views: int) -> Array:
    """Of all values: from the edge points' noise, or from the scatter of the pictures where that is larger.

    The scatter (cluster-robust covariance, Liang and Zeger 1986) sees what pictures do not have in common: worn tape,
    wrong lines, a curve that is no circle. What they do have in common, a wrong lens model, nothing here sees.
    """
    size = len(edges.pixels)
    weighted = jacobian.copy()
    weighted[:size] /= math.sqrt(points_for_one)
    model = np.linalg.pinv(weighted.T @ weighted)
    deviation = np.sqrt(np.diag(model))
    count = int(edges.picture.max()) + 1
    if views >= FEW:
        bread = np.linalg.pinv(jacobian.T @ jacobian)
        pulls = np.zeros((count, jacobian.shape[1]))
        np.add.at(pulls, edges.picture, jacobian[:size] * residual[:size, None])
        scatter = bread @ (pulls.T @ pulls) @ bread * count / (count - 1)
        deviation = np.maximum(deviation, np.sqrt(np.maximum(np.diag(scatter), 0)))
    deviation[:3] = np.hypot(deviation[:3], np.array(PICTURE_SPREAD) / math.sqrt(views))
    widened = deviation / np.sqrt(np.diag(model))
    covariance: Array = model * widened[:, None] * widened[None, :]
    return covariance


def lane_coordinate(ground: Array, heading: Array, offset: Array, curvature: Array) -> Array:
    """[m] by which (M, 2) road points lie left of a curve. heading: [rad] of the robot against it. offset: [m] of the
    curve to the robot's left. curvature: [1/m], positive when it bends left; each (M,) or a number.

    The distance from a circle, written so that it is right for a straight line too.
    """
    cos, sin = np.cos(heading), np.sin(heading)
    x = cos * ground[:, 0] - sin * ground[:, 1]
    y = sin * ground[:, 0] + cos * ground[:, 1] - offset
    twice = 2 * y - curvature * (x**2 + y**2)
    aside: Array = twice / (1 + np.sqrt(np.maximum(1 - curvature * twice, 1e-9)))
    return aside


def ground_or_far(homography: Array, pixels: Array) -> Array:
    """ground_from_pixel for trial tilts, which may lift the horizon over a point: it is then very far away."""
    points = np.column_stack([pixels, np.ones(len(pixels))]) @ homography.T
    ground: Array = points[:, :2] / np.maximum(points[:, 2:], 1e-6)
    return ground


def yaw_from_motion(fitted: Fit, times: Sequence[float], driven: Sequence[float]) -> Optional[Tuple[float, float]]:
    """The camera's yaw, [rad] further left than the file says, and its standard deviation, from a drive.

    A robot that drives a distance at a heading changes its place in the lane by their product, whatever the camera
    says. times: [s] of all pictures. driven: [m] of the way up to each. None when the robot hardly moved.
    """
    ways, yaws = [], []
    for before, after in zip(range(len(fitted.pictures) - 1), range(1, len(fitted.pictures))):
        first, second = fitted.pictures[before], fitted.pictures[after]
        way = driven[second] - driven[first]
        if not 0.03 < way < 0.4 or times[second] - times[first] > 2.0:
            continue
        heading = (fitted.headings[before] + fitted.headings[after]) / 2
        yaws.append(heading + (fitted.offsets[after] - fitted.offsets[before]) / way)
        ways.append(way)
    if sum(ways) < 0.5 or len(ways) < 4:
        return None
    yaw = float(np.average(yaws, weights=ways))
    deviation = math.sqrt(np.average((np.array(yaws) - yaw) ** 2, weights=ways) / (len(ways) - 1))
    return yaw, max(deviation, math.radians(0.2))


def _edges_of(homography: Array, pictures: Sequence[Sequence[Line]]) -> Tuple[Edges, List[int], Tuple[int, int]]:
    """Edge points with their place in the lane, the numbers of the pictures that have any, and the lines by tape.

    A point's distance left of the yellow line's middle is widths @ (lane, white, yellow).
    """
    parts: List[Edges] = []
    numbers: List[int] = []
    count = {Tape.WHITE: 0, Tape.YELLOW: 0}
    edge = 0
    for number, lines in enumerate(pictures):
        placed = _placed(homography, lines)
        if not placed:
            continue
        for line, side in placed:
            count[line.tape] += 1
            if line.tape is Tape.YELLOW:
                both = ((line.left, (0, 0, 0.5)), (line.right, (0, 0, -0.5)))
            else:
                inner, outer = (line.left, line.right) if side < 0 else (line.right, line.left)
                both = ((inner, (side, 0, side / 2)), (outer, (side, side, side / 2)))
            for pixels, widths in both:
                size = len(pixels)
                outward = 1.0 if pixels is line.right else -1.0
                parts.append(
                    Edges(
                        pixels,
                        np.full(size, len(numbers)),
                        np.tile(np.array(widths, dtype=np.float64), (size, 1)),
                        np.full(size, outward),
                        np.full(size, edge),
                    )
                )
                edge += 1
        numbers.append(number)
    empty = Edges(np.empty((0, 2)), np.empty(0, int), np.empty((0, 3)), np.empty(0), np.empty(0, int))
    together = Edges(
        *(np.concatenate([getattr(part, field.name) for part in (empty, *parts)]) for field in fields(Edges))
    )
    return together, numbers, (count[Tape.WHITE], count[Tape.YELLOW])


def _placed(homography: Array, lines: Sequence[Line]) -> List[Tuple[Line, float]]:
    """Lines of one picture that can belong to one road, each with its side of the yellow line: -1, 0 or 1."""
    if not lines:
        return []
    middles = [ground_from_pixel(homography, (line.left + line.right) / 2) for line in lines]
    yellow = next((index for index, line in enumerate(lines) if line.tape is Tape.YELLOW), None)
    whites = [index for index, line in enumerate(lines) if line.tape is Tape.WHITE]
    reference = yellow if yellow is not None else whites[0]
    curve = _curve(middles[reference])
    aside = [float(np.median(_beside(middle, curve))) for middle in middles]
    if yellow is not None:
        placed = [(lines[yellow], 0.0)]
        for side in (-1.0, 1.0):
            found = [index for index in whites if LANE_LIMITS[0] < side * aside[index] < LANE_LIMITS[1]]
            if found:
                nearest = min(found, key=lambda index: abs(side * aside[index] - LANE_WIDTH - 0.036))
                placed.append((lines[nearest], side))
        return placed
    for index in whites[1:]:  # the yellow line is not seen between two white ones
        if 2 * LANE_LIMITS[0] < abs(aside[index]) < 2 * LANE_LIMITS[1]:
            side = math.copysign(1.0, aside[index])
            return [(lines[whites[0]], -side), (lines[index], side)]
    near = middles[whites[0]][np.argmin(middles[whites[0]][:, 0])]
    return [(lines[whites[0]], math.copysign(1.0, near[1]))]


def _curve(points: Array) -> Array:
    """Coefficients of y = a + b x + c x² / 2 through road points."""
    x = points[:, 0]
    curve: Array = np.linalg.lstsq(np.stack([np.ones_like(x), x, x**2 / 2], axis=1), points[:, 1], rcond=None)[0]
    return curve


def _beside(points: Array, curve: Array) -> Array:
    """[m] left of a curve, across it."""
    x, y = points[:, 0], points[:, 1]
    slope = curve[1] + curve[2] * x
    beside: Array = (y - curve[0] - curve[1] * x - curve[2] * x**2 / 2) / np.hypot(1, slope)
    return beside


def _first_guess(homography: Array, edges: Edges, count: int) -> Array:
    """Heading, offset, curvature of each picture's yellow line, by a straight line through every edge."""
    ground = ground_from_pixel(homography, edges.pixels)
    aside = edges.widths @ [mean for mean, _ in KNOWN]
    guesses = []
    for number in range(count):
        mine = edges.picture == number
        x, y = ground[mine, 0], ground[mine, 1] - aside[mine]
        slope, start = np.polyfit(x, y, 1)
        guesses.append((-math.atan(slope), start * math.cos(math.atan(slope)), 0.0))
    return np.ravel(guesses)


def _pixels_apart(homography: Array, edges: Edges, widths: Array, lanes: Array) -> Array:
    """[px] along the row by which each edge point lies right of where the model has its edge."""
    lane = lanes[edges.picture].T
    nudge = np.array([0.5, 0.0])
    aside, right, left = (
        lane_coordinate(ground_or_far(homography, pixels), *lane)
        for pixels in (edges.pixels, edges.pixels + nudge, edges.pixels - nudge)
    )
    wanted = edges.widths @ widths
    apart: Array = np.clip((aside - wanted) / np.minimum(right - left, -1e-5), -100, 100)
    return apart


def _noise(apart: Array) -> float:
    """[px] standard deviation by the median of the sizes, which outliers hardly move."""
    return max(1.4826 * float(np.median(np.abs(apart))), LEAST_NOISE)


def _points_for_one(apart: Array, edge: Array) -> float:
    """How many points of an edge say as much as one independent one, by their correlation along it (Bartlett 1946)."""
    same = edge[1:] == edge[:-1]
    power = float((apart**2).mean())
    if not same.any() or power <= 0:
        return 1.0
    correlation = float((apart[1:] * apart[:-1])[same].mean()) / power
    correlation = min(max(correlation, 0.0), 0.95)
    return (1 + correlation) / (1 - correlation)
